"""Hooks of mkdocs: pages from the root of the repository, and links between pages.

The files in `docs/` link to each other and to the root as they lie in the repository, so that they read as
plain files. The site has one folder: links are rewritten while it is built.
"""

import re
from pathlib import Path
from typing import Any

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files

ROOT = Path(__file__).resolve().parents[1]
FROM_ROOT = {
    "index.md": "README.md",
    **{name: name for name in ("GLOSSARY.md", "ARCHITECTURE.md", "CONTRIBUTING.md", "CHANGELOG.md")},
}
LINK = re.compile(r"\]\((?!https?://|#)([^)#]+)(#[^)]*)?\)")
NAMED_PAGE = re.compile(r"(?<!\[)`docs/(\w+\.md)`(?!\])")
DRAWN = "│┃─━"  # signs of tables in a terminal
OUTSIDE = re.compile(r"(?<!!)\[([^\]]+)\]\(OUTSIDE\)")


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pages of the root."""
    for name, source in FROM_ROOT.items():
        text = (ROOT / source).read_text(encoding="utf-8")
        files.append(File.generated(config, name, content=text))
    return files


def on_page_markdown(markdown: str, files: Files, **_: Any) -> str:
    """Markdown of a page with links as the site has them; what it does not hold is named, not linked."""
    known = {file.src_uri for file in files}

    def moved(found: re.Match[str]) -> str:
        target = found[1].removeprefix("../").removeprefix("docs/")
        target = "index.md" if target == "README.md" else target
        return f"]({target}{found[2] or ''})" if target in known else "](OUTSIDE)"

    def linked(found: re.Match[str]) -> str:
        return f"[`docs/{found[1]}`]({found[1]})" if found[1] in known else found[0]

    parts = re.split(r"(^```.*?^```)", markdown, flags=re.DOTALL | re.MULTILINE)
    for place in range(0, len(parts), 2):
        text = LINK.sub(moved, parts[place])
        parts[place] = NAMED_PAGE.sub(linked, OUTSIDE.sub(r"\1", text))
    for place in range(1, len(parts), 2):
        parts[place] = with_wrapped_sentences(parts[place])
    return "".join(parts)


def with_wrapped_sentences(block: str) -> str:
    """A block of printed text whose long lines wrap; one with a drawn table keeps its lines."""
    printed = block.startswith("```text\n") and not any(sign in block for sign in DRAWN)
    return block.replace("```text\n", "```{ .text .sentences }\n", 1) if printed else block
