"""Test of an answer by fresh runs: do simulations at the fitted numbers say what their emulator has said?

The explanation that is told, the likeliest one that contradicts it, and the bare model are judged again, each
with the mean of fresh runs in place of the emulator's mean, and with the scatter of that mean in place of the
emulator's errors; slopes and paths along strengths stay. An answer is contradicted where its odds over
another fall below those that a name needs although as many runs of a right emulator would have kept them, or
where an emulator is off by more than its stated errors (`levels.EMULATOR_LEVEL`, Holm-adjusted).

Reference: Holm (1979), Scand. J. Stat. 6, 65.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from math import log, nan, sqrt

import numpy as np

from taichi_erosion.evidence.data.findings import NAMING
from taichi_erosion.evidence.data.fresh_findings import (
    EmulatorGap,
    FreshCheck,
    FreshRows,
    FreshSetting,
    Outcome,
    Role,
)
from taichi_erosion.evidence.data.problem import Floats, Progress
from taichi_erosion.evidence.data.transforms import from_scale, slope
from taichi_erosion.evidence.emulator.fresh_runs import FreshCampaign, FreshRuns, GapTest, Request, Setting
from taichi_erosion.evidence.inference import verdict_levels as levels
from taichi_erosion.evidence.inference.goodness_of_fit import chi_square
from taichi_erosion.evidence.inference.marginal_likelihood import Expansion, score
from taichi_erosion.evidence.inference.pipeline import Analysis
from taichi_erosion.evidence.inference.posterior import log_prior_of
from taichi_erosion.evidence.inference.prepared_problem import PreparedProblem
from taichi_erosion.evidence.inference.refit import FittedHypothesis
from taichi_erosion.evidence.inference.verdict import IDLE, Decision, withdrawn

Simulate = Callable[[Sequence[Setting], Sequence[Request], Floats, Progress], FreshCampaign]
MOST_FAILED = 0.5  # share of the runs, above which nothing is concluded [1]


@dataclass(frozen=True)
class Rival:
    """An explanation beside the one that is told, with ln of the odds of that over it."""

    item: FittedHypothesis
    role: Role
    needed: float  # least ln odds of a name
    emulated: float
    expected: float  # by as many fresh runs, were the emulator right
    simulated: float
    alone: tuple[float, ...]  # of every seed alone

    @property
    def contradicts(self) -> bool:
        """Whether fresh runs take the odds away that they could have confirmed."""
        return self.expected >= self.needed > self.simulated

    @property
    def undecided(self) -> bool:
        """Whether these runs are too few or scatter too much to confirm the odds."""
        return self.expected < self.needed


def can_be_tested(found: Analysis) -> bool:
    """Whether an answer names something that an emulator has found."""
    return found.decision.verdict in NAMING and bool(found.final.names)


def fresh_check(found: Analysis, simulate: Simulate, progress: Progress) -> tuple[FreshCheck, frozenset[str]]:
    """What fresh runs say about an answer that names effects, and the keys of these runs."""
    prepared, told = found.fitted.prepared, found.final
    others = contenders(found)
    items = [told, *(item for item, _ in others)]
    settings = [Setting(*prepared.predictor.setting(each.fit.x, each.fit.acting())) for each in items]
    made = simulate(settings, prepared.predictor.requests, weight_of(prepared, items), progress)
    if not made.runs:
        return FreshCheck("not_made", needed=len(made.keys)), frozenset()
    rivals = [
        rival_of(found, item, role, (made.runs[0], own))
        for (item, role), own in zip(others, made.runs[1:], strict=True)
    ]
    gaps = adjusted([gap_of(prepared, each.tests) for each in made.runs])
    rows = zip(items, made.runs, gaps, [None, *rivals], strict=True)
    agree = [min(odds) > 0.0 for odds in zip(*(rival.alone for rival in rivals), strict=True)]
    check = FreshCheck(
        outcome_of(rivals, gaps, made),
        tuple(fresh_setting(prepared, *each) for each in rows),
        agreement=float(np.mean(agree)),
        runs=len(made.keys),
        seeds=made.seeds,
        failed=made.failed,
        rows={
            role_of(rival): fresh_rows(prepared, runs)
            for rival, runs in zip([None, *rivals], made.runs, strict=True)
        },
    )
    return check, made.keys


def outcome_of(rivals: Sequence[Rival], gaps: Sequence[EmulatorGap | None], made: FreshCampaign) -> Outcome:
    """The verdict on the answer."""
    if made.failed > MOST_FAILED * len(made.keys) or gaps[0] is None:
        return "undecided"
    off = any(gap is not None and gap.p < levels.EMULATOR_LEVEL for gap in gaps)
    if off or any(rival.contradicts for rival in rivals):
        return "contradicted"
    return "undecided" if any(rival.undecided for rival in rivals) else "confirmed"


def contenders(found: Analysis) -> list[tuple[FittedHypothesis, Role]]:
    """The likeliest explanation that contradicts the answer, where there is one, and the bare model."""
    fitted = found.fitted
    count = len(fitted.screened.signatures)
    against = [
        each
        for each in fitted.refits
        if each.usable and acts(each) and contradicts(found.decision, each.names)
    ]
    best = max(against, key=lambda each: log_total(fitted.prepared, each, count), default=None)
    bare: tuple[FittedHypothesis, Role] = (fitted.base, "bare")
    return [bare] if best is None else [(best, "runner_up"), bare]


def acts(item: FittedHypothesis) -> bool:
    """Whether all effects of a set act at its fit: otherwise it is a smaller set, or the bare model."""
    return bool(item.names) and min(item.fit.acting().values()) >= IDLE


def contradicts(decision: Decision, names: tuple[str, ...]) -> bool:
    """Whether a set of effects lacks what a verdict states: all that is sure, and one of its group."""
    return not set(decision.named) <= set(names) or not decision.accepted & set(names)


def weight_of(prepared: PreparedProblem, items: Sequence[FittedHypothesis]) -> Floats:
    """How far the explanations lie apart in every row, in sd of the measurement."""
    first = items[0].expansion.mean
    return sum(
        (np.abs(each.expansion.mean - first) / prepared.sd for each in items[1:]), np.zeros(first.size)
    )


def rival_of(found: Analysis, item: FittedHypothesis, role: Role, runs: tuple[FreshRuns, FreshRuns]) -> Rival:
    """Odds of what is told over another explanation, by the emulator and by fresh runs of both."""
    prepared, told, count = found.fitted.prepared, found.final, len(found.fitted.screened.signatures)

    def odds(means: Sequence[Floats], factor: float = 1.0) -> float:
        own, other = (
            log_total(prepared, each, count, with_runs(prepared, each, mean, factor * run.columns))
            for each, mean, run in zip((told, item), means, runs, strict=True)
        )
        return own - other

    means = [where_simulated(each, run) for each, run in zip((told, item), runs, strict=True)]
    emulated = log_total(prepared, told, count) - log_total(prepared, item, count)
    needed = log(levels.least_odds(role == "bare"))
    if found.decision.verdict == "group" or emulated < needed:
        needed = 0.0
    size = runs[0].values.shape[0]
    return Rival(
        item,
        role,
        needed,
        emulated,
        odds(means),
        odds([run.mean for run in runs]),
        tuple(odds([run.values[k] for run in runs], sqrt(size)) for k in range(size)),
    )


def where_simulated(item: FittedHypothesis, runs: FreshRuns) -> Floats:
    """Mean of the emulator at the conditions as stated, NaN where there is no fresh run."""
    return np.where(np.isfinite(runs.mean), item.expansion.mean - item.expansion.moved, np.nan)


def log_total(
    prepared: PreparedProblem, item: FittedHypothesis, count: int, expansion: Expansion | None = None
) -> float:
    """Ln of prior times marginal likelihood, with another mean where an expansion is given."""
    evidence = item.scored.log_evidence if expansion is None else score(prepared, expansion).log_evidence
    prior = log_prior_of(item.names, False, count) + (log(levels.PRIOR_BEYOND) if item.fit.beyond else 0.0)
    return prior + prepared.doubt.averaged(evidence)


def with_runs(prepared: PreparedProblem, item: FittedHypothesis, mean: Floats, columns: Floats) -> Expansion:
    """An expansion about simulated means with their errors; rows without them keep those of the emulator."""
    expansion, known = item.expansion, np.isfinite(mean)
    own = prepared.predictor.model_errors(expansion.fit.x, expansion.fit.acting())
    before = prepared.rows.shared.shape[1]
    shared = [
        expansion.shared[:, :before],
        np.where(known[:, np.newaxis], 0.0, own),
        expansion.shared[:, before + own.shape[1] :],
        np.where(known[:, np.newaxis], columns, 0.0),
    ]
    found = np.where(known, np.nan_to_num(mean) + expansion.moved, expansion.mean)
    return replace(expansion, mean=found, shared=np.hstack(shared))


def fresh_setting(
    prepared: PreparedProblem,
    item: FittedHypothesis,
    runs: FreshRuns,
    gap: EmulatorGap | None,
    rival: Rival | None,
) -> FreshSetting:
    """The record of one explanation; without a rival it is the one that is told."""
    n = prepared.rows.size
    simulated = with_runs(prepared, item, runs.mean, runs.columns)
    emulated = with_runs(prepared, item, where_simulated(item, runs), runs.columns)
    return FreshSetting(
        role_of(rival),
        item.names,
        chi_square(prepared, emulated) / n,
        chi_square(prepared, simulated) / n,
        nan if rival is None else rival.emulated,
        nan if rival is None else rival.simulated,
        nan if rival is None else rival.expected,
        gap,
    )


def role_of(rival: Rival | None) -> Role:
    """What an explanation is to the answer."""
    return "told" if rival is None else rival.role


def fresh_rows(prepared: PreparedProblem, runs: FreshRuns) -> FreshRows:
    """Simulated values of all rows in the units of their observables."""
    values, sd = np.full(prepared.rows.size, nan), np.linalg.norm(runs.columns, axis=1)
    for observable, chosen in prepared.by_observable():
        values[chosen] = from_scale(observable, runs.mean[chosen])
        sd[chosen] /= slope(observable, values[chosen])
    return FreshRows(values, np.where(np.isfinite(values), sd, nan))


def gap_of(prepared: PreparedProblem, tests: Mapping[str, GapTest]) -> EmulatorGap | None:
    """The least likely gap among the observables of one explanation, its p adjusted for their number."""
    if not tests:
        return None
    name, worst = min(tests.items(), key=lambda item: item[1].p)
    at = prepared.rows.conditions_at(worst.row)
    known = {key: value for key, value in at.items() if np.isfinite(value)}
    told = (worst.emulated, worst.emulated_sd, worst.simulated, worst.simulated_sd)
    return EmulatorGap(name, known, *told, p=min(len(tests) * worst.p, 1.0))


def adjusted(gaps: Sequence[EmulatorGap | None]) -> list[EmulatorGap | None]:
    """Gaps with their chances adjusted for the number of explanations (Holm)."""
    found, least = list(gaps), 0.0
    told = [(gap.p, k, gap) for k, gap in enumerate(gaps) if gap is not None]
    for rank, (p, k, gap) in enumerate(sorted(told, key=lambda each: each[:2])):
        least = max(least, min((len(told) - rank) * p, 1.0))
        found[k] = replace(gap, p=least)
    return found


def after_check(found: Analysis, check: FreshCheck) -> Analysis:
    """The analysis with the verdict that fresh runs leave, and the share of seeds that agree."""
    decision = found.decision
    if check.outcome == "contradicted":
        decision = withdrawn(decision)
    return replace(found, decision=decision, stability=check.agreement)
