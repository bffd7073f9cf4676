"""Measurements on the comparison scale: repeats merged, the sources of error known."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from scipy import linalg

from taichi_erosion.evidence.data.measurement_noise import (
    LEAST_FREEDOM,
    Disagreement,
    ObservableNoise,
    Scatter,
    lack_of_fit_p_value,
    measurement_scatter,
    pure_error_squares,
    suspect_rows_of_group,
)
from taichi_erosion.evidence.data.problem import (
    Bools,
    Conditions,
    Floats,
    Integers,
    Measurements,
    Observable,
    Problem,
    pick_rows,
)
from taichi_erosion.evidence.data.table_units import Scale
from taichi_erosion.evidence.data.tables.rows import row_sources
from taichi_erosion.evidence.data.transforms import slope, to_scale
from taichi_erosion.tables.number_columns import reading_step

NEGLIGIBLE = 0.1  # variance over that of a row, below which a rounding is left out
ROW_WISE = ("which", "z", "variance", "censored", "reach", "conditions", "group", "source", "slope")
ROW_WISE += ("rounding", "condition_sd", "heaps", "lines")  # one entry a row, beside shared errors


@dataclass(frozen=True)
class ComparisonRows:
    """n merged rows; a repeated condition is one row."""

    observables: tuple[Observable, ...]
    which: Integers  # index of each row's observable
    z: Floats  # value on the comparison scale; the limit where censored, the middle of an interval
    variance: Floats  # of z: laboratory and numerical tolerance; NaN where the noise is unknown
    censored: Bools
    reach: Floats  # on that scale: 0; of censored values -inf below z, +inf above, h between z - h and z + h
    rounding: Floats  # sd of z by the last digit of its value; 0 where it hardly counts
    shared: Floats  # (n, q): change of z per sd of each instrument's systematic error
    conditions: Conditions
    group: tuple[str, ...]
    source: tuple[str, ...]  # the place of a row where it names none
    slope: Floats  # dz/dy at the measured value
    heaps: tuple[Mapping[str, float], ...]  # of each row: heap -> repeats on it; '' where it is unknown
    noise: Mapping[str, ObservableNoise]
    warnings: tuple[str, ...]
    condition_sd: Conditions = field(default_factory=dict)  # of stated conditions; NaN: exact
    covariance: Floats | None = None  # (n, n), covariance of z of rows of one heap, diagonal 0; None: none
    lines: tuple[tuple[int, ...], ...] = ()  # rows of the table that each row merges
    unmerged: tuple[Disagreement, ...] = ()  # repeats that are not merged and tell nothing of the scatter

    @property
    def size(self) -> int:
        return int(self.z.size)

    @property
    def source_names(self) -> tuple[str, ...]:
        """Source of every row; the file of those that name none."""
        return row_sources(self.source)

    @property
    def rows_to_check(self) -> Bools:
        """Rows to check, which differ grossly from their repeats."""
        off = {(each.observable, line) for each in self.unmerged for line in each.suspects}
        rows = zip(self.names, self.lines, strict=True)
        return np.array([(name, lines[0]) in off for name, lines in rows], bool)

    @property
    def awaits_correction(self) -> Bools:
        """Readings that their own repeats contradict: they wait for a correction and take no part."""
        off = {(each.observable, *each.suspects) for each in self.unmerged}
        return np.array([(name, *row) in off for name, row in zip(self.names, self.lines, strict=True)], bool)

    @property
    def has_noise(self) -> Bools:
        return np.isfinite(self.variance)

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(self.observables[index].name for index in self.which)

    def observable_indices(self, names: Sequence[str]) -> Integers:
        place = {observable.name: index for index, observable in enumerate(self.observables)}
        return np.array([place[name] for name in names], dtype=np.int64)

    def conditions_at(self, row: int) -> dict[str, float]:
        return {name: float(column[row]) for name, column in self.conditions.items()}

    def select_rows(self, chosen: Integers | Bools) -> "ComparisonRows":
        columns = pick_rows({name: getattr(self, name) for name in (*ROW_WISE, "shared")}, chosen)
        columns["shared"] = columns["shared"][:, np.any(columns["shared"] != 0.0, axis=0)]
        columns["covariance"] = None if self.covariance is None else self.covariance[np.ix_(chosen, chosen)]
        return replace(self, **columns)


def comparison_rows(problem: Problem, table: Measurements) -> ComparisonRows:
    """The rows of a table on their comparison scales, with repeated rows merged."""
    names, observable = sorted(set(table.observable)), np.array(table.observable)
    observables = tuple(problem.observables.get(name, Observable(name)) for name in names)
    tables = (table.pick_rows_at(np.flatnonzero(observable == name)) for name in names)
    rows = join_rows([merge_repeats(observables, index, each) for index, each in enumerate(tables)])
    scatters = [noise.scatter for noise in rows.noise.values()]
    # repeats check the worth of stated sd everywhere, sample variances the level of their own observable
    freedom = [scatter.own_freedom for scatter in scatters if scatter.own_freedom > 0.0]
    if sum(scatter.freedom for scatter in scatters) + sum(freedom) / max(len(freedom), 1) >= LEAST_FREEDOM:
        return rows
    note = "The stated sd cannot be checked: no condition was repeated."
    remedy = "At least 3 repeats at 4 or more conditions would separate noise from a missing effect."
    return replace(rows, warnings=(*rows.warnings, f"{note} {remedy}"))


def merge_repeats(observables: tuple[Observable, ...], index: int, table: Measurements) -> ComparisonRows:
    """Rows of one observable, repeats merged by inverse variance."""
    observable = observables[index]
    value = np.where(table.censored, table.limit, table.value)
    reach = np.where(table.censored, -np.inf if table.reach is None else table.reach, 0.0)
    (z, reach), steepness = censor_scale(observable, value, reach), slope(observable, value)
    usable = np.isfinite(z) & np.isfinite(steepness)
    notes, table = notes_on_missing_numbers(observable, table, usable), table.pick_rows_at(usable)
    z, reach, steepness, value = (column[usable] for column in (z, reach, steepness, value))
    cell, exact = repeat_group_numbers(table), np.where(table.censored, np.nan, z)  # a limit is no repeat
    repeats, usual = np.where(table.n >= 1.0, table.n, 1.0), observable.transform == "identity"
    # a slip has no weight of its own
    typical = np.array([np.median(np.abs(value[cell == each])) for each in cell])
    steep = np.abs(slope(observable, typical))
    shapes = np.array([steep, typical * steep])[:: 1 if usual else -1]  # of sd; usual first
    sd, design = np.abs(table.sd * steepness), design_level_numbers(table)
    scatter = measurement_scatter(exact, sd, repeats, cell, shapes, design)
    weight = repeats / np.where(np.isfinite(scatter.variance), scatter.variance, 1.0)
    alone = np.where(scatter.off, np.arange(scatter.off.size), -1)
    labels = zip(cell, table.group, table.source, reach, alone, strict=True)  # equal for repeats
    keys = np.array(["|".join(map(str, each)) for each in labels])
    first, mean, total = weighted_means_by_key(z, weight, keys)
    steep, first_rows, heaps = steepness[first], table.pick_rows_at(first), np.array(heap_keys(table))
    numerical = (observable.sd_numerical * steep) ** 2
    if (unknown := ~np.isfinite(scatter.variance[first])).any():
        count = f"{int(unknown.sum())} of {unknown.size}"
        notes.append(f"{observable.name}: the scatter of {count} rows is not known; they are not used")
    shared = np.hypot(observable.sd_shared, observable.sd_shared_relative * value[first]) * steep
    variance = np.where(unknown, np.nan, 1.0 / np.where(total > 0, total, 1.0) + numerical)
    members = [keys == key for key in keys[first]]
    count = np.array([np.sum(m) if np.ptp(z[m]) > 0.0 else 1 for m in members])  # one rounding
    on_heaps = [
        {str(h): float(repeats[m & (heaps == h)].sum()) for h in dict.fromkeys(heaps[m])} for m in members
    ]
    return ComparisonRows(
        observables,
        which=np.full(first.size, index),
        z=mean,
        variance=variance,
        censored=first_rows.censored,
        reach=reach[first],
        rounding=rounding_errors(observable.name, table, steep / count**0.5, variance),
        shared=shared_error_columns(observable, shared, first_rows.conditions),
        conditions=first_rows.conditions,
        group=first_rows.group,
        source=first_rows.source,
        slope=steep,
        heaps=tuple(on_heaps),
        noise={observable.name: noise_budget(variance, numerical, scatter)},
        warnings=tuple(notes),
        lines=tuple(tuple(np.array(table.line)[each].tolist()) for each in members),
        unmerged=tuple(gross_repeat_disagreements(observable, table, exact, cell, scatter.off)),
        condition_sd=first_rows.condition_sd,
    )


def shared_error_columns(observable: Observable, size: Floats, conditions: Conditions) -> Floats:
    """Columns (n, q) of a systematic error of size (n,): of all rows, and of each value of `shared_over`."""
    column = conditions.get(observable.shared_over, np.zeros(size.size))
    values = np.unique(column[np.isfinite(column)])
    each = 0.5 * (column[:, np.newaxis] == values[: values.size * (values.size > 1)])
    return size[:, np.newaxis] * np.hstack([np.ones((size.size, 1)), each])


def rounding_errors(observable: str, table: Measurements, steep: Floats, variance: Floats) -> Floats:
    """Rounding (n,) of each row: no row scatters less, however equal rounded values are."""
    factor = table.table_units.values.get(observable, Scale()).factor
    step = factor * reading_step(table.value[~table.censored] / factor)
    size = step / 12.0**0.5 * np.abs(steep)
    return np.where(size**2 > NEGLIGIBLE * variance, size, 0.0)


def heap_keys(table: Measurements) -> list[str]:
    """Key of the heap of each row: its name, group, source and conditions; empty where it is unknown."""
    cells = zip(*table.conditions.values(), strict=True) if table.conditions else [()] * table.size
    labels = zip(table.heap or ("",) * table.size, table.group, table.source, cells, strict=True)
    return ["|".join(map(str, each)) if each[0] else "" for each in labels]


def gross_repeat_disagreements(
    observable: Observable, table: Measurements, z: Floats, cell: Floats, off: Bools
) -> Iterator[Disagreement]:
    """Repeats of one observable that disagree grossly, with the rows to check."""
    for number in np.unique(cell[off]):
        rows = np.flatnonzero((cell == number) & np.isfinite(z))
        check = suspect_rows_of_group(z, rows, off, tuple(table.conditions.values()))
        lines, wrong = (tuple(table.line[row] for row in chosen) for chosen in (rows, check))
        yield Disagreement(observable.name, lines, wrong, float(np.ptp(table.value[rows])))


def repeat_fit_p(rows: ComparisonRows, variance: Floats, residual: Floats, leverage: Floats) -> float:
    """Chance of the lack of fit of a model; limits, and rows to check, have no part in it.

    `residual` (n,) is over its sd, `variance` its square, `leverage` the shares that calibration removes.
    Preparations differ by about half of the scatter of repeats: squares of means of m by 1 + m / 4 more.
    """
    cell, parts = repeat_group_numbers(rows), []
    for name, noise in rows.noise.items():
        tested = (np.array(rows.names) == name) & ~rows.censored & ~rows.rows_to_check
        if not tested.any():
            continue
        squares, within = pure_error_squares(rows.z[tested], 1.0 / variance[tested], cell[tested])
        freedom = float(np.sum(1.0 - leverage[tested])) - within
        single = noise.scatter.variance[np.isfinite(noise.scatter.variance)]
        m = float(np.sum(np.median(single) / variance[tested])) / np.unique(cell[tested]).size
        between = (float(residual[tested] @ residual[tested]) - squares) / (1.0 + 0.25 * m)
        parts.append((between, freedom, *noise.scatter.pure))
    return lack_of_fit_p_value(parts)


def repeat_group_numbers(table: Measurements | ComparisonRows) -> Floats:
    """Number of each row's conditions, set-up and source; equal for repeated rows."""
    set_up, source, *_ = design_level_numbers(table)
    return set_up * table.size + source


def design_level_numbers(table: Measurements | ComparisonRows) -> Floats:
    """Numbers (4, n) of each row's set-up under its conditions, its source, its set-up and its conditions."""
    labels = (np.array(each) for each in (table.group, row_sources(table.source)))
    set_up, source = (np.unique(each, return_inverse=True)[1].astype(float) for each in labels)
    conditions = condition_groups(table)
    return np.array([conditions * table.size + set_up, source, set_up, conditions])


def censor_scale(observable: Observable, value: Floats, reach: Floats) -> tuple[Floats, Floats]:
    """Values and reaches on the comparison scale; an interval with an end off it has the upper one.

    The middle of an interval on that scale is not that of the interval in its unit.
    """
    z, inside = to_scale(observable, value), np.isfinite(reach) & (reach > 0.0)
    if not inside.any():
        return z, reach
    low, high = (to_scale(observable, value + sign * np.where(inside, reach, 0.0)) for sign in (-1.0, 1.0))
    open_below = inside & ~np.isfinite(low)
    z = np.where(open_below, high, np.where(inside, 0.5 * (low + high), z))
    return z, np.where(open_below, -np.inf, np.where(inside, 0.5 * (high - low), reach))


def weighted_means_by_key(z: Floats, weight: Floats, keys: np.ndarray) -> tuple[Integers, Floats, Floats]:
    """First row, mean and total weight of the rows of each key, in the order of the first rows."""
    _, first, inverse = np.unique(keys, return_index=True, return_inverse=True)
    total: Floats = np.bincount(inverse, weight, minlength=first.size).astype(float)
    order = np.argsort(first)
    mean = np.bincount(inverse, weight * z)[order] / total[order] if z.size else z
    return first[order], mean, total[order]


def condition_groups(table: Measurements | ComparisonRows) -> Floats:
    """Number of each row's set of conditions; equal for repeated rows."""
    columns = [np.nan_to_num(column, nan=-1.2345e300) for column in table.conditions.values()]
    stacked = np.column_stack(columns) if columns else np.zeros((table.size, 1))
    return np.unique(stacked, axis=0, return_inverse=True)[1].ravel().astype(float)


def notes_on_missing_numbers(observable: Observable, table: Measurements, usable: Bools) -> list[str]:
    """Sentences about rows without a finite value, sd or n."""
    rows_by_fault = {
        f"rows have no finite value on the {observable.transform} scale": ~usable,
        f"of {table.size} rows have no sd": ~np.isfinite(table.sd) & ~table.censored,
        f"of {table.size} rows have no n, taken as 1": ~(table.n >= 1.0),
    }
    return [f"{observable.name}: {rows.sum()} {fault}" for fault, rows in rows_by_fault.items() if rows.any()]


def noise_budget(variance: Floats, numerical: Floats, scatter: Scatter) -> ObservableNoise:
    finite = variance[np.isfinite(variance)]
    tolerance = float(np.sqrt(np.median(numerical))) if variance.size else 0.0
    lab = float(np.sqrt(max(np.median(finite) - tolerance**2, 0.0))) if finite.size else np.nan
    return ObservableNoise(lab, tolerance, scatter)


def join_rows(parts: Sequence[ComparisonRows]) -> ComparisonRows:
    def concatenate_field(name: str) -> Any:
        first, *_ = values = [getattr(part, name) for part in parts]
        if isinstance(first, np.ndarray):
            return np.concatenate(values)
        if isinstance(first, tuple):
            return tuple(each for column in values for each in column)
        return {key: np.concatenate([column[key] for column in values]) for key in first}

    shared = np.asarray(linalg.block_diag(*(part.shared for part in parts)))
    columns = {name: concatenate_field(name) for name in (*ROW_WISE, "warnings", "unmerged")}
    noise = {name: noise for part in parts for name, noise in part.noise.items()}
    return replace(parts[0], **columns, shared=shared[:, np.any(shared != 0.0, axis=0)], noise=noise)
