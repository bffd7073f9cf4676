"""Which mechanism could explain a misfit: every one weighed with doses of its own for all conditions.

A mechanism explains a misfit if it is likely enough against the bare model and against a free smooth
discrepancy of every observable, leaves no misfit, and one dose in each set of conditions serves all
observables. Instruments take part: a gain and an offset of every observable, which need no further runs.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy import interpolate

from taichi_erosion.evidence.data.mechanism_findings import (
    BeyondList,
    DoseEstimate,
    DoseLaw,
    MechanismFinding,
)
from taichi_erosion.evidence.data.problem import Mechanism, Observable
from taichi_erosion.evidence.data.transforms import from_scale, to_scale
from taichi_erosion.evidence.inference import verdict_levels as levels
from taichi_erosion.evidence.inference.doses.dose_inference import (
    DoseEvidence,
    again,
    averaged,
    bare_log_evidence,
    curvature,
    dose_evidence,
    first_fit,
    left_p,
    one_dose_p,
)
from taichi_erosion.evidence.inference.doses.dose_laws import dose_law, law_doses, law_rows
from taichi_erosion.evidence.inference.doses.dose_path import DosePath, dose_nodes, dose_path
from taichi_erosion.evidence.inference.pipeline import FittedHypotheses
from taichi_erosion.evidence.inference.posterior import label
from taichi_erosion.evidence.inference.prepared_problem import PreparedProblem
from taichi_erosion.mechanisms.library import load_mechanisms

GAIN, OFFSET = "reading_gain", "reading_offset"  # mechanisms of instruments
OF = ":"  # between such a mechanism and its observable
INSTRUMENT_DOSES = {GAIN: (-0.9, 4.0), OFFSET: (-2.0, 2.0)}
ROUNDS = 10  # in which a path is made anew where the calibrated numbers have moved
STILL = 0.05  # move below which it stays, in prior sd
FARTHEST = 0.5  # move of one round


@dataclass(frozen=True)
class Weighed:
    """One mechanism with its evidence."""

    evidence: DoseEvidence
    log_bayes: float  # against the bare model
    finding: MechanismFinding


def beyond_list(fitted: FittedHypotheses) -> BeyondList:
    """Mechanisms, doses and law for one prepared problem whose misfit no listed effect explains."""
    prepared = fitted.prepared
    free = discrepancy_log_bayes(fitted)
    weighed = [weigh(prepared, path, free) for path in first_paths(fitted)]
    weighed.sort(key=lambda item: (not item.finding.explains, -item.log_bayes))
    top = weighed[0].log_bayes
    findings = tuple(
        replace(item.finding, odds=float(np.exp(np.clip(top - item.log_bayes, -50.0, 50.0))))
        for item in weighed
    )
    group = tuple(f.name for f in findings if f.explains and f.odds <= levels.MECHANISM_ODDS)
    law, doses = law_and_doses(prepared, weighed[0].evidence) if group else (None, ())
    listed, names = listed_log_bayes(fitted)
    verdict = "none" if not group else "mechanism" if len(group) == 1 else "group"
    return BeyondList(verdict, findings, group, free, listed, names, doses, law)


def first_paths(fitted: FittedHypotheses) -> list[DosePath]:
    """Paths of all mechanisms at the best fit of the bare model; those that change nothing are left out."""
    prepared, x = fitted.prepared, fitted.base.fit.x
    paths = [dose_path(prepared, mechanism, x) for mechanism in prepared.problem.mechanisms]
    bare = dose_path(prepared, Mechanism("", 0.0, 0.0), x) if not paths else paths[0]
    for observable, _ in prepared.by_observable():
        paths += [instrument_path(prepared, bare, kind, observable) for kind in INSTRUMENT_DOSES]
    return [path for path in paths if path.curve is not None]


def instrument_path(prepared: PreparedProblem, bare: DosePath, kind: str, observable: Observable) -> DosePath:
    """Path of the gain or the offset of one observable, from its bare values."""
    low, high = INSTRUMENT_DOSES[kind]
    chosen = prepared.rows.which == prepared.rows.observables.index(observable)
    values = from_scale(observable, bare.bare[chosen])
    size = float(np.median(np.abs(from_scale(observable, prepared.rows.z[chosen]))))
    doses, changes = [], []
    for dose in dose_nodes(Mechanism(kind, low, high)):
        change = np.zeros(bare.bare.size)
        read = values * (1.0 + dose) if kind == GAIN else values + dose * size
        with np.errstate(invalid="ignore", divide="ignore"):
            change[chosen] = to_scale(observable, read) - bare.bare[chosen]
        if np.all(np.isfinite(change)):
            doses.append(dose)
            changes.append(change)
    curve = (
        interpolate.PchipInterpolator(np.array(doses), np.array(changes), axis=0) if len(doses) > 1 else None
    )
    ends = (float(doses[0]), float(doses[-1])) if doses else (0.0, 0.0)
    name = f"{kind}{OF}{observable.name}"
    return DosePath(name, bare.x, bare.bare, bare.jacobian, None, *ends, curve)


def weigh(prepared: PreparedProblem, path: DosePath, free: float) -> Weighed:
    """Evidence of one mechanism, from the best fit of the bare model and from the prior mean."""
    nothing = averaged(prepared, bare_log_evidence(prepared, path))
    declared = {mechanism.name: mechanism for mechanism in prepared.problem.mechanisms}
    found = [settled(prepared, path, declared.get(path.name))]
    if path.name in declared and np.max(np.abs(path.x - prepared.prior_mean), initial=0.0) > FARTHEST:
        other = dose_path(prepared, declared[path.name], prepared.prior_mean)
        if other.curve is not None and np.all(np.isfinite(other.bare)):
            found.append(settled(prepared, other, declared[path.name]))
    best = max(found, key=lambda each: averaged(prepared, each.log_evidence))
    gain = averaged(prepared, best.log_evidence) - nothing
    return Weighed(best, gain, finding_of(prepared, best, gain, free))


def settled(prepared: PreparedProblem, path: DosePath, mechanism: Mechanism | None) -> DoseEvidence:
    """Evidence on a path that is made anew until the calibrated numbers stay where it was made."""
    fit = first_fit(prepared, path)
    for _ in range(ROUNDS if mechanism is not None else 0):
        assert mechanism is not None
        move = np.clip(fit.theta[: path.x.size] - path.x, -FARTHEST, FARTHEST)
        x = np.clip(path.x + move, prepared.low, prepared.high)
        if np.max(np.abs(x - path.x), initial=0.0) < STILL:
            break
        made = dose_path(prepared, mechanism, x)
        if made.curve is None or not np.all(np.isfinite(made.bare)):
            break
        path, fit = made, again(prepared, made, fit)
    return dose_evidence(prepared, path, fit)


def finding_of(prepared: PreparedProblem, found: DoseEvidence, gain: float, free: float) -> MechanismFinding:
    """The record of one mechanism."""
    name, _, observable = found.path.name.partition(OF)
    left, one = left_p(found.best), one_dose_p(prepared, found)
    enough = gain > levels.MECHANISM_GAIN and gain > free - levels.MECHANISM_BEHIND
    moved = found.path.change(found.best.doses[found.sets.index])[0]
    moves = tuple(o.name for o, chosen in prepared.by_observable() if np.any(moved[chosen] != 0.0))
    return MechanismFinding(
        name=found.path.name,
        title=load_mechanisms()[name].title + (f" of {observable}" if observable else ""),
        observable=observable,
        log_bayes_factor=gain,
        odds=1.0,
        p_left=left,
        p_one_dose=one,
        moves=moves,
        axis=found.best.prior.axis,
        curvature=curvature(prepared, found),
        explains=bool(enough and not levels.fails(left) and not levels.fails(one)),
    )


def discrepancy_log_bayes(fitted: FittedHypotheses) -> float:
    """Ln Bayes factor of a free smooth discrepancy of every observable against the bare model."""
    prepared, base = fitted.prepared, fitted.base
    bare = averaged(prepared, base.scored.log_evidence)
    return averaged(prepared, base.scored.log_evidence + base.gain) - bare


def listed_log_bayes(fitted: FittedHypotheses) -> tuple[float, str]:
    """Ln Bayes factor of the best listed effects against the bare model, and their names."""
    prepared = fitted.prepared
    bare = averaged(prepared, fitted.base.scored.log_evidence)
    tried = [
        (averaged(prepared, item.scored.log_evidence) - bare, label(item.names))
        for item in fitted.refits
        if item.usable
    ]
    return max(tried, default=(-np.inf, ""))


def law_and_doses(
    prepared: PreparedProblem, evidence: DoseEvidence
) -> tuple[DoseLaw | None, tuple[DoseEstimate, ...]]:
    """Law of the best mechanism, and its doses in every set of conditions."""
    rows = law_rows(prepared, evidence)
    fitted, law = dose_law(rows)
    sets, fit = evidence.sets, evidence.best
    by_law = np.full(prepared.rows.size, np.nan) if fitted is None else law_doses(rows, fitted)
    sd = np.sqrt(np.maximum(np.diag(fit.covariance), 0.0))
    estimates = [
        DoseEstimate(
            {name: float(column[row]) for name, column in prepared.rows.conditions.items()},
            float(fit.doses[k]),
            float(sd[k]),
            float(by_law[row]),
        )
        for k, row in enumerate(sets.first)
    ]
    return law, tuple(estimates)
