"""The race of one study: prepared rows, every hypothesis that matters, and its posterior."""

import numpy as np

from taichi_erosion.evidence.data.problem import Measurements, Problem
from taichi_erosion.evidence.inference.prepared_problem import prepare
from taichi_erosion.evidence.race.doses import add_doses
from taichi_erosion.evidence.race.expansion import BudgetSpentError, RaceModel
from taichi_erosion.evidence.race.posterior import Posterior
from taichi_erosion.evidence.race.priors import NOTHING
from taichi_erosion.evidence.race.search import Hypothesis, Race, search

MOST_SETTINGS = 2000  # of the model, all rows at once, that one answer may take


def raced(problem: Problem, seed: int, table: Measurements | None = None, most: float = MOST_SETTINGS) -> Posterior:
    """The posterior of all explanations of a table, by default the rows outside the vault.

    `most` settings of the model may be evaluated; what is known when they are spent is the answer, and
    `Race.stopped` says so.
    """
    prepared = prepare(problem, problem.visible() if table is None else table, seed)
    race = Race(prepared, RaceModel(prepared, most))
    try:
        search(race)
        if race.posterior()[Hypothesis(())] < NOTHING:
            add_doses(race)
    except BudgetSpentError:
        race.stopped = True
    return Posterior(race, race.posterior())
