"""The book: commands run and print what is shown, links and files exist, pages lead to one another."""

import ast
import re
import runpy
from pathlib import Path

import pytest
import typer

from taichi_erosion.cli.main import app

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"
BOOK = sorted(DOCS.glob("*.md"))
TOP = [path for path in sorted(ROOT.glob("*.md")) if path.name != "CHANGELOG.md"]
PAGES = [*TOP, ROOT / "recordings" / "README.md", *BOOK]
INLINE = re.compile(r"`\./erosion ([^`]+)`")
FILE_PATH = re.compile(
    r"`((?:[\w.-]+/)+[\w.*-]+\.(?:py|md|toml|csv|txt|png|rrd|json|npz|html|yml))(?:::?\w+)?`"
)
CREATED = re.compile(r"^(?:recordings|campaigns|my_scenes)/(?!README|sample)|results?/|^out/|peers/cases/")
NUMBER = re.compile(r"\d+\.?\d*(?:e-?\d+)?")
ROUNDING = 0.01  # by which a printed number may differ where a processor rounds otherwise
WALKED = DOCS / "write_an_effect.md"  # test_own_effect_walk.py runs it
MOST_PAGES, MOST_LINES_OF_README = 15, 90
pytestmark = pytest.mark.docs


def name_of(page: Path) -> str:
    """Where a page lies; there is more than one README."""
    return str(page.relative_to(ROOT))


@pytest.mark.parametrize("page", [page for page in PAGES if page != WALKED], ids=name_of)
def test_the_commands_of_a_page_run_and_print_what_it_shows(page: Path) -> None:
    tutorial = runpy.run_path(str(DOCS / "tutorial.py"))
    text = page.read_text("utf-8")
    marked = [step for step in tutorial["STEP"].finditer(text) if step["mark"] is not None]
    assert text.count("<!-- output:") == len(marked)
    made = tutorial["fill"](text)
    assert NUMBER.sub("#", made) == NUMBER.sub("#", text), "python docs/make.py writes it anew"
    shown, printed = ([float(number) for number in NUMBER.findall(each)] for each in (text, made))
    assert printed == pytest.approx(shown, rel=ROUNDING)


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_what_a_page_names_exists(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    command = typer.main.get_command(app)
    known = {"test", *command.commands, *(name for each in command.params for name in each.opts)}  # pyright: ignore[reportAttributeAccessIssue]
    assert {words.split()[0] for words in INLINE.findall(text)} <= known
    links = re.findall(r"\]\(([^)#]+)\)", text)
    assert [link for link in links if "://" not in link and not (page.parent / link).exists()] == []
    bases = (ROOT, ROOT / "taichi_erosion", ROOT / "doe", page.parent)
    named = {found for found in FILE_PATH.findall(text) if not CREATED.search(found)}
    assert [path for path in sorted(named) if not any(any(base.glob(path)) for base in bases)] == []


@pytest.mark.parametrize("page", BOOK, ids=name_of)
def test_python_on_a_page_is_valid_and_imports_what_is_there(page: Path) -> None:
    for block in re.findall(r"```python\n(.*?)```", page.read_text("utf-8"), re.DOTALL):
        for node in ast.parse(block).body:
            if isinstance(node, ast.ImportFrom) and str(node.module).startswith("taichi_erosion"):
                exec(compile(ast.Module([node], []), page.name, "exec"), {})


def test_the_book_is_short_and_each_page_leads_to_the_next() -> None:
    assert len(BOOK) <= MOST_PAGES
    assert len((ROOT / "README.md").read_text("utf-8").splitlines()) <= MOST_LINES_OF_README
    menu = re.findall(r"(\w+)\.md$", (ROOT / "mkdocs.yml").read_text("utf-8"), re.MULTILINE)
    order = [name for name in menu if (DOCS / f"{name}.md").exists()]
    assert sorted(order) == [page.stem for page in BOOK]
    for name, following in zip(order, [*order[1:], "../README"], strict=True):
        text = (DOCS / f"{name}.md").read_text("utf-8")
        assert "](../GLOSSARY.md)" in text, name
        assert f"]({following}.md)" in text.rstrip().splitlines()[-1], name
