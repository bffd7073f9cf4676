"""Correlation of the scatter of observables that are measured on one heap.

Rows of one heap share what sets it apart from others. For means z_i of N_i repeats of observable a and z_j of
N_j repeats of b, M_ij of them on the same heaps,

    cov(z_i, z_j) = rho_ab M_ij / sqrt(N_i N_j) s_i s_j,    s_i^2 = variance of z_i by scatter alone

rho comes from the sample correlation r of nu repeats that the laboratory made of several observables at once,
and from that of replicates of the model, t; without replicates t = 0, without repeats lambda = 1:

    rho = (1 - lambda) (nu r + t) / (nu + 1) + lambda t,    lambda = sum (1 - r^2)^2 / nu / sum (r - t)^2

with sums over all pairs of observables; rho is t where lambda is above MOST_CHANCE. The scatter of a model is
that of its packings: where a laboratory scatters more, what is beyond is taken to be independent.

Reference: Schaefer & Strimmer (2005), Stat. Appl. Genet. Mol. Biol. 4(1), 32 (lambda); the one count of t
stands for the uncertainty of rho.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from taichi_erosion.evidence.data.comparison_rows import ComparisonRows, condition_numbers, heap_keys
from taichi_erosion.evidence.data.problem import Bools, Floats, Measurements, Observable, Replicates
from taichi_erosion.evidence.data.transforms import to_scale

LEAST_FREEDOM = 8.0  # degrees of freedom of repeats from which a correlation is estimated
MOST_CHANCE = 0.25  # lambda above which a correlation may be chance alone, and is not used
LEAST_EIGENVALUE = 0.05  # of a correlation: no contrast of observables is taken to be more certain
SEEN = 0.05  # correlation from which it is told


@dataclass(frozen=True)
class HeapCorrelation:
    """Correlation (k, k) of observables of one heap."""

    names: tuple[str, ...]
    matrix: Floats
    repeats: float = 0.0  # degrees of freedom of the laboratory's repeats behind it
    replicates: float = 0.0  # of those of the model

    def of(self, names: Sequence[str]) -> Floats:
        """The correlation of some observables, 0 with those that it does not know."""
        found, known = np.eye(len(names)), [k for k, name in enumerate(names) if name in self.names]
        own = [self.names.index(names[k]) for k in known]
        found[np.ix_(known, known)] = self.matrix[np.ix_(own, own)]
        return found

    @property
    def sentences(self) -> tuple[str, ...]:
        """Every correlation that matters, in words."""
        parts = ((self.repeats, "repeats of the laboratory"), (self.replicates, "replicates of the model"))
        origin = " and ".join(words for freedom, words in parts if freedom > 0.0)
        return tuple(
            f"{self.names[i]} and {self.names[j]} of one heap scatter together: correlation "
            f"{self.matrix[i, j]:.2f}, by {origin}."
            for i, j in zip(*np.triu_indices(len(self.names), 1), strict=True)
            if abs(self.matrix[i, j]) >= SEEN
        )


def heap_correlation(
    rows: ComparisonRows, table: Measurements, replicates: Replicates | None = None
) -> HeapCorrelation | None:
    """Correlation of the observables of a table; None where no heap has two of them, or nothing is known."""
    names, unit = tuple(each.name for each in rows.observables), np.ones((len(rows.observables),) * 2)
    if not np.any(shared_share(rows, unit)):
        return None
    target = np.eye(len(names)) if replicates is None else model_correlation(rows, replicates)
    wrong = {(each.observable, line) for each in rows.apart for line in each.suspects}
    sound = [key not in wrong for key in zip(table.observable, table.lines, strict=True)]
    sample, freedom = sample_correlation(rows.observables, table.rows(np.array(sound)))
    known = (freedom >= LEAST_FREEDOM) & ~np.eye(len(names), dtype=np.bool_)
    found = shrunk(sample, freedom, known, target)
    if np.array_equal(found, np.eye(len(names))):
        return None
    runs = 0.0 if replicates is None else replicates.freedom
    return HeapCorrelation(names, found, float(np.max(freedom, where=known, initial=0.0)), runs)


def correlated(rows: ComparisonRows, correlation: HeapCorrelation | None) -> ComparisonRows:
    """Rows with the covariances of those of one heap."""
    if correlation is None:
        return rows
    share = shared_share(rows, correlation.of([each.name for each in rows.observables]))
    if not share.any():
        return rows
    sd = np.sqrt(np.nan_to_num(scatter_variance(rows)))
    return replace(rows, covariance=share * np.outer(sd, sd))


def scatter_variance(rows: ComparisonRows) -> Floats:
    """Variance of every row by scatter alone, without the tolerance of the model."""
    tolerance = np.array([each.sd_numerical for each in rows.observables])[rows.which]
    return np.maximum(rows.variance - (tolerance * rows.slope) ** 2, 0.0)


def shared_share(rows: ComparisonRows, matrix: Floats) -> Floats:
    """Correlation (n, n) of rows, diagonal 0, where observables of one heap have the correlation (k, k).

    A censored row is correlated with no other one.
    """
    found, on = np.zeros((rows.size, rows.size)), dict[str, list[int]]()
    for row, own in enumerate(rows.heaps):
        for heap in own.keys() - {""} if not rows.censored[row] else ():
            on.setdefault(heap, []).append(row)
    for heap, members in on.items():
        count = np.array([rows.heaps[row][heap] for row in members])
        found[np.ix_(members, members)] += np.minimum.outer(count, count)
    if not on:
        return found
    whole = repeats_of(rows)
    found *= matrix[np.ix_(rows.which, rows.which)] / np.sqrt(np.outer(whole, whole))
    found[rows.which[:, np.newaxis] == rows.which] = 0.0
    return found


def repeats_of(rows: ComparisonRows) -> Floats:
    """Number of repeats behind each row."""
    return np.array([sum(own.values()) for own in rows.heaps])


def model_correlation(rows: ComparisonRows, replicates: Replicates) -> Floats:
    """Correlation of the model's replicates, less where the laboratory scatters more than the model."""
    found = np.eye(len(rows.observables))
    single = scatter_variance(rows) * repeats_of(rows)
    share = np.zeros(len(rows.observables))
    for k, observable in enumerate(rows.observables):
        own = single[(rows.which == k) & np.isfinite(single)]
        if observable.name in replicates.names and own.size:
            sd = float(replicates.sd[replicates.names.index(observable.name)])
            share[k] = min(1.0, sd / max(float(np.sqrt(np.median(own))), 1e-300))
    names = [each.name for each in rows.observables]
    known = HeapCorrelation(replicates.names, replicates.correlation).of(names)
    return np.where(found > 0.0, 1.0, known * np.outer(share, share))


def sample_correlation(observables: Sequence[Observable], table: Measurements) -> tuple[Floats, Floats]:
    """Correlation of repeats about the means of their conditions, and its degrees of freedom (k, k)."""
    size, keys, cells = len(observables), heap_keys(table), condition_numbers(table)
    places: dict[tuple[float, str], int] = {}
    values, counts = np.full((table.size, size), np.nan), np.zeros((table.size, size))
    for k, observable in enumerate(observables):
        z = to_scale(observable, np.where(table.censored, np.nan, table.value))
        for i in np.flatnonzero(np.array(table.observable) == observable.name):
            if keys[i] and np.isfinite(z[i]):
                heap, n = places.setdefault((cells[i], keys[i]), len(places)), max(table.n[i], 1.0)
                n = n if np.isfinite(n) else 1.0
                before = counts[heap, k]
                values[heap, k] = (np.nan_to_num(values[heap, k]) * before + n * z[i]) / (before + n)
                counts[heap, k] += n
    cell = np.array([cell for cell, _ in places])
    values, counts = values[: cell.size], counts[: cell.size]
    found, freedom = np.eye(size), np.zeros((size, size))
    for a, b in zip(*np.triu_indices(size, 1), strict=True):
        both = (counts[:, a] > 0.0) & (counts[:, b] > 0.0)
        r, nu = pair_correlation(values[both][:, [a, b]], counts[both][:, [a, b]], cell[both])
        found[a, b] = found[b, a] = r
        freedom[a, b] = freedom[b, a] = nu
    return found, freedom


def pair_correlation(values: Floats, counts: Floats, cell: Floats) -> tuple[float, float]:
    """Correlation of two columns (m, 2) about the means of their cells, and its degrees of freedom."""
    products, freedom = np.zeros((2, 2)), 0.0
    for number in np.unique(cell):
        own = cell == number
        gap = values[own] - np.average(values[own], axis=0, weights=counts[own])
        gap = gap * np.sqrt(counts[own])
        products += gap.T @ gap
        freedom += float(own.sum()) - 1.0
    if freedom < LEAST_FREEDOM or products[0, 0] <= 0.0 or products[1, 1] <= 0.0:
        return 0.0, 0.0
    return float(products[0, 1] / np.sqrt(products[0, 0] * products[1, 1])), freedom


def shrunk(sample: Floats, freedom: Floats, known: Bools, target: Floats) -> Floats:
    """Sample correlation (k, k) drawn towards a target; the target alone for pairs that are not known."""
    nu = np.where(known, freedom, 1.0)
    uncertain = float(np.sum(((1.0 - sample**2) ** 2 / nu)[known]))
    apart = float(np.sum(((sample - target) ** 2)[known]))
    share = uncertain / apart if apart > 0.0 else 1.0
    share = 1.0 if share > MOST_CHANCE else share
    mixed = (1.0 - share) * (nu * sample + target) / (nu + 1.0) + share * target
    return valid_correlation(np.where(known, mixed, target))


def valid_correlation(matrix: Floats) -> Floats:
    """The same matrix where its eigenvalues allow it, else with the least of them raised."""
    values, vectors = np.linalg.eigh(matrix)
    if values[0] >= LEAST_EIGENVALUE:
        return matrix
    found = (vectors * np.maximum(values, LEAST_EIGENVALUE)) @ vectors.T
    size = np.sqrt(np.diag(found))
    return np.asarray(found / np.outer(size, size), dtype=np.float64)


def replicates_of(rows: ComparisonRows, values: Floats) -> Replicates | None:
    """Scatter of a model's seeds (r, n) at the rows; None where no conditions have two observables."""
    size, seeds = len(rows.observables), values.shape[0]
    cell = condition_numbers(rows).astype(np.int64)
    gaps = np.full((seeds, int(cell.max(initial=-1)) + 1, size), np.nan)
    gaps[:, cell, rows.which] = values - values.mean(axis=0)
    sd = np.sqrt(
        np.nansum(gaps**2, axis=(0, 1)) / np.maximum(np.sum(np.isfinite(gaps[0]), axis=0), 1) / (seeds - 1)
    )
    found, freedom = np.eye(size), np.zeros((size, size))
    for a, b in zip(*np.triu_indices(size, 1), strict=True):
        both = np.all(np.isfinite(gaps[:, :, [a, b]]), axis=(0, 2))
        first, second = gaps[:, both, a], gaps[:, both, b]
        energy = float(np.sum(first**2)) * float(np.sum(second**2))
        if energy > 0.0:
            found[a, b] = found[b, a] = float(np.sum(first * second)) / np.sqrt(energy)
            freedom[a, b] = freedom[b, a] = min(independent_count(each) for each in (first, second))
    known = freedom >= LEAST_FREEDOM
    if not known.any():
        return None
    names = tuple(each.name for each in rows.observables)
    return Replicates(names, sd, shrunk(found, freedom, known, np.eye(size)), float(freedom.max()))


def independent_count(gaps: Floats) -> float:
    """Independent deviations (r, m) from the means of m columns: seeds may disturb all columns alike.

    (r - 1) m / (1 + (m - 1) c^2), c^2 the mean squared correlation of two columns beyond that of chance.
    """
    seeds, count = gaps.shape
    norm = np.linalg.norm(gaps, axis=0)
    if count < 2 or not np.all(norm > 0.0):
        return float((seeds - 1) * (count > 0))
    chance, squares = 1.0 / (seeds - 1), ((gaps / norm).T @ (gaps / norm)) ** 2
    mean = float((np.sum(squares) - count) / (count * (count - 1)))
    common = min(max((mean - chance) / (1.0 - chance), 0.0), 1.0)
    return (seeds - 1) * count / (1.0 + (count - 1) * common)
