"""A mechanism whose dose grows with a condition: it is found, with the doses that act."""

from dataclasses import replace

import numpy as np

from doe.trials.reduced import beyond
from taichi_erosion.evidence.answers.commands import discover_record
from taichi_erosion.evidence.answers.rounds import RacedStudy
from taichi_erosion.evidence.models.prepared_problem import prepare
from taichi_erosion.evidence.race.blocks import dose_columns
from taichi_erosion.evidence.race.decision import decide
from taichi_erosion.evidence.race.doses import from_axis
from taichi_erosion.evidence.race.expansion import RaceModel
from taichi_erosion.evidence.race.posterior import raced
from taichi_erosion.evidence.words.answer_lines import discover_answer
from tests.evidence.ten_records import VOC

CASE = 5058  # restitution that grows with moisture


def test_a_mechanism_is_told_with_its_doses():
    problem, truth = beyond.draw(CASE)
    posterior = raced(problem, 58)
    found = decide(posterior)
    assert found.verdict == "outside_library"
    assert found.mechanisms == (truth.name,)
    share = posterior.probability
    fit = posterior.race.fits[max(share, key=lambda h: share[h])]
    assert fit.hypothesis.along == truth.condition
    true = beyond.doses(truth, posterior.race.prepared.rows.conditions)
    assert np.max(np.abs(from_axis(fit.dose.w) - true)) < 0.35 * np.max(true)
    record = discover_record(RacedStudy(posterior, found))
    assert (record.law.mechanism, record.law.conditions) == (truth.name, (truth.condition,))
    assert truth.condition in discover_answer(record, VOC).lines[0]


def test_a_mechanism_is_judged_with_the_errors_of_the_model_at_its_own_doses():
    problem, truth = beyond.draw(CASE)

    def uncertainty(asked, parameters, effects):
        doses = [each.get(truth.name, np.zeros(at["moisture"].size)) for _, at, each in asked]
        return np.diag((0.01 * np.concatenate(doses)) ** 2)

    race = raced(replace(problem, uncertainty=uncertainty), 58).race
    fits = [fit for fit in race.fits.values() if fit.hypothesis.kind == truth.name and fit.dose is not None]
    assert fits
    for fit in fits:
        size = np.sqrt(np.sum(fit.errors**2, axis=1))
        np.testing.assert_allclose(size, 0.01 * np.abs(from_axis(fit.dose.w)), atol=1e-4)


def test_a_model_that_takes_a_dose_for_each_row_answers_as_one_that_takes_one():
    problem, truth = beyond.draw(CASE)

    def by_row(observable, at, parameters, effects, seeds):
        columns = []
        for row in range(at["moisture"].size):
            own = {name: column[[row]] for name, column in at.items()}
            doses = {name: float(np.broadcast_to(d, at["moisture"].size)[row]) for name, d in effects.items()}
            columns.append(problem.model(observable, own, parameters, doses, seeds))
        return np.hstack(columns)

    prepared = prepare(problem, problem.visible(), 58)
    rows = replace(problem, model=by_row, dosed_by_row=True)
    one = RaceModel(prepared)
    each = RaceModel(
        replace(prepared, problem=rows, predictor=replace(prepared.predictor, model=by_row, cache={}))
    )
    v, doses = np.zeros(one.count), np.linspace(0.0, 0.8, prepared.rows.size).round(1)
    np.testing.assert_allclose(each.dosed(v, truth.name, doses), one.dosed(v, truth.name, doses))


def test_a_dose_is_zero_where_its_condition_is():
    problem, _ = beyond.draw(CASE)
    rows = raced(problem, 58, most=30).race.prepared.rows
    kernels = dose_columns(rows, np.ones(rows.size, dtype=np.bool_))
    dry = rows.conditions["moisture"] == 0.0
    assert dry.any()
    np.testing.assert_allclose(kernels["moisture"][dry], 0.0, atol=1e-6)
    assert np.max(np.abs(kernels["diameter"][dry])) > 0.1
