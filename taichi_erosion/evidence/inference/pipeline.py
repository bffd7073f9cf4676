"""All stages of the inference, in order: calibrate, screen, refit, weigh, decide."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from math import nan
from typing import Literal

import numpy as np
from scipy.special import expit, logit

from taichi_erosion.evidence.data.findings import NAMING, NONE, OUTSIDE, SILENT, MisfitPlace
from taichi_erosion.evidence.data.linear_algebra import log_sum_exp
from taichi_erosion.evidence.data.problem import Floats, Progress
from taichi_erosion.evidence.inference import refit
from taichi_erosion.evidence.inference import verdict_levels as levels
from taichi_erosion.evidence.inference.cross_validation import ScoreGain, log_score_gain
from taichi_erosion.evidence.inference.familywise_test import DRAWS, FamilywiseTest, familywise_test, power
from taichi_erosion.evidence.inference.goodness_of_fit import misfit_p, misfit_places, stuck_numbers
from taichi_erosion.evidence.inference.map_fit import Fit, fit, fit_base, fit_free_levels
from taichi_erosion.evidence.inference.marginal_likelihood import expand, score
from taichi_erosion.evidence.inference.model_discrepancy import Kernels, kernels
from taichi_erosion.evidence.inference.posterior import (
    Hypothesis,
    Posterior,
    label,
    log_prior_of,
    mixed,
    posterior_of,
)
from taichi_erosion.evidence.inference.prepared_problem import PreparedProblem, prepare
from taichi_erosion.evidence.inference.refit import FittedHypothesis
from taichi_erosion.evidence.inference.robustness.error_accounts import (
    ErrorAccount,
    Reference,
    error_accounts,
    reference_evidence,
)
from taichi_erosion.evidence.inference.robustness.linear_steps import evidence_by_factor
from taichi_erosion.evidence.inference.screen import Screen, screen
from taichi_erosion.evidence.inference.search.effect_sets import (
    MemberTest,
    Search,
    fit_sets,
    needed_decision,
    with_stronger,
)
from taichi_erosion.evidence.inference.search.enumeration import complete, unvisited_share
from taichi_erosion.evidence.inference.verdict import (
    Decision,
    acting_decision,
    adequate_decision,
    best_hypothesis,
    decide,
    withdrawn,
)
from taichi_erosion.evidence.inference.verdict_levels import UNSTABLE, too_few_rows
from taichi_erosion.evidence.models.predictor import seed_mean

RANKING_DRAWS = 200  # of a null that only ranks
REFERENCES = 3  # sets of effects by which accounts of errors are estimated, beside the bare model


@dataclass(frozen=True)
class FittedHypotheses:
    """All hypotheses fitted on one prepared problem."""

    prepared: PreparedProblem
    base: FittedHypothesis
    screened: Screen
    ranking: FamilywiseTest
    refits: list[FittedHypothesis]
    family: Kernels
    search: Search  # of the refits

    def listed(self) -> list[Hypothesis]:
        """Every explanation with its evidence."""
        return refit.hypotheses(self.prepared, self.base, self.screened, self.ranking, self.refits)

    @cached_property
    def posterior(self) -> Posterior:
        """Probabilities of all explanations."""
        return posterior_of(self.prepared, self.listed())

    @cached_property
    def linear_evidence(self) -> list[Floats]:
        """Ln evidence by noise factor of the bare model and of all refits, linear about their fits.

        That of a hypothesis whose model fails is as it was scored.
        """
        return [
            evidence_by_factor(self.prepared, item.expansion) if item.usable else item.scored.log_evidence
            for item in (self.base, *self.refits)
        ]

    def of(self, names: tuple[str, ...]) -> FittedHypothesis:
        """The fit of a set; the bare model where it was not fitted."""
        return next((item for item in self.refits if item.names == names), self.base)

    def rescored(self, seeds: np.ndarray) -> "FittedHypotheses":
        """The same weighed with other scoring seeds, out of runs that were made already."""
        prepared = replace(
            self.prepared,
            seeds=replace(self.prepared.seeds, scoring=seeds),
            variance=self.prepared.rows.variance + self.prepared.seed_variance / seeds.size,
        )

        def again(item: FittedHypothesis) -> FittedHypothesis:
            mean = mean_over_seeds(prepared, item.fit) + item.expansion.moved
            expansion = replace(item.expansion, mean=mean)
            return refit.scored_expansion(prepared, expansion, self.family)

        refits = [again(item) for item in self.refits]
        return replace(self, prepared=prepared, base=again(self.base), refits=refits)


@dataclass(frozen=True)
class Account:
    """All hypotheses weighed on one account of the errors: as stated, with free levels, or others."""

    fitted: FittedHypotheses
    posterior: Posterior
    test: FamilywiseTest
    p_misfit: float
    places: tuple[MisfitPlace, ...]  # of the bare model, worst first
    warnings: tuple[str, ...]

    @property
    def least(self) -> float:
        """Least chance of a misfit, in the whole or in one place."""
        return min([self.p_misfit, *(place.p for place in self.places)])


@dataclass(frozen=True)
class Analysis:
    """Outcome of all stages."""

    fitted: FittedHypotheses
    test: FamilywiseTest
    posterior: Posterior
    decision: Decision
    final: FittedHypothesis  # the hypothesis whose calibration is reported
    p_misfit: float
    p_misfit_after: float  # of what the final hypothesis leaves
    places: tuple[MisfitPlace, ...]  # of the bare model, worst first
    gains: dict[str, ScoreGain]  # of single effects, over left-out groups
    stability: float
    warnings: tuple[str, ...]
    level_probability: float = 0.0  # that instrument or code is off at all conditions alike
    p_misfit_stated: float = nan  # of the bare model with the stated errors, where levels are free
    range_suffices: bool = False  # the misfit is gone if calibrated numbers may leave their ranges
    errors: ErrorAccount | None = None  # errors other than stated, on which the answer rests
    errors_probability: float = 0.0  # that errors are other than stated, levels apart
    stated: Account | None = None  # with the errors as stated, where the answer rests on others
    members: tuple[MemberTest, ...] = ()  # of a set of three or more, each tested beside the others
    unvisited: Mapping[str, float] = field(default_factory=dict)  # probability of sets not fitted, by effect
    accounts: tuple["WeighedAccount", ...] = ()  # all that were weighed


def analyse(prepared: PreparedProblem, seed: int, progress: Progress) -> Analysis:
    """All stages on one prepared problem.

    Where the model fails, or an effect is seen, everything is weighed once more with the level of every
    observable free: the commonest misfit is an instrument or a code that is off at all conditions alike. Free
    levels that leave something unexplained themselves are no answer. Errors of sources, of batches, of single
    rows and of the scatter compete too. Probabilities are averaged over all accounts, and the likeliest one
    decides what is calibrated.
    """
    stated = account(prepared, seed, progress)
    errors = likely_errors(stated)
    tried = stated_or_free_levels(stated, errors, seed, progress)
    tried += other_errors(stated, errors, seed, progress)
    logs = np.array([each.log_weight for each in tried])
    weight = np.exp(logs - log_sum_exp(logs))
    lead = tried[int(np.argmax(weight))]
    posterior = mixed(lead.account.posterior, [each.account.posterior for each in tried], weight)
    found = replace(
        concluded(lead.account, posterior, seed),
        level_probability=chance_of("levels", tried, weight),
        errors=lead.errors,
        errors_probability=chance_of("errors", tried, weight),
        accounts=tuple(tried),
    )
    if lead.kind == "errors":
        found = replace(found, stated=stated)
    if lead.kind != "stated":
        found = replace(found, p_misfit_stated=stated.p_misfit)
    return with_ranges(found, lead.account)


def confirmed_analysis(prepared: PreparedProblem, seed: int, progress: Progress) -> Analysis:
    """All stages; what a quick budget would tell is asked again with a full one, with the same seed.

    With fewer starts, steps and refits the right effect may stay short of its best fit, and another one is
    named in its place. So a quick budget tells what a full one tells, or less: its silence is not asked
    again. Runs that were made already are not made again.
    """
    found = analyse(prepared, seed, progress)
    if not prepared.quick or found.decision.verdict in SILENT:
        return found
    problem = replace(prepared.problem, budget=replace(prepared.problem.budget, name="full"))
    full, made = prepare(problem, problem.visible(), seed), prepared.predictor
    full.predictor.cache.update(made.cache)
    full.predictor.cost.runs += made.cost.runs
    full.predictor.cost.failures += made.cost.failures
    return analyse(full, seed, progress)


@dataclass(frozen=True)
class WeighedAccount:
    """An account of the errors with the ln of its probability, up to a constant."""

    account: Account
    log_weight: float
    kind: Literal["stated", "levels", "errors"]
    errors: ErrorAccount | None = None


def chance_of(kind: str, tried: list[WeighedAccount], weight: Floats) -> float:
    """Probability of the accounts of one kind."""
    return float(sum(w for w, each in zip(weight, tried, strict=True) if each.kind == kind))


def likely_errors(stated: Account) -> list[ErrorAccount]:
    """Errors that nobody stated which could change the answer, by their linear estimate, likeliest first.

    Of few rows nothing is estimated on their errors.
    """
    prepared = stated.fitted.prepared
    if not levels_matter(stated) or prepared.rows.size < levels.LEAST_ROWS:
        return []
    found = error_accounts(prepared, references(stated))[: levels.MOST_ACCOUNTS]
    return [each for each in found if each.gain > found[0].gain - levels.ACCOUNT_FAR]


def overtaken(stated: Account, errors: list[ErrorAccount]) -> bool:
    """Whether other errors explain the rows far better than levels do, by the linear estimate of both."""
    if not errors:
        return False
    prepared, known = stated.fitted.prepared, references(stated)
    widths = prepared.level_widths(stated.fitted.base.expansion.mean)
    tried = [widths, *({name: width} for name, width in widths.items())]
    found = [reference_evidence(prepared.with_free_levels(each), known) for each in tried]
    gain = max(found) - reference_evidence(prepared, known) + float(logit(levels.PRIOR_LEVEL))
    return gain < errors[0].gain - levels.ACCOUNT_FAR


def stated_or_free_levels(
    stated: Account, errors: list[ErrorAccount], seed: int, progress: Progress
) -> list[WeighedAccount]:
    """Stated errors, and free levels where these could change the answer and leave nothing unexplained.

    Free levels are compared with the stated errors by what measurements do not reject; with other accounts
    both together count by all explanations.
    """
    alone = [WeighedAccount(stated, stated.posterior.log_all, "stated")]
    if not levels_matter(stated) or overtaken(stated, errors):
        return alone
    bare = stated.fitted
    free, best = fit_free_levels(bare.prepared, bare.base.expansion.mean)
    if settled(stated, free, best):
        return alone
    freed = account(free, seed, progress, best)
    if freed.posterior.probability[OUTSIDE] > levels.LEVEL_ODDS:
        return alone
    share = level_share(stated.posterior.log_total, freed.posterior.log_total)
    prior = np.log([1.0 - levels.PRIOR_LEVEL, levels.PRIOR_LEVEL])
    both = float(log_sum_exp(prior + np.array([stated.posterior.log_all, freed.posterior.log_all])))
    with np.errstate(divide="ignore"):
        one, other = both + np.log([1.0 - share, share])
    return [WeighedAccount(stated, float(one), "stated"), WeighedAccount(freed, float(other), "levels")]


def other_errors(
    stated: Account, errors: list[ErrorAccount], seed: int, progress: Progress
) -> list[WeighedAccount]:
    """Everything weighed once more with errors of sources, of batches, of rows or of the scatter.

    Errors that leave something unexplained are no answer.
    """
    base, tried = stated.fitted.base.fit, list[WeighedAccount]()
    for each in errors:
        best = fit(each.prepared, (), [base.x, each.prepared.prior_mean])
        found = account(each.prepared, seed, progress, best)
        if found.posterior.probability[OUTSIDE] <= levels.LEVEL_ODDS:
            tried.append(WeighedAccount(found, each.log_odds + found.posterior.log_all, "errors", each))
    return tried


def references(stated: Account) -> list[Reference]:
    """The bare model and the likeliest sets of effects, by which accounts of errors are estimated."""
    fitted = stated.fitted
    count = max(len(fitted.screened.signatures), 1)

    def total(item: FittedHypothesis) -> float:
        return log_prior_of(item.names, False, count) + refit.total_evidence(fitted.prepared, item)

    usable = sorted((each for each in fitted.refits if each.usable), key=total, reverse=True)
    chosen = [fitted.base, *usable[:REFERENCES]]
    return [Reference(each.expansion, log_prior_of(each.names, False, count)) for each in chosen]


def with_ranges(found: Analysis, leading: Account) -> Analysis:
    """The answer, withdrawn where the bare model with wider ranges explains the rows better than anything.

    A number at an end of its range leaves a misfit that effects imitate: nothing is concluded on these then.
    """
    fitted = leading.fitted
    if not levels.fails(found.p_misfit) or not stuck_numbers(fitted.prepared, fitted.base.expansion):
        return found
    prepared, base = fitted.prepared.with_wide_ranges(), fitted.base.fit
    best = fit(prepared, (), [base.x, prepared.prior_mean])
    wide = score(prepared, expand(prepared, best))
    evidence = np.log(levels.PRIOR_RANGE) + prepared.doubt.averaged(wide.log_evidence)
    suffices = not levels.fails(misfit_p(prepared, wide.expansion)) and evidence > leading.posterior.log_total
    if not suffices:
        return found
    return replace(
        found,
        range_suffices=True,
        decision=Decision("not_testable"),
        final=fitted.base,
        p_misfit_after=found.p_misfit,
    )


def levels_matter(stated: Account) -> bool:
    """Whether free levels could change the answer, and there are rows enough to tell them."""
    enough = enough_for_levels(stated.fitted.prepared)
    return enough and (levels.fails(stated.least) or stated.test.p < levels.FAMILYWISE_LEVEL)


def settled(stated: Account, free: PreparedProblem, best: Fit) -> bool:
    """Whether listed effects explain the rows with stated errors, and free levels alone far less."""
    done = {label(item.names): item for item in stated.fitted.refits if item.usable}
    top = max(done, key=lambda key: stated.posterior.probability.get(key, 0.0), default=None)
    if top is None or stated.posterior.named < levels.SETTLED_NAME:
        return False
    if levels.fails(misfit_p(stated.fitted.prepared, done[top].expansion)):
        return False
    bare = score(free, expand(free, best)).log_evidence
    alone = float(np.log(levels.PRIOR_NONE) + free.doubt.averaged(bare))
    return alone < stated.posterior.log_total - levels.SETTLED_BEHIND


def enough_for_levels(prepared: PreparedProblem) -> bool:
    """Whether there are more rows than calibrated numbers and levels together."""
    return prepared.rows.size > len(prepared.axes) + len(list(prepared.by_observable()))


def level_share(stated: float, freed: float) -> float:
    """Probability that levels are off, from ln evidence with stated errors and with free levels."""
    prior = levels.PRIOR_LEVEL
    return float(expit(freed - stated + np.log(prior / (1.0 - prior))))


def account(
    prepared: PreparedProblem, seed: int, progress: Progress, calibrated: Fit | None = None
) -> Account:
    """Fits, tests and probabilities of all hypotheses, from the bare model where it is calibrated already."""
    progress("calibrating the bare model", 0.05)
    best, warnings = calibrated, list[str]()
    if best is None:
        prepared, best, warnings = fit_base(prepared)
    expansion, family = expand(prepared, best), kernels(prepared)
    base = refit.scored_expansion(prepared, expansion, family)
    progress("making signatures", 0.15)
    screened = screen(prepared, expansion)
    ranking = familywise_test(prepared, screened, np.ones(RANKING_DRAWS), seed)
    names = refit.shortlist(prepared, screened, ranking)
    refits = refit.fit_singles(prepared, screened, names, family, progress)
    search = with_sets(prepared, screened, refits, family, progress)
    if not prepared.quick and refit.none_fits(prepared, list(search.found.values())):
        singles = [item for item in search.found.values() if len(item.names) == 1]
        more = refit.fit_from_other_starts(prepared, screened, singles, family, progress)
        if any(all(item is not known for known in singles) for item in more):
            search = with_sets(prepared, screened, more, family, progress)
    complete(search, screened, base)
    progress("weighing the evidence", 0.9)
    refits = list(search.found.values())
    fitted = FittedHypotheses(prepared, base, screened, ranking, refits, family, search)
    posterior = fitted.posterior
    test = familywise_test(prepared, screened, noise_draws(prepared, posterior, seed), seed)
    p_misfit, places = misfit_p(prepared, expansion), misfit_places(prepared, expansion)
    return Account(fitted, posterior, test, p_misfit, places, tuple(warnings))


def noise_draws(prepared: PreparedProblem, posterior: Posterior, seed: int) -> Floats:
    """Noise factors drawn from their posterior."""
    weight = posterior.noise_weight / posterior.noise_weight.sum()
    return np.random.default_rng(seed + 1).choice(prepared.doubt.factor, size=DRAWS, p=weight)


def with_sets(
    prepared: PreparedProblem,
    screened: Screen,
    singles: list[FittedHypothesis],
    family: Kernels,
    progress: Progress,
) -> Search:
    """Singles, those beyond the list among them, and sets of several effects."""
    singles = [*singles, *with_stronger(prepared, singles, family)]
    return fit_sets(prepared, screened, singles, family, progress)


def concluded(found: Account, posterior: Posterior, seed: int) -> Analysis:
    """The verdict on one account, probabilities averaged over both."""
    fitted, prepared = found.fitted, found.fitted.prepared
    base = fitted.base.expansion
    decision = initial_decision(fitted, posterior, found.test, found.least)
    usable = [item for item in fitted.refits if len(item.names) == 1 and item.usable]
    gains = {item.names[0]: log_score_gain(prepared, base, item.expansion) for item in usable}
    stability, decision = seed_stability(fitted, decision)
    decision, final, p_left = final_decision(fitted, posterior, decision)
    factors = noise_draws(prepared, found.posterior, seed)
    needed, members = needed_decision(fitted.search, decision, factors, seed)
    if needed != decision:
        decision, final = needed, fitted.search.found[fitted.search.sorted(needed.named)]
        p_left = misfit_p(prepared, final.expansion)
    return Analysis(
        fitted,
        found.test,
        posterior,
        decision,
        final,
        found.p_misfit,
        p_left,
        found.places,
        gains,
        stability,
        found.warnings,
        members=tuple(members),
        unvisited=unvisited_share(fitted.search, fitted.screened, fitted.base, found.posterior.log_all),
    )


def initial_decision(
    fitted: FittedHypotheses, posterior: Posterior, test: FamilywiseTest, p_misfit: float
) -> Decision:
    """The first verdict; none where almost anything would explain the rows."""
    if too_few_rows(fitted.prepared.rows.size, len(fitted.prepared.axes)):
        return Decision("not_testable")
    powers = [power(signature.norm, test.threshold) for signature in fitted.screened.signatures]
    return decide(posterior, fitted.refits, test.p, p_misfit, powers)


def final_decision(
    fitted: FittedHypotheses, posterior: Posterior, decision: Decision
) -> tuple[Decision, FittedHypothesis, float]:
    """The verdict, the hypothesis whose calibration is reported, and the chance of what that leaves."""
    names = best_hypothesis(posterior, fitted.refits, decision)
    final = fitted.of(names)
    p_left = misfit_p(fitted.prepared, final.expansion)
    kept = adequate_decision(acting_decision(decision, final), posterior, p_left)
    return (decision, final, p_left) if kept == decision else final_decision(fitted, posterior, kept)


def seed_stability(fitted: FittedHypotheses, decision: Decision) -> tuple[float, Decision]:
    """Share of the two halves of the scoring seeds that agree on the name, and the verdict after that.

    NaN where there is no name, or no noise that could change it.
    A half that is more than even on another name makes the verdict unstable.
    """
    if not fitted.prepared.noisy or decision.verdict not in NAMING:
        return nan, decision
    scoring = fitted.prepared.seeds.scoring
    agree = against = 0
    for seeds in (scoring[: scoring.size // 2], scoring[scoring.size // 2 :]):
        probability = fitted.rescored(seeds).posterior.probability
        top = max(probability, key=lambda key: probability[key])
        same = bool(decision.accepted & set(top.split("+")))
        agree += same
        against += not same and top != NONE and probability[top] > UNSTABLE
    return agree / 2.0, withdrawn(decision) if against else decision


def mean_over_seeds(prepared: PreparedProblem, best: Fit) -> Floats:
    """Mean of a fit over the scoring seeds, out of runs with more seeds where there are any."""
    setting = best.x.tobytes(), tuple(sorted(best.acting().items()))
    for (x, acting, seeds), values in prepared.predictor.cache.items():
        if (x, acting) != setting:
            continue
        drawn = np.frombuffer(seeds, dtype=np.int64)
        if np.isin(prepared.seeds.scoring, drawn).all():
            return seed_mean(values[np.isin(drawn, prepared.seeds.scoring)])
    return prepared.predictor.mean(best.x, best.acting(), prepared.seeds.scoring)
