"""The pages as a site: links lead somewhere, every page is in the menu, the search knows the words."""

import json
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
pytestmark = pytest.mark.docs


def test_the_site_has_every_page_a_search_with_the_words_of_users_and_no_other_server(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "--site-dir", str(tmp_path)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    pages = {path.stem for path in (ROOT / "docs").glob("*.md")} | {"index", "GLOSSARY", "CHANGELOG"}
    assert pages <= {path.stem for path in tmp_path.glob("*.html")}
    found = json.loads((tmp_path / "search" / "search_index.json").read_text(encoding="utf-8"))
    texts = {entry["location"].partition("#")[0]: entry["text"] for entry in found["docs"]}
    assert any("vault" in text for text in texts.values())
    assert "your_table.html" in texts
    for page in tmp_path.glob("*.html"):
        text = page.read_text(encoding="utf-8")
        assert not re.findall(r"<(?:script|link|img)[^>]+(?:src|href)=[\"'](?:https?:)?//", text), page.name
