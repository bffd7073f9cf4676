"""Posterior of the race: probabilities of explanations, and draws of everything unknown, averaged over them.

    p(v, u | y) = sum_h P(h | y) p(u | y, h) N(v; c_h(u), C_h(u))

The scales u are drawn from a t distribution about their best values and weighted by their true density, so
that a level which data do not see keeps its tail and widens the numbers that it could hide in.

References: Hoeting et al. (1999), Stat. Sci. 14, 382 (averaging over models); Geweke (1989), Econometrica 57,
1317 (importance sampling with a t distribution).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from taichi_erosion.core.errors import BadInput
from taichi_erosion.evidence.data.problem import MOST_SETTINGS, Floats, Measurements, Problem, Progress
from taichi_erosion.evidence.models.prepared_problem import prepare_problem
from taichi_erosion.evidence.models.run_store import BudgetSpentError
from taichi_erosion.evidence.race.adequacy import misfit_p_value
from taichi_erosion.evidence.race.doses import fit_all_mechanisms
from taichi_erosion.evidence.race.expansion import RaceModel
from taichi_erosion.evidence.race.fit import UNLISTED, Fit, Hypothesis, Race
from taichi_erosion.evidence.race.linear_evidence import LinearPosterior
from taichi_erosion.evidence.race.priors import DRAWS, FAMILYWISE, KEEP, PRIORS, SEED, Priors
from taichi_erosion.evidence.race.search import log_prior_of, search_effect_sets

SCALES = 60  # draws of the scales of one hypothesis
FREEDOM = 4.0  # degrees of freedom of the t distribution of the scales


@dataclass(frozen=True)
class Draws:
    """Draws of all that is unknown in one hypothesis."""

    fit: Fit
    values: Floats  # (m, q), coefficients of all columns of its linear rows
    weight: Floats  # (m,), of all hypotheses together their sum is 1


def draw_scales(
    best: LinearPosterior, probability: float, random: np.random.Generator, each: int = 0
) -> list[tuple[LinearPosterior, Floats, float]]:
    """Solutions at drawn scales, with so many draws (each, q) of all coefficients, and weights."""
    spread = np.linalg.cholesky(np.linalg.inv(best.gradient_and_curvature()[1]))
    scales, log_weight = [], []
    for k in range(SCALES):
        step = random.standard_normal(best.u.size) if k else np.zeros(best.u.size)
        stretch = np.sqrt(FREEDOM / random.chisquare(FREEDOM))
        u = np.clip(best.u + spread @ step * stretch, -8.0, 8.0)
        try:
            now = best.rows.at_scales(u)
            root = np.linalg.cholesky(now.inverse)
        except np.linalg.LinAlgError:
            continue
        length = float(step @ step) * stretch**2
        log_weight.append(now.value + 0.5 * (FREEDOM + best.u.size) * np.log1p(length / FREEDOM))
        scales.append((now, (now.centre + random.standard_normal((each, now.tau.size)) @ root.T) * now.tau))
    share = np.exp(np.array(log_weight) - np.max(log_weight))
    share = np.minimum(share, 0.1 * share.sum())  # no draw stands for more than a tenth of all
    weights = probability * share / share.sum()
    return [(*draw, weight) for draw, weight in zip(scales, weights, strict=True) if weight > 0.0]


@dataclass(frozen=True)
class Posterior:
    race: Race
    probability: dict[Hypothesis, float]

    def likely_hypotheses(self, least: float = KEEP) -> dict[Hypothesis, float]:
        """Hypotheses, by default worth another run of the model, with probabilities of which the sum is 1."""
        shares = {h: p for h, p in self.probability.items() if p > least}
        return {h: p / sum(shares.values()) for h, p in shares.items()}

    @cached_property
    def draws(self) -> list[Draws]:
        draws_of_fits, random = list[Draws](), np.random.default_rng(SEED)
        for h, share in self.likely_hypotheses(1e-3).items():
            fit, each = self.race.fits[h], max(4, int(DRAWS * share / SCALES))
            _, values, weights = zip(*draw_scales(fit.evidence.solution, share, random, each), strict=True)
            draws_of_fits.append(Draws(fit, np.vstack(values), np.repeat(np.array(weights) / each, each)))
        return draws_of_fits

    @cached_property
    def number_draws(self) -> tuple[Floats, Floats]:
        """Calibrated numbers (m, p) in their units, and weights (m,)."""
        count, unit_values = self.race.model.count, self.race.model.numbers_in_units
        values = np.array([unit_values(v) for each in self.draws for v in each.values[:, :count]])
        return values, np.concatenate([each.weight for each in self.draws])

    @property
    def best_fit(self) -> Fit:
        return self.race.fits[max(self.probability, key=lambda h: self.probability[h])]

    def draw_numbers_and_strengths(self, count: int) -> dict[str, Floats]:
        """Draws of equal weight: calibrated numbers, and strengths, 0 where an effect has no single one."""
        numbers, weight = self.number_draws
        names = list(self.race.model.candidates)
        picked = np.random.default_rng(SEED).choice(weight.size, count, p=weight / weight.sum())
        keys = [axis.name for axis in self.race.prepared.parameter_axes] + names
        return dict(zip(keys, np.vstack([numbers.T, *map(self.strengths, names)])[:, picked], strict=True))

    def strength_draws(self, name: str) -> tuple[Floats, Floats]:
        """Strength of an effect where it acts with one strength, and weights."""
        values = self.strengths(name)
        return values[values > 0.0], np.concatenate([each.weight for each in self.draws])[values > 0.0]

    def strengths(self, name: str) -> Floats:
        """Strengths of an effect in all draws; 0 where it has no single one."""
        model, values = self.race.model, list[float]()
        for each in self.draws:
            if name in (names := each.fit.hypothesis.names):
                column = each.values[:, model.count + names.index(name)]
                values += [model.strength(name, v) for v in column]
            else:
                values += [0.0] * each.weight.size
        return np.array(values)


def quantiles(values: Floats, weight: Floats, shares: Sequence[float] = (0.05, 0.5, 0.95)) -> Floats:
    """Quantiles of weighted draws; NaN without any."""
    if not values.size:
        return np.full(len(shares), np.nan)
    return np.quantile(values, shares, weights=weight, method="inverted_cdf")


def infer(
    problem: Problem,
    seed: int,
    table: Measurements | None = None,
    most: float = MOST_SETTINGS,
    progress: Progress = lambda _, __: None,
    bare: bool = False,
    priors: Priors = PRIORS,
) -> Posterior:
    """The posterior of all explanations of a table, by default the rows outside the vault.

    `bare` leaves out all that could be missing, with the same seeds. `most` settings of the model may be
    evaluated; what is known when they are spent is the answer, and `Race.out_of_budget` says so.
    """
    prepared = prepare_problem(problem, problem.visible_rows() if table is None else table, seed)
    if bare:
        nothing = replace(problem, candidates=(), mechanisms=())
        prepared = replace(prepared, problem=nothing, predictor=replace(prepared.predictor, candidates=()))
    race = Race(prepared, RaceModel(prepared, most, progress, priors))
    try:
        search_effect_sets(race)
        if problem.mechanisms and (problem.dosed_by_row or has_unexplained_misfit(race)):
            fit_all_mechanisms(race)
    except BudgetSpentError:
        race.out_of_budget = True
        if not race.all_singles:
            early = "the budget of runs ends before the model is calibrated and every effect tried once"
            raise BadInput(f"{early}: raise budget.runs") from None
    race.model.most_settings = np.inf
    return Posterior(race, race.posterior_probabilities())


def condition_on_effects(posterior: Posterior, effects: Sequence[str]) -> Posterior:
    """The posterior if exactly these effects act, each with one strength."""
    race, names = posterior.race, tuple(sorted(effects))
    fit = race.bare
    for name in names:
        hypothesis = Hypothesis(tuple(sorted((*fit.hypothesis.names, name))))
        fit_with = race.fits.get(hypothesis) or race.add_effect(fit, name, log_prior_of(race, hypothesis))
        if fit_with is None:
            raise BadInput(f"{name} changes nothing in this model at the measured conditions")
        fit = fit_with if fit_with.is_optimum else race.optimise_setting(fit_with)
    return restrict_hypotheses(race, lambda h: h.names == names and {*h.extra} <= UNLISTED)


def restrict_hypotheses(race: Race, wanted: Callable[[Hypothesis], bool]) -> Posterior:
    """The posterior if one of some hypotheses is true."""
    share = {h: p for h, p in race.posterior_probabilities().items() if wanted(h)}
    total = max(sum(share.values()), 1e-300)
    return Posterior(race, {h: p / total for h, p in share.items()})


def has_unexplained_misfit(race: Race) -> bool:
    """Whether listed effects leave something open: they are unlikely, or need errors larger than expected.

    Until mechanisms are tried, what is not in the list has their prior too.
    """
    listed = [fit for fit in race.likeliest_fits(0.0) if not fit.hypothesis.extra]
    share = race.posterior_probabilities()
    listed_share = sum(share[fit.hypothesis] for fit in listed)
    unlisted = (1.0 - listed_share) / (race.priors.step if race.prepared.problem.mechanisms else 1.0)
    is_unlikely = listed_share < race.priors.nothing * (listed_share + unlisted)
    return is_unlikely or misfit_p_value(listed[0], levels=False) < FAMILYWISE
