"""The page of a study at every stage of the loop: what its first screen says, and that a browser shows all of it."""

import shutil
from pathlib import Path

import pytest

from taichi_erosion.cli.main import main
from taichi_erosion.report import write_report
from tests.evidence.small_study import write_study
from tests.report.browser import assert_readable


@pytest.fixture(scope="module")
def stages(tmp_path_factory) -> dict[str, Path]:
    """Pages of one study after compare, discover, adopt, and after adopt alone."""
    study = write_study(tmp_path_factory.mktemp("stages"), {"liquid_bridge": 1.0})
    pages = {}
    for words in (["compare"], ["discover"], ["adopt", "liquid_bridge"]):
        assert main([words[0], str(study), *words[1:]]) == 0
        pages[words[0]] = write_report(study, study.with_name(f"after_{words[0]}.html"))
    alone = shutil.copytree(study.parent, tmp_path_factory.mktemp("alone") / "study")
    for command in ("compare", "discover"):
        (alone / "heap-results" / f"heap.{command}.json").unlink()
    return pages | {"alone": write_report(alone / "heap.toml", alone / "alone.html")}


def first_screen(page: Path) -> str:
    return page.read_text("utf-8").partition("<h2")[0]


def test_a_browser_shows_every_stage_of_a_study_on_a_desk_and_on_a_phone(stages, tmp_path):
    assert_readable(stages, tmp_path)


def test_the_first_screen_says_where_the_model_fails(stages):
    for page in stages.values():
        assert "than the model says" in first_screen(page)
