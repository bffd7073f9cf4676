"""Which mechanism could explain a misfit: every one weighed with doses of its own for all conditions.

A mechanism explains a misfit if it is likely enough against the bare model and against a free smooth
discrepancy of every observable, leaves no misfit, and one dose in each set of conditions serves all
observables. Instruments take part: a gain and an offset of every observable, which need no further runs.

An effect that is named stands beside them too: one that is likelier by `levels.MECHANISM_ODDS` withdraws the
name, others that explain as much are told.
"""

from dataclasses import dataclass, replace
from math import nan
from typing import Protocol

import numpy as np
from scipy import interpolate

from taichi_erosion.evidence.data.findings import NAMING, SILENT, Verdict
from taichi_erosion.evidence.data.mechanism_findings import (
    GAIN,
    OF,
    OFFSET,
    BeyondList,
    DoseEstimate,
    DoseLaw,
    MechanismFinding,
    StrengthTrend,
)
from taichi_erosion.evidence.data.problem import Floats, Integers, Mechanism, Observable
from taichi_erosion.evidence.data.transforms import from_scale, to_scale
from taichi_erosion.evidence.inference import verdict_levels as levels
from taichi_erosion.evidence.inference.doses.dose_inference import (
    DoseEvidence,
    again,
    bare_log_evidence,
    curvature,
    dose_evidence,
    first_fit,
    left_p,
    one_dose_p,
)
from taichi_erosion.evidence.inference.doses.dose_laws import LawRows, dose_law, law_table, rows_about
from taichi_erosion.evidence.inference.doses.dose_path import (
    FARTHEST,
    DosePath,
    dose_nodes,
    dose_path,
    moved_path,
    next_numbers,
    usable,
)
from taichi_erosion.evidence.inference.doses.dose_search import DoseFit
from taichi_erosion.evidence.inference.pipeline import Account, Analysis, FittedHypotheses
from taichi_erosion.evidence.inference.posterior import label
from taichi_erosion.evidence.inference.prepared_problem import PreparedProblem
from taichi_erosion.evidence.inference.refit import total_evidence
from taichi_erosion.evidence.inference.verdict import Decision
from taichi_erosion.mechanisms.library import dose_meaning, load_mechanisms

INSTRUMENT_DOSES = {GAIN: (-0.9, 4.0), OFFSET: (-2.0, 2.0)}
ROUNDS = 10  # in which a path is made anew where the calibrated numbers have moved
STILL = 0.05  # move below which it stays, in prior sd
CHOICES = 2  # of another kernel and amplitude from one start
IN_REACH, CLOSE = 0.5, 0.75  # of the best ln Bayes factor: worth a fit to its end, from a second start too
SLACK = 8.0  # ln behind such a share, within which a mechanism still is


@dataclass(frozen=True)
class NamedRival:
    """Named effects, against which mechanisms are weighed."""

    names: tuple[str, ...]
    log_bayes: float  # against the bare model that mechanisms are weighed against


@dataclass(frozen=True)
class Weighed:
    """One mechanism with its evidence."""

    evidence: DoseEvidence
    log_bayes: float  # against the bare model
    finding: MechanismFinding


def beyond_list(fitted: FittedHypotheses, name: NamedRival | None = None) -> BeyondList:
    """Mechanisms, doses and law for one prepared problem whose misfit no listed effect explains.

    With named effects, which compete, the group holds those that are not less likely by a factor of
    `levels.MECHANISM_ODDS`.
    """
    prepared = fitted.prepared
    free = discrepancy_log_bayes(fitted)
    weighed = weighed_mechanisms(fitted, free, -np.inf if name is None else name.log_bayes)
    weighed.sort(key=lambda item: (not item.finding.explains, -item.log_bayes))
    top = weighed[0].log_bayes
    findings = tuple(
        replace(item.finding, odds=float(np.exp(np.clip(top - item.log_bayes, -50.0, 50.0))))
        for item in weighed
    )
    behind = 0.0 if name is None else name.log_bayes - top  # ln odds of the name
    kept = levels.MECHANISM_ODDS * np.exp(min(-behind, 0.0))
    group = tuple(f.name for f in findings if f.explains and f.odds <= kept)
    law, doses = law_and_doses(prepared, weighed[0].evidence) if group else (None, ())
    listed, names = listed_log_bayes(fitted)
    verdict = "none" if not group else "mechanism" if len(group) == 1 else "group"
    found = BeyondList(verdict, findings, group, free, listed, names, doses, law)
    if name is None:
        return found
    withdrawn = bool(group) and behind < -np.log(levels.MECHANISM_ODDS)
    odds = float(np.exp(np.clip(-behind, -50.0, 50.0)))
    return replace(found, named=name.names, named_odds=odds, withdrawn=withdrawn)


class Chances(Protocol):
    """What an answer leaves unexplained."""

    @property
    def p_misfit(self) -> float: ...
    @property
    def p_misfit_after(self) -> float: ...
    @property
    def range_suffices(self) -> bool: ...


def missing(verdict: Verdict, found: Chances) -> bool:
    """Whether the list explains a misfit with nothing, so that mechanisms are asked."""
    silent = verdict in SILENT and levels.fails(found.p_misfit)
    return verdict == "outside_library" or (silent and not found.range_suffices)


def doubtful(verdict: Verdict, found: Chances, trend: StrengthTrend | None) -> bool:
    """Whether an answer that names effects is worth runs along the doses of mechanisms."""
    return named(verdict) and (trend is not None or found.p_misfit_after < levels.CHALLENGE_LEVEL)


def named(verdict: Verdict) -> bool:
    """Whether an answer names effects, which then stand beside mechanisms where these have values."""
    return verdict in NAMING


def challenge(found: Analysis) -> tuple[Analysis, BeyondList]:
    """The answer after mechanisms were weighed against the effects that it names, and these mechanisms.

    Where the names rest on other errors than stated, mechanisms with the errors as stated come first: these
    errors were estimated so that the list explains the rows, and have their price in the odds.
    """
    if found.stated is not None:
        beyond = beyond_list(found.stated.fitted, named_rival(found, found.stated.fitted))
        if beyond.withdrawn:
            return without_names(with_stated_errors(found, found.stated)), beyond
        if beyond.group:
            return found, beyond
    beyond = beyond_list(found.fitted, named_rival(found, found.fitted))
    return without_names(found) if beyond.withdrawn else found, beyond


def named_rival(found: Analysis, fitted: FittedHypotheses) -> NamedRival:
    """The named effects with the errors of the answer, against the bare model with those of some fits."""
    own = total_evidence(found.fitted.prepared, found.final)
    if fitted is not found.fitted and found.errors is not None:
        own += found.errors.log_odds
    return NamedRival(found.final.names, own - total_evidence(fitted.prepared, fitted.base))


def without_names(found: Analysis) -> Analysis:
    """The answer where a mechanism is far likelier than what it names."""
    decision, base = Decision("outside_library"), found.fitted.base
    return replace(found, decision=decision, final=base, p_misfit_after=found.p_misfit)


def with_stated_errors(found: Analysis, stated: Account) -> Analysis:
    """An answer on the account of the errors as stated."""
    return replace(
        found,
        fitted=stated.fitted,
        test=stated.test,
        posterior=stated.posterior,
        p_misfit=stated.p_misfit,
        p_misfit_stated=nan,
        places=stated.places,
        errors=None,
        errors_probability=0.0,
        stated=None,
        accounts=tuple(each for each in found.accounts if each.kind == "stated"),
    )


def first_paths(fitted: FittedHypotheses) -> list[DosePath]:
    """Paths of all mechanisms at the best fit of the bare model; those that change nothing are left out."""
    prepared, x = fitted.prepared, fitted.base.fit.x
    paths = [dose_path(prepared, mechanism, x) for mechanism in prepared.problem.mechanisms]
    bare = dose_path(prepared, Mechanism("", 0.0, 0.0), x) if not paths else paths[0]
    for observable, _ in prepared.by_observable():
        size = reading_size(prepared, observable)
        paths += [instrument_path(prepared, bare, kind, observable, size) for kind in INSTRUMENT_DOSES]
    return [path for path in paths if path.curve is not None]


def reading_size(prepared: PreparedProblem, observable: Observable) -> float:
    """Median size of the readings of one observable, in its unit: the scale of an offset."""
    chosen = prepared.rows.rows_of(observable)
    return float(np.median(np.abs(from_scale(observable, prepared.rows.z[chosen]))))


def instrument_path(
    prepared: PreparedProblem, bare: DosePath, kind: str, observable: Observable, size: float
) -> DosePath:
    """Path of the gain or the offset of one observable, from its bare values; `size`: scale of an offset."""
    low, high = INSTRUMENT_DOSES[kind]
    chosen = prepared.rows.rows_of(observable)
    values = from_scale(observable, bare.bare[chosen])
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


def weighed_mechanisms(fitted: FittedHypotheses, free: float, named: float) -> list[Weighed]:
    """Evidence of all mechanisms, less exact of those that are far behind the best or the named effects.

    First doses at the bare model's best fit; these brought to their end; the same from the prior mean.
    """
    prepared = fitted.prepared
    declared = {mechanism.name: mechanism for mechanism in prepared.problem.mechanisms}
    begun = [started(prepared, path, declared.get(path.name)) for path in first_paths(fitted)]
    nothing = [bare_evidence(prepared, start.path) for start in begun]
    found = [dose_evidence(start.prepared, start.path, start.fit) for start in begun]

    def gains() -> Floats:
        logs = [prepared.doubt.averaged(each.log_evidence) for each in found]
        return np.array(logs) - np.array(nothing)

    for k in near_the_best(gains(), named, IN_REACH):
        found[k] = finished(begun[k], declared.get(begun[k].path.name))
    for k in near_the_best(gains(), named, CLOSE):
        path = begun[k].path
        if path.name in declared and np.max(np.abs(path.x - prepared.prior_mean), initial=0.0) > FARTHEST:
            found[k] = from_prior_mean(prepared, found[k], declared[path.name])
    return [
        Weighed(each, float(gain), finding_of(prepared, each, float(gain), free))
        for each, gain in zip(found, gains(), strict=True)
    ]


def near_the_best(gains: Floats, named: float, share: float) -> Integers:
    """Mechanisms whose ln Bayes factor is such a share of the best, or of the named effects'."""
    return np.flatnonzero(gains >= share * max(float(gains.max()), named) - SLACK)


def bare_evidence(prepared: PreparedProblem, path: DosePath) -> float:
    """Ln evidence without any dose, on the calibrated numbers of a path."""
    return prepared.doubt.averaged(bare_log_evidence(prepared.with_model_errors(path.x, {}), path))


@dataclass(frozen=True)
class SettledFit:
    """Doses fitted on a path that was made where the calibrated numbers stay."""

    prepared: PreparedProblem  # with the model's own errors there
    path: DosePath
    fit: DoseFit

    def at(self, mechanism: Mechanism, x: Floats) -> "SettledFit":
        """The same on the path at other calibrated numbers; unchanged where the model fails there."""
        return self.on(moved_path(self.prepared, self.path, x, (mechanism, self.fit.doses)))

    def exact(self, mechanism: Mechanism) -> "SettledFit":
        """The same on a path that is exact about the doses."""
        return self.on(dose_path(self.prepared, mechanism, self.path.x, near=self.fit.doses))

    def on(self, path: DosePath) -> "SettledFit":
        """The same on another path; unchanged where the model fails on it."""
        if not usable(path):
            return self
        return SettledFit(self.prepared, path, again(self.prepared, path, self.fit))


def from_prior_mean(prepared: PreparedProblem, found: DoseEvidence, mechanism: Mechanism) -> DoseEvidence:
    """The better of the evidence found, from the bare model's best fit, and that from the prior mean.

    Both are brought to their ends before they are compared: where rows pass a threshold the misfit has
    several minima along the calibrated numbers, and moved paths tell little of their depths.
    """
    path = dose_path(prepared, mechanism, prepared.prior_mean)
    if not usable(path):
        return found
    other = finished(started(prepared, path, mechanism), mechanism)
    return max(found, other, key=lambda each: prepared.doubt.averaged(each.log_evidence))


def finished(found: SettledFit, mechanism: Mechanism | None) -> DoseEvidence:
    """Evidence from one start, kernel and amplitude chosen anew where the calibrated numbers have moved."""
    found = settled_fit(found, mechanism)
    if mechanism is None:
        return dose_evidence(found.prepared, found.path, found.fit)
    evidence = exact_evidence(found, mechanism)
    for _ in range(CHOICES):
        if evidence.best.chosen == found.fit.chosen:
            break
        found = replace(found, path=evidence.path, fit=evidence.best)
        evidence = exact_evidence(found, mechanism)
    return evidence


def exact_evidence(found: SettledFit, mechanism: Mechanism) -> DoseEvidence:
    """Evidence of all kernels and amplitudes, on a path that is exact about the best doses of one."""
    found = settled_fit(found.exact(mechanism), mechanism)
    return dose_evidence(found.prepared, found.path, found.fit)


def started(prepared: PreparedProblem, path: DosePath, mechanism: Mechanism | None) -> SettledFit:
    """First doses on a path; the model's own errors are those at the typical dose."""
    bare = prepared.with_model_errors(path.x, {})
    fit = first_fit(bare, path)
    if mechanism is None:
        return SettledFit(bare, path, fit)
    if bare is not prepared:
        prepared = prepared.with_model_errors(path.x, {path.name: typical_dose(fit)})
    return SettledFit(prepared, path, fit).exact(mechanism)


def settled_fit(found: SettledFit, mechanism: Mechanism | None) -> SettledFit:
    """Doses on a path that is made anew until the calibrated numbers stay where it was made.

    Slopes along these numbers keep their change along the dose meanwhile.
    """
    for _ in range(ROUNDS if mechanism is not None else 0):
        x = next_numbers(found.prepared, found.path, found.fit.theta, STILL)
        if x is None:
            break
        assert mechanism is not None
        made = found.at(mechanism, x)
        if made is found:
            break
        found = made
    return found


def typical_dose(fit: DoseFit) -> float:
    """Root mean square of the doses, with the sign of most of them [1]."""
    size = float(np.sqrt(np.mean(fit.doses**2)))
    return size if float(fit.doses.sum()) >= 0.0 else -size


def finding_of(prepared: PreparedProblem, found: DoseEvidence, gain: float, free: float) -> MechanismFinding:
    """The record of one mechanism."""
    name, _, observable = found.path.name.partition(OF)
    left, one = left_p(found.best), one_dose_p(prepared, found)
    enough = gain > levels.MECHANISM_GAIN and gain > free - levels.MECHANISM_BEHIND
    moved = found.path.change(found.best.doses[found.sets.index])[0]
    moves = tuple(o.name for o, chosen in prepared.by_observable() if np.any(moved[chosen] != 0.0))
    mechanism, scale = load_mechanisms()[name], float("nan")
    if name == OFFSET:
        scale = next(reading_size(prepared, o) for o, _ in prepared.by_observable() if o.name == observable)
    return MechanismFinding(
        name=found.path.name,
        title=mechanism.title + (f" of {observable}" if observable else ""),
        meaning=dose_meaning(mechanism),
        observable=observable,
        log_bayes_factor=gain,
        odds=1.0,
        p_left=left,
        p_one_dose=one,
        moves=moves,
        axis=found.best.prior.axis,
        curvature=curvature(prepared, found),
        explains=bool(enough and not levels.fails(left) and not levels.fails(one)),
        scale=scale,
    )


def discrepancy_log_bayes(fitted: FittedHypotheses) -> float:
    """Ln Bayes factor of a free smooth discrepancy of every observable against the bare model."""
    prepared, base = fitted.prepared, fitted.base
    bare = total_evidence(prepared, base)
    return prepared.doubt.averaged(base.scored.log_evidence + base.gain) - bare


def listed_log_bayes(fitted: FittedHypotheses) -> tuple[float, str]:
    """Ln Bayes factor of the best listed effects against the bare model, and their names."""
    prepared = fitted.prepared
    bare = total_evidence(prepared, fitted.base)
    tried = [
        (total_evidence(prepared, item) - bare, label(item.names)) for item in fitted.refits if item.usable
    ]
    return max(tried, default=(-np.inf, ""))


def law_and_doses(
    prepared: PreparedProblem, evidence: DoseEvidence
) -> tuple[DoseLaw | None, tuple[DoseEstimate, ...]]:
    """Law of the best mechanism, and its doses in every set of conditions."""
    sets, fit, path = evidence.sets, evidence.best, evidence.path
    declared = {mechanism.name: mechanism for mechanism in prepared.problem.mechanisms}
    acting = {path.name: typical_dose(fit)} if path.name in declared else {}
    prepared = prepared.with_model_errors(path.x, acting)

    def remake(x: Floats, dose: Floats, like: DosePath | None) -> LawRows | None:
        if path.name not in declared:
            return None
        if like is None:
            made = dose_path(prepared, declared[path.name], x, near=dose)
        else:
            made = moved_path(prepared, like, x)
        return rows_about(prepared, made, dose) if usable(made) else None

    rows = rows_about(prepared, path, fit.doses[sets.index])
    fitted, law = dose_law(prepared, rows, remake)
    if fitted is not None and law is not None:
        law = replace(law, table=law_table(fitted, prepared.problem.measurements.conditions))
    by_law = np.full(prepared.rows.size, np.nan) if fitted is None else fitted.doses
    sd = np.sqrt(np.maximum(np.diag(fit.covariance), 0.0))
    estimates = [
        DoseEstimate(
            prepared.rows.conditions_at(int(row)), float(fit.doses[k]), float(sd[k]), float(by_law[row])
        )
        for k, row in enumerate(sets.first)
    ]
    return law, tuple(estimates)
