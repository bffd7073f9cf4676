"""The race of one study: prepared rows, every hypothesis that matters, and its posterior."""

from scipy import stats

from taichi_erosion.evidence.data.problem import Measurements, Problem
from taichi_erosion.evidence.inference.prepared_problem import prepare
from taichi_erosion.evidence.race.doses import add_doses
from taichi_erosion.evidence.race.expansion import BudgetSpentError, RaceModel
from taichi_erosion.evidence.race.fit import Hypothesis, Race
from taichi_erosion.evidence.race.posterior import Posterior
from taichi_erosion.evidence.race.priors import FAMILYWISE, NOTHING
from taichi_erosion.evidence.race.search import search

MOST_SETTINGS = 2000  # of the model, all rows at once, that one answer may take


def raced(
    problem: Problem, seed: int, table: Measurements | None = None, most: float = MOST_SETTINGS
) -> Posterior:
    """The posterior of all explanations of a table, by default the rows outside the vault.

    `most` settings of the model may be evaluated; what is known when they are spent is the answer, and
    `Race.stopped` says so.
    """
    prepared = prepare(problem, problem.visible() if table is None else table, seed)
    race = Race(prepared, RaceModel(prepared, most))
    try:
        search(race)
        if race.posterior()[Hypothesis(())] < NOTHING or strained(race):
            add_doses(race)
    except BudgetSpentError:
        race.stopped = True
    return Posterior(race, race.posterior())


def strained(race: Race) -> bool:
    """Whether the bare model needs larger errors than their priors expect."""
    rows, _ = race.linear(race.fits[Hypothesis(())])
    residual, _ = rows.solved(rows.scales.start).precision
    return bool(stats.chi2.sf(rows.y @ residual, rows.y.size) < FAMILYWISE)
