"""The book, its site, the glossary and the workflows: what is shown is printed, what is named exists."""

import ast
import json
import re
import runpy
import subprocess
import sys
from pathlib import Path

import pytest
import typer
from device_code import device_functions

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
MOST_PAGES, MOST_LINES_OF_README, MOST_TERMS = 15, 90, 60
GITHUB = ROOT / ".github"
SCHEMAS = {path: "vendor.github-workflows" for path in (GITHUB / "workflows").glob("*.yml")} | {
    path: "vendor.github-issue-config" if path.stem == "config" else "vendor.github-issue-forms"
    for path in (GITHUB / "ISSUE_TEMPLATE").glob("*.yml")
}
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


def test_every_index_letter_that_device_functions_take_or_count_with_is_explained():
    names = set()
    for function in device_functions().values():
        names |= {argument.arg for argument in function.args.args}
        loops = (node.target for node in ast.walk(function) if isinstance(node, ast.For))
        names |= {part.id for target in loops for part in ast.walk(target) if isinstance(part, ast.Name)}
    text = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    paragraph = text.partition("Index letters of device code")[2].partition("\n\n")[0]
    assert {name for name in names - {"_"} if len(name) == 1} <= set(re.findall(r"`(\w)`", paragraph))


def test_the_glossary_keeps_the_terms_that_a_reader_may_not_know():
    rows = re.findall(r"^\| (?!word|term)", (ROOT / "GLOSSARY.md").read_text(encoding="utf-8"), re.MULTILINE)
    assert 0 < len(rows) <= MOST_TERMS


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


@pytest.mark.parametrize(("path", "schema"), SCHEMAS.items(), ids=lambda part: getattr(part, "name", part))
def test_a_file_has_the_form_of_its_schema(path, schema):
    command = [sys.executable, "-m", "check_jsonschema", "--builtin-schema", schema, str(path)]
    ended = subprocess.run(command, capture_output=True, text=True, check=False)
    assert ended.returncode == 0, ended.stdout


def test_every_workflow_runs_the_gates_of_the_readme():
    workflows = list((GITHUB / "workflows").glob("*.yml"))
    assert {path.stem for path in workflows} == {"release", "tests"}
    assert all("run: bash .ci/run" in path.read_text(encoding="utf-8") for path in workflows)
