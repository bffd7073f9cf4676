"""Faults of a set-up are told before physics: units, levels, bounds, heaps that are too small."""

import json
import re
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from taichi_erosion.cli.main import main
from taichi_erosion.evidence.answers import set_up
from taichi_erosion.evidence.answers.commands import open_study
from taichi_erosion.evidence.data.findings import Estimate, SetUpFault
from taichi_erosion.evidence.data.problem import Parameter
from tests.evidence.small_study import study_text, table_text

COUNT = 8
MODEL = np.linspace(0.2, 0.4, COUNT)


def rows(measured: np.ndarray, sd: float = 0.01, predicted: np.ndarray = MODEL) -> Any:
    """As much of a table of one observable as faults are looked for in."""
    return SimpleNamespace(
        observable=("u",) * COUNT,
        conditions={"x": np.arange(COUNT, dtype=float)},
        measured=measured,
        measured_sd=np.full(COUNT, sd),
        predicted=predicted,
        predicted_sd=np.zeros(COUNT),
        residual=(measured - predicted) / sd,
    )


def study(start: np.ndarray = MODEL, unit: str = "m/s", faults=()) -> Any:
    """As much of a study as faults are looked for in."""
    problem = SimpleNamespace(
        parameters=(Parameter("a", 1.0, 0.1, 10.0, 0.2),),
        candidates=(),
        adopted=(),
        model=lambda name, conditions, parameters, effects, seeds: np.tile(start, (seeds.size, 1)),
        measurements=SimpleNamespace(observable=("u",), unit=(unit,)),
    )
    file = SimpleNamespace(adopted={}, study=SimpleNamespace(seed=1))
    return SimpleNamespace(problem=problem, file=file, faults=tuple(faults))


def kinds(found) -> list[tuple[str, bool]]:
    return [(fault.kind, fault.blocks) for fault in found]


def faults(table: Any, parameters=None, warnings=(), **known):
    return set_up.set_up_faults(study(**known), table, parameters or {}, warnings)


def test_a_model_that_agrees_has_no_fault():
    assert faults(rows(MODEL + 0.005)) == ()


@pytest.mark.parametrize(("factor", "unit"), [(10.0, "m/s"), (1e-3, "m/s"), (57.3, "deg"), (1 / 57.3, "deg")])
def test_a_factor_that_a_unit_would_explain_is_told_and_blocks(factor, unit):
    found = faults(rows(factor * MODEL), unit=unit)
    assert kinds(found) == [("unit", True)]
    assert f"[{unit}]" in found[0].sentence
    assert set_up.sentences(found)[-1] == set_up.WAITS


def test_degrees_are_not_suspected_of_a_speed():
    assert "unit" not in [fault.kind for fault in faults(rows(57.3 * MODEL), unit="m/s")]


def test_a_factor_that_varies_along_the_rows_is_no_unit():
    assert "unit" not in [fault.kind for fault in faults(rows(10.0 * MODEL * np.geomspace(0.1, 10.0, COUNT)))]


def test_a_unit_that_calibration_has_swallowed_is_told_where_a_number_is_strained_for_it():
    table = rows(10.0 * MODEL, predicted=10.0 * MODEL)
    assert faults(table, {"a": Estimate(1.2, 1.0, 1.4, False)}) == ()
    assert kinds(faults(table, {"a": Estimate(9.9, 9.0, 10.0, False)})) == [("unit", True)]
    at_bound = faults(table, {"a": Estimate(1.2, 1.0, 1.4, True)})
    assert kinds(at_bound) == [("unit", True), ("at_bound", False)]


def test_a_level_that_is_off_everywhere_is_told_and_blocks_nothing():
    found = faults(rows(1.5 * MODEL))
    assert kinds(found) == [("offset", False)]
    assert "all 8 rows lie above the calibrated model by more than 5 sd" in found[0].sentence
    below = faults(rows(0.5 * MODEL))
    assert "below" in below[0].sentence
    mixed = 1.5 * MODEL
    mixed[0] = MODEL[0]
    assert faults(rows(mixed)) == ()


def test_conditions_without_a_value_of_the_model_are_told():
    words = "the model gives no value at 2 of 10 conditions; they are left out"
    found = faults(rows(MODEL), warnings=("another note", words))
    assert [fault.sentence for fault in found] == [words]


def test_what_blocks_is_told_first():
    small = SetUpFault("too_small", "u", "the heap is too small", True)
    bound = SetUpFault("at_bound", "a", "at its bound", False)
    assert set_up.sentences((bound, small)) == ["the heap is too small", "at its bound", set_up.WAITS]
    assert set_up.sentences((bound,)) == ["at its bound"]
    assert set_up.sentences(()) == []
    assert set_up.blocked((replace(small, blocks=False),)) is False


def in_wrong_unit(folder, transform: str) -> str:
    """A study of thresholds alone, ten times too large in the table."""
    lines = table_text({"liquid_bridge": 0.2}, 1).splitlines()
    wrong = [
        line.replace(line.split(",")[1], f"{10.0 * float(line.split(',')[1]):.6g}", 1)
        for line in lines
        if line.startswith("threshold_u_star")
    ]
    (folder / "heap.csv").write_text("\n".join([lines[0], *wrong]) + "\n", encoding="utf-8")
    text = study_text().replace("[observables.repose_angle]\n", "").replace('"log"', f'"{transform}"')
    (folder / "heap.toml").write_text(text, encoding="utf-8")
    return str(folder / "heap.toml")


def test_a_wrong_unit_is_told_first_and_the_answer_leaves_its_level_free(tmp_path, capsys):
    study = in_wrong_unit(tmp_path, "log")
    assert main(["discover", study, "--budget", "quick", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert (
        "a factor of 10 (a power of ten) in a unit would explain most of it: check [m/s]"
        in found["set_up"][0]
    )
    assert found["set_up"][0].endswith("What follows leaves this level free")
    assert set_up.WAITS not in found["set_up"]


def test_a_wrong_unit_blocks_where_the_answer_cannot_leave_its_factor_free(tmp_path, capsys):
    study = in_wrong_unit(tmp_path, "identity")
    assert main(["discover", study, "--budget", "quick", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert "a factor of 10 (a power of ten) in a unit would explain them" in found["set_up"][0]
    assert found["set_up"][-1] == set_up.WAITS
    assert (found["verdict"], found["named"], found["group"]) == ("not_testable", [], [])
    assert main(["discover", study, "--budget", "quick"]) == 0
    printed = capsys.readouterr().out
    assert printed.startswith("set-up: threshold_u_star: measured over modelled values are")
    assert "Mend the set-up first" in printed


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


@pytest.mark.parametrize(("count", "enough"), [(2, False), (3, False), (4, True)])
def test_rows_are_enough_where_one_is_left_to_contradict_an_effect(tmp_path, capsys, count, enough):
    study = small_table(tmp_path, measured_rows(count))
    assert main(["discover", str(study), "--budget", "quick", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    told = [words for words in found["set_up"] if words.startswith("too few rows")]
    assert bool(told) is not enough
    if not enough:
        assert f"{count} under different conditions, where 1 number is calibrated" in told[0]
        assert found["named"] == []


def test_a_row_that_no_explanation_comes_near_is_to_be_checked_first(tmp_path, capsys):
    lines = measured_rows(8).splitlines(keepends=True)
    cells = lines[5].split(",")
    wrong = ",".join([cells[0], f"{1.5 * float(cells[1]):.3g}", *cells[2:]])
    study = small_table(tmp_path, "".join([*lines[:5], wrong, *lines[6:]]))
    assert main(["discover", str(study), "--budget", "quick"]) == 0
    printed = capsys.readouterr().out
    at = "moisture = 0.01, diameter = 0.25 mm of x"
    assert re.search(rf"Check one row first: threshold_u_star at {at} lies \d+ sd above", printed), printed
    study = small_table(tmp_path, "".join(lines))
    assert main(["discover", str(study), "--budget", "quick"]) == 0
    assert "Check one row first" not in capsys.readouterr().out


def test_where_rows_are_lacking_the_measurements_are_told_that_tell_most(tmp_path, capsys):
    study = small_table(tmp_path, measured_rows(3))
    assert main(["next", str(study), "--budget", "quick"]) == 0
    printed = capsys.readouterr().out
    assert "At least one row more under other conditions is needed before an effect can be named." in printed
    assert "1. Measure threshold_u_star at moisture = " in printed
    assert "To tell nothing missing from " in printed
    assert "liquid bridge" in printed or "liquid_bridge" in printed
    assert "Mend the set-up" not in printed
    assert main(["discover", str(study), "--budget", "quick"]) == 0
    told = capsys.readouterr().out
    assert f"next {study}` proposes the measurements that tell most" in told
    assert "next: Measure threshold_u_star" in told


def test_where_no_condition_can_be_set_otherwise_ranges_are_asked_for(tmp_path, capsys):
    rows = "".join(f"threshold_u_star,0.2{k},0.004,5,m/s,g{k},0,0.25,x\n" for k in (5, 6))
    study = small_table(tmp_path, rows)
    assert main(["next", str(study), "--budget", "quick"]) == 0
    printed = capsys.readouterr().out
    assert "[laboratory] ranges" in printed
    study.write_text(
        study.read_text("utf-8") + "[laboratory]\nranges = { moisture = [0.0, 0.05] }\n", "utf-8"
    )
    assert main(["next", str(study), "--budget", "quick"]) == 0
    assert "1. Measure threshold_u_star at moisture = " in capsys.readouterr().out


def test_repeats_count_once_among_the_rows_that_tell_effects_apart(tmp_path):
    with open_study(small_table(tmp_path, 9 * measured_rows(3).replace(",0.004,", ",,"))) as found:
        assert [fault.kind for fault in found.faults] == ["too_few_rows"]


@pytest.mark.parametrize(("factor", "blocks"), [(1.0, None), (3.0, False), (12.0, True)])
def test_rows_of_the_same_conditions_that_differ_more_than_stated_are_told(tmp_path, factor, blocks):
    random = np.random.default_rng(3)
    rows = "".join(
        f"threshold_u_star,{0.25 + 0.05 * m + 0.004 * factor * random.normal():.5f},0.004,1,m/s,g{m}{k},"
        f"{0.002 * m},0.25,x\n"
        for m in range(6)
        for k in range(4)
    )
    with open_study(small_table(tmp_path, rows)) as found:
        told = [fault for fault in found.faults if fault.kind == "repeats"]
    assert [fault.blocks for fault in told] == ([] if blocks is None else [blocks])
    if told:
        assert "a condition that the table or the study lacks" in told[0].sentence
