"""Mean of a model along the dose of one mechanism, at one setting of the calibrated numbers.

The model is asked at some doses, the same for all rows, closer together where a row would be off otherwise;
between them every row has a monotone cubic of its own, so that every set of conditions may have another dose
without further runs. Beyond its range a dose changes the mean less and less.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy import interpolate

from taichi_erosion.evidence.data.problem import Bools, Candidate, Floats, Integers, Mechanism, Numbers
from taichi_erosion.evidence.inference.prepared_problem import PreparedProblem
from taichi_erosion.evidence.models.predictor import Predictor, paired_change, seed_mean

NODES = 13  # doses at which the model is asked first
MOST_NODES = 49  # after doses between them
TOLERANCE = 0.1  # of a change between two doses, over the sd of the row [1]
SOFT = 0.05  # of the range, over which a change levels off beyond its ends
STEP = 0.05  # of a calibrated number, in prior sd, for slopes
FARTHEST = 0.5  # move of calibrated numbers, in prior sd, over which slopes hold


@dataclass(frozen=True)
class DosePath:
    """Rows at one setting, linear in the calibrated numbers and any function of the dose."""

    name: str
    x: Floats  # (p,), setting of the calibrated numbers, in prior sd
    bare: Floats  # (n,), mean without the mechanism
    jacobian: Floats  # (n, p), of it
    steeper: interpolate.PPoly | None  # dose -> (n, p) change of the jacobian by the mechanism
    low: float  # range of the dose
    high: float
    curve: interpolate.PPoly | None  # dose -> (n,) change of the mean; None: it changes nothing

    def change(self, dose: Floats) -> tuple[Floats, Floats]:
        """Change of the mean (..., n), and its slope, at one dose for each row."""
        if self.curve is None:
            return np.zeros_like(dose), np.zeros_like(dose)
        inside = np.minimum(np.maximum(dose, self.low), self.high)
        value, slope = row_values(self.curve, inside)
        width = SOFT * (self.high - self.low)
        beyond = (dose - inside) / width
        if not beyond.any():
            return value, slope
        value = value + slope * width * np.tanh(beyond)
        return value, slope / np.cosh(np.clip(beyond, -50.0, 50.0)) ** 2

    def over(self, chosen: Bools) -> "DosePath":
        """Changes of the mean of some rows."""
        curve = None if self.curve is None else interpolate.PPoly(self.curve.c[:, :, chosen], self.curve.x)
        parts = (self.bare[chosen], self.jacobian[chosen], None, self.low, self.high, curve)
        return DosePath(self.name, self.x, *parts)

    def slopes(self, dose: Floats) -> tuple[Floats, Floats]:
        """Derivative of the mean along the calibrated numbers (..., n, p), and its slope, at doses."""
        if self.steeper is None or not self.jacobian.size:
            flat = np.broadcast_to(self.jacobian, (*dose.shape, self.jacobian.shape[1]))
            return flat, np.zeros_like(flat)
        value, slope = row_values(self.steeper, np.clip(dose, self.steeper.x[0], self.steeper.x[-1]))
        return self.jacobian + value, slope


def usable(path: DosePath) -> bool:
    """Whether a mechanism changes anything, and the bare model has values for all rows."""
    return path.curve is not None and bool(np.all(np.isfinite(path.bare)))


def next_numbers(prepared: PreparedProblem, path: DosePath, best: Floats, still: float) -> Floats | None:
    """Calibrated numbers at which a path is made next, nearer to the best; None where they stay."""
    move = np.clip(best[: path.x.size] - path.x, -FARTHEST, FARTHEST)
    x = np.clip(path.x + move, prepared.low, prepared.high)
    return None if np.max(np.abs(x - path.x), initial=0.0) < still else np.asarray(x)


def row_values(curve: interpolate.PPoly, dose: Floats) -> tuple[Floats, Floats]:
    """Value and derivative of curves (n, ...) with a dose for each row, or for each row several times."""
    nodes, powers = curve.x, curve.c
    piece = np.minimum(np.maximum(nodes.searchsorted(dose, side="right") - 1, 0), nodes.size - 2)
    a, b, c, d = powers[:, piece, np.arange(dose.shape[-1])]
    t = (dose - nodes[piece]).reshape(*dose.shape, *([1] * (a.ndim - dose.ndim)))
    return ((a * t + b) * t + c) * t + d, (3.0 * a * t + 2.0 * b) * t + c


@dataclass(frozen=True)
class ModelAlongDose:
    """The model at one setting of the calibrated numbers, asked along the dose of a mechanism."""

    predictor: Predictor
    mechanism: Mechanism
    x: Floats
    seeds: Integers

    @cached_property
    def bare(self) -> Floats:
        """Values without the mechanism."""
        return self.predictor.predict(self.x, {}, self.seeds)

    def change(self, dose: float) -> Floats:
        """Change of the mean at one dose."""
        acting = self.predictor.predict(self.x, {self.mechanism.name: dose}, self.seeds)
        return paired_change(acting, self.bare, self.predictor)


def along_dose(prepared: PreparedProblem, mechanism: Mechanism, x: Floats) -> ModelAlongDose:
    """The model of a prepared problem; what it was asked before is not computed again."""
    candidates = (*prepared.predictor.candidates, Candidate(mechanism.name))
    predictor = replace(prepared.predictor, candidates=candidates)
    return ModelAlongDose(predictor, mechanism, x, prepared.seeds.signature)


def dose_path(
    prepared: PreparedProblem, mechanism: Mechanism, x: Floats, near: Floats | None = None
) -> DosePath:
    """Path of a mechanism at one setting; doses at which the model fails are left out.

    With `near` curve and slopes are exact about the given doses.
    """
    model = along_dose(prepared, mechanism, x)
    doses, table = changes_at(model.change, dose_nodes(mechanism))
    if near is not None and doses.size > 1:
        doses, table = refined(model.change, doses, table, prepared.sd, near)
    ends = (float(doses[0]), float(doses[-1])) if doses.size else (0.0, 0.0)
    flat, bare = slopes_at(prepared, x), seed_mean(model.bare)
    if doses.size < 2 or not table.any():
        return DosePath(mechanism.name, x, bare, flat, None, *ends, None)
    curve = interpolate.PchipInterpolator(doses, table, axis=0)
    asked = doses if near is None else around(doses, near)
    bent = bent_slopes(prepared, model.predictor, mechanism, x, asked)
    return DosePath(mechanism.name, x, bare, flat, bent, *ends, curve)


def moved_path(
    prepared: PreparedProblem, path: DosePath, x: Floats, exact: tuple[Mechanism, Floats] | None = None
) -> DosePath:
    """The path at calibrated numbers nearby: bare values and slopes anew, changes moved by their slopes.

    With `exact` changes are exact about these doses of the mechanism, where the model does not fail.
    """
    assert path.curve is not None
    nodes, table = path.curve.x, path.curve(path.curve.x)
    if path.steeper is not None:
        slopes = path.steeper(np.clip(nodes, path.steeper.x[0], path.steeper.x[-1]))
        table = table + slopes @ (x - path.x)
    if exact is not None:
        mechanism, doses = exact
        used = np.flatnonzero(np.isin(nodes, around(nodes, doses)))
        used = np.arange(max(used[0] - 1, 0), min(used[-1] + 2, nodes.size))
        good, values = changes_at(along_dose(prepared, mechanism, x).change, nodes[used])
        table[np.isin(nodes, good)] = values
    bare = prepared.predictor.mean(x, {}, prepared.seeds.signature)
    curve = interpolate.PchipInterpolator(nodes, table, axis=0)
    return replace(path, x=x, bare=bare, jacobian=slopes_at(prepared, x), curve=curve)


def around(nodes: Floats, doses: Floats) -> Floats:
    """Those of some nodes between which doses lie."""
    first = min(max(int(nodes.searchsorted(doses.min(), side="right")) - 1, 0), nodes.size - 2)
    last = min(max(int(nodes.searchsorted(doses.max())), first + 1), nodes.size - 1)
    return nodes[first : last + 1]


def changes_at(change: Callable[[float], Floats], doses: Floats) -> tuple[Floats, Floats]:
    """Doses at which the model has values for every row, and the changes there (k, n)."""
    table = np.array([change(float(dose)) for dose in doses])
    good = np.all(np.isfinite(table), axis=1)
    return doses[good], table[good]


def refined(
    change: Callable[[float], Floats], doses: Floats, table: Floats, sd: Floats, near: Floats
) -> tuple[Floats, Floats]:
    """The same with more about the given doses, until a curve predicts those between within errors."""
    kept = np.isin(doses, around(doses, near))
    doubtful = kept[1:] & kept[:-1]
    while doubtful.any() and doses.size + doubtful.sum() <= MOST_NODES and table.any():
        curve = interpolate.PchipInterpolator(doses, table, axis=0)
        asked = (0.5 * (doses[1:] + doses[:-1]))[doubtful]
        between, values = changes_at(change, asked)
        wrong = between[np.any(np.abs(values - curve(between)) > TOLERANCE * sd, axis=1)]
        doses, table = np.concatenate([doses, between]), np.concatenate([table, values])
        order = np.argsort(doses)
        doses, table = doses[order], table[order]
        doubtful = np.isin(doses[1:], wrong) | np.isin(doses[:-1], wrong)
    return doses, table


def bent_slopes(
    prepared: PreparedProblem, predictor: Predictor, mechanism: Mechanism, x: Floats, doses: Floats
) -> interpolate.PPoly | None:
    """Change of the slopes along calibrated numbers by a mechanism, along its dose; None for none.

    The ends and the middle are asked first, then doses between until a curve predicts them: to within an
    error of the mean of TOLERANCE of its sd where the numbers are FARTHEST off.
    """
    flat = forward_slopes(prepared, predictor, x, {})
    asked, table = np.zeros(0, dtype=np.int64), np.zeros((0, *flat.shape))
    limit = TOLERANCE * prepared.sd[:, np.newaxis] / FARTHEST
    for places in halved_gaps(doses.size):
        new = np.setdiff1d(places, asked)
        acting = [forward_slopes(prepared, predictor, x, {mechanism.name: float(doses[k])}) for k in new]
        found = np.array(acting).reshape(-1, *flat.shape) - flat
        near = asked.size > 1 and bool(
            np.all(np.abs(interpolate.PchipInterpolator(doses[asked], table)(doses[new]) - found) < limit)
        )
        order = np.argsort(np.append(asked, new))
        asked, table = np.append(asked, new)[order], np.concatenate([table, found])[order]
        if near:
            break
    return interpolate.PchipInterpolator(doses[asked], table, axis=0) if table.any() else None


def halved_gaps(size: int) -> list[Integers]:
    """Places among so many, the ends and the middle first, then half as far apart, until all."""
    found = [np.arange(size)]
    for k in range(1, (size - 2).bit_length()):
        found.insert(k - 1, np.round(np.linspace(0, size - 1, 2**k + 1)).astype(np.int64))
    return found


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
