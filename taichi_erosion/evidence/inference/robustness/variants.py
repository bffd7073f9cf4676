"""What an answer hangs on: hypotheses weighed again with other tolerances, priors, errors or rows.

The evidence of every hypothesis changes as in its linear expansion about the fit that it has
(`linear_steps.py`). The likeliest whose linear step is in doubt is fitted again, until none in doubt within
BEHIND of the best is left; hypotheses farther behind keep their linear evidence. The smooth rival and the
chance of the misfit are computed anew. Where an answer is averaged over accounts of the errors, so is every
variant.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from taichi_erosion.evidence.data.findings import NONE, OUTSIDE, Variants
from taichi_erosion.evidence.data.linear_algebra import log_sum_exp
from taichi_erosion.evidence.data.problem import Bools, Floats
from taichi_erosion.evidence.inference import verdict_levels as levels
from taichi_erosion.evidence.inference.map_fit import Fit
from taichi_erosion.evidence.inference.marginal_likelihood import (
    Expansion,
    ScoredHypothesis,
    columns_of,
    log_prior,
)
from taichi_erosion.evidence.inference.model_discrepancy import Kernels, discrepancy_gain
from taichi_erosion.evidence.inference.pipeline import (
    Analysis,
    FittedHypotheses,
    WeighedAccount,
    enough_for_levels,
    level_share,
)
from taichi_erosion.evidence.inference.posterior import Posterior, log_prior_of, mixed
from taichi_erosion.evidence.inference.prepared_problem import PreparedProblem, level_shape
from taichi_erosion.evidence.inference.refit import FittedHypothesis, scored_fit
from taichi_erosion.evidence.inference.robustness.error_accounts import with_variances, worst_row
from taichi_erosion.evidence.inference.robustness.linear_steps import (
    BEHIND,
    LinearStep,
    doubtful_step,
    evidence_by_factor,
    settled,
)
from taichi_erosion.evidence.models.condition_errors import condition_errors

SCALES = (0.5, 2.0)  # of the priors of all strengths
TOLERANCES = (0.0, 2.0)  # of declared tolerances and shared errors
MOST_GROUPS = 12  # that are left out one by one; of more, those with most rows
WORST_ROWS = 2  # that are left out one by one
LEAST_SHARE = 0.01  # probability from which an account of the errors beside the leading one counts

RowSets = list[tuple[str, Bools]]


@dataclass(frozen=True)
class Change:
    """A change of the rows under all hypotheses."""

    before: PreparedProblem
    now: PreparedProblem
    kept: Bools  # (n,), rows before that remain
    family: Kernels  # of the rows that remain


def reweighed(fitted: FittedHypotheses, prepared: PreparedProblem) -> FittedHypotheses:
    """All hypotheses with other variances or shared errors of the same rows."""
    family = fitted.family.rescaled(fitted.prepared.white, prepared.white)
    return changed(fitted, Change(fitted.prepared, prepared, np.ones(prepared.rows.size, np.bool_), family))


def without_rows(fitted: FittedHypotheses, gone: Bools) -> FittedHypotheses:
    """All hypotheses without some rows."""
    before, kept = fitted.prepared, ~gone
    now = shortened(before, kept)
    return changed(fitted, Change(before, now, kept, fitted.family.rescaled(before.white, now.white, kept)))


def shortened(prepared: PreparedProblem, kept: Bools) -> PreparedProblem:
    """Some of the rows; an error that only others share remains as a column of zeros."""
    rows = replace(prepared.rows.rows(kept), shared=prepared.rows.shared[kept])
    return replace(
        prepared,
        rows=rows,
        predictor=prepared.predictor.over(rows.observables, rows.which, rows.conditions),
        seed_variance=prepared.seed_variance[kept],
        variance=prepared.variance[kept],
        condition_errors=condition_errors(rows),
    )


def changed(fitted: FittedHypotheses, change: Change) -> FittedHypotheses:
    """All hypotheses after a change."""
    inclusion = fitted.posterior.inclusion
    found, old = list[FittedHypothesis](), [fitted.base, *fitted.refits]
    for item, evidence in zip(old, fitted.linear_evidence, strict=True):
        likely = not item.names or inclusion.get(item.names[0], 0.0) > levels.REPORTED_RIVAL
        rival = likely and len(item.names) < 2  # a remainder beside an unlikely effect is the one beside none
        found.append(linear(change, item, evidence, rival))
    base, *refits = trusted(change, old, found, max(len(fitted.screened.signatures), 1))
    return replace(fitted, prepared=change.now, base=base, refits=refits, family=change.family)


def linear(change: Change, item: FittedHypothesis, before: Floats, rival: bool) -> FittedHypothesis:
    """A hypothesis after a change, in its linear expansion; a rival has a remainder beside it.

    `before` is its ln evidence in that expansion before the change.
    """
    expansion = expansion_after(change, item.expansion)
    if not item.usable:
        return replace(item, scored=replace(item.scored, expansion=expansion))
    more = evidence_by_factor(change.now, expansion) - before
    scored = ScoredHypothesis(expansion, item.scored.likelihoods, item.scored.log_evidence + more)
    gain = np.full(item.gain.size, -np.inf)
    return FittedHypothesis(scored, discrepancy_gain(change.now, expansion, change.family) if rival else gain)


def expansion_after(change: Change, expansion: Expansion) -> Expansion:
    """The expansion over the rows that remain, with the errors that these share now."""
    kept, own = change.kept, expansion.shared[:, change.before.rows.shared.shape[1] :]
    return replace(
        expansion,
        mean=expansion.mean[kept],
        jacobian=expansion.jacobian[kept],
        paths=tuple(
            replace(
                path, runs=replace(path.runs, change=path.runs.change[:, kept]), change=path.change[:, kept]
            )
            for path in expansion.paths
        ),
        local=expansion.local[kept],
        shared=np.hstack([change.now.rows.shared, own[kept]]),
        moved=expansion.moved[kept],
    )


def trusted(
    change: Change, old: list[FittedHypothesis], found: list[FittedHypothesis], count: int
) -> list[FittedHypothesis]:
    """The same, every hypothesis that counts linear to within TRUSTED about its fit, or fitted again."""
    found, doubtful = list(found), dict[int, LinearStep]()
    for index, item in enumerate(found):
        if item.usable and (step := doubt(change, old[index], item)) is not None:
            doubtful[index] = step
    while doubtful:
        worth = [weight(change.now, item, count) for item in found]
        top = max(doubtful, key=lambda index: worth[index])
        if worth[top] < max(worth) - BEHIND:
            break
        found[top] = weighed_again(change, found[top], doubtful.pop(top))
    return found


def weight(prepared: PreparedProblem, item: FittedHypothesis, count: int) -> float:
    """Ln prior and evidence of a hypothesis among `count` candidates, with and without a remainder."""
    own, doubt = item.scored.log_evidence, prepared.doubt.log_weight
    parts = [log_prior_of(item.names, False, count) + doubt + own]
    if len(item.names) < 2:
        parts.append(log_prior_of(item.names, True, count) + doubt + own + item.gain)
    return float(log_sum_exp(np.concatenate(parts)))


def doubt(change: Change, old: FittedHypothesis, item: FittedHypothesis) -> LinearStep | None:
    """The linear step of a hypothesis where it is in doubt."""
    return doubtful_step(change.before, old.expansion, change.now, item.expansion)


def weighed_again(change: Change, item: FittedHypothesis, step: LinearStep) -> FittedHypothesis:
    """The hypothesis about where the step ends, if the model falls as predicted, else fitted again."""
    prepared = change.now

    def mean(there: Fit) -> Floats:
        whole = change.before.predictor.mean(there.x, there.acting(), prepared.seeds.scoring)
        return whole[change.kept]

    found = settled(prepared, item.expansion, step, mean)
    if isinstance(found, Expansion):
        return replace(item, scored=replace(item.scored, expansion=found))
    again = scored_fit(prepared, found, change.family)
    return again if again.usable else item


@dataclass(frozen=True)
class Variant:
    """One change of the assumptions: in words, and what it makes of the hypotheses."""

    words: str  # "if ..."
    fitted: FittedHypotheses
    freed: FittedHypotheses | None = None  # the same with a free level in place of a shared error not granted

    def posterior(self) -> Posterior:
        """Probabilities; with the free level where that is likelier and leaves nothing unexplained.

        A study that declares no shared error is weighed so too.
        """
        stated = self.fitted.posterior
        other = None if self.freed is None else self.freed.posterior
        if other is None or other.probability[OUTSIDE] > levels.LEVEL_ODDS:
            return stated
        return other if level_share(stated.log_total, other.log_total) > levels.LEVEL_ODDS else stated


def variants(found: Analysis) -> Variants:
    """In how many variants the answer holds, and what it becomes in the others; none of silence."""
    decision = found.decision
    if decision.verdict not in ("present", "group", "outside_library"):
        return Variants(0, 0, ())
    kept, changes = 0, list[str]()
    tried = averaged_variants(found)
    for words, posterior in tried:
        if holds(posterior, decision.verdict, decision.named, decision.group):
            kept += 1
        else:
            changes.append(f"{becomes(posterior)} {words}")
    return Variants(len(tried), kept, tuple(changes))


def averaged_variants(found: Analysis) -> list[tuple[str, Posterior]]:
    """Every variant in words, with its probabilities averaged over the accounts of the errors that count.

    An account that a variant does not concern keeps its probabilities.
    """
    lead = found.fitted
    sets = list(row_sets(lead))
    likely = likely_accounts(found.accounts)
    priors = np.array([each.log_weight - each.account.posterior.log_all for each in likely])
    beside = [
        {one.words: one.posterior() for one in all_variants(each.account.fitted, sets)}
        if each.account.fitted is not lead
        else None
        for each in likely
    ]

    def averaged(words: str, own: Posterior) -> Posterior:
        every = [
            own if table is None else table.get(words, each.account.posterior)
            for each, table in zip(likely, beside, strict=True)
        ]
        logs = priors + np.array([each.log_all for each in every])
        return mixed(own, every, np.exp(logs - log_sum_exp(logs)))

    tried = all_variants(lead, sets)
    return [(variant.words, averaged(variant.words, variant.posterior())) for variant in tried]


def likely_accounts(accounts: Sequence[WeighedAccount]) -> list[WeighedAccount]:
    """The accounts of the errors that have a probability of LEAST_SHARE and more."""
    logs = np.array([each.log_weight for each in accounts])
    share = np.exp(logs - log_sum_exp(logs)) if logs.size else logs
    return [each for each, part in zip(accounts, share, strict=True) if part >= LEAST_SHARE]


def holds(posterior: Posterior, verdict: str, named: Sequence[str], group: Sequence[str]) -> bool:
    """Whether an answer is still what the probabilities say."""
    top = likeliest(posterior)
    if verdict == "outside_library":
        return top == OUTSIDE
    if verdict == "group":
        return bool(set(top.split("+")) & {*named, *group})
    return all(posterior.inclusion[name] >= levels.ALONE for name in named)


def likeliest(posterior: Posterior) -> str:
    """Key of the likeliest explanation."""
    return max(posterior.probability, key=lambda key: posterior.probability[key])


def becomes(posterior: Posterior) -> str:
    """The likeliest explanation in words, with its probability."""
    top = likeliest(posterior)
    words = {NONE: "nothing missing", OUTSIDE: "not in the list"}.get(top, top.replace("+", " and "))
    return f"{words} ({100 * posterior.probability[top]:.0f} %)"


def all_variants(fitted: FittedHypotheses, sets: RowSets) -> Iterator[Variant]:
    """Every change that the study allows."""
    prepared = fitted.prepared
    for scale in SCALES:
        words = f"if all priors of strengths are {scale:g} times as wide"
        yield Variant(words, with_prior_scales(fitted, scale))
    for factor in TOLERANCES:
        for words, other in tolerance_variants(prepared, factor):
            yield Variant(words, reweighed(fitted, other))
        yield from shared_error_variants(fitted, factor)
    for words, rows in sets:
        if not levels.too_few_rows(prepared.rows.size - int(rows.sum()), len(prepared.axes)):
            yield Variant(words, without_rows(fitted, rows))


def tolerance_variants(prepared: PreparedProblem, factor: float) -> Iterator[tuple[str, PreparedProblem]]:
    """Declared tolerances times a factor, observable by observable."""
    rows = prepared.rows
    for index, observable in enumerate(rows.observables):
        own = rows.which == index
        if observable.sd_numerical > 0.0 and own.any():
            part = np.where(own, (observable.sd_numerical * rows.slope) ** 2, 0.0)
            change = 1.0 + (factor**2 - 1.0) * part / rows.variance
            words = f"if the tolerance of {observable.sd_numerical:g} of {observable.name} {said(factor)}"
            yield words, with_variances(prepared, np.maximum(change, 1e-6))


def said(factor: float) -> str:
    """What becomes of a declared error."""
    return "is not granted" if factor == 0.0 else f"is {factor:g} times as large"


def shared_error_variants(fitted: FittedHypotheses, factor: float) -> Iterator[Variant]:
    """Declared shared errors times a factor, observable by observable; none where levels are free already."""
    prepared, rows = fitted.prepared, fitted.prepared.rows
    widths = prepared.level_widths(fitted.base.expansion.mean)
    for observable, own in prepared.by_observable() if not prepared.levels else ():
        if not (observable.sd_shared or observable.sd_shared_relative):
            continue
        column = np.any(rows.shared[own] != 0.0, axis=0) & ~np.any(rows.shared[~own] != 0.0, axis=0)

        def with_column(values: Floats, column: Bools = column) -> FittedHypotheses:
            shared = np.where(column, values, rows.shared)
            return reweighed(fitted, replace(prepared, rows=replace(rows, shared=shared)))

        level = np.where(own, widths[observable.name] * level_shape(observable, rows.z), 0.0)[:, np.newaxis]
        asked = factor == 0.0 and enough_for_levels(prepared)
        words = f"if the declared shared error of {observable.name} {said(factor)}"
        yield Variant(words, with_column(factor * rows.shared), with_column(level) if asked else None)


def row_sets(fitted: FittedHypotheses) -> Iterator[tuple[str, Bools]]:
    """Rows that are left out: each source, each of the largest groups, and the worst rows."""
    rows, units = fitted.prepared.rows, fitted.prepared.problem.measurements.table_units
    for column, word, most in ((rows.source_names, "source", None), (rows.group, "group", MOST_GROUPS)):
        labels = np.array(column)
        names, counts = np.unique(labels, return_counts=True)
        for name in names[np.argsort(-counts, kind="stable")][:most] if names.size > 1 else []:
            at = rows.conditions_at(int(np.flatnonzero(labels == name)[0]))
            unnamed = name == ", ".join(
                f"{value:g}" for value in at.values()
            )  # its conditions name the group
            yield (
                f"without {f'the rows at {units.setting_text(at)}' if unnamed else f'{word} {name}'}",
                labels == name,
            )
    off = list[int]()
    for _ in range(WORST_ROWS):
        row = worst_row(fitted.prepared, fitted.base.expansion, off)
        off.append(row)
        at = units.setting_text({name: float(column[row]) for name, column in rows.conditions.items()})
        yield (
            f"without the row of {rows.observables[rows.which[row]].name} at {at}",
            np.arange(rows.size) == row,
        )


def with_prior_scales(fitted: FittedHypotheses, factor: float) -> FittedHypotheses:
    """All hypotheses with half-normal priors of other widths."""

    def again(item: FittedHypothesis) -> FittedHypothesis:
        if not item.names or not item.usable:
            return item
        listed = [fitted.prepared.candidate(name) for name in item.names]
        paths = tuple(
            replace(path, log_prior=log_prior(path.grid, factor * each.prior_scale, each.maximum))
            for path, each in zip(item.expansion.paths, listed, strict=True)
        )
        prior = columns_of(fitted.prepared, replace(item.expansion, paths=paths)).log_prior
        evidence = np.array([log_sum_exp(each.log_likelihood + prior) for each in item.scored.likelihoods])
        return FittedHypothesis(replace(item.scored, log_evidence=evidence), item.gain)

    return replace(fitted, refits=[again(item) for item in fitted.refits])
