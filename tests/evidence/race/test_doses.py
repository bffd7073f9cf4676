"""Mechanisms whose dose grows with a condition: found with their doses, and laws of doses in a closed form.

y = 30 + level + 4 d z,   f = 5 + level / 2 + 3 ln(1 + d),   d = a (x / 1.2)^p, or a
"""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from doe.trials.reduced import beyond
from doe.trials.reduced.laboratory import Readings, table_of
from taichi_erosion.evidence.answers.commands import discover_record
from taichi_erosion.evidence.answers.rounds import StudyInference
from taichi_erosion.evidence.answers.summary import mechanism_part_with_law
from taichi_erosion.evidence.data.problem import Mechanism, Parameter, Problem
from taichi_erosion.evidence.models.prepared_problem import prepare_problem
from taichi_erosion.evidence.race.blocks import dose_factors
from taichi_erosion.evidence.race.decision import decide_cause
from taichi_erosion.evidence.race.dose_laws import dose_law_of_fit
from taichi_erosion.evidence.race.doses import all_dosings
from taichi_erosion.evidence.race.expansion import RaceModel
from taichi_erosion.evidence.race.fit import Race, axis_to_dose
from taichi_erosion.evidence.race.posterior import infer
from taichi_erosion.evidence.record import MechanismPart
from taichi_erosion.evidence.words.answer_lines import discover_answer
from taichi_erosion.mechanisms.dose_forms import allowed_forms
from tests.evidence.ten_records import VOC

CASE = 5058  # restitution that grows with moisture


def test_a_mechanism_is_told_with_its_doses():
    problem, truth = beyond.draw(CASE)
    posterior = infer(problem, 58)
    found = decide_cause(posterior)
    assert (found.verdict, found.acting_mechanisms) == ("outside_library", (truth.name,))
    share = posterior.probability
    fit = posterior.race.fits[max(share, key=lambda h: share[h])]
    assert fit.hypothesis.along == truth.condition
    true = beyond.doses(truth, posterior.race.prepared.rows.conditions)
    assert np.max(np.abs(axis_to_dose(fit.dose.w) - true)) < 0.35 * np.max(true)
    record = discover_record(StudyInference(posterior, found))
    assert (record.law.mechanism, record.law.conditions) == (truth.name, (truth.condition,))
    assert truth.condition in discover_answer(record, VOC).lines[0]


@pytest.mark.parametrize("case", [3, 62])  # no search from 0 at the numbers of the prior reaches them
def test_the_search_reaches_doses_that_are_far_from_0(case: int) -> None:
    problem, truth = beyond.draw(case)
    assert truth.name in decide_cause(infer(problem, 58)).acting_mechanisms


def test_a_mechanism_is_judged_with_the_errors_of_the_model_at_its_own_doses():
    problem, truth = beyond.draw(CASE)

    def uncertainty(asked, parameters, effects):
        doses = [each.get(truth.name, np.zeros(at["moisture"].size)) for _, at, each in asked]
        return np.diag((0.01 * np.concatenate(doses)) ** 2)

    race = infer(replace(problem, uncertainty=uncertainty), 58).race
    fits = [f for f in race.fits.values() if f.hypothesis.extra == (truth.name,) and f.dose is not None]
    assert fits
    for fit in fits:
        size = np.sqrt(np.sum(fit.errors**2, axis=1))
        np.testing.assert_allclose(size, 0.01 * np.abs(axis_to_dose(fit.dose.w)), atol=1e-4)


def test_a_model_that_takes_doses_for_each_row_answers_as_one_that_takes_one():
    problem, truth = beyond.draw(CASE)

    def by_row(observable, at, parameters, effects, seeds):
        def value(row):
            doses = {name: float(np.broadcast_to(d, at["moisture"].size)[row]) for name, d in effects.items()}
            return problem.model(observable, {n: c[[row]] for n, c in at.items()}, parameters, doses, seeds)

        return np.hstack([value(row) for row in range(at["moisture"].size)])

    prepared = prepare_problem(problem, problem.visible_rows(), 58)
    own = replace(prepared.predictor, model=by_row, cache={})
    rows = replace(prepared, problem=replace(problem, model=by_row, dosed_by_row=True), predictor=own)
    doses = np.linspace(0.0, 0.8, prepared.rows.size).round(1)
    both, v = {truth.name: doses, "drag": doses[::-1]}, np.zeros(len(prepared.parameter_axes))
    np.testing.assert_allclose(*(RaceModel(each).predict_mean((), v, both) for each in (rows, prepared)))


@pytest.mark.parametrize("second", ["bed_stress", "dry_cohesion"])
def test_two_mechanisms_and_a_mechanism_beside_a_listed_effect_are_both_told(second):
    problem, truth = beyond.draw(0, shares=(1.0, 0.0, 0.0))
    table, listed = problem.measurements, second in beyond.CANDIDATES
    dose = beyond.doses(truth, table.conditions)
    value = table.value + 0.3 * table.sd * np.random.default_rng(1).standard_normal(table.size)
    for row, (name, size) in enumerate(zip(table.observable, dose, strict=True)):
        at = {key: column[[row]] for key, column in table.conditions.items()}
        acting = {truth.name: size, second: 1.2 if listed else 0.8 * size}
        value[row] += beyond.reduced_places.expected(name, at, truth.parameters, acting)[0] - table.value[row]
    found = decide_cause(infer(replace(problem, measurements=replace(table, value=value)), 58))
    assert {*found.named, *found.acting_mechanisms} == {truth.name, second}
    assert (found.together, bool(found.named)) == (not listed, listed)


def test_a_dose_is_zero_where_its_condition_is():
    problem, _ = beyond.draw(CASE)
    rows = infer(problem, 58, most=60).race.prepared.rows
    kernels = dose_factors(rows, np.ones(rows.size, dtype=np.bool_))
    dry = rows.conditions["moisture"] == 0.0
    assert dry.any()
    np.testing.assert_allclose(kernels["moisture"][dry], 0.0, atol=1e-6)
    assert np.max(np.abs(kernels["diameter"][dry])) > 0.1


COUNT, SD, DOSE = 20, 0.3, 0.8
MOST_SETTINGS = 120  # that a law may take


def value(observable, conditions, parameters, effects, seeds):
    level, dose = parameters["level"], effects.get("pull", 0.0)
    pulled = 30.0 + level + 4.0 * dose * conditions["z"]
    found = pulled if observable == "y" else 5.0 + 0.5 * level + 3.0 * np.log1p(dose) + 0.0 * conditions["z"]
    return np.repeat(found[np.newaxis], seeds.size, axis=0)


def pulled_rows(random: np.random.Generator, exponent: float, high: float, apart: bool = False) -> Problem:
    """Rows made with an exponent, and a mechanism with doses up to some; `apart`: no row has both."""
    x, z = np.exp(random.uniform(-0.7, 0.9, COUNT)), random.uniform(0.5, 1.5, COUNT)
    if apart:
        x[::2], z[1::2] = 0.0, 0.0
    dose = DOSE * (x / 1.2) ** exponent
    parts, group = [], tuple(f"g{k}" for k in range(COUNT))
    for name in ("y", "f"):
        exact = value(name, {"z": z}, {"level": 0.7}, {"pull": dose}, np.zeros(1))[0]
        noisy = exact + SD * random.standard_normal(COUNT)
        parts.append(Readings(name, {"x": x, "z": z}, noisy, np.full(COUNT, SD), group))
    level = Parameter("level", 0.0, -10.0, 10.0)
    return Problem(table_of(parts), {}, (level,), (), value, mechanisms=(Mechanism("pull", -0.9, high),))


def test_a_mechanism_that_cannot_reach_the_rows_is_not_told_and_its_doses_stay_in_their_range():
    found = {}
    for high in (10.0, 0.05):
        posterior = infer(pulled_rows(np.random.default_rng(1), 1.5, high), 1)
        found[high] = decide_cause(posterior)
        fits = [fit for fit in posterior.race.fits.values() if fit.dose is not None]
        assert max(float(axis_to_dose(fit.w).max()) for fit in fits) < 1.2 * high
    assert found[10.0].acting_mechanisms == ("pull",)
    assert (found[0.05].verdict, found[0.05].acting_mechanisms) == ("outside_library", ())


def law(exponent: float, seed: int, apart: bool = False) -> tuple[MechanismPart, int]:
    """The law of rows made with an exponent, and the settings that it took; `apart`: no row has both."""
    problem = pulled_rows(np.random.default_rng(seed), exponent, 10.0, apart)
    prepared = prepare_problem(problem, problem.measurements, seed)
    race = Race(prepared, RaceModel(prepared))
    bare = race.fit_bare_model(0.0)
    pull = all_dosings(race, dose_factors(prepared.rows, np.ones(prepared.rows.size, dtype=np.bool_)))[0]
    fit = pull.optimise(bare, bare.w)
    before = race.model.settings
    assert dose_law_of_fit(race, bare) is None
    return mechanism_part_with_law(dose_law_of_fit(race, fit), 0.9), race.model.settings - before


@pytest.mark.parametrize("exponent", [1.3, -0.8])
def test_power_with_its_exponent_is_found_within_few_settings(exponent: float) -> None:
    inside = 0
    for seed in range(3):
        mechanism, settings = law(exponent, seed)
        found = mechanism.law
        assert (found.form, found.conditions) == ("power", ("x",))
        assert settings <= MOST_SETTINGS
        assert found.held_out_share > 0.8
        told = found.powers["x"]
        assert told.value == pytest.approx(exponent, abs=0.25)
        assert told.high - told.low < 0.5
        inside += told.low <= exponent <= told.high
    assert inside >= 2


def test_conditions_that_never_go_together_make_no_law_of_both() -> None:
    mechanism, _ = law(1.3, 0, apart=True)
    assert mechanism.law.conditions == ("x",)


def test_doses_are_those_of_the_expression_within_their_intervals() -> None:
    mechanism, _ = law(1.3, 3)
    found, doses = mechanism.law, mechanism.doses
    params = SimpleNamespace(**{name: number.value for name, number in found.numbers.items()})
    for each in doses:
        dose = eval(found.python, {"np": np, "at": each.conditions, "params": params})
        assert dose == pytest.approx(each.dose)
        assert each.low < each.dose < each.high
    inside = [each.low <= DOSE * (each.conditions["x"] / 1.2) ** 1.3 <= each.high for each in doses]
    assert np.mean(inside) > 0.7


def test_same_dose_everywhere_is_told_as_constant() -> None:
    mechanism, _ = law(0.0, 0)
    assert mechanism.law.form == "constant"
    (each,) = mechanism.doses
    assert not each.conditions
    assert each.low < DOSE < each.high


@pytest.mark.parametrize("least", [0.0, 1e-4])
def test_every_form_is_its_expression_and_nothing_without_its_condition(least: float) -> None:
    conditions = {
        "diameter": np.linspace(1e-4, 6e-4, 9),
        "u_star": np.linspace(0.3, 0.8, 9)[::-1],
        "water": np.linspace(least, 0.04, 9),
    }
    forms = list(allowed_forms(conditions))
    for form in forms:
        numbers = np.array([0.7, *form.starts[0]])
        values = {name: repr(float(x)) for name, x in zip(("a", *form.names), numbers, strict=True)}
        dose = form.dose(conditions, numbers)
        told = eval(form.python.format(**values), {"np": np, "at": conditions})
        np.testing.assert_allclose(dose, told * np.ones(9), rtol=1e-12)
        if "water" in form.conditions and least == 0.0:
            assert dose[0] == 0.0
    assert ("exponential", ("water",)) not in [(form.name, form.conditions) for form in forms] or least > 0.0
