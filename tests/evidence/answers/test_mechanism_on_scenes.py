"""A mechanism beyond the list in the simulator itself: found, written as a file and adopted; one null.

Another process makes the tables: its grains stick when wet, and the study lists nothing that does. The truth
is drawn and its digest written before anything is measured; it is opened at the end only. Marked slow: some
hundred runs of half a second each.
"""

import json
import subprocess
import sys
from contextlib import redirect_stdout
from hashlib import sha256
from io import StringIO
from pathlib import Path

import pytest

from taichi_erosion.cli.main import main

ROOT = Path(__file__).parents[3]
SEED = 3
pytestmark = pytest.mark.slow


def ask(*words: str) -> dict:
    told = StringIO()
    with redirect_stdout(told):
        assert main([*words, "--json"]) == 0
    return json.loads(told.getvalue())


@pytest.fixture(scope="module")
def laboratory(tmp_path_factory) -> Path:
    """Folder of two studies whose tables another process has made."""
    folder = tmp_path_factory.mktemp("laboratory")
    words = [sys.executable, "-m", "tests.evidence.wet_laboratory", str(folder), str(SEED)]
    subprocess.run(words, cwd=ROOT, check=True, timeout=1200.0)
    return folder


def strengths_in(folder: Path) -> dict[str, float]:
    sealed = (folder / "sealed" / "truth.json").read_text("utf-8")
    assert sha256(sealed.encode()).hexdigest() == (folder / "truth.sha256").read_text("utf-8")
    return json.loads(sealed)["strengths"]


def test_a_pull_that_no_list_holds_is_found_and_adopted(laboratory, monkeypatch):
    monkeypatch.chdir(laboratory)
    found = ask("discover", "wet.toml", "--budget", "quick")
    assert found["verdict"] == "outside_library"
    beyond = found["beyond"]
    assert beyond["group"][0] == "contact_pull"
    doses = {dose["conditions"]["moisture"]: dose["dose"] for dose in beyond["doses"]}
    assert doses[max(doses)] > doses[min(doses)]
    assert main(["effects", "new", "sticky", "--from-discovery", "wet.toml"]) == 0
    vault = ask("adopt", "wet.toml", "sticky", "--effect", "sticky.py")["vault"]
    assert vault["chi2_after"] < 0.5 * vault["chi2_before"]
    assert strengths_in(laboratory)["wet"] > 1.0


def test_in_a_null_no_mechanism_is_asked_for(laboratory, monkeypatch):
    monkeypatch.chdir(laboratory)
    found = ask("discover", "plain.toml", "--budget", "quick")
    assert found["verdict"] in ("none_detected", "not_testable")
    assert found["beyond"] is None
    assert strengths_in(laboratory)["plain"] == 0.0
