"""Held-out rows of a source that states no scatter, against closed forms and tables in which it was put."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from taichi_erosion.evidence.answers.adopt import adopt
from taichi_erosion.evidence.answers.held_out_misfit import (
    SCATTERS,
    held_out_prediction,
    held_out_problem,
    scatter_evidence,
    silent_sources,
    with_silent_sources,
)
from taichi_erosion.evidence.data.problem import Problem, Vault
from taichi_erosion.evidence.inference.map_fit import fit
from taichi_erosion.evidence.inference.marginal_likelihood import expand
from taichi_erosion.evidence.models.prepared_problem import prepare
from tests.evidence.inference.robustness.test_error_accounts import SD, SHAPES, with_silent_source
from tests.evidence.linear_study import linear_problem

SCATTER = 8.0  # of laboratory B over that of laboratory A


def silent_laboratory(strength: float = 1.0, calibrated: bool = True) -> Problem:
    """Rows of laboratory B, which states no sd and scatters by more, in the vault."""
    problem = linear_problem(SHAPES, {"bend": strength}, sd=SD, count=48, calibrated=calibrated)
    problem = with_silent_source(problem, SCATTER)
    rows = np.flatnonzero(np.array(problem.measurements.source) == "laboratory B")
    return replace(problem, vault=Vault(rows.astype(np.int64)))


def predicted(problem: Problem, names: tuple[str, ...]):
    """Visible rows, and what one hypothesis says of the held-out ones."""
    prepared = prepare(problem, problem.visible(), 1)
    held = held_out_problem(prepared)
    best = fit(prepared, names, [np.concatenate([prepared.prior_mean, np.ones(len(names))])])
    return prepared, held_out_prediction(prepared, expand(prepared, best), held)


def rescattered(prepared, told):
    """The prediction with the scatter of silent sources; the fit itself plays no part."""
    ((_, again),), _ = with_silent_sources(prepared, [(None, told)])
    return again


def test_the_scatter_of_held_out_rows_has_the_density_of_a_normal_with_what_calibration_leaves():
    prepared, told = predicted(silent_laboratory(), ("bend",))
    (silent,) = silent_sources(prepared, told.held)
    found = scatter_evidence(prepared, told, silent)
    exact = [
        stats.multivariate_normal(
            told.expansion.mean, f**2 * np.diag(told.held.rows.variance) + told.covariance
        ).logpdf(told.held.rows.z)
        for f in SCATTERS
    ]
    assert found - found.max() == pytest.approx(np.array(exact) - max(exact), abs=1e-6)


def test_the_precision_is_that_of_the_posterior_of_a_scale():
    """Without calibrated numbers f^-2 has a gamma posterior: E = m / sum (e / s)^2, f uniform in ln f."""
    problem = silent_laboratory(strength=0.0, calibrated=False)
    prepared, told = predicted(problem, ())
    again = rescattered(prepared, told)
    unit = (told.held.rows.z - told.expansion.mean) / np.sqrt(told.held.rows.variance)
    factor = again.held.rows.variance / told.held.rows.variance
    assert factor == pytest.approx(np.full(unit.size, np.mean(unit**2)), rel=0.01)


def test_a_source_without_stated_scatter_is_no_misfit_of_its_held_out_rows_and_it_is_said():
    problem = silent_laboratory()
    proof = adopt(problem, ["bend"], 1)
    assert proof.added.vault_chi2_per_row == pytest.approx(1.0, abs=0.35)
    assert proof.base.vault_chi2_per_row > proof.added.vault_chi2_per_row
    assert "laboratory B states no scatter" in proof.sentence


def test_sources_that_state_their_scatter_keep_it():
    problem = silent_laboratory()
    stated = replace(problem.measurements, sd=np.full(48, SD))
    prepared, told = predicted(replace(problem, measurements=stated), ("bend",))
    assert list(silent_sources(prepared, told.held)) == []
    again = rescattered(prepared, told)
    assert again.held.variance == pytest.approx(told.held.variance, rel=1e-12)
