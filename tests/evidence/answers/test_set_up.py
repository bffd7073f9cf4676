"""Faults of a set-up are told before physics: too few rows, repeats that differ."""

import json

import numpy as np
import pytest

from taichi_erosion.cli.main import main
from taichi_erosion.evidence.answers.commands import open_study
from tests.evidence.asking import ask
from tests.evidence.small_study import study_text


def small_table(folder, rows: str):
    """A study of thresholds alone with the rows of a table."""
    head = "observable,value,sd,n,unit,group,moisture,diameter [mm],source\n"
    (folder / "heap.csv").write_text(head + rows, encoding="utf-8")
    text = study_text().replace("[observables.repose_angle]\n", "")
    for number in ("sliding", "rolling"):
        start = text.index(f"[parameters.friction_{number}]")
        end = text.index("[", start + 1)
        text = text[:start] + text[end:]
    (folder / "heap.toml").write_text(text.replace("fraction = 0.3", "fraction = 0"), encoding="utf-8")
    return folder / "heap.toml"


def measured_rows(count: int) -> str:
    """Thresholds that grow with moisture."""
    values = enumerate(0.2 + 0.03 * k for k in range(count))
    return "".join(f"threshold_u_star,{v:.3g},0.004,5,m/s,g{k},{0.002 * k},0.25,x\n" for k, v in values)


@pytest.mark.parametrize(("count", "enough"), [(3, False), (4, True)])
def test_rows_are_enough_where_one_is_left_to_contradict_an_effect(tmp_path, count, enough):
    with open_study(small_table(tmp_path, measured_rows(count))) as found:
        assert ("too_few_rows" in [fault.kind for fault in found.faults]) is not enough


@pytest.mark.parametrize("factor", [1.0, 3.0, 12.0])
def test_repeats_that_differ_more_than_stated_are_told(tmp_path, factor):
    random = np.random.default_rng(3)
    rows = "".join(
        f"threshold_u_star,{0.3 + 0.004 * factor * random.normal():.5f},0.004,1,m/s,g{m}{k},"
        f"{0.002 * m},0.25,x\n"
        for m in range(6)
        for k in range(4)
    )
    with open_study(small_table(tmp_path, rows)) as found:
        told = [fault for fault in found.faults if fault.kind == "scatter"]
    assert len(told) == (factor > 1.0)
    assert not any(fault.blocks for fault in told)


def test_a_mistyped_repeat_is_told_first_with_its_row_in_the_users_table(tmp_path, capsys):
    """Angles of a laboratory that measured every heap twice; one cell says 60 for 30."""
    random = np.random.default_rng(2)
    places = [(d, w) for d in (0.2, 0.4, 0.8) for w in (0.0, 0.5, 1.0, 2.0) for _ in range(2)]
    rows = [f"{d};{w};{28.0 + 3.0 * w + 2.0 * d + 0.4 * random.standard_normal():.1f}" for d, w in places]
    rows[12] = f"{rows[12].rpartition(';')[0]};60.0"
    text = "\n".join(["diameter [mm];moisture [%];repose angle [deg]", *rows]) + "\n"
    (tmp_path / "lab.csv").write_text(text, encoding="utf-8")
    made = ["study", "new", str(tmp_path / "lab.csv"), "--closed-form", "--yes", "--out", str(tmp_path / "s")]
    study = tmp_path / "s" / "lab.toml"
    told = []
    for words in (made, ["study", "check", str(study)]):
        assert main([*words, "--json"]) == 0
        told.append(json.loads(capsys.readouterr().out)["notes"][0])
    compared = ask("compare", study)
    assert "rows 14 and 15 differ by" in told[0]
    assert told[0].endswith("check row 14")
    assert {f"warning: {each}" for each in told} == {compared.about["set_up"][0]}
    assert not [error for error in compared.record.errors if error.kind == "scatter"]
