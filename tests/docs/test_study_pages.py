"""Pages of studies show the tables that their committed results make, and pictures of a modest size."""

from pathlib import Path

import pytest

from doe.common.cases import read_rows
from doe.common.pages import filled
from doe.effects import page as effects
from doe.lab_c import page as lab_c
from doe.repose_sensitivity import page as repose_sensitivity

pytestmark = pytest.mark.docs

ROOT = Path(__file__).parents[2]
DOE, DOCS = ROOT / "doe", ROOT / "docs"
MOST_BYTES = 200_000  # of a picture in the repository
PICTURES = {lab_c.PAGE: [lab_c.PICTURE], repose_sensitivity.PAGE: [repose_sensitivity.PICTURE]}


def lab_c_tables() -> dict[str, str]:
    folder = DOE / "lab_c"
    return lab_c.tables(read_rows(folder / "results.csv"), lab_c.read_laboratory(folder / "laboratory.csv"))


def repose_tables() -> dict[str, str]:
    return repose_sensitivity.tables(read_rows(DOE / "repose_sensitivity" / "results.csv"))


@pytest.mark.parametrize(
    ("page", "study", "made"),
    [
        (lab_c.PAGE, "lab_c", lab_c_tables),
        (repose_sensitivity.PAGE, "repose_sensitivity", repose_tables),
        (effects.PAGE, "effects", lambda: effects.tables(DOE)),
    ],
)
def test_a_page_and_the_readme_of_its_study_show_the_tables_that_its_numbers_make(page, study, made):
    for path, text in filled((DOCS / page, DOE / study / "README.md"), made()).items():
        assert path.read_text(encoding="utf-8") == text


@pytest.mark.parametrize(("page", "picture"), [(page, one) for page in PICTURES for one in PICTURES[page]])
def test_a_picture_is_there_and_small(page, picture):
    assert 0 < (DOCS / picture).stat().st_size < MOST_BYTES
    assert picture in (DOCS / page).read_text(encoding="utf-8")
