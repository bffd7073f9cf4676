"""The page of a study at every stage of the loop: its first screen, and that a browser shows all of it."""

import json
import re
import shutil
from pathlib import Path

import pytest

from taichi_erosion.cli.main import main
from taichi_erosion.report import write_report
from taichi_erosion.report.results import layers, stored_results
from taichi_erosion.report.study_figures import panels_of, points_of
from tests.evidence.small_study import write_study
from tests.report.browser import assert_readable


@pytest.fixture(scope="module")
def stages(tmp_path_factory) -> dict[str, Path]:
    """Pages of one study after compare, discover, adopt, and after adopt alone."""
    study = write_study(tmp_path_factory.mktemp("stages"), {"liquid_bridge": 1.0})
    pages = {}
    for words in (["compare"], ["discover", "--budget", "quick"], ["adopt", "liquid_bridge"]):
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


def test_after_an_adoption_the_first_screen_says_how_far_the_error_falls(stages):
    words = first_screen(stages["adopt"])
    seen = "10 measured means of 30 rows that no fit has seen"
    assert f"With liquid bridge the error on {seen} falls: " in words
    assert 'data-layer="held"' in words
    assert 'data-layer="held"' not in stages["discover"].read_text("utf-8"), "the vault is closed"


def test_every_measured_value_tells_its_row_its_source_and_its_models(stages):
    found = re.findall(r"<title>(measured .*?)</title>", stages["adopt"].read_text("utf-8"), re.DOTALL)
    assert found
    for text in found:
        assert re.search(r"^rows \d+, \d+ and \d+ of the table, repeats: 3$", text, re.MULTILINE), text
        assert "diameter 0." in text
        assert "model with liquid bridge: " in text
        assert text.endswith("made")


def test_a_strength_is_told_by_what_it_moves(stages):
    assert re.search(
        r"it raises the threshold friction velocity from .* m/s at", stages["adopt"].read_text("utf-8")
    )


def test_an_answer_to_an_older_table_is_left_out_and_told(stages, tmp_path):
    study = shutil.copytree(stages["adopt"].parent, tmp_path / "study") / "heap.toml"
    table = study.with_name("heap.csv")
    table.write_text(table.read_text("utf-8").replace("33.", "34."), "utf-8")
    assert main(["compare", str(study)]) == 0
    page = write_report(study).read_text("utf-8")
    assert "the answer of `adopt` rests on another version of the table" in page
    assert "With liquid bridge the error" not in page


def test_the_cost_of_an_answer_stays_that_of_the_first_time(stages, tmp_path):
    study = shutil.copytree(stages["adopt"].parent, tmp_path / "study") / "heap.toml"
    stored = study.parent / "heap-results" / "heap.compare.json"
    first = json.loads(stored.read_text("utf-8"))
    stored.write_text(json.dumps(first | {"runs": 10**9, "wall_s": 6789.0}), "utf-8")
    assert main(["compare", str(study)]) == 0
    again = json.loads(stored.read_text("utf-8"))
    assert (again["runs"], again["wall_s"]) == (10**9, 6789.0)


LABORATORY = """
[study]
measurements = "t.csv"
model = "taichi_erosion.evidence.models.reduced:predict"
[observables.threshold_u_star]
unit = "m/s"
transform = "log"
[conditions]
diameter = "diameter"
[parameters.threshold_coefficient]
start = 0.1
low = 0.05
high = 0.2
[candidates.dry_cohesion]
[candidates.gusts]
"""
DIAMETERS = (60, 75, 90, 125, 180, 250, 355, 500, 710, 900)  # um


def laboratory_study(folder: Path, values: list[str]) -> Path:
    """Study of thresholds in cm/s against diameters in um."""
    rows = [
        f"threshold_u_star,{value},{'' if value[0] == '<' else 0.6},3,cm/s,{size}"
        for value, size in zip(values, DIAMETERS, strict=False)
    ]
    text = "\n".join(["observable,value,sd,n,unit,diameter [um]", *rows])
    (folder / "t.csv").write_text(text + "\n", "utf-8")
    (folder / "t.toml").write_text(LABORATORY, "utf-8")
    return folder / "t.toml"


def cohesive(size: int) -> str:
    """Threshold that a bare model with the root of the diameter cannot follow [cm/s]."""
    return f"{23.0 * (size / 250.0) ** 0.5 * (1.0 + 80.0 / size):.3f}"


def test_page_and_terminal_tell_units_of_the_table(tmp_path, capsys):
    study = laboratory_study(tmp_path, [cohesive(size) for size in DIAMETERS])
    for command in ("compare", "discover", "next"):
        assert main([command, str(study)]) == 0
    page, told = write_report(study).read_text("utf-8"), capsys.readouterr().out
    assert "threshold_u_star [cm/s]" in told
    assert re.search(r"too low .* diameter = \d+ um", told)
    assert not re.search(r"diameter = (0\.0|\d+e-)", told + page), "SI numbers under a table in um"
    assert "threshold friction velocity [cm/s]" in page
    assert "<td>threshold_u_star [cm/s]</td>" in page
    measured = [float(text) for text in re.findall(r"measured ([\d.]+) cm/s", page)]
    assert measured
    assert min(measured) > 10.0


def test_a_limit_is_drawn_as_an_arrow_and_told_as_a_limit(tmp_path):
    values = [cohesive(size) for size in DIAMETERS]
    study = laboratory_study(tmp_path, ["<30", *values[1:]])
    assert main(["compare", str(study)]) == 0
    page = write_report(study).read_text("utf-8")
    assert "measured: below 30.0 cm/s" in page
    assert "measured 30.0 cm/s" not in page
    rows = json.loads((tmp_path / "t-results" / "t.compare.json").read_text("utf-8"))["rows"]
    assert rows["limit"].count("below") == 1


def test_an_interval_is_drawn_as_a_bar_with_ends_and_told_as_one(tmp_path):
    values = [cohesive(size) for size in DIAMETERS]
    study = laboratory_study(tmp_path, [*values[:4], "18..24", *values[5:]])
    study.write_text(LABORATORY + "[vault]\nfraction = 0.0\n", "utf-8")
    assert main(["compare", str(study)]) == 0
    rows = json.loads((tmp_path / "t-results" / "t.compare.json").read_text("utf-8"))["rows"]
    place = rows["limit"].index("between")
    ends = (rows["low"][place], rows["high"][place])
    assert ends == pytest.approx((0.18, 0.24)), "in the unit of the model"
    assert [end for k, end in enumerate(rows["low"]) if k != place] == [None] * 9
    found = stored_results(study)
    (panel,) = panels_of(["threshold_u_star"], layers(found), found.table, found.units)
    points = points_of(panel, layers(found)[0].fitted)
    (inside,) = points[points["limit"] == "between"].itertuples()
    assert (inside.low, inside.high) == pytest.approx((18.0, 24.0))
    page = write_report(study).read_text("utf-8")
    assert "measured: between 18.0 and 24.0 cm/s" in page
    assert "A bar with ends: the value lies between them." in page
    assert "An arrow" not in page


def test_a_single_row_tests_nothing_and_is_told_so(tmp_path, capsys):
    study = laboratory_study(tmp_path, ["11.5"])
    assert main(["compare", str(study)]) == 0
    told = capsys.readouterr().out
    assert "1 measured mean cannot test a model with 1 calibrated number" in told
    assert "consistent" not in told
    assert "1 measured mean cannot test" in first_screen(write_report(study))


def test_an_outlier_leads_the_page_and_is_marked_at_the_edge(tmp_path):
    values = [cohesive(size) for size in DIAMETERS]
    study = laboratory_study(tmp_path, [*values[:5], "950", *values[6:]])
    study.write_text(LABORATORY + "[vault]\nfraction = 0.0\n", "utf-8")
    assert main(["compare", str(study)]) == 0
    page = write_report(study)
    assert "diameter = 250 um" in first_screen(page)
    assert "Check that row in the table" in first_screen(page)
    assert_readable({"outlier": page}, tmp_path)


def test_rows_of_a_vault_that_was_opened_twice_are_not_called_unseen(stages, tmp_path):
    study = shutil.copytree(stages["adopt"].parent, tmp_path / "study") / "heap.toml"
    assert main(["adopt", str(study), "gusts"]) == 0
    words = first_screen(write_report(study))
    assert "no fit has seen" not in words
    assert "opened 2 times" in words
    assert "they do not confirm it" in words


def test_an_interval_that_holds_the_textbook_strength_excludes_nothing(stages):
    found = json.loads((stages["adopt"].parent / "heap-results" / "heap.discover.json").read_text("utf-8"))
    for name, effect in found["effects"].items():
        assert effect["status"] != "excluded" or effect["strength_high"] < 1.0, name
