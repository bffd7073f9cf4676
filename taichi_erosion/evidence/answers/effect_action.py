"""What an effect of one strength does to the model, all else the same: the value that it moves most."""

import numpy as np

from taichi_erosion.evidence.data.findings import EffectAction
from taichi_erosion.evidence.data.transforms import from_scale
from taichi_erosion.evidence.inference.map_fit import Fit
from taichi_erosion.evidence.inference.prepared_problem import PreparedProblem
from taichi_erosion.evidence.models.predictor import seed_mean


def effect_actions(prepared: PreparedProblem, best: Fit) -> dict[str, EffectAction]:
    """Action of every acting effect of a fit, on the row that it moves most in standard errors."""
    acting, seeds, found = best.acting(), prepared.seeds.signature, {}
    for name in acting:
        rest = {other: strength for other, strength in acting.items() if other != name}
        values = [prepared.predictor.predict(best.x, strengths, seeds) for strengths in (rest, acting)]
        without, with_it = (seed_mean(each) for each in values)
        moved = np.abs(with_it - without) / prepared.sd
        if not np.any(moved > 0.0):
            continue
        row = int(np.nanargmax(moved))
        observable = prepared.rows.observables[prepared.rows.which[row]]
        before, after = (float(from_scale(observable, each[[row]])[0]) for each in (without, with_it))
        conditions = {name: float(column[row]) for name, column in prepared.rows.conditions.items()}
        found[name] = EffectAction(observable.name, conditions, before, after)
    return found
