"""Correlation of the scatter of observables that are measured on one heap.

Rows of one heap share what sets it apart from others. For means z_i of N_i repeats of observable a and z_j of
N_j repeats of b, M_ij of them on the same heaps,

    cov(z_i, z_j) = rho_ab M_ij / sqrt(N_i N_j) s_i s_j,    s_i^2 = variance of z_i by scatter alone

rho comes from the sample correlation r of nu repeats that the laboratory made of several observables at once,

    rho = (1 - lambda) nu r / (nu + 1),    lambda = sum (1 - r^2)^2 / nu / sum r^2

with sums over all pairs of observables; it is 0 where lambda is above MOST_CHANCE. Observables without such
repeats have the correlation of the model's runs, whose scatter is that of its packings: where a laboratory
scatters more, what is beyond is taken to be independent.

Reference: Schaefer & Strimmer (2005), Stat. Appl. Genet. Mol. Biol. 4(1), 32 (lambda); one count of 0 stands
for the uncertainty of rho.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from taichi_erosion.evidence.data.comparison_rows import ComparisonRows, condition_groups, heap_keys
from taichi_erosion.evidence.data.problem import Floats, Measurements, Observable, Replicates
from taichi_erosion.evidence.data.transforms import to_scale

LEAST_FREEDOM = 8.0  # degrees of freedom of repeats from which a correlation is estimated
MOST_CHANCE = 0.25  # lambda above which a correlation may be chance alone, and is not used
LEAST_EIGENVALUE = 0.05  # of a correlation: no contrast of observables is taken to be more certain


@dataclass(frozen=True)
class HeapCorrelation:
    """Correlation (k, k) of observables of one heap."""

    names: tuple[str, ...]
    matrix: Floats

    def correlation_between(self, names: Sequence[str]) -> Floats:
        """The correlation of some observables, 0 with those that it does not know."""
        matrix, places = np.eye(len(names)), [k for k, name in enumerate(names) if name in self.names]
        indices = [self.names.index(names[k]) for k in places]
        matrix[np.ix_(places, places)] = self.matrix[np.ix_(indices, indices)]
        return matrix


def heap_correlation(
    rows: ComparisonRows, table: Measurements, replicates: Replicates | None = None
) -> HeapCorrelation | None:
    """Correlation of the observables of a table; None where no heap has two of them, or nothing is known."""
    names, unit = tuple(each.name for each in rows.observables), np.ones((len(rows.observables),) * 2)
    if not np.any(row_correlation(rows, unit)):
        return None
    target = np.eye(len(names)) if replicates is None else replicate_correlation(rows, replicates)
    wrong = {(each.observable, line) for each in rows.unmerged for line in each.suspects}
    sound = [key not in wrong for key in zip(table.observable, table.table_line_numbers, strict=True)]
    sample, freedom = correlation_of_repeats(rows.observables, table.pick_rows_at(np.array(sound)))
    matrix = np.where(freedom >= LEAST_FREEDOM, shrink_correlation(sample, freedom), target)
    if np.array_equal(matrix, np.eye(len(names))):
        return None
    return HeapCorrelation(names, make_positive_definite(matrix))


def add_correlation(rows: ComparisonRows, correlation: HeapCorrelation | None) -> ComparisonRows:
    """Rows with the covariances of those of one heap."""
    if correlation is None:
        return rows
    share = row_correlation(rows, correlation.correlation_between([each.name for each in rows.observables]))
    if not share.any():
        return rows
    sd = np.sqrt(np.nan_to_num(scatter_variance(rows)))
    return replace(rows, covariance=share * np.outer(sd, sd))


def scatter_variance(rows: ComparisonRows) -> Floats:
    """Variance of every row by scatter alone, without the tolerance of the model."""
    tolerance = np.array([each.sd_numerical for each in rows.observables])[rows.which]
    return np.maximum(rows.variance - (tolerance * rows.slope) ** 2, 0.0)


def row_correlation(rows: ComparisonRows, matrix: Floats) -> Floats:
    """Correlation (n, n) of rows, diagonal 0, where observables of one heap have the correlation (k, k).

    A censored row is correlated with no other one.
    """
    shares, on = np.zeros((rows.size, rows.size)), dict[str, list[int]]()
    for row, heaps in enumerate(rows.heaps):
        for heap in heaps.keys() - {""} if not rows.censored[row] else ():
            on.setdefault(heap, []).append(row)
    for heap, members in on.items():
        count = np.array([rows.heaps[row][heap] for row in members])
        shares[np.ix_(members, members)] += np.minimum.outer(count, count)
    if not on:
        return shares
    whole = np.array([sum(counts.values()) for counts in rows.heaps])  # repeats behind each row
    shares *= matrix[np.ix_(rows.which, rows.which)] / np.sqrt(np.outer(whole, whole))
    shares[rows.which[:, np.newaxis] == rows.which] = 0.0
    return shares


def replicate_correlation(rows: ComparisonRows, replicates: Replicates) -> Floats:
    """Correlation of the model's replicates, less where the laboratory scatters more than the model."""
    names = [each.name for each in rows.observables]
    single = scatter_variance(rows) * [sum(variances.values()) for variances in rows.heaps]
    share = np.zeros(len(names))
    for k, name in enumerate(names):
        finite = single[(rows.which == k) & np.isfinite(single)]
        if name in replicates.names and finite.size:
            sd = float(replicates.sd[replicates.names.index(name)])
            share[k] = min(1.0, sd / max(float(np.sqrt(np.median(finite))), 1e-300))
    of_model = HeapCorrelation(replicates.names, replicates.correlation).correlation_between(names)
    return np.where(np.eye(len(names), dtype=np.bool_), 1.0, of_model * np.outer(share, share))


def correlation_of_repeats(observables: Sequence[Observable], table: Measurements) -> tuple[Floats, Floats]:
    """Correlation of repeats about the means of their conditions, and its degrees of freedom (k, k)."""
    size, names = len(observables), np.array(table.observable)
    heaps, first, heap = np.unique(heap_keys(table), return_index=True, return_inverse=True)
    cell, n = condition_groups(table)[first], np.where(table.n >= 1.0, table.n, 1.0)
    values, counts = np.zeros((heaps.size, size)), np.zeros((heaps.size, size))
    for k, observable in enumerate(observables):
        z = to_scale(observable, np.where(table.censored, np.nan, table.value))
        pairs = (names == observable.name) & np.isfinite(z) & (heaps[heap] != "")
        counts[:, k] = np.bincount(heap[pairs], n[pairs], heaps.size)
        totals = np.bincount(heap[pairs], n[pairs] * z[pairs], heaps.size)
        values[:, k] = totals / np.maximum(counts[:, k], 1.0)
    correlation, freedom = np.eye(size), np.zeros((size, size))
    for a, b in zip(*np.triu_indices(size, 1), strict=True):
        both = (counts[:, a] > 0.0) & (counts[:, b] > 0.0)
        pair = values[both][:, [a, b]], counts[both][:, [a, b]], cell[both]
        correlation[a, b], freedom[a, b] = correlation[b, a], freedom[b, a] = correlation_within_cells(*pair)
    return correlation, freedom


def correlation_within_cells(values: Floats, counts: Floats, cell: Floats) -> tuple[float, float]:
    """Correlation of two columns (m, 2) about the means of their cells, and its degrees of freedom."""
    products, freedom = np.zeros((2, 2)), 0.0
    for number in np.unique(cell):
        pairs = cell == number
        gap = values[pairs] - np.average(values[pairs], axis=0, weights=counts[pairs])
        gap = gap * np.sqrt(counts[pairs])
        products += gap.T @ gap
        freedom += float(pairs.sum()) - 1.0
    if freedom < LEAST_FREEDOM or products[0, 0] <= 0.0 or products[1, 1] <= 0.0:
        return 0.0, 0.0
    return float(products[0, 1] / np.sqrt(products[0, 0] * products[1, 1])), freedom


def shrink_correlation(sample: Floats, freedom: Floats) -> Floats:
    """Sample correlation (k, k) drawn towards 0, which it is for pairs of too few degrees of freedom."""
    is_known = freedom >= LEAST_FREEDOM
    nu = np.where(is_known, freedom, 1.0)
    uncertain, size = (float(np.sum(part[is_known])) for part in ((1.0 - sample**2) ** 2 / nu, sample**2))
    if uncertain > MOST_CHANCE * size or size == 0.0:
        return np.eye(len(sample))
    weights = (1.0 - uncertain / size) * (nu * sample) / (nu + 1.0)
    return make_positive_definite(np.where(is_known, weights, np.eye(len(sample))))


def make_positive_definite(matrix: Floats, least: float = LEAST_EIGENVALUE) -> Floats:
    """The same matrix where its eigenvalues allow it, else with the `least` of them raised."""
    values, vectors = np.linalg.eigh(matrix)
    if values[0] >= least:
        return matrix
    correlation = (vectors * np.maximum(values, least)) @ vectors.T
    size = np.sqrt(np.diag(correlation))
    return np.asarray(correlation / np.outer(size, size), dtype=np.float64)
