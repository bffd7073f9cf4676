"""The page of the published series holds the table of results, whatever it says."""

import shutil

from doe.t4.page import HERE, answer_cells, error_cells, publish, said

ROW = {
    "series": "flux",
    "held_out": "a beach",
    "rows_fitted": "12",
    "rows_held_out": "5",
    "verdict": "group",
    "named": "gusts",
    "group": "lift+wall",
    "p_misfit": "0.001",
    "p_misfit_after": "0.4",
    "none": "0.01",
    "outside_library": "0.2",
    "effect": "lift",
    "adopted_as": "likeliest",
    "strength": "1 (0.5 to 2)",
    "chi2_before": "3",
    "chi2_after": "4",
    "chi2_wrong": "5",
    "p_held_out_after": "0.01",
    "error_before": "10",
    "error_after": "12",
    "closed_forms": "Kok: 30",
}


def test_the_page_is_made_from_the_table(tmp_path):
    for name in ("results.csv", "README.md"):
        shutil.copy(HERE / name, tmp_path / name)
    publish(tmp_path)
    assert (tmp_path / "README.md").read_text("utf-8") == (HERE / "README.md").read_text("utf-8")


def test_an_effect_that_was_not_named_is_marked_as_such():
    assert said(ROW) == "group: gusts; one of lift, wall"
    assert answer_cells(ROW)[2:] == ("12, 5", said(ROW), "0.001", "0.4", "0.01, 0.2")
    assert error_cells(ROW)[2] == "lift (likeliest)"
    assert error_cells(ROW | {"adopted_as": "named"})[2] == "lift"


def test_nothing_is_said_without_names():
    assert said(ROW | {"verdict": "none_detected", "named": "", "group": ""}) == "nothing"
