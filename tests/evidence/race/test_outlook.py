"""Rows that a race has not seen, beside closed forms, seeded truths and the rows that it has seen."""

from dataclasses import replace

import numpy as np
import pytest

from doe.trials.reduced.families import FAMILIES
from taichi_erosion.evidence.data.new_conditions import NewConditions
from taichi_erosion.evidence.data.problem import Measurements, Parameter, Problem
from taichi_erosion.evidence.race.answer import raced
from taichi_erosion.evidence.race.fit import Hypothesis
from taichi_erosion.evidence.race.outlook import outlook
from taichi_erosion.evidence.race.priors import KEEP
from taichi_erosion.evidence.race.unseen_rows import elsewhere, new_rows

PRIOR_SD, SD = 0.7, 0.1


def three_rows() -> Problem:
    """y = v x, v ~ N(0, PRIOR_SD^2): too few rows for any block but a level."""
    x, y = np.array([0.2, 0.5, 1.0]), np.array([0.21, 0.33, 0.81])

    def model(observable, conditions, parameters, effects, seeds):
        return np.tile(np.log(parameters["a"]) * conditions["x"], (seeds.size, 1))

    plain, none = np.ones(3), np.full(3, np.nan)
    table = Measurements(
        *(("y",) * 3, y, SD * plain, plain, ("a", "b", "c"), ("1",) * 3, {"x": x}),
        censored=np.zeros(3, dtype=np.bool_),
        limit=none,
        source=("made",) * 3,
    )
    return Problem(table, {}, (Parameter("a", 1.0, 0.0, np.inf, PRIOR_SD),), (), model)


def test_closed_form_with_one_level():
    found = raced(three_rows(), 1)
    race, x = found.race, np.array([0.2, 0.5, 1.0, 0.7, 2.0])
    fit = race.fits[Hypothesis(())]
    told = outlook(elsewhere(race, new_rows(race.prepared, NewConditions(("y",) * 2, {"x": x[3:]}))), fit)
    assert [block.kind for block in fit.blocks] == ["level"]
    level, factor = np.exp(fit.evidence.solved.u)
    prior = PRIOR_SD**2 * np.outer(x, x) + (level * SD) ** 2
    gain = prior[3:, :3] @ np.linalg.inv(prior[:3, :3] + (factor * SD) ** 2 * np.eye(3))
    assert told.mean() == pytest.approx(gain @ race.prepared.rows.z, rel=1e-6)
    assert told.covariance() == pytest.approx(prior[3:, 3:] - gain @ prior[:3, 3:], rel=1e-6)


@pytest.mark.parametrize(
    ("family", "seed"), [("clean", 15), ("beyond", 5003), ("disturbed", 5), ("intervals", 31003)]
)
def test_conditions_that_were_fitted_are_told_as_fitted(family: str, seed: int):
    """Every block carries over: at the fitted conditions each explanation says what it says of the fit."""
    base = {"clean": 4242, "disturbed": 777}.get(family, seed)
    race = (found := raced(FAMILIES[family](base, seed).problem, seed)).race
    rows = race.prepared.rows
    place = elsewhere(
        race,
        replace(
            new_rows(race.prepared, NewConditions(rows.names, rows.conditions)),
            group=rows.group,
            source=rows.source,
        ),
    )
    for hypothesis in [h for h, p in found.probability.items() if p > KEEP]:
        fit = race.fits[hypothesis]
        told, now = outlook(place, fit), fit.evidence.solved
        fitted = race.prepared.rows.z - race.prepared.whitening(race.prepared.working(fit.mean)).back(
            now.rows.y - now.rows.columns @ (now.tau * now.centre)
        )
        print(hypothesis, np.abs((told.mean() - fitted) / race.prepared.sd).max())
