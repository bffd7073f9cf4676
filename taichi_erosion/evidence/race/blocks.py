"""Errors that rows have in common, as blocks of columns: part of every hypothesis, each of a size of its own.

    level         one column per observable
    source        one column per source of each observable
    preparation   one column per set-up under the same conditions of each observable, where it is repeated
    batch         one column per set of conditions, where set-ups stand for repeats
    group         numbers of the model that each soil or batch has for itself: its mask, times their slopes
    discrepancy   smooth function of the conditions of each observable, without its level:
                  k(x, x') = prod_c (1 + (1 + r_c) exp(-r_c)), r_c = 3^1/2 |x_c - x_c'| / LENGTH,
                  centred, trace n; of an amount also a power of the grain size

All in units of the median standard error of an observable. Rows that are to be predicted have columns too, so
that they are conditioned on those that are known.

References: Kennedy & O'Hagan (2001), J. R. Stat. Soc. B 63, 425; Plumlee (2017), J. Am. Stat. Assoc. 112,
1274 (a discrepancy must not imitate what calibration or a level can do); Carvalho, Polson & Scott (2010),
Biometrika 97, 465 (half-Cauchy scales).
"""

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Literal

import numpy as np

from taichi_erosion.evidence.data.comparison_rows import ComparisonRows, condition_groups
from taichi_erosion.evidence.data.problem import Bools, Floats
from taichi_erosion.evidence.models.predictor import axis_scale_of, matrix_root
from taichi_erosion.evidence.race.linear_evidence import Scales, one_scale
from taichi_erosion.evidence.race.priors import LENGTH, Priors

Kind = Literal["level", "source", "preparation", "batch", "group", "discrepancy", "unlisted", "dose"]
AND = " and "  # between two conditions
EACH_SET_UP = "each_set_up"  # differs for itself, along no condition
SMOOTHEST = 1e-3  # of the largest variance of a smooth function, below which a part of it is left out


@dataclass(frozen=True)
class Block:
    """One cause of what rows have in common."""

    kind: Kind
    observable: str
    columns: Floats  # (n, q), on the comparison scale
    scale: Scales
    size: float = 1.0  # standard error of a row of the observable, in which a discrepancy counts


def unlisted_blocks(
    rows: ComparisonRows, is_known: Bools, blocks: Sequence[Block], priors: Priors, unread: Collection[str]
) -> dict[str, tuple[Block, ...]]:
    """The same with functions that may be large, level included, in place of discrepancies.

    One key for each: something acts along one condition, along all, or along two, each by itself, of which no
    effect reads one; or each set-up differs for itself.
    """
    level = {block.observable: block.columns for block in blocks if block.kind == "level"}
    axes = [name for name, column in rows.conditions.items() if axis_scale_of(column[is_known]) is not None]

    def enlarge(block: Block, along: str) -> Block:
        columns = smooth_columns(rows, block.observable, is_known, block.size, along)
        scale = one_scale(f"unlisted {block.observable}", cauchy=priors.large)
        whole = np.hstack([columns, level[block.observable]])
        return replace(block, kind="unlisted", columns=whole, scale=scale) if columns.size else block

    pairs = [AND.join(pair) for pair in combinations(axes, 2) if {*pair} & {*unread}]
    places = ("", *(axes if len(axes) > 1 else ()), *pairs, EACH_SET_UP)
    return {at: tuple(enlarge(b, at) if b.kind == "discrepancy" else b for b in blocks) for at in places}


def error_blocks(rows: ComparisonRows, is_known: Bools, unit: Floats, priors: Priors) -> list[Block]:
    """Every block that a table allows; `known` rows were measured, `unit` (n,) is their standard error."""
    blocks = []
    for index, observable in enumerate(rows.observables):
        mask = rows.which == index
        fitted = np.flatnonzero(mask & is_known)
        if not fitted.size:
            continue
        name, size = observable.name, float(np.median(unit[fitted]))
        column = np.where(mask, size, 0.0)
        blocks.append(Block("level", name, column[:, None], one_scale(f"level {name}", cauchy=priors.near)))
        if fitted.size > 3 and (columns := smooth_columns(rows, name, is_known, size)).shape[1]:
            small = one_scale(f"discrepancy {name}", normal=priors.small)
            blocks.append(Block("discrepancy", name, columns, small, size=size))
    return [*blocks, *shared_error_blocks(rows, is_known, unit, priors.near)]


def shared_error_blocks(rows: ComparisonRows, is_known: Bools, unit: Floats, near: float) -> Iterator[Block]:
    """Errors that rows of a source, of a preparation, and of a group of several set-ups have in common."""
    masks = ((rows.which == k) & is_known for k in rows.which)
    size = np.array([np.median(unit[mask] if is_known.any() else 1.0) for mask in masks])
    cells = [f"{group}|{cell:g}" for group, cell in zip(rows.group, condition_groups(rows), strict=True)]

    def block_of_labels(kind: Kind, labels: Sequence[str], **prior: float) -> Iterator[Block]:
        if pairs := label_masks(rows, is_known, labels):
            columns = np.column_stack([mask for _, mask in pairs]) * size[:, None]
            yield Block(kind, "", columns, one_scale(kind, **prior))

    yield from block_of_labels("source", rows.source_names, cauchy=near)
    yield from block_of_labels("preparation", cells, normal=2.0 * near)
    if any(noise.scatter.by_blocks for noise in rows.noise.values()):
        yield from block_of_labels("batch", list(map(str, condition_groups(rows))), normal=2.0 * near)
    groups = [*dict.fromkeys(label for label, _ in label_masks(rows, is_known, rows.group))]
    masks = np.array(rows.group)[:, None] == np.array(groups)
    if any(len({cells[row] for row in np.flatnonzero(mask)}) > 1 for mask in masks.T):
        yield Block("group", "", masks.astype(np.float64), one_scale("group", cauchy=2.0 * near))


def label_masks(rows: ComparisonRows, is_known: Bools, tags: Sequence[str]) -> list[tuple[str, Floats]]:
    """A mask for each label of each observable that has several rows of it and others too.

    A label of no known row has one too: what is known of the others says how large it may be.
    """
    pairs, label = [], np.array(tags)
    for index in range(len(rows.observables)):
        mask = rows.which == index
        count = int(np.sum(mask & is_known))
        for each in dict.fromkeys(label[mask]):
            chosen = mask & (label == each)
            number = int(np.sum(chosen & is_known))
            if count and (1 < number < count or not number):
                pairs.append((each, chosen.astype(np.float64)))
    return pairs if any(np.any(mask[is_known] > 0.0) for _, mask in pairs) else []


def columns_of(block: Block, jacobian: Floats) -> Floats:
    """Columns (n, q) of a block, about a setting with slopes (n, p) along the calibrated numbers."""
    if block.kind != "group":
        return block.columns
    return (block.columns[:, :, None] * jacobian[:, None, :]).reshape(jacobian.shape[0], -1)


def smooth_columns(rows: ComparisonRows, observable: str, mask: Bools, sd: float, along: str = "") -> Floats:
    """Columns F (n, q) of a smooth function along all conditions or some: F F^T is its covariance.

    `along` names one, or two joined by AND, each of which acts by itself; empty: all.
    """
    at = np.flatnonzero(np.array(rows.names) == observable)
    fitted, by_set_up = mask[at], along == EACH_SET_UP
    by_blocks = observable in rows.noise and rows.noise[observable].scatter.by_blocks
    group = (condition_groups(rows) if by_blocks else np.array(rows.group))[at]
    kernel = np.where(by_set_up, group[:, None] == group, 1.0 * (AND not in along))
    for name in () if by_set_up else along.split(AND) if along else rows.conditions:
        column = rows.conditions[name][at]
        axis = axis_scale_of(column[fitted])
        if axis is not None:
            place = axis.standardise_column(column)
            share = (place - place[fitted].min()) / np.ptp(place[fitted])
            distance = 3.0**0.5 * np.abs(share[:, None] - share) / LENGTH
            change = 1.0 + (1.0 + distance) * np.exp(-distance)
            kernel = kernel + change if AND in along else kernel * change
    kernel = kernel - kernel[fitted].mean(axis=0)
    kernel = kernel - kernel[:, fitted].mean(axis=1, keepdims=True)
    count, usual = int(fitted.sum()), float(np.mean(np.diag(kernel)[fitted]))
    columns = matrix_root(kernel / usual, count, SMOOTHEST) if usual > 1e-12 else np.zeros((at.size, 0))
    entry = next(each for each in rows.observables if each.name == observable)
    # published laws of an amount differ by powers of the grain size
    if not along and entry.transform == "log_floor" and entry.shared_over in rows.conditions:
        sizes = rows.conditions[entry.shared_over][at]
        power = np.nan_to_num(np.log(sizes / np.nanmedian(sizes[fitted]))) / sd
        columns = np.column_stack([columns, power]) if power.any() else columns
    values = np.zeros((rows.size, columns.shape[1]))
    values[at] = sd * columns
    return values


def dose_factors(rows: ComparisonRows, is_known: Bools) -> dict[str, Floats]:
    """Factors L (n, r) of what a dose may be over the conditions, along each and along all of them.

    All observables share it: L L^T = exp(-1/2 d^2) + 1/4 with d in sd of a condition; along a
    condition that reaches 0 it is 0 there, and the same is true of L.
    """
    columns, squares, count = {}, [], int(is_known.sum())
    for name, column in rows.conditions.items():
        axis = axis_scale_of(column[is_known])
        if axis is None:
            continue
        place, zero = axis(column), column == 0.0
        squares.append((place[:, None] - place) ** 2)
        kernel = np.exp(-0.5 * squares[-1]) + 0.25
        if zero[is_known].any() and np.nanmin(column[is_known]) == 0.0:
            at = int(np.argmax(zero))
            kernel = kernel - np.outer(kernel[at], kernel[at]) / kernel[at, at]
        columns[name] = matrix_root(kernel, count, SMOOTHEST)
    if len(squares) > 1:
        columns["all"] = matrix_root(np.exp(-0.5 * sum(squares)) + 0.25, count, SMOOTHEST)
    return columns
