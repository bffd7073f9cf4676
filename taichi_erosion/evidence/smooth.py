"""Differences between paired runs, freed from replicate noise where the runs say how much of it there is.

A slope or signature changes smoothly with the conditions; replicate noise does not. Within one observable

    d = c + K a (K a + s^2)^-1 (d_raw - c)

with K a squared-exponential kernel over the conditions, s^2 the measured variance of the mean difference, c
the mean and the amplitude a the likeliest one. Two calibrated numbers that move a heap alike stay
indistinguishable then; raw noise would tell them apart. A model without noise is left as it is.
"""

from math import sqrt

import numpy as np

from taichi_erosion.evidence.predictor import Predictor, Spectrum, seed_mean
from taichi_erosion.evidence.problem import Bools, Floats, Integers

LENGTH = 1.5  # of the kernel, in sd of a condition
AMPLITUDES = np.concatenate([[0.0], np.geomspace(1e-2, 1e6, 25)])  # of the smooth part, over the noise
LOG_SPAN = 3.0  # a positive condition that spans more than this factor is taken by its logarithm


def standard_axis(column: Floats) -> Floats | None:
    """Standardised condition; None if it does not vary. Missing entries sit at the mean."""
    finite = column[np.isfinite(column)]
    if finite.size < 2 or np.ptp(finite) <= 1e-12 * np.abs(finite).max():
        return None
    filled = np.where(np.isfinite(column), column, finite.mean())
    if finite.min() > 0.0 and finite.max() > LOG_SPAN * finite.min():
        filled = np.log(filled)
    return (filled - filled.mean()) / filled.std()


def pooled_noise(differences: Floats, which: Integers) -> Floats:
    """Variance of the mean difference of paired runs (r, n), pooled over the rows of an observable."""
    count = differences.shape[0]
    if count < 2:
        return np.zeros(differences.shape[1])
    good = np.where(np.isfinite(differences), differences, 0.0)
    spread = np.var(good, axis=0, ddof=1) / count
    pooled = np.zeros(spread.size)
    for index in np.unique(which):
        rows = which == index
        pooled[rows] = spread[rows].mean()
    return pooled


def paired_change(after: Floats, before: Floats, predictor: Predictor) -> Floats:
    """Mean change between paired runs of a predictor, smoothed as far as their noise demands."""
    change = seed_mean(after) - seed_mean(before)
    noise = pooled_noise(after - before, predictor.which)
    if not np.any(noise > 0.0):
        return change
    for index in np.unique(predictor.which):
        rows = (predictor.which == index) & np.isfinite(change) & (change != 0.0)
        if rows.sum() > 2 and noise[rows].max() > 0.0:
            change[rows] = smoothed(change[rows], float(noise[rows].mean()), spectrum(predictor, rows))
    return change


def spectrum(predictor: Predictor, rows: Bools) -> Spectrum:
    """Eigenvalues and eigenvectors of the kernel over some rows; remembered, no run changes them."""
    key = rows.tobytes()
    if key not in predictor.spectra:
        axes = [standard_axis(column[rows]) for column in predictor.conditions.values()]
        varied = [axis for axis in axes if axis is not None]
        square = np.zeros((int(rows.sum()), int(rows.sum())))
        for axis in varied:
            square += ((axis[:, np.newaxis] - axis[np.newaxis, :]) / LENGTH) ** 2
        values, vectors = np.linalg.eigh(np.exp(-0.5 * square / max(sqrt(len(varied)), 1.0)))
        predictor.spectra[key] = np.maximum(values, 0.0), vectors
    return predictor.spectra[key]


def smoothed(values: Floats, variance: float, kernel: Spectrum) -> Floats:
    """Posterior mean of a smooth function of the conditions, at its likeliest amplitude."""
    eigenvalues, vectors = kernel
    centre = values.mean()
    parts = vectors.T @ (values - centre)
    total = variance * (1.0 + AMPLITUDES[:, np.newaxis] * eigenvalues)
    fit = -0.5 * np.sum(np.log(total) + parts**2 / total, axis=1)
    best = AMPLITUDES[int(np.argmax(fit))] * eigenvalues
    return centre + vectors @ (best / (1.0 + best) * parts)
