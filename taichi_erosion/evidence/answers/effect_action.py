"""What an effect of one strength does to the model, all else the same: where it acts most, and which way."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from taichi_erosion.evidence.data.findings import EffectAction, OpposedSign
from taichi_erosion.evidence.data.problem import Floats
from taichi_erosion.evidence.data.transforms import from_scale
from taichi_erosion.evidence.inference.map_fit import Fit
from taichi_erosion.evidence.inference.prepared_problem import PreparedProblem
from taichi_erosion.evidence.models.predictor import seed_mean

VISIBLE = 1.0  # standard errors of a row; what an effect moves by less, the measurements do not show
WAYS = {1: ("lowers", "raised"), -1: ("raises", "lowered")}  # by what is expected


@dataclass(frozen=True)
class Moved:
    """Values of the model at all rows without an effect and with it, on the scale of the fit."""

    effect: str
    without: Floats
    acting: Floats


def moved_rows(prepared: PreparedProblem, best: Fit) -> Iterator[Moved]:
    """Every acting effect of a fit that moves anything."""
    acting, seeds = best.acting(), prepared.seeds.signature
    for name in acting:
        rest = {other: strength for other, strength in acting.items() if other != name}
        values = [prepared.predictor.predict(best.x, strengths, seeds) for strengths in (rest, acting)]
        without, with_it = (seed_mean(each) for each in values)
        if np.any(without != with_it):
            yield Moved(name, without, with_it)


def effect_actions(prepared: PreparedProblem, best: Fit) -> dict[str, EffectAction]:
    """Action of every acting effect of a fit, on the row that it moves most in standard errors."""
    found = {}
    for moved in moved_rows(prepared, best):
        row = int(np.nanargmax(np.abs(moved.acting - moved.without) / prepared.sd))
        observable = prepared.rows.observable_at(row)
        before, after = (
            float(from_scale(observable, each[[row]])[0]) for each in (moved.without, moved.acting)
        )
        at = prepared.rows.conditions_at(row)
        found[moved.effect] = EffectAction(observable.name, at, before, after)
    return found


def opposed_signs(prepared: PreparedProblem, best: Fit) -> tuple[OpposedSign, ...]:
    """Observables that effects of a fit move against their sources, by `VISIBLE` standard errors or more.

    The farthest row and the sum of all have to go against it. Scales of the fit grow with values.
    """
    found = []
    stated = {candidate.name: candidate.expected for candidate in prepared.problem.candidates}
    names = [each.name for each in prepared.rows.observables]
    for moved in moved_rows(prepared, best):
        change = (moved.acting - moved.without) / prepared.sd
        for observable, sign in stated.get(moved.effect, ()):
            if observable not in names:
                continue
            against = -sign * change[prepared.rows.which == names.index(observable)]
            farthest = float(np.nanmax(against, initial=0.0))
            if min(farthest, float(np.nansum(against))) >= VISIBLE:
                told = opposed_sentence(moved.effect, observable, sign, farthest)
                found.append(OpposedSign(moved.effect, observable, sign, farthest, told))
    return tuple(found)


def opposed_sentence(effect: str, observable: str, expected: int, moved_sd: float) -> str:
    """The disagreement in words."""
    here, there = WAYS[expected]
    return (
        f"In this model {effect} {here} {observable}, by up to {moved_sd:.2g} standard errors, where its "
        f"source has it {there}: check the set-up before you trust the name."
    )
