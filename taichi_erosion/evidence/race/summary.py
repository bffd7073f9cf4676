"""A posterior as the record of an answer: what every candidate, number, level and error comes to.

For a signature g of strength 1 about the bare model, with P = V^-1 under nothing and K of the rows alone,

    limit = max(s, 0) + 1.645 i^-1/2,   s = g^T P y / i,   i = g^T P g      (95 % above which it is excluded)
    unseen below 3.3 i^-1/2,   absorption = 1 - (g^T P g / g^T K g)^1/2

Reference: Cowan et al. (2011), Eur. Phys. J. C 71, 1554 (upper limits of a strength that is not negative).
"""

from collections.abc import Iterator
from dataclasses import replace
from math import nan
from typing import Literal

import numpy as np
from scipy import special

from taichi_erosion.evidence.data.comparison_rows import tested_by_repeats
from taichi_erosion.evidence.data.number_words import set_up_name
from taichi_erosion.evidence.data.problem import Floats
from taichi_erosion.evidence.data.transforms import axis_value, from_scale
from taichi_erosion.evidence.models.predictor import axis_scale
from taichi_erosion.evidence.race.decision import Decision, decide
from taichi_erosion.evidence.race.fit import Fit, Hypothesis, Race
from taichi_erosion.evidence.race.posterior import Draws, Posterior, quantiles
from taichi_erosion.evidence.race.priors import KEEP, SURE
from taichi_erosion.evidence.race.record import (
    CostPart,
    Decided,
    EffectPart,
    ErrorPart,
    FitPart,
    Interval,
    LevelPart,
    NumberPart,
    PlacePart,
    Record,
    RepeatPart,
    RowsPart,
    Status,
    Stop,
)

ONE_SIDED = float(special.ndtri(0.95))  # sd beyond which 5 % of a normal distribution lie


def summary(posterior: Posterior, decision: Decision | None = None) -> Record:
    """The record of a race."""
    found, race = decision or decide(posterior), posterior.race
    after, bare, model = told_fit(posterior, found), race.bare, race.model
    stop: Stop = "budget" if race.stopped else ""
    (before, p_before), (now, p_now) = misfit(bare), misfit(after, told=True)
    return Record(
        decided=decided(posterior, found),
        effects={name: effect_part(posterior, found, name) for name in model.candidates},
        numbers=number_parts(posterior),
        levels=tuple(level_parts(posterior)),
        errors=tuple(error_parts(after, race)),
        repeats=tuple(repeat_parts(race, after)),
        fit=FitPart(race.prepared.rows.size, before, now, p_before, p_now, lack_of_fit(race, bare)),
        where=tuple(places(race, bare)),
        rows=rows_part(race, bare, after),
        cost=CostPart(model.settings, race.prepared.predictor.cost.runs, nan, stop),
    )


def told_fit(posterior: Posterior, found: Decision) -> Fit:
    """The likeliest explanation of exactly what is told; of all of them where a group or no set is told."""
    if found.verdict == "none_detected":
        return posterior.race.bare
    named, effects = set(found.named), set(found.inclusion)
    able = [h for h in posterior.probability if h.kind != "?" and {*h.names, *({h.kind} & effects)} == named]
    if found.verdict != "present" or not able:
        return posterior.best
    return posterior.race.fits[max(able, key=lambda h: posterior.probability[h])]


def decided(posterior: Posterior, found: Decision) -> Decided:
    """Probabilities by explanation; a set beside something unlisted counts as the set."""
    named = {*found.inclusion, *found.beyond}
    table: dict[str, float] = {"none": found.none, "outside_library": 0.0}
    for hypothesis, p in posterior.probability.items():
        acting = (*hypothesis.names, *([hypothesis.kind] if hypothesis.kind in named else []))
        if acting or hypothesis.kind == "?":
            key = "+".join(acting) or "outside_library"
            table[key] = table.get(key, 0.0) + p
    return Decided(found.verdict, found.named, found.group, found.mechanisms, table, found.familywise)


def repeat_parts(race: Race, after: Fit) -> Iterator[RepeatPart]:
    """Repeats that disagree grossly, and which of them the told model does not expect."""
    rows = race.prepared.rows
    bad = {(rows.names[i], rows.lines[i][0]) for i in after.evidence.bad}
    for each in rows.apart:
        likely = [line for line in each.suspects if (each.observable, line) in bad]
        found = each.suspects if len(each.suspects) == 1 else likely
        yield RepeatPart(each.observable, each.lines, each.gap, found[0] if len(found) == 1 else 0)


def lack_of_fit(race: Race, bare: Fit) -> float:
    """Chance that repeats scatter as far from the calibrated model as their means do; NaN without repeats."""
    now, p = bare.evidence.solved, race.prepared
    own = p.white(bare.jacobian)
    leverage = np.einsum("ij,jk,ik->i", own, now.inverse[: bare.v.size, : bare.v.size], own)
    return tested_by_repeats(p.rows, p.variance, p.white(p.rows.z - bare.mean), leverage)


def misfit(fit: Fit, told: bool = False) -> tuple[float, float]:
    """Chi-square of the rows with levels, sources and batches at their best, and the chance of as much.

    No smooth discrepancy takes away what is missing; the chance is that of errors of the size that their
    priors expect, and of levels, sources and batches as large as they are `told`.
    """
    now = fit.evidence.solved
    smooth = [k for k, block in enumerate(fit.blocks) if block.kind in ("discrepancy", "unlisted")]
    best = np.where(np.isin(now.rows.block, smooth), 0.0, now.tau * now.centre)
    stated = now.rows.y - now.rows.columns @ best
    shared = [told and name.startswith(("level", "source", "batch")) for name in now.rows.scales.names]
    residual, _ = now.rows.solved(np.where(shared, now.u, now.rows.scales.start)).precision
    chi2 = max(float(now.rows.y @ residual), 0.0)
    return float(now.rows.weight @ stated**2), float(special.chdtrc(now.rows.y.size, chi2))


def interval(values: Floats, weight: Floats) -> Interval:
    """Median and 90 % interval of weighted draws."""
    low, middle, high = quantiles(values, weight)
    return Interval(float(middle), float(low), float(high))


def number_parts(posterior: Posterior) -> dict[str, NumberPart]:
    """Every calibrated number if nothing is missing, and averaged over all explanations."""
    (values, weight), model, bare = posterior.numbers, posterior.race.model, posterior.race.bare
    sd, found = np.sqrt(np.diag(bare.covariance)), {}
    before = np.array([model.unit_values(bare.target + z * sd) for z in (0.0, -ONE_SIDED, ONE_SIDED)])
    least, most = (model.unit_values(np.full(model.count, z)) for z in (-ONE_SIDED, ONE_SIDED))
    for j, axis in enumerate(posterior.race.prepared.axes):
        now = interval(values[:, j], weight)
        low, high = (
            axis_value(axis, end) if np.isfinite(end) else np.sign(end) * np.inf
            for end in (axis.low, axis.high)
        )
        tenth = 0.1 * (high - low)
        at_end = bool(np.isfinite(tenth) and not low + tenth < now.value < high - tenth)
        share = (now.high - now.low) / float(most[j] - least[j])
        told = Interval(*map(float, before[:, j]))
        found[axis.name] = NumberPart(axis_value(axis, 0.0), told, now, share, at_end)
    return found


def effect_part(posterior: Posterior, found: Decision, name: str) -> EffectPart:
    """One candidate, from its explanations and its signature about the bare model."""
    race, most = posterior.race, posterior.race.model.candidates[name].maximum
    bare, single = race.bare, race.fits.get(Hypothesis((name,)))
    strength, share = interval(*posterior.strength(name)), found.inclusion[name]
    if single is None:
        return EffectPart("untestable", share, strength, nan, 0.0, 1.0, nan, most=most)
    column = race.prepared.white(signature(race, single, name))
    action, gram = bare.evidence.solved.against(column[:, np.newaxis])
    alone = float(column @ (bare.evidence.solved.row_share * column))
    information = max(float(gram[0, 0]), 1e-12)
    sd = information**-0.5
    factor = single.log_evidence - bare.log_evidence
    absorption = 1.0 - (information / alone) ** 0.5 if alone > 0.0 else 1.0
    limit = max(float(action[0]) / information, 0.0) + ONE_SIDED * sd
    alike = tuple(other for other in found.group if other != name) if name in found.group else ()
    along = next((h.along for h, p in posterior.probability.items() if h.kind == name and p > 0.5), "")
    status, unseen = status_of(name, found, factor, limit, most, absorption), 2.0 * ONE_SIDED * sd
    return EffectPart(status, share, strength, limit, factor, absorption, unseen, alike, along, most)


def signature(race: Race, single: Fit, name: str) -> Floats:
    """Change of the rows (n,) per unit of strength, about the fit of the effect alone."""
    t = float(single.v[-1])
    rise = (race.model.strength(name, t + 0.05) - race.model.strength(name, t - 0.05)) / 0.1
    return single.jacobian[:, -1] / max(rise, 1e-9)


def status_of(
    name: str, found: Decision, factor: float, limit: float, most: float, absorption: float
) -> Status:
    """What these measurements say of a candidate."""
    if name in found.named:
        return "present"
    if factor > -np.log(KEEP) and found.verdict == "outside_library":
        return "better_but_not_sufficient"
    if name in found.group or found.inclusion[name] > 1.0 - SURE:
        return "open"
    if limit < 1.0 and factor < 0.0:
        return "excluded"
    return "untestable" if absorption > SURE or limit > most else "open"


def level_parts(posterior: Posterior) -> Iterator[LevelPart]:
    """Level of every observable, averaged over all explanations, where more likely off than not."""
    race = posterior.race
    weight = np.concatenate([each.weight for each in posterior.draws])
    for observable, own in race.prepared.by_observable():
        sizes = np.concatenate([level_of(each, observable.name) for each in posterior.draws])
        chance = float(weight @ (np.abs(sizes) > 0.5)) / float(weight.sum())
        if chance > 0.5:
            name = "offset" if observable.transform == "identity" else "factor"
            values = np.median(race.prepared.sd[own]) * sizes
            values = np.exp(values) if name == "factor" else values
            yield LevelPart(observable.name, name, interval(values, weight), chance)


def level_of(draws: Draws, observable: str) -> Floats:
    """Draws of a level, in standard errors of a row."""
    index = [(b.kind, b.observable) for b in draws.fit.blocks].index(("level", observable))
    return draws.values[:, int(np.argmax(draws.fit.evidence.solved.rows.block == index))]


def error_parts(fit: Fit, race: Race) -> Iterator[ErrorPart]:
    """Errors of sources, batches, rows and scatter that the likeliest explanation finds, beyond 90 %."""
    now, rows = fit.evidence.solved, race.prepared.rows
    for index, block in enumerate(fit.blocks):
        if block.kind in ("source", "batch"):
            yield from shared_parts(block.kind, fit, index, race)
    for row in sorted(fit.evidence.bad):
        half = ONE_SIDED * float(race.prepared.sd[row])
        scale, expected = rows.observables[rows.which[row]], fit.mean[row] + np.array([0.0, half, -half])
        gap = from_scale(scale, rows.z[row]) - from_scale(scale, expected)
        yield ErrorPart("row", rows.names[row], str(rows.lines[row][0]), Interval(*gap.tolist()))
    _, curvature = now.derivatives()
    spread = np.sqrt(np.diag(np.linalg.inv(curvature)))
    for j in range(now.rows.blocks, now.u.size):
        low, middle, high = (float(np.exp(now.u[j] + z * spread[j])) for z in (-ONE_SIDED, 0.0, ONE_SIDED))
        if low > 1.0 or high < 1.0:
            name = now.rows.scales.names[j].removeprefix("scatter ")
            yield ErrorPart("scatter", name, "", Interval(middle, low, high))


def batch_label(race: Race, group: str) -> str:
    """A group; the conditions of one that is named by them alone, with their units."""
    rows, units = race.prepared.rows, race.prepared.problem.measurements.table_units
    at = rows.conditions_at(rows.group.index(group))
    return units.setting_text(at).replace(" = ", " ") if group == set_up_name(at.values()) else group


def shared_parts(kind: Literal["source", "batch"], fit: Fit, index: int, race: Race) -> Iterator[ErrorPart]:
    """How far rows of one source or batch lie from all others of their observable; of two, the second."""
    now, block, rows = fit.evidence.solved, fit.blocks[index], race.prepared.rows
    at, count = np.flatnonzero(now.rows.block == index), np.sum(block.columns > 0.0, axis=0)
    best, root = (now.tau * now.centre)[at], now.tau[at]
    covariance = now.inverse[np.ix_(at, at)] * np.outer(root, root)
    named = np.array([label.rpartition("|")[2] for label in block.labels])
    for j, column in enumerate(block.columns.T):
        others = (named == named[j]) & (np.arange(named.size) != j)
        rest = int(np.sum(np.array(rows.names) == named[j])) - count[j]
        gap = np.where(others, -count / rest, 0.0)
        gap[j] = 1.0
        value, sd = float(gap @ best), float(np.sqrt(gap @ covariance @ gap))
        told = others.sum() == 1 and int(np.argmax(others)) > j and count[others][0] == rest
        if abs(value) > max(ONE_SIDED * sd, 1.0) and not told:
            size = float(np.max(column)) / float(np.median(rows.slope[column > 0.0]))
            ends = [size * (value + z * sd) for z in (0.0, -ONE_SIDED, ONE_SIDED)]
            label = block.labels[j].rpartition("|")[0]
            label = batch_label(race, label) if kind == "batch" else label
            yield ErrorPart(kind, str(named[j]), label, Interval(*ends))


def places(race: Race, bare: Fit) -> Iterator[PlacePart]:
    """Trends of the bare model's residual along every condition, as one more column each (Holm)."""
    rows, found = race.prepared.rows, []
    kept = [b for b in bare.blocks if b.kind != "discrepancy"]
    linear, _ = race.linear(replace(bare, blocks=tuple(kept)))
    u = bare.evidence.solved.scales_of(linear.scales)
    u[linear.blocks :] = np.minimum(u[linear.blocks :], 0.0)
    solved = linear.solved(u)
    for observable, own in race.prepared.by_observable():
        for name, values in rows.conditions.items():
            axis = axis_scale(values[own])
            if axis is None:
                continue
            column = race.prepared.white(np.where(own, axis(values), 0.0))
            along, gram = solved.against(column[:, np.newaxis])
            z = float(along[0] / np.sqrt(max(gram[0, 0], 1e-12)))
            found.append((2.0 * float(special.ndtr(-abs(z))), observable.name, name, 1 if z > 0.0 else -1))
    least = 0.0  # an adjusted p is no smaller than those before it
    for rank, (p, observable, name, sign) in enumerate(sorted(found)):
        least = max(least, min(1.0, p * (len(found) - rank)))
        yield PlacePart(observable, name, sign, least)


def rows_part(race: Race, bare: Fit, after: Fit) -> RowsPart:
    """Measured and predicted values in the units of the observables."""
    rows, columns = race.prepared.rows, []
    sd = race.prepared.sd / np.maximum(rows.slope, 1e-300)
    half = np.where(np.isfinite(rows.reach), rows.reach, 0.0)
    for values in (rows.z, rows.z - half, rows.z + half, bare.mean, after.mean):
        column = np.empty(rows.size)
        for observable, own in race.prepared.by_observable():
            column[own] = from_scale(observable, values[own])
        columns.append(column)
    measured, low, high, before, told = columns
    low, high = np.where(rows.reach == -np.inf, -np.inf, low), np.where(rows.reach == np.inf, np.inf, high)
    return RowsPart(rows.names, rows.conditions, measured, low, high, sd, before, told)
