"""Evidence of sets that were not fitted, as screens estimate it, beside that of a fit."""

import numpy as np
import pytest

from taichi_erosion.evidence.answers.compare import no_progress
from taichi_erosion.evidence.inference.map_fit import fit
from taichi_erosion.evidence.inference.pipeline import FittedHypotheses, analyse
from taichi_erosion.evidence.inference.posterior import log_prior_of
from taichi_erosion.evidence.inference.prepared_problem import prepare
from taichi_erosion.evidence.inference.refit import scored_fit, total_evidence
from taichi_erosion.evidence.inference.search.enumeration import (
    complete,
    log_joint_of,
    unvisited_sets,
    unvisited_share,
)
from tests.evidence.inference.search.test_effect_sets import SHAPES, THREE
from tests.evidence.linear_study import linear_problem


@pytest.fixture
def fitted() -> FittedHypotheses:
    problem = linear_problem(SHAPES, THREE, sd=0.3, seed=5)
    return analyse(prepare(problem, problem.measurements, 1), 1, no_progress).fitted


def test_the_estimate_of_a_set_is_close_to_its_fit(fitted):
    search = fitted.search
    left = unvisited_sets(search, fitted.screened, fitted.base)
    total = log_joint_of(search, fitted.screened, fitted.base)
    likely = [each for each in left.values() if each.log_joint > total - 10.0]
    assert likely
    for each in likely:
        best = fit(search.prepared, each.names, [each.start])
        item = scored_fit(search.prepared, best, search.family)
        exact = total_evidence(search.prepared, item) + log_prior_of(each.names, False, len(SHAPES))
        assert each.log_joint == pytest.approx(exact, abs=1.0)


def test_a_set_that_was_left_out_is_fitted_after_all(fitted):
    search, names = fitted.search, ("bend", "wave")
    kept, _ = search.found.pop(names), search.fits.pop(names, None)
    share = unvisited_share(
        search, fitted.screened, fitted.base, log_joint_of(search, fitted.screened, fitted.base)
    )
    assert share[""] > 0.05
    complete(search, fitted.screened, fitted.base)
    assert search.found[names].fit.misfit == pytest.approx(kept.fit.misfit, abs=0.1)
    after = unvisited_share(
        search, fitted.screened, fitted.base, log_joint_of(search, fitted.screened, fitted.base)
    )
    assert after[""] < 0.5 * share[""]


def test_shares_of_effects_lie_within_that_of_all_sets(fitted):
    share = unvisited_share(fitted.search, fitted.screened, fitted.base, fitted.posterior.log_all)
    assert 0.0 < share[""] < 1.0
    assert all(value <= share[""] for value in share.values())
    assert sum(value for name, value in share.items() if name) >= 2.0 * share[""], "sets of two or more"
    assert unvisited_share(fitted.search, fitted.screened, fitted.base, -np.inf) == {}
