"""The book, its site, tables and workflows: what is shown is printed, what is named exists."""

import ast
import json
import re
import runpy
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
import typer
from device_code import device_functions

from doe.beyond import laboratory
from doe.common.cases import read_rows
from doe.common.pages import RESULTS, filled
from doe.effects import page as effects
from doe.lab_c import page as lab_c
from doe.repose_sensitivity import page as repose_sensitivity
from taichi_erosion.cli.main import app
from taichi_erosion.execution.observables import OBSERVABLES
from taichi_erosion.scene.load import parse_scene, read_toml

ROOT = Path(__file__).resolve().parents[2]
DOE, DOCS = ROOT / "doe", ROOT / "docs"
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
MOST_PAGES, MOST_LINES_OF_README = 15, 80
MOST_BYTES = {".webp": 1_500_000, ".png": 420_000, ".svg": 420_000}  # of a film, of a picture
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


SCENE_FILES = (DOCS / "scene_files.md").read_text(encoding="utf-8")
PARTS = re.findall(r"<!-- part -->\n```toml\n(.*?)```", SCENE_FILES, re.DOTALL)
assert len(PARTS) >= 6, "the page has lost its parts"
FACET = "facet normal 0 0 1\nouter loop\nvertex -30 -30 -10\nvertex 30 -30 -5\nvertex 30 30 -5\n"
RAMP = f"solid ramp\n{FACET}endloop\nendfacet\nendsolid ramp\n"  # in millimetres, below the plate


@pytest.mark.parametrize("part", PARTS, ids=lambda part: part.splitlines()[0])
def test_a_part_of_a_scene_is_valid_in_the_scene_of_the_page(tmp_path, part):
    (tmp_path / "ramp.stl").write_text(RAMP, encoding="utf-8")
    table = read_toml(ROOT / "scenes" / "column_collapse.toml")
    for section, entries in tomllib.loads(part).items():
        table[section] = table.get(section, {}) | entries
    assert parse_scene(table, folder=tmp_path, observables=tuple(OBSERVABLES)).grains.count > 0


def test_the_page_of_results_and_the_readme_of_a_study_show_the_tables_that_its_numbers_make():
    lab_rows, rows = (read_rows(DOE / study / "results.csv") for study in ("lab_c", "repose_sensitivity"))
    measured = lab_c.read_laboratory(DOE / "lab_c" / "laboratory.csv")
    tables = {"lab_c": lab_c.tables(lab_rows, measured), "effects": effects.tables(DOE)}
    tables["repose_sensitivity"] = repose_sensitivity.tables(rows)
    for study, made in tables.items():
        for path, text in filled((DOCS / RESULTS, DOE / study / "README.md"), made).items():
            assert path.read_text(encoding="utf-8") == text


def test_pictures_are_small_and_used():
    pages = [ROOT / "README.md", *DOCS.glob("*.md"), *DOE.glob("*/README.md")]
    text = "".join(page.read_text(encoding="utf-8") for page in pages)
    for picture in (DOCS / "pictures").iterdir():
        assert picture.stat().st_size < MOST_BYTES[picture.suffix], picture
        assert f"pictures/{picture.name}" in text, picture


def test_the_committed_table_is_the_one_of_its_laboratory():
    assert (DOE / "beyond" / "rolling_wet.csv").read_text(encoding="utf-8") == laboratory.table()
