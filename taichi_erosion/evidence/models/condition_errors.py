"""Errors of stated conditions, propagated through the slope of the model (effective variance).

A row says that a condition was c; in truth it was c + s u, with u ~ N(0, 1) and s the `sd of` that condition:

    z = m(c + s u) + e ~ m(c) + F u + e,    F = s dm/dc

The columns of F are errors that rows share, as others are: the variance of a row grows by F^2. The rows of
one set-up under the same conditions share one u. This is right for a condition that was set to c and then
differs from it (Berkson). One that was measured, with an error, is taken so too: a law along it comes out
too flat (regression dilution).

Reference: Orear (1982), Am. J. Phys. 50, 912 (effective variance); Carroll, Ruppert, Stefanski & Crainiceanu
(2006), Measurement Error in Nonlinear Models, chapter 1 (Berkson and classical errors).
"""

from dataclasses import dataclass

import numpy as np

from taichi_erosion.evidence.data.comparison_rows import ComparisonRows, condition_numbers
from taichi_erosion.evidence.data.problem import Conditions, Floats, Integers, Numbers
from taichi_erosion.evidence.models.predictor import Predictor, paired_change

SEED = 1  # of the runs from which slopes along conditions are taken


@dataclass(frozen=True)
class ConditionErrors:
    """Standard deviations of stated conditions, and the rows that share an error."""

    sd: Conditions  # (n,) by condition, 0 where the condition is exact
    cell: Integers  # (n,), number of the set-up and its conditions


def condition_errors(rows: ComparisonRows) -> ConditionErrors | None:
    """Errors of the conditions of some rows; None where every condition is exact."""
    stated = {name: np.nan_to_num(column) for name, column in rows.condition_sd.items()}
    stated = {name: column for name, column in stated.items() if np.any(column > 0.0)}
    if not stated:
        return None
    cells = zip(rows.group, rows.source, condition_numbers(rows), strict=True)
    keys = ["|".join(map(str, each)) for each in cells]
    cell = np.unique(keys, return_inverse=True)[1].astype(np.int64)
    return ConditionErrors(stated, cell)


def error_columns(errors: ConditionErrors, predictor: Predictor, x: Floats, acting: Numbers) -> Floats:
    """Change of the mean (n, q) by one sd of the condition of each set-up."""
    parts, size = [], predictor.which.size
    for name, sd in errors.sd.items():
        change = change_along(predictor, name, sd, x, acting)
        cells = np.unique(errors.cell[sd > 0.0])
        column = errors.cell[:, np.newaxis] == cells[np.newaxis, :]
        parts.append(np.where(column, change[:, np.newaxis], 0.0))
    return np.hstack(parts) if parts else np.zeros((size, 0))


def change_along(predictor: Predictor, name: str, sd: Floats, x: Floats, acting: Numbers) -> Floats:
    """Half the difference of the mean one sd above and below; 0 where the model fails.

    A condition that is nowhere negative is not taken below 0.
    """
    stated = predictor.conditions[name]
    least = 0.0 if np.nanmin(stated) >= 0.0 else -np.inf
    ends = [np.maximum(stated - sd, least), stated + sd]
    seeds = np.random.default_rng(SEED).integers(1, 2**31 - 1, size=4).astype(np.int64)
    runs = [predictor.at_conditions({name: end}).predict(x, acting, seeds) for end in ends]
    width = ends[1] - ends[0]
    change = paired_change(runs[1], runs[0], predictor)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.nan_to_num(np.where(width > 0.0, change * sd / width, 0.0))
