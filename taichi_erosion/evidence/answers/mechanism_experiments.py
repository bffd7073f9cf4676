"""What to measure next where mechanisms are left: the experiments that tell them apart.

Every mechanism predicts with the doses that the present measurements give it, carried to new conditions by
the Gaussian process of its doses: between measured conditions it is certain, beyond them it is not. Listed
effects that are named beside them take part. The measurements are chosen as for effects.

Reference: Rasmussen & Williams (2006), Gaussian processes for machine learning, section 2.2.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from taichi_erosion.evidence.answers.finding_sentences import separation_sentence
from taichi_erosion.evidence.answers.next_experiments import (
    DesignPool,
    RivalPrediction,
    design_pool,
    proposals,
    rival_prediction,
    weighted,
)
from taichi_erosion.evidence.data.findings import Discovery, Proposals
from taichi_erosion.evidence.data.mechanism_findings import BeyondList, MechanismFinding
from taichi_erosion.evidence.data.problem import Floats, Laboratory, Mechanism, Problem
from taichi_erosion.evidence.inference.doses.dose_inference import LEVEL, DoseEvidence
from taichi_erosion.evidence.inference.doses.dose_path import DosePath, dose_path
from taichi_erosion.evidence.inference.doses.mechanism_search import (
    OF,
    finished,
    from_prior_mean,
    instrument_path,
    reading_size,
    started,
)
from taichi_erosion.evidence.inference.map_fit import fit_base
from taichi_erosion.evidence.inference.prepared_problem import PreparedProblem, prepare
from taichi_erosion.evidence.models.predictor import axis_scale

MOST_MECHANISMS = 5  # that take part, likeliest first
NOTHING = "No condition varies, or every setting within the ranges of the laboratory is measured already."


def mechanism_experiments(problem: Problem, found: Discovery, laboratory: Laboratory) -> Proposals | None:
    """Experiments between mechanisms; None where fewer than two explanations are left."""
    beyond = found.beyond
    if beyond is None or len(beyond.group) + bool(beyond.named and not beyond.withdrawn) < 2:
        return None
    prepared, base, _ = fit_base(prepare(problem, problem.visible(), found.seed))
    pool = design_pool(prepared, laboratory) if prepared.rows.conditions else None
    if pool is None:
        return Proposals((), {}, NOTHING)
    left = [each for each in beyond.mechanisms if each.name in beyond.group][:MOST_MECHANISMS]
    rivals = [mechanism_rival(prepared, pool, each, base.x) for each in left]
    rivals += named_rivals(prepared, pool, found, beyond)
    rivals = weighted([rival for rival in rivals if rival is not None])
    if len(rivals) < 2:
        return Proposals((), {}, separation_sentence(left[0].title, {e.title: 0.0 for e in left[1:]}, ()))
    return proposals(pool, rivals, replace(found, probabilities={}))


def named_rivals(
    prepared: PreparedProblem, pool: DesignPool, found: Discovery, beyond: BeyondList
) -> Sequence[RivalPrediction]:
    """The named effects, where they are not withdrawn."""
    if beyond.withdrawn or not beyond.named:
        return []
    named = [each for each in found.survivors if each.names == beyond.named]
    weight = 1.0 / max(beyond.named_odds, 1e-12)
    return [replace(rival_prediction(prepared, pool, each), weight=weight) for each in named]


def mechanism_rival(
    prepared: PreparedProblem, pool: DesignPool, finding: MechanismFinding, x: Floats
) -> RivalPrediction | None:
    """Predictions of one mechanism on the pool; None where the model gives none."""
    declared = {mechanism.name: mechanism for mechanism in prepared.problem.mechanisms}
    mechanism = declared.get(finding.name)
    path = path_at(prepared, prepared, mechanism, finding, x)
    if path.curve is None:
        return None
    evidence = finished(started(prepared, path, mechanism), mechanism)
    if mechanism is not None:
        evidence = from_prior_mean(prepared, evidence, mechanism)
    there = replace(prepared, rows=pool.rows, predictor=pool.predictor, variance=np.ones(pool.rows.size))
    ahead = path_at(prepared, there, mechanism, finding, evidence.path.x)
    if ahead.curve is None:
        return None
    mean, root = predicted(prepared, there, evidence, ahead)
    errors = pool.predictor.model_errors(evidence.path.x, {})
    return RivalPrediction(finding.title, 1.0 / finding.odds, mean, np.hstack([root, errors]))


def path_at(
    prepared: PreparedProblem,
    there: PreparedProblem,
    mechanism: Mechanism | None,
    finding: MechanismFinding,
    x: Floats,
) -> DosePath:
    """Path of a mechanism, or of an instrument, over some rows."""
    if mechanism is not None:
        return dose_path(there, mechanism, x)
    kind, _, name = finding.name.partition(OF)
    observable = prepared.rows.observable(name)
    bare = dose_path(there, Mechanism("", 0.0, 0.0), x)
    return instrument_path(there, bare, kind, observable, reading_size(prepared, observable))


@dataclass(frozen=True)
class CarriedDoses:
    """Doses at new conditions as a linear function of the coefficients of the process."""

    weights: Floats  # (new, r), of the coefficients f
    rest: Floats  # (new, k), root of the covariance that no measured dose determines


def predicted(
    prepared: PreparedProblem, there: PreparedProblem, evidence: DoseEvidence, ahead: DosePath
) -> tuple[Floats, Floats]:
    """Mean of the rows `there`, and a root of its covariance."""
    fit, carried = evidence.best, carried_doses(prepared, there, evidence)
    count, size = ahead.x.size, fit.prior.factor.shape[1]
    coefficients = fit.theta[-size:]
    dose = carried.weights @ coefficients
    change, slope = ahead.change(dose)
    jacobian, _ = ahead.slopes(dose)
    mean = ahead.bare + jacobian @ (fit.theta[:count] - ahead.x) + change
    design = np.zeros((there.rows.size, fit.theta.size))
    design[:, :count] = jacobian
    design[:, -size:] = slope[:, np.newaxis] * carried.weights
    precision = fit.columns.T @ fit.columns + np.eye(fit.theta.size)
    known = np.linalg.solve(np.linalg.cholesky(precision), design.T).T
    root = np.hstack([known, slope[:, np.newaxis] * carried.rest])
    return mean, np.asarray(root, dtype=np.float64)


def carried_doses(prepared: PreparedProblem, there: PreparedProblem, evidence: DoseEvidence) -> CarriedDoses:
    """Doses at new conditions, given those of the measured ones.

    With K = L L^T of the measured sets and k of new and measured ones, psi' = k K^-1 psi = lambda M f with
    M = k L (L^T L)^-1, and the covariance lambda^2 (K' - M M^T) is left.
    """
    fit, sets = evidence.best, evidence.sets
    old, new = dose_axes(prepared, prepared, fit.prior.axis), dose_axes(prepared, there, fit.prior.axis)
    old = old[sets.first]
    factor, length = fit.prior.factor, fit.prior.length
    cross, own = (kernel(new, each, length) for each in (old, new))
    solved = np.linalg.solve(factor.T @ factor, (cross @ factor).T)
    weights = np.asarray(solved.T, dtype=np.float64)
    values, vectors = np.linalg.eigh(own - weights @ weights.T)
    rest = vectors * np.sqrt(np.maximum(values, 0.0))
    return CarriedDoses(fit.amplitude * weights, fit.amplitude * rest)


def dose_axes(prepared: PreparedProblem, there: PreparedProblem, axis: str) -> Floats:
    """Standardised conditions (rows, axes) of a kernel, on the scale of the measured rows."""
    columns = []
    for name, column in prepared.rows.conditions.items():
        scale = axis_scale(column)
        if scale is not None and axis in ("", name):
            columns.append(scale(there.rows.conditions[name]))
    return np.column_stack(columns) if columns else np.zeros((there.rows.size, 1))


def kernel(one: Floats, other: Floats, length: float) -> Floats:
    """Covariance of doses at amplitude 1, their common level with it."""
    square = np.zeros((one.shape[0], other.shape[0]))
    for k in range(one.shape[1]):
        square += ((one[:, k, np.newaxis] - other[np.newaxis, :, k]) / length) ** 2
    return np.exp(-0.5 * square) + LEVEL
