"""Search of the hypotheses: nothing, sets of effects, each with or without what no list holds.

A set grows by one effect from the best sets of its size, and each member of the best set is tried against
every other effect. Whatever has been fitted when the budget of settings is spent is an answer.

    P(set of k) = (1 - nothing - unlisted) step^k / sum_j step^j / C(m, k)

Reference: Madigan & Raftery (1994), J. Am. Stat. Assoc. 89, 1535 (only what is not far less likely than the
best is visited).
"""

from collections.abc import Iterable
from dataclasses import replace
from math import comb, log

import numpy as np

from taichi_erosion.evidence.data.problem import Floats
from taichi_erosion.evidence.race.adequacy import is_adequate
from taichi_erosion.evidence.race.blocks import AND, EACH_SET_UP
from taichi_erosion.evidence.race.fit import OUTSIDE, UNLISTED, Fit, Hypothesis, Race, log_joint
from taichi_erosion.evidence.race.priors import CARRIED, KEEP, MOST, SHARED, STRAIGHT, SURE, Priors
from taichi_erosion.tables.number_columns import (
    column_affects_result,
    steps_of_one_sign,
    variance_left_by_parabola,
    vary_together,
)


def prior(race: Race, hypothesis: Hypothesis, priors: Priors) -> float:
    """Prior of all hypotheses with as many effects, alone or beside the same kind of what no list holds.

    That is a mechanism where the model declares some, or one step more unlikely; of each set-up, and along
    two conditions, one more.
    """
    size, others, step = len(hypothesis.names), hypothesis.extra, priors.step
    size += EACH_SET_UP in others or AND in hypothesis.along
    if others:
        part = step if UNLISTED & {*others} else (1.0 - step) * step ** (len(others) - 1)
        return priors.unlisted * (1.0 - step) * step**size * (part if race.prepared.problem.mechanisms else 1)
    if not size:
        return priors.nothing
    whole = sum(step**k for k in range(1, min(MOST, len(race.model.candidates)) + 1))
    return (1.0 - priors.nothing - priors.unlisted) * step**size / whole


def log_prior_of(race: Race, hypothesis: Hypothesis) -> float:
    """Ln prior of a set of effects, alone or beside what no list holds."""
    whole = prior(race, hypothesis, race.priors) / comb(len(race.model.candidates), len(hypothesis.names))
    alike = [key for key in race.large if (AND in key) == (AND in hypothesis.along) and key != EACH_SET_UP]
    return log(whole / (len(alike) if hypothesis.extra else 1))


def search_effect_sets(race: Race) -> None:
    """Nothing, singles, sets grown from the best ones, and each beside something that is not in the list."""
    bare = race.fit_bare_model(log(race.priors.nothing))
    add_unlisted_effect(race, bare)
    add_every_effect(race, bare)
    race.all_singles = True
    for single in race.effect_sets(1):
        race.optimise_setting(single)
    for size in range(1, min(MOST, len(race.model.candidates))):
        grow_sets_by_one_effect(race, size)
    prune_sets_of_effects(race)
    likeliest = [fit.hypothesis for fit in race.likeliest_fits(KEEP)]
    best = [each for each in likeliest if each.names and not each.extra][:3]
    sets = {*best, *(each.without(name) for each in best for name in each.names)}
    for each in sorted(sets & (race.fits.keys() - {race.bare.hypothesis}), key=lambda each: each.names):
        add_unlisted_effect(race, race.fits[each])
    grow_sets_beside_unlisted(race)
    visits = {race.bare.hypothesis}  # calibrated to the end already, as for `compare`
    for _ in range(2):
        for fit in race.likeliest_fits(KEEP)[:CARRIED]:
            if fit.hypothesis not in visits:
                visits.add(fit.hypothesis)
                race.polish(fit)


def add_every_effect(race: Race, parent: Fit) -> None:
    for name in race.model.candidates:
        hypothesis = Hypothesis(tuple(sorted((*parent.hypothesis.names, name))))
        if name not in parent.hypothesis.names and hypothesis not in race.fits:
            if (fit := race.add_effect(parent, name, log_prior_of(race, hypothesis))) is not None:
                race.store_fit(fit)


def add_unlisted_effect(race: Race, parent: Fit, places: Iterable[str] | None = None) -> None:
    """A set beside what is not in the list, along all conditions and each, or what set-ups differ in."""
    for along in [each for each in race.large if AND not in each] if places is None else places:
        blocks = race.large[along]
        hypothesis = Hypothesis(parent.hypothesis.names, (along if along == EACH_SET_UP else OUTSIDE,), along)
        if hypothesis not in race.fits and any(block.kind == "unlisted" for block in blocks):
            most, price = 0 if along == EACH_SET_UP else 2, log_prior_of(race, hypothesis)
            start = replace(parent, hypothesis=hypothesis, log_prior=price, blocks=blocks)
            race.store_fit(race.gauss_newton(race.fit_at_scales(start, 10, fresh=True), most))


def grow_sets_beside_unlisted(race: Race) -> None:
    """Sets beside what is not in the list along conditions that no effect reads, grown by what is likelier.

    Only where something unlisted may act: a large one hides from plain sets what a listed effect does.
    """
    share = race.posterior_probabilities()
    if sum(p for h, p in share.items() if h.extra) < 1.0 - SURE:
        return
    add_unlisted_effect(race, race.bare, race.large)
    starts = [fit for h, fit in race.fits.items() if h.extra == (OUTSIDE,) and not h.names]
    for best in [fit for fit in starts if can_tell_apart(race, fit)]:
        for _ in range(min(MOST, len(race.model.candidates))):
            wider = [best]
            for name in [each for each in race.model.candidates if each not in best.hypothesis.names]:
                hypothesis = replace(best.hypothesis, names=tuple(sorted((*best.hypothesis.names, name))))
                fit = race.add_effect(best, name, log_prior_of(race, hypothesis))
                if fit is not None and can_tell_apart(race, fit):
                    wider.append(race.store_fit(fit))
            if (now := max(wider, key=log_joint)) is best:
                break
            best = race.optimise_setting(now)


def can_tell_apart(race: Race, fit: Fit) -> bool:
    """Whether what is unlisted beside effects can do nothing of what these do.

    It acts along conditions that no effect reads, of which none imitates an effect.
    """
    places = [*filter(None, fit.hypothesis.along.split(AND))]
    if OUTSIDE not in fit.hypothesis.extra:
        return True
    slopes = fit.jacobian[:, race.model.count :].T
    alike = any(imitates(race, place, each) for place in places for each in slopes)
    return bool(places) and {*places} <= {*race.prepared.problem.unread} and not alike


def imitates(race: Race, condition: str, change: Floats) -> bool:
    """Whether a condition that no effect reads makes a change of the rows.

    One that varies with a condition that an effect reads, or a dose with a control, shows it in three values.
    """
    conditions, unread = race.prepared.rows.conditions, race.prepared.problem.unread
    column = np.nan_to_num(conditions[condition])
    others = [x for name, x in conditions.items() if name not in unread]
    is_set = np.min(column) == 0.0 or any(vary_together(column, x) for x in others)
    return can_make_change(column, change, 2 if is_set else 4)


def can_make_change(column: Floats, change: Floats, least: int) -> bool:
    """Whether a bent line that rises or falls with a column makes a change of the rows, not by chance.

    Or it rises or falls with the change at every step, of `least`: of four, by chance at p = 2 / 5!. Rows
    alike in both count once: repeats show nothing of it.
    """
    column, change = np.unique([column, change], axis=1)
    if steps_of_one_sign(column, change) >= least:
        return True
    same = np.zeros(change.size)
    acts = column_affects_result(column, change, same) and abs(np.corrcoef(column, change)[0, 1]) > STRAIGHT
    return bool(acts) and variance_left_by_parabola(change, column, same) < 1.0 - SHARED


def grow_sets_by_one_effect(race: Race, size: int) -> None:
    """Sets of one more effect than `size`, from the best of that size, then swaps of the best of them."""
    for parent in best_sets(race, size, 0.1 * KEEP, MOST - size):
        add_every_effect(race, parent)
    for fit in [each for each in best_sets(race, size + 1, 0.2 * KEEP, 6) if not each.is_optimum]:
        race.optimise_setting(fit)
    for fit in best_sets(race, size + 1, 10.0 * KEEP, 1):
        for name in fit.hypothesis.names:
            if (rest := race.fits.get(fit.hypothesis.without(name))) is not None:
                add_every_effect(race, rest)
        for near in [each for each in best_sets(race, size + 1, 0.2 * KEEP, 4) if not each.is_optimum]:
            race.optimise_setting(near)


def best_sets(race: Race, size: int, least: float, most: int) -> list[Fit]:
    """The best sets of one size, likely ones alone where the rows do not refute the best of all.

    Where all are refuted, one that is far behind may be the nearest to what is right.
    """
    plain = race.effect_sets()
    fits = sorted(race.effect_sets(size), key=lambda fit: -fit.log_evidence)
    total = float(np.logaddexp.reduce([*map(log_joint, plain)]))
    if is_adequate(max(plain, key=lambda fit: fit.log_evidence)):
        fits = [fit for fit in fits if log_joint(fit) > total + log(least)]
    return fits[:most]


def prune_sets_of_effects(race: Race) -> None:
    """Sets without one member of the best, fitted from its optimum, until none of them is better."""
    best = None
    while best is not (now := max(race.effect_sets(), key=log_joint)):
        best = now
        for name in best.hypothesis.names if len(best.hypothesis.names) > 1 else ():
            race.fit_without_effect(best, name, log_prior_of(race, best.hypothesis.without(name)))
