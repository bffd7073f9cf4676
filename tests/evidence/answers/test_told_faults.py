"""Faults of the former inference that no answer may have again: each with the table that showed it."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from taichi_erosion.evidence.answers.commands import adopt_record, next_record
from taichi_erosion.evidence.data.problem import Laboratory, Problem, Vault
from taichi_erosion.evidence.race.posterior import raced
from taichi_erosion.evidence.race.summary import summary
from taichi_erosion.evidence.words.answer_lines import adopt_answer, discover_answer, next_answer
from tests.evidence.asking import ask
from tests.evidence.linear_study import linear_problem
from tests.evidence.small_study import study_text, write_study
from tests.evidence.ten_records import VOC

ACTING = {"liquid_bridge": 1.0}


def repeated(value: np.ndarray, x: np.ndarray, shapes: dict) -> Problem:
    """Rows at some conditions without a stated sd."""
    problem = linear_problem(shapes, {}, count=x.size)
    table = replace(problem.measurements, value=value, sd=np.full(x.size, np.nan), conditions={"x": x})
    return replace(problem, measurements=table)


def test_a_typo_in_a_repeat_is_told_first_and_the_same_effect_is_named(tmp_path: Path):
    path = write_study(tmp_path, ACTING)
    head, *lines = (tmp_path / "heap.csv").read_text("utf-8").splitlines()
    row = next(k for k, line in enumerate(lines) if line.startswith("repose_angle"))
    name, value, *rest = lines[row].split(",")
    lines[row] = ",".join([name, f"{float(value) + 30.0:.6g}", *rest])
    (tmp_path / "heap.csv").write_text("\n".join([head, *lines]) + "\n", encoding="utf-8")
    found = ask("discover", path)
    assert found.answer().lines[0].startswith(f"Check row {row + 2} first")
    assert found.record.decided.named == tuple(ACTING)
    assert [each.suspect for each in found.record.repeats] == [row + 2]
    compared = ask("compare", path).answer().lines
    assert compared[0].startswith(f"Check row {row + 2} first")


def test_scatter_that_repeats_contradict_is_not_told():
    x = np.repeat(np.linspace(-1.0, 1.0, 12), 3)
    noise = 0.1 * np.random.default_rng(3).standard_normal(x.size)
    found = summary(raced(repeated(2.0 * np.sin(4.0 * x) * (1.0 + x) + noise, x, {"slope": lambda x: x}), 0))
    assert found.decided.verdict == "outside_library"
    assert not [each for each in found.errors if each.kind == "scatter"]


def test_an_adoption_that_improves_and_does_not_suffice_says_so():
    shapes = {"slope": lambda x: x, "other": lambda x: np.sin(5.0 * x)}
    problem = linear_problem(shapes, {"slope": 2.0}, sd=0.1)
    x = problem.measurements.conditions["x"]
    table = replace(problem.measurements, value=problem.measurements.value + 1.5 * np.cos(7.0 * x))
    problem = replace(problem, measurements=table, vault=Vault(np.arange(2, 24, 4)))
    record = adopt_record(raced(problem, 1), ("slope",), 1)
    assert record.held_out.after < record.held_out.before
    first, *_ = adopt_answer(record, VOC).lines
    assert "but the model still fails" in first
    assert "The error falls" not in first


def test_a_strength_at_the_end_of_the_list_says_so_and_its_interval_holds_it():
    record = summary(raced(linear_problem({"wave": lambda x: np.sin(3.0 * x)}, {"wave": 5.0}), 0))
    strength = record.effects["wave"].strength
    assert 3.0 < strength.low < strength.value < strength.high
    assert strength.low < 5.0 < strength.high
    assert "at the limit of the list, 3" in discover_answer(record, VOC).lines[0]


def test_nothing_is_proposed_that_decides_nothing():
    copies = linear_problem({"slope": lambda x: x, "copy": lambda x: x}, {"slope": 0.6})
    record = next_record(raced(copies, 1), Laboratory(ranges={"x": (-3.0, 3.0)}))
    assert record.experiments == ()
    (line,) = next_answer(record, VOC).lines
    assert line.startswith("No measurement under the conditions of the table would decide more")


def test_what_is_proposed_lies_within_the_stated_ranges(tmp_path: Path):
    text = study_text(("gusts", "saffman_lift")) + "\n[laboratory]\nranges = { moisture = [0.0, 0.002] }\n"
    path = write_study(tmp_path, {"gusts": 0.3}, study=text)
    found = ask("next", path)
    for each in found.record.experiments:
        assert 0.0 <= each.conditions["moisture"] <= 0.002
