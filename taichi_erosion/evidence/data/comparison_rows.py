"""Measurements as the statistics see them: on the comparison scale, repeats merged, error sources known."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from taichi_erosion.evidence.data.findings import ObservableNoise
from taichi_erosion.evidence.data.measurement_noise import Scatter, lab_scatter, unchecked_noise_sentence
from taichi_erosion.evidence.data.problem import (
    Bools,
    Conditions,
    Floats,
    Integers,
    Measurements,
    Observable,
    Problem,
)
from taichi_erosion.evidence.data.transforms import slope, to_scale


@dataclass(frozen=True)
class ComparisonRows:
    """n merged rows; a repeated condition is one row."""

    observables: tuple[Observable, ...]
    which: Integers  # index of each row's observable
    z: Floats  # value on the comparison scale; the limit where censored
    variance: Floats  # of z: laboratory and numerical tolerance; NaN where the noise is unknown
    censored: Bools
    shared: Floats  # (n, q): change of z per sd of each instrument's systematic error
    conditions: Conditions
    group: tuple[str, ...]
    slope: Floats  # dz/dy at the measured value
    freedom: float  # degrees of freedom behind the noise level
    noise: Mapping[str, ObservableNoise]
    warnings: tuple[str, ...]

    @property
    def size(self) -> int:
        return int(self.z.size)

    @property
    def known(self) -> Bools:
        """Rows whose noise is known."""
        return np.isfinite(self.variance)

    def rows(self, chosen: Integers | Bools) -> "ComparisonRows":
        """Some of the rows."""
        index = np.flatnonzero(chosen) if chosen.dtype == np.bool_ else chosen
        shared = self.shared[index]
        return ComparisonRows(
            self.observables,
            self.which[index],
            self.z[index],
            self.variance[index],
            self.censored[index],
            shared[:, np.any(shared != 0.0, axis=0)] if index.size else shared[:, :0],
            {name: column[index] for name, column in self.conditions.items()},
            tuple(self.group[i] for i in index),
            self.slope[index],
            self.freedom,
            self.noise,
            self.warnings,
        )


def comparison_rows(problem: Problem, table: Measurements) -> ComparisonRows:
    """The rows of a table on their comparison scales, with repeated rows merged."""
    names = sorted(set(table.observable))
    observables = tuple(problem.observables.get(name, Observable(name)) for name in names)
    pieces, noise, warnings, scatters = [], {}, [], []
    for index, observable in enumerate(observables):
        rows = np.array([i for i, name in enumerate(table.observable) if name == observable.name])
        piece, scatter, notes = merged_rows(observable, table.rows(rows), index, len(observables))
        pieces.append(piece)
        noise[observable.name] = noise_budget(piece, scatter)
        warnings += notes
        scatters.append(scatter)
    freedom = joint_freedom(scatters)
    note = unchecked_noise_sentence(freedom)
    return joined(observables, pieces, freedom, noise, [*warnings, *([note] if note else [])])


def joint_freedom(scatters: list[Scatter]) -> float:
    """Degrees of freedom behind the noise level as a whole.

    Repeated rows check the same thing everywhere, what a stated sd is worth. Sample variances tell the level
    of their own observable and of no other, so that the level is known as well as on average in one of them.
    """
    own = [scatter.own_freedom for scatter in scatters if scatter.own_freedom > 0.0]
    return sum(scatter.freedom for scatter in scatters) + (sum(own) / len(own) if own else 0.0)


@dataclass(frozen=True)
class Piece:
    """Merged rows of one observable."""

    which: Integers
    z: Floats
    variance: Floats
    censored: Bools
    shared: Floats
    conditions: Conditions
    group: tuple[str, ...]
    slope: Floats
    numerical: float


def merged_rows(
    observable: Observable, table: Measurements, index: int, width: int
) -> tuple[Piece, Scatter, list[str]]:
    """Rows of one observable, repeats merged by inverse variance."""
    value = np.where(table.censored, table.limit, table.value)
    z, steepness = to_scale(observable, value), slope(observable, value)
    usable = np.isfinite(z) & np.isfinite(steepness)
    notes = row_notes(observable, table, usable)
    table, z, steepness = table.rows(usable), z[usable], steepness[usable]
    cell = cell_numbers(table)
    repeats = np.where(table.n >= 1.0, table.n, 1.0)
    shapes = scatter_shapes(observable, value[usable], steepness)
    scatter = lab_scatter(z, np.abs(table.sd * steepness), repeats, cell, shapes)
    weight = repeats / np.where(np.isfinite(scatter.variance), scatter.variance, 1.0)
    merge_key = np.array([f"{c}|{g}|{b}" for c, g, b in zip(cell, table.group, table.censored, strict=True)])
    _, first, inverse = np.unique(merge_key, return_index=True, return_inverse=True)
    total = np.bincount(inverse, weight, minlength=first.size)
    order = np.argsort(first)
    first, total = first[order], total[order]
    mean = (np.bincount(inverse, weight * z)[order] / total) if z.size else z
    steep = steepness[first]
    numerical = (observable.sd_numerical * steep) ** 2
    unknown = ~np.isfinite(scatter.variance[first])
    if unknown.any():
        count = f"{int(unknown.sum())} of {unknown.size}"
        notes.append(f"{observable.name}: the scatter of {count} rows is not known; they are not used")
    shared = np.zeros((first.size, width))
    growing = observable.sd_shared_relative * value[usable][first]
    shared[:, index] = np.hypot(observable.sd_shared, growing) * steep
    piece = Piece(
        which=np.full(first.size, index),
        z=mean,
        variance=np.where(unknown, np.nan, 1.0 / np.where(total > 0, total, 1.0) + numerical),
        censored=table.censored[first],
        shared=shared,
        conditions={name: column[first] for name, column in table.conditions.items()},
        group=tuple(table.group[i] for i in first),
        slope=steep,
        numerical=float(np.sqrt(np.median(numerical))) if first.size else 0.0,
    )
    return piece, scatter, notes


def scatter_shapes(observable: Observable, value: Floats, steepness: Floats) -> Floats:
    """Ways in which sd may go with the value, on the comparison scale: what the scale implies first."""
    relative, absolute = np.abs(value) * steepness, steepness
    return np.array([absolute, relative] if observable.transform == "identity" else [relative, absolute])


def cell_numbers(table: Measurements) -> Floats:
    """Number of each row's set of conditions; equal for repeated rows."""
    if table.size == 0:
        return np.zeros(0)
    columns = [np.nan_to_num(column, nan=-1.2345e300) for column in table.conditions.values()]
    stacked = np.column_stack(columns) if columns else np.zeros((table.size, 1))
    return np.unique(stacked, axis=0, return_inverse=True)[1].ravel().astype(float)


def row_notes(observable: Observable, table: Measurements, usable: Bools) -> list[str]:
    """What the report must say about rows that lack something."""
    notes = []
    lost = int(np.sum(~usable))
    if lost:
        notes.append(
            f"{observable.name}: {lost} rows have no finite value on the {observable.transform} scale"
        )
    missing = int(np.sum(~np.isfinite(table.sd) & ~table.censored))
    if missing:
        notes.append(f"{observable.name}: {missing} of {table.size} rows have no sd")
    uncounted = int(np.sum(~(table.n >= 1.0)))
    if uncounted:
        notes.append(f"{observable.name}: {uncounted} of {table.size} rows have no n, taken as 1")
    return notes


def noise_budget(piece: Piece, scatter: Scatter) -> ObservableNoise:
    """Budget of one observable before the model has been run."""
    known = piece.variance[np.isfinite(piece.variance)]
    lab = float(np.sqrt(max(np.median(known) - piece.numerical**2, 0.0))) if known.size else np.nan
    shared = float(np.median(np.abs(piece.shared).sum(axis=1))) if piece.z.size else 0.0
    repeats = int(scatter.freedom + scatter.own_freedom)
    return ObservableNoise(
        lab, 0.0, shared, piece.numerical, repeats, scatter.factor, scatter.p, float("nan")
    )


def joined(
    observables: tuple[Observable, ...],
    pieces: list[Piece],
    freedom: float,
    noise: Mapping[str, ObservableNoise],
    warnings: list[str],
) -> ComparisonRows:
    """All observables together."""
    shared = np.vstack([piece.shared for piece in pieces]) if pieces else np.zeros((0, 0))
    names = list(pieces[0].conditions) if pieces else []
    return ComparisonRows(
        observables,
        np.concatenate([piece.which for piece in pieces]).astype(np.int64),
        np.concatenate([piece.z for piece in pieces]),
        np.concatenate([piece.variance for piece in pieces]),
        np.concatenate([piece.censored for piece in pieces]),
        shared[:, np.any(shared != 0.0, axis=0)],
        {name: np.concatenate([piece.conditions[name] for piece in pieces]) for name in names},
        tuple(group for piece in pieces for group in piece.group),
        np.concatenate([piece.slope for piece in pieces]),
        freedom,
        noise,
        tuple(warnings),
    )
