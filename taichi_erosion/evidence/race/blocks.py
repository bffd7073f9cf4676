"""Errors that rows have in common, as blocks of columns: part of every hypothesis, each of a size of its own.

    level         one column per observable
    source        one column per source of each observable
    batch         one per group of rows of each observable
    discrepancy   smooth function of the conditions of each observable, without its level:
                  k(x, x') = prod_c (1 + (1 + r_c) exp(-r_c)), r_c = 3^1/2 |x_c - x_c'| / LENGTH,
                  centred, trace n

All in units of the median standard error of an observable. Rows that are to be predicted have columns too, so
that they are conditioned on those that are known.

References: Kennedy & O'Hagan (2001), J. R. Stat. Soc. B 63, 425; Plumlee (2017), J. Am. Stat. Assoc. 112,
1274 (a discrepancy must not imitate what calibration or a level can do); Carvalho, Polson & Scott (2010),
Biometrika 97, 465 (half-Cauchy scales).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from taichi_erosion.evidence.data.comparison_rows import ComparisonRows
from taichi_erosion.evidence.data.problem import Bools, Floats
from taichi_erosion.evidence.data.transforms import from_scale
from taichi_erosion.evidence.models.predictor import axis_scale
from taichi_erosion.evidence.race.linear_evidence import Scales, scale
from taichi_erosion.evidence.race.priors import LARGE, LENGTH, NEAR, SMALL

Kind = Literal["level", "source", "batch", "discrepancy", "unlisted", "dose"]
SMOOTHEST = 1e-3  # of the largest variance of a smooth function, below which a part of it is left out


@dataclass(frozen=True)
class Block:
    """One cause of what rows have in common."""

    kind: Kind
    observable: str
    columns: Floats  # (n, q), on the comparison scale
    scale: Scales
    labels: tuple[str, ...] = ()  # of the columns of sources and batches


def unlisted(blocks: Sequence[Block]) -> list[Block]:
    """The same with discrepancies that may be large, level included: something that is not in the list."""
    level = {block.observable: block.columns for block in blocks if block.kind == "level"}
    return [
        Block(
            "unlisted",
            block.observable,
            np.hstack([block.columns, level[block.observable]]),
            scale(f"unlisted {block.observable}", cauchy=LARGE),
        )
        if block.kind == "discrepancy"
        else block
        for block in blocks
    ]


def nuisance(rows: ComparisonRows, known: Bools, unit: Floats) -> list[Block]:
    """Every block that a table allows; `known` rows were measured, `unit` (n,) is their standard error."""
    found = []
    for index, observable in enumerate(rows.observables):
        own = rows.which == index
        fitted = np.flatnonzero(own & known)
        if not fitted.size:
            continue
        name, size = observable.name, float(np.median(unit[fitted]))
        value = from_scale(observable, rows.z)
        logarithmic = observable.transform != "identity"
        shape = np.clip(value * rows.slope, 0.0, 1.0) if logarithmic else np.ones(rows.size)
        column = np.where(own, size * shape, 0.0)
        found.append(Block("level", name, column[:, None], scale(f"level {name}", cauchy=NEAR)))
        if fitted.size > 3:
            columns = size * smooth_columns(rows, own, known)
            if columns.shape[1]:
                found.append(Block("discrepancy", name, columns, scale(f"discrepancy {name}", normal=SMALL)))
    several: tuple[tuple[Kind, Sequence[str]], ...] = (("source", rows.source_names), ("batch", rows.group))
    for kind, labels in several:
        columns, names = shared_columns(rows, known, labels, unit)
        if names:
            prior = scale(kind, cauchy=NEAR) if kind == "source" else scale(kind, normal=2.0 * NEAR)
            found.append(Block(kind, "", columns, prior, names))
    return found


def shared_columns(
    rows: ComparisonRows, known: Bools, labels: Sequence[str], unit: Floats
) -> tuple[Floats, tuple[str, ...]]:
    """A column for each label of each observable that has several rows of it and others too.

    A label of no known row has one too: what is known of the others says how large it may be.
    """
    columns, names, label = [], [], np.array(labels)
    for index, observable in enumerate(rows.observables):
        own = rows.which == index
        count = int(np.sum(own & known))
        for each in dict.fromkeys(label[own]):
            chosen = own & (label == each)
            seen = int(np.sum(chosen & known))
            if 1 < seen < count or not seen:
                columns.append(np.where(chosen, float(np.median(unit[own & known])), 0.0))
                names.append(f"{each}|{observable.name}")
    names = names if any(np.any(column[known]) for column in columns) else []
    return (np.column_stack(columns) if names else np.zeros((rows.size, 0))), tuple(names)


def smooth_columns(rows: ComparisonRows, own: Bools, known: Bools) -> Floats:
    """Columns F (n, q) of a smooth function of the conditions of one observable: F F^T is its covariance."""
    at, fitted = np.flatnonzero(own), known[own]
    kernel = np.ones((at.size, at.size))
    for column in rows.rows(own).conditions.values():
        axis = axis_scale(column[fitted])
        if axis is not None:
            place = axis.filled(column)
            share = (place - place[fitted].min()) / np.ptp(place[fitted])
            distance = 3.0**0.5 * np.abs(share[:, None] - share) / LENGTH
            kernel *= 1.0 + (1.0 + distance) * np.exp(-distance)
    centre = np.eye(at.size) - fitted / fitted.sum()
    kernel = centre @ kernel @ centre.T
    size = float(np.trace(kernel[np.ix_(fitted, fitted)])) / fitted.sum()
    columns = square_root(kernel / size) if size > 1e-12 else np.zeros((at.size, 0))
    found = np.zeros((rows.size, columns.shape[1]))
    found[at] = columns
    return found


def square_root(kernel: Floats) -> Floats:
    """Columns F with F F^T a covariance, without those that hardly matter."""
    values, vectors = np.linalg.eigh(kernel)
    kept = values > SMOOTHEST * values[-1]
    return np.asarray(vectors[:, kept] * np.sqrt(values[kept]), dtype=np.float64)


def dose_columns(rows: ComparisonRows, known: Bools) -> dict[str, Floats]:
    """Factors L (n, r) of what a dose may be over the conditions, along each and along all of them.

    All observables share it: L L^T = exp(-1/2 d^2) + 1/4 with d in sd of a condition; along a
    condition that reaches 0 it is 0 there, and the same is true of L.
    """
    found, squares = {}, []
    for name, column in rows.conditions.items():
        axis = axis_scale(column[known])
        if axis is None:
            continue
        place, zero = axis(column), column == 0.0
        squares.append((place[:, None] - place) ** 2)
        kernel = np.exp(-0.5 * squares[-1]) + 0.25
        if zero[known].any() and np.nanmin(column[known]) == 0.0:
            at = int(np.argmax(zero))
            kernel = kernel - np.outer(kernel[at], kernel[at]) / kernel[at, at]
        found[name] = square_root(kernel)
    if len(squares) > 1:
        found["all"] = square_root(np.exp(-0.5 * sum(squares)) + 0.25)
    return found
