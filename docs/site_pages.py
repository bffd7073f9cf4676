"""Hooks of mkdocs: pages from the root of the repository, links between pages, page of the Python interface.

The files in `docs/` link to each other and to the root as they lie in the repository, so that they read as
plain files. The site has one folder: links are rewritten while it is built. The Python page is made from
signatures and docstrings of the source.
"""

import ast
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
SESSION = (
    "Session open_session step run_for run_until_rest next_stage set_entry measure_now session_status save "
    "restore write_picture record_session"
)
# modules of the Python page, with the names that it shows; None: every public name with a docstring
INTERFACE = {"taichi_erosion/__init__.py": None, "taichi_erosion/run/session.py": SESSION.split()}
LINK = re.compile(r"\]\((?!https?://|#)([^)#]+)(#[^)]*)?\)")
NAMED_PAGE = re.compile(r"(?<!\[)`docs/(\w+\.md)`(?!\])")
OUTSIDE = re.compile(r"(?<!!)\[([^\]]+)\]\(OUTSIDE\)")


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pages of the root and the Python page."""
    for name, source in FROM_ROOT.items():
        text = (ROOT / source).read_text(encoding="utf-8")
        files.append(File.generated(config, name, content=text))
    files.append(File.generated(config, "python.md", content=python_page()))
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
    return "".join(parts)


def python_page() -> str:
    """Page of the Python interface."""
    lines = ["# Python interface", "", "Made from the docstrings of the source. Units are SI.", ""]
    for source, names in INTERFACE.items():
        tree = ast.parse((ROOT / source).read_text(encoding="utf-8"))
        entries = [entry(node) for node in tree.body if is_shown(node, names)]
        if entries:
            name = source.removesuffix(".py").removesuffix("/__init__").replace("/", ".")
            lines += [f"## {name}", "", *docstring_lines(tree), *(line for one in entries for line in one)]
    return "\n".join(lines) + "\n"


def is_shown(node: ast.stmt, names: list[str] | None) -> bool:
    """Whether a statement is a function or class of the page."""
    if not isinstance(node, ast.FunctionDef | ast.ClassDef) or node.name.startswith("_"):
        return False
    return bool(ast.get_docstring(node)) if names is None else node.name in names


def docstring_lines(node: Any) -> list[str]:
    """Docstring as markdown; indented parts stay code."""
    return [*(ast.get_docstring(node) or "").splitlines(), ""]


def entry(node: Any) -> list[str]:
    """Heading, signature and docstring of a function or class."""
    signature = f"class {node.name}"
    if isinstance(node, ast.FunctionDef):
        result = f" -> {ast.unparse(node.returns)}" if node.returns else ""
        signature = f"{node.name}({ast.unparse(node.args)}){result}"
    return [f"### {node.name}", "", "```python", signature, "```", "", *docstring_lines(node)]
