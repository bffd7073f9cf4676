"""Page and recording of a study from its stored answers, at every stage of the loop."""

import re
import shutil
from pathlib import Path

import pytest

from taichi_erosion.core.errors import BadInput
from taichi_erosion.evidence.answers.commands import adopt_study, compare_study, discover_study, next_study
from taichi_erosion.evidence.answers.predictions import predict_study
from taichi_erosion.recording.readback import read_chunks
from taichi_erosion.report import write_recording, write_report
from tests.evidence.asking import no_progress as silent
from tests.evidence.small_study import write_study
from tests.report.browser import assert_readable


@pytest.fixture(scope="module")
def stages(tmp_path_factory) -> dict[str, Path]:
    """Pages of one study after compare, discover, adopt and next."""
    study = write_study(tmp_path_factory.mktemp("stages"), {"liquid_bridge": 1.0})
    pages = {}
    commands = {"compare": compare_study, "discover": discover_study, "next": next_study}
    commands["adopt"] = lambda path, progress: adopt_study(path, ["liquid_bridge"], progress)
    for name, command in commands.items():
        command(study, silent)
        pages[name] = write_report(study, study.with_name(f"after_{name}.html"))
    return pages


@pytest.fixture
def study(stages, tmp_path) -> Path:
    """A copy of the study with all its answers."""
    return shutil.copytree(stages["adopt"].parent, tmp_path / "study") / "heap.toml"


def first_screen(page: Path) -> str:
    return page.read_text("utf-8").partition("<h2")[0]


def test_a_browser_shows_every_stage_of_a_study_on_a_desk_and_on_a_phone(stages, tmp_path):
    assert_readable(stages, tmp_path)


def test_the_first_screen_says_what_was_found(stages):
    assert "The calibrated model fails" in first_screen(stages["compare"])
    missing = "Missing: capillary bridges between moist grains (liquid_bridge)"
    assert all(missing in first_screen(stages[name]) for name in ("discover", "next"))
    assert "The error falls with liquid_bridge" in first_screen(stages["adopt"])
    assert missing in stages["adopt"].read_text("utf-8")
    for page in stages.values():
        assert str(page.parent) not in page.read_text("utf-8")


def test_an_answer_to_an_older_table_is_left_out_and_told(study):
    table = study.with_name("heap.csv")
    table.write_text(table.read_text("utf-8").replace("33.", "34."), "utf-8")
    with pytest.raises(BadInput, match="no answer to its present table"):
        write_report(study)
    discover_study(study, silent)
    page = write_report(study)
    told = "Left out, for they rest on another version of the table: answers of "
    assert told + "<code>compare</code>, <code>adopt</code> and <code>next</code>." in first_screen(page)
    assert "The error falls" not in page.read_text("utf-8")


def test_the_last_predictions_of_the_adopted_model_stand_on_the_page(study):
    assert "<h2>Predictions</h2>" not in write_report(study).read_text("utf-8")
    conditions = study.with_name("wanted.csv")
    conditions.write_text("moisture,diameter [mm]\n0.007,0.3\n", "utf-8")
    told = predict_study(study, conditions, silent).answer()
    page = write_report(study).read_text("utf-8").partition("<h2>Predictions</h2>")[2]
    assert "Predicted by the adopted model, with liquid_bridge" in page
    assert all(cell in page for row in told.table.rows for cell in row)


def test_a_page_of_somebody_else_is_not_replaced(study):
    page = study.with_name("mine.html")
    page.write_text("mine", "utf-8")
    with pytest.raises(BadInput, match="this program did not write it"):
        write_report(study, page)
    assert write_report(study, page, force=True) == write_report(study, page)


def test_a_recording_holds_the_lines_the_tables_and_the_figures(study):
    chunks = read_chunks(write_recording(study))
    entities = {str(chunk.entity_path) for chunk in chunks}
    figures = {each.removeprefix("/figures/") for each in entities if each.startswith("/figures/")}
    drawn = {"rows", "posterior", "strengths", "ladder", "numbers"}
    assert {re.sub(r"\d+$", "", name) for name in figures} == drawn
    assert {"/summary", "/table"} <= entities


def test_limits_are_drawn_and_told_as_limits(study):
    table = study.with_name("heap.csv")
    heading, *rows = table.read_text("utf-8").splitlines()
    cells = [row.split(",") for row in rows]
    lowest = min((row for row in cells if row[0] == "repose_angle"), key=lambda row: float(row[1]))
    alike = [row for row in cells if (row[0], row[4]) == ("repose_angle", lowest[4])]
    for row, value in zip(alike, ("<60", "10..50", ">5"), strict=True):
        row[1] = value
    table.write_text("\n".join([heading, *map(",".join, cells)]) + "\n", "utf-8")
    study.write_text(study.read_text("utf-8").replace("fraction = 0.3", "fraction = 0.0"), "utf-8")
    compare_study(study, silent)
    page = write_report(study).read_text("utf-8")
    for words in ("below 60 deg", "between 10 deg and 50 deg", "above 5 deg"):
        assert f"measured {words}" in page
    assert "Arrow: a limit" in page
