"""Mean of a model along the dose of one mechanism, at one setting of the calibrated numbers.

The model is asked at a few doses, the same for all rows; between them every row has a monotone cubic of its
own, so that every set of conditions may have another dose without further runs. Beyond its range a dose
changes the mean less and less.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy import interpolate

from taichi_erosion.evidence.data.problem import Candidate, Floats, Mechanism, Numbers
from taichi_erosion.evidence.inference.prepared_problem import PreparedProblem
from taichi_erosion.evidence.models.predictor import Predictor, paired_change, seed_mean

NODES = 13  # doses at which the model is asked
SOFT = 0.05  # of the range, over which a change levels off beyond its ends
STEP = 0.05  # of a calibrated number, in prior sd, for slopes


@dataclass(frozen=True)
class DosePath:
    """Rows at one setting, linear in the calibrated numbers and any function of the dose."""

    name: str
    x: Floats  # (p,), setting of the calibrated numbers, in prior sd
    bare: Floats  # (n,), mean without the mechanism
    jacobian: Floats  # (n, p), of it
    steeper: interpolate.PchipInterpolator | None  # dose -> (n, p) change of the jacobian by the mechanism
    low: float  # range of the dose
    high: float
    curve: interpolate.PchipInterpolator | None  # dose -> (n,) change of the mean; None: it changes nothing

    def change(self, dose: Floats) -> tuple[Floats, Floats]:
        """Change of the mean (n,), and its slope, at one dose for each row."""
        if self.curve is None:
            return np.zeros(dose.size), np.zeros(dose.size)
        inside = np.minimum(np.maximum(dose, self.low), self.high)
        value, slope = row_values(self.curve, inside)
        width = SOFT * (self.high - self.low)
        beyond = (dose - inside) / width
        if not beyond.any():
            return value, slope
        value = value + slope * width * np.tanh(beyond)
        return value, slope / np.cosh(np.clip(beyond, -50.0, 50.0)) ** 2

    def slopes(self, dose: Floats) -> tuple[Floats, Floats]:
        """Derivative of the mean along the calibrated numbers (n, p), and its slope, at doses of the rows."""
        if self.steeper is None or not self.jacobian.size:
            return self.jacobian, np.zeros_like(self.jacobian)
        value, slope = row_values(self.steeper, np.clip(dose, self.low, self.high))
        return self.jacobian + value, slope


def row_values(curve: interpolate.PchipInterpolator, dose: Floats) -> tuple[Floats, Floats]:
    """Value and derivative of curves (..., n, ...) with a dose for each row."""
    nodes, powers = curve.x, curve.c
    piece = np.minimum(np.maximum(nodes.searchsorted(dose, side="right") - 1, 0), nodes.size - 2)
    a, b, c, d = powers[:, piece, np.arange(dose.size)]
    t = (dose - nodes[piece]).reshape(-1, *([1] * (a.ndim - 1)))
    return ((a * t + b) * t + c) * t + d, (3.0 * a * t + 2.0 * b) * t + c


def dose_path(prepared: PreparedProblem, mechanism: Mechanism, x: Floats) -> DosePath:
    """Path of a mechanism at one setting; doses at which the model fails are left out."""
    predictor = replace(
        prepared.predictor, candidates=(*prepared.predictor.candidates, Candidate(mechanism.name)), cache={}
    )
    seeds, doses = prepared.seeds.signature, dose_nodes(mechanism)
    bare = predictor.predict(x, {}, seeds)
    flat = forward_slopes(prepared, predictor, x, {})
    changes, steeper = [], []
    for dose in doses:
        acting = {mechanism.name: float(dose)}
        changes.append(paired_change(predictor.predict(x, acting, seeds), bare, predictor))
        steeper.append(forward_slopes(prepared, predictor, x, acting) - flat)
    table, slopes = np.array(changes), np.array(steeper)
    good = np.all(np.isfinite(table), axis=1)
    doses, table, slopes = doses[good], table[good], slopes[good]
    ends = (float(doses[0]), float(doses[-1])) if doses.size else (0.0, 0.0)
    flat = slopes_at(prepared, x)
    if doses.size < 2 or not table.any():
        return DosePath(mechanism.name, x, seed_mean(bare), flat, None, *ends, None)
    curve = interpolate.PchipInterpolator(doses, table, axis=0)
    bent = interpolate.PchipInterpolator(doses, slopes, axis=0) if slopes.any() else None
    return DosePath(mechanism.name, x, seed_mean(bare), flat, bent, *ends, curve)


def dose_nodes(mechanism: Mechanism) -> Floats:
    """Doses at which the model is asked, closer together near 0, which is one of them."""
    below, above = np.sqrt(max(-mechanism.low, 0.0)), np.sqrt(max(mechanism.high, 0.0))
    count = round((NODES - 1) * below / (below + above))
    roots = np.concatenate(
        [-np.linspace(below, 0.0, count, endpoint=False), np.linspace(0.0, above, NODES - count)]
    )
    return np.sign(roots) * roots**2


def slopes_at(prepared: PreparedProblem, x: Floats) -> Floats:
    """Derivative of the bare mean along every calibrated number, by central differences (n, p)."""
    predictor, seeds, columns = prepared.predictor, prepared.seeds.signature, []
    for index in range(x.size):
        up, down = x.copy(), x.copy()
        up[index] = min(x[index] + STEP, prepared.high[index])
        down[index] = max(x[index] - STEP, prepared.low[index])
        gap = max(up[index] - down[index], 1e-12)
        above, below = (predictor.predict(place, {}, seeds) for place in (up, down))
        columns.append(np.nan_to_num(paired_change(above, below, predictor)) / gap)
    return np.column_stack(columns) if columns else np.zeros((prepared.rows.size, 0))


def forward_slopes(prepared: PreparedProblem, predictor: Predictor, x: Floats, acting: Numbers) -> Floats:
    """The same with a mechanism acting, by differences to one side; their change along the dose is used."""
    seeds, columns = prepared.seeds.signature, []
    here = predictor.predict(x, acting, seeds)
    for index in range(x.size):
        step = STEP if x[index] + STEP <= prepared.high[index] else -STEP
        there = x.copy()
        there[index] += step
        change = paired_change(predictor.predict(there, acting, seeds), here, predictor)
        columns.append(np.nan_to_num(change) / step)
    return np.column_stack(columns) if columns else np.zeros((prepared.rows.size, 0))
