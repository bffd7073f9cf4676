"""Pages of studies show the tables that their committed results make, and pictures of a modest size."""

from pathlib import Path

import pytest

from doe.common.cases import read_rows
from doe.common.pages import RESULTS, filled
from doe.effects import page as effects
from doe.lab_c import page as lab_c
from doe.repose_sensitivity import page as repose_sensitivity

pytestmark = pytest.mark.docs

ROOT = Path(__file__).parents[2]
DOE, DOCS = ROOT / "doe", ROOT / "docs"
MOST_BYTES = 420_000  # of a picture in the repository


def tables_of(study: str) -> dict[str, str]:
    folder = DOE / study
    if study == "effects":
        return effects.tables(DOE)
    rows = read_rows(folder / "results.csv")
    if study == "lab_c":
        return lab_c.tables(rows, lab_c.read_laboratory(folder / "laboratory.csv"))
    return repose_sensitivity.tables(rows)


@pytest.mark.parametrize("study", ["lab_c", "repose_sensitivity", "effects"])
def test_the_page_of_results_and_the_readme_of_a_study_show_the_tables_that_its_numbers_make(study):
    for path, text in filled((DOCS / RESULTS, DOE / study / "README.md"), tables_of(study)).items():
        assert path.read_text(encoding="utf-8") == text


def test_pictures_are_small_and_used():
    pages = [ROOT / "README.md", *DOCS.glob("*.md"), *DOE.glob("*/README.md")]
    text = "".join(page.read_text(encoding="utf-8") for page in pages)
    for picture in (DOCS / "pictures").iterdir():
        assert picture.stat().st_size < MOST_BYTES, picture
        assert f"pictures/{picture.name}" in text, picture


def test_the_committed_table_is_the_one_of_its_laboratory():
    from doe.beyond.laboratory import table

    assert (DOE / "beyond" / "rolling_wet.csv").read_text(encoding="utf-8") == table()
