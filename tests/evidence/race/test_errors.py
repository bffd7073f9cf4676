"""Errors that nobody stated, in tables in which they were put: of rows, sources, conditions, laboratories."""

from dataclasses import replace

import numpy as np
import pytest

from doe.trials.reduced.families import FAMILIES
from doe.trials.reduced.laboratory import Readings, table_of
from taichi_erosion.evidence.answers.commands import adoption_record
from taichi_erosion.evidence.answers.summary import race_record
from taichi_erosion.evidence.data import problem as problems
from taichi_erosion.evidence.models.prepared_problem import prepare_problem
from taichi_erosion.evidence.race.posterior import infer, quantiles
from taichi_erosion.evidence.record import ErrorPart, Record
from taichi_erosion.evidence.words.answer_lines import discover_answer
from tests.evidence.linear_study import linear_problem
from tests.evidence.ten_records import VOC

SD, COUNT = 0.1, 48  # of a row, and rows
SHAPES = {"bend": lambda x: x**2, "wave": lambda x: np.sin(3.0 * x)}
BEND = {"bend": 1.0}
SECOND = np.arange(COUNT) % 2 == 1
LABORATORIES = tuple("laboratory B" if other else "laboratory A" for other in SECOND)


def told(problem: problems.Problem, **changes) -> Record:
    """The record of a table with some changes."""
    return race_record(infer(replace(problem, measurements=replace(problem.measurements, **changes)), 3))


def made(**acting: float) -> tuple[problems.Problem, problems.Measurements]:
    problem = linear_problem(SHAPES, acting, sd=SD, count=COUNT)
    return problem, problem.measurements


def kinds(record: Record) -> list[str]:
    return [each.kind for each in record.errors]


def test_nothing_but_noise_has_no_errors():
    record = told(made()[0], source=LABORATORIES)
    assert set(kinds(record)) <= {"scatter"}, "which chance tells in one of ten"
    assert record.levels == ()


def test_batches_are_not_taken_for_an_effect_nor_for_something_unlisted():
    problem, table = made()
    shift = 3.0 * SD * np.random.default_rng(5).standard_normal(12)
    record = told(problem, value=table.value + shift[np.arange(COUNT) % 12])
    assert (record.verdict, set(kinds(record))) == ("none_detected", {"group"})


def test_a_source_that_reads_higher_is_told_with_its_size():
    problem, table = made(**BEND)
    record = told(problem, value=table.value + 5.0 * SD * SECOND, source=LABORATORIES)
    assert record.named == ("bend",)
    (source,) = (each for each in record.errors if each.kind == "source")
    assert source.label == "laboratory B"
    assert source.low < 0.5 < source.high < source.low + 0.2, "48 rows know it to 0.05"


def test_rows_that_are_off_do_not_change_the_answer():
    problem, table = made(**BEND)
    value = table.value.copy()
    value[[17, 30]] += 9.0 * SD
    record = told(problem, value=value)
    assert record.named == ("bend",)
    found: dict[str, ErrorPart] = {each.label: each for each in record.errors if each.kind == "row"}
    assert set(found) == {"19", "32"}  # line 1 is the head
    assert found["19"].value == pytest.approx(9.0 * SD, abs=3.0 * SD)


def test_a_row_that_is_off_on_a_logarithmic_scale_is_told_in_its_unit():
    problem = FAMILIES["clean"](4242, 33).problem
    value = problem.measurements.value.copy()
    value[5] *= 2.0
    (found,) = (each for each in told(problem, value=value).errors if each.kind == "row")
    assert found.label == str(problem.measurements.table_line_numbers[5])
    assert found.value == pytest.approx(0.5 * value[5], rel=0.1)


def test_scatter_that_is_understated_is_told_and_names_nothing():
    problem, table = made()
    record = told(problem, value=2.5 * table.value)
    assert record.verdict == "none_detected"
    (scatter,) = record.errors
    assert scatter.kind == "scatter"
    # the prior of the scatter, a factor of 1.4, takes a tenth of 2.2
    assert scatter.value == pytest.approx(2.5 * np.std(table.value) / SD, rel=0.2)


@pytest.mark.parametrize("acting", [{}, BEND], ids=["nothing", "bend"])
@pytest.mark.parametrize("factor", [0.0, 10.0])
def test_a_source_that_states_no_sd_has_a_scatter_of_its_own(acting: dict[str, float], factor: float):
    problem, table = made(**acting)
    more = SD * factor * np.random.default_rng(2).standard_normal(COUNT) * SECOND
    sd = np.where(SECOND, np.nan, table.sd)
    record = told(problem, value=table.value + more, sd=sd, source=LABORATORIES)
    right, silent = tuple(acting), record.verdict == "none_detected"
    assert record.named == right or (silent and record.refuted == right and factor > 0.0)


def test_scatter_that_repeats_contradict_is_not_told():
    x = np.repeat(np.linspace(-1.0, 1.0, COUNT // 3), 3)
    problem, table = made()
    value = 2.0 * np.sin(4.0 * x) * (1.0 + x) + table.value
    record = told(problem, value=value, sd=np.nan * x, conditions={"x": x}, group=tuple(map(str, x)))
    assert record.verdict == "outside_library"
    assert "scatter" not in kinds(record)


CELLS, REPEATS, SLOPE_SD = 10, 3, 0.5


def model(observable, conditions, parameters, effects, seeds):
    x = conditions["x"]
    value = 3.0 + parameters["slope"] * x * (1.0 if observable == "angle" else -0.5)
    value = value + effects.get("bend", 0.0) * (x**2 if observable == "angle" else 0.3 * x)
    return np.repeat(value[np.newaxis], seeds.size, axis=0)


def heaps(seed: int, named: bool = True, strength: float = 0.0) -> problems.Problem:
    """Single heaps at ten conditions, three of each, with two observables whose scatter is correlated."""
    random = np.random.default_rng(seed)
    size, x = CELLS * REPEATS, np.repeat(np.linspace(-1.0, 1.0, CELLS), REPEATS)
    errors = random.standard_normal((size, 2)) @ np.linalg.cholesky([[1.0, 0.8], [0.8, 1.0]]).T
    acting = {"slope": 0.4}
    truth = [model(name, {"x": x}, acting, {"bend": strength}, np.zeros(1))[0] for name in ("angle", "width")]
    parts = [
        Readings(name, {"x": x}, exact + sd * error, np.full(size, sd), tuple(f"x{v:.3f}" for v in x))
        for name, sd, exact, error in zip(("angle", "width"), (0.1, 0.2), truth, errors.T, strict=True)
    ]
    heap = tuple(f"heap {k}" for k in range(size)) * 2 if named else ()
    table = replace(table_of(parts), heap=heap)
    observables = {"angle": problems.Observable("angle", sd_shared=0.15)}
    numbers = (problems.Parameter("slope", 0.4, 1e-9, 1e9, SLOPE_SD),)
    return problems.Problem(table, observables, numbers, (problems.Candidate("bend"),), model)


def test_rows_of_one_heap_are_whitened_together():
    prepared = prepare_problem(problem := heaps(0), problem.measurements, 1)
    white = prepared.whiten(np.eye(prepared.rows.size))
    whole = white @ (np.diag(prepared.variance) + prepared.rows.covariance) @ white.T
    np.testing.assert_allclose(whole, np.eye(len(white)), atol=1e-8)


def test_an_effect_of_single_heaps_is_found():
    assert (told(heaps(1)).named, told(heaps(1, strength=0.5)).named) == ((), ("bend",))


SD_X, SLOPE, TABLES, ROWS = 0.1, 1.2, 24, 24  # at 0.25 slopes along a measured condition are too small


def line(seed: int, classical: bool) -> problems.Problem:
    """y = slope x + e, stated x off by N(0, SD_X^2): measured so (classical), or set so (Berkson)."""
    generator = np.random.default_rng(seed)
    problem = linear_problem({"slope": lambda x: x}, {"slope": 0.0}, sd=SD, count=ROWS, seed=None)
    set_x = problem.measurements.conditions["x"]
    other = set_x + SD_X * generator.standard_normal(ROWS)
    stated, true = (other, set_x) if classical else (set_x, other)
    value, sd = SLOPE * true + SD * generator.standard_normal(ROWS), {"x": np.full(ROWS, SD_X)}
    table = replace(problem.measurements, value=value, conditions={"x": stated}, condition_sd=sd)
    return replace(problem, measurements=table, candidates=(problems.Candidate("slope", 3.0, 3.0),))


@pytest.mark.parametrize("classical", [True, False])
def test_intervals_hold_the_slope_where_the_condition_was_measured_and_where_it_was_set(classical: bool):
    found = [quantiles(*infer(line(100 + k, classical), 1).strength_draws("slope")) for k in range(TABLES)]
    assert sum(low <= SLOPE <= high for low, _, high in found) >= 18, "fewer of 24 come with 0.7 % at 0.9"


OFFSET = 1.5  # fifteen sd of a row


def off(acting: dict[str, float], factor: float = 0.0, **changes) -> problems.Problem:
    """A laboratory that reads more by OFFSET, or on a logarithmic scale by a factor."""
    problem = replace(linear_problem(SHAPES, acting, calibrated=False), **changes)
    table, linear = problem.measurements, problem.model
    if not factor:
        return replace(problem, measurements=replace(table, value=table.value + OFFSET))
    value = factor * np.exp(table.value)
    table = replace(table, value=value, sd=value * table.sd)
    problem = replace(problem, measurements=table, observables={"y": problems.Observable("y", "log")})
    return replace(problem, model=lambda *asked: np.exp(linear(*asked)))


def test_a_level_of_amounts_does_not_follow_the_noise_of_its_rows():
    problem = off({}, factor=2.0)
    problem = replace(problem, observables={"y": problems.Observable("y", "log_floor", 1.0)})
    level = infer(problem, 1, bare=True).race.blocks[0]
    assert (level.kind, np.ptp(level.columns)) == ("level", 0.0)


def test_an_offset_of_the_laboratory_is_told_as_a_level_and_along_no_condition():
    found = race_record(infer(off({}), 1))
    assert found.verdict == "none_detected"
    assert found.probabilities["none"] > 0.8
    (shift,) = found.levels
    assert (shift.observable, shift.kind) == ("y", "offset")
    assert shift.low < OFFSET < shift.high
    assert found.p_misfit < 0.01, "calibration alone does not explain it"
    lines = discover_answer(found, VOC).lines
    assert lines[0].startswith("No missing effect is seen")
    assert not any("Where the model fails" in line for line in lines)


@pytest.mark.parametrize("shared", [0.0, 3.0 * OFFSET])
def test_a_stated_error_of_a_laboratory_is_part_of_the_level_that_is_told(shared: float):
    problem = replace(off({}), observables={"y": problems.Observable("y", sd_shared=shared)})
    (shift,) = race_record(infer(problem, 1)).levels
    assert shift.low < OFFSET < shift.high
    assert race_record(infer(replace(made()[0], observables=problem.observables), 3)).levels == ()


@pytest.mark.parametrize(
    ("factor", "words"),
    [(10.0, "(another unit?)"), (57.3, "(degrees for radians?)"), (3.0, "at all conditions.")],
)
def test_a_column_in_a_wrong_unit_is_told_as_a_factor_and_hides_no_effect(factor: float, words: str):
    found = race_record(infer(off({}, factor), 1))
    assert found.verdict == "none_detected"
    (shift,) = found.levels
    assert (shift.observable, shift.kind) == ("y", "factor")
    assert shift.value == pytest.approx(factor, rel=0.06)  # sd of a mean of 24 rows: 0.02
    assert any(words in line for line in discover_answer(found, VOC).lines)
    acting = race_record(infer(off(BEND, factor), 1))
    assert acting.named == ("bend",)
    assert acting.p_misfit_after > 0.01


def test_an_adopted_effect_is_judged_after_the_offset_of_the_laboratory():
    found = adoption_record(infer(off(BEND, vault=problems.Vault(np.arange(3, 24, 5))), 1), ("bend",), 1)
    assert found.vault.chi2_per_row_after < 3.0 < found.vault.chi2_per_row_before
    assert found.p_misfit_after > 0.01
    assert found.effects["bend"].strength_low < 1.0 < found.effects["bend"].strength_high


def test_soils_with_numbers_of_their_own_do_not_hide_what_an_adoption_explains():
    problem, table = made(bend=3.0)
    soils = tuple(f"soil {k * 6 // COUNT}" for k in range(COUNT))
    hidden = problems.Vault(np.flatnonzero(np.isin(soils, ("soil 1", "soil 4"))))
    problem = replace(problem, measurements=replace(table, group=soils), vault=hidden)
    held = adoption_record(infer(problem, 3), ("bend",), 1).vault
    assert held.chi2_per_row_after < 2.0 < 10.0 < held.chi2_per_row_before


def test_an_adoption_that_improves_and_does_not_suffice_is_a_misfit():
    table = (problem := off({"bend": 3.0}, vault=problems.Vault(np.arange(3, 24, 5)))).measurements
    table = replace(table, value=table.value + 1.5 * np.cos(9.0 * table.conditions["x"]))
    found = adoption_record(infer(replace(problem, measurements=table), 1), ("bend",), 1)
    assert found.vault.chi2_per_row_after < found.vault.chi2_per_row_before
    assert found.p_misfit_after < 0.01


def test_numbers_are_not_moved_by_a_level():
    table = (problem := heaps(1)).measurements
    value = table.value + OFFSET * (np.array(table.observable) == "angle")
    found = race_record(infer(replace(problem, measurements=replace(table, value=value)), 1))
    slope = found.parameters["slope"]
    assert slope.low < 0.4 < slope.high < slope.low + 0.3
    assert [level.observable for level in found.levels] == ["angle"]


def test_a_number_beyond_its_range_is_told_and_no_effect_is_named_in_its_place():
    narrow = (problems.Parameter("slope", 0.1, 0.01, 0.15, 1.0),)
    found = race_record(infer(replace(heaps(1), parameters=narrow), 1))
    assert found.named == found.group == ()
    assert found.parameters["slope"].at_end
    assert found.p_misfit < 0.01
    wide = (problems.Parameter("slope", 0.1, 0.01, 10.0, 1.0),)  # 0.4 is the middle of its logarithm
    assert not race_record(infer(replace(heaps(1), parameters=wide), 1)).parameters["slope"].at_end


@pytest.mark.parametrize("seed", [0, 1, 7])
def test_soils_of_one_row_each_differ_without_a_cause_along_what_differs_between_them(seed):
    problem, random = linear_problem(SHAPES, {}, SD, 8, seed), np.random.default_rng(100 + seed)
    record = told(problem, value=problem.measurements.value + 8.0 * SD * random.standard_normal(8))
    assert (record.verdict, record.probabilities["each_set_up"] > 0.5) == ("none_detected", True)
