"""Rows, noise budgets and misfits as the findings show them: back in the observables' own units."""

import numpy as np

from taichi_erosion.evidence.algebra import projection, working
from taichi_erosion.evidence.evidence import Expansion
from taichi_erosion.evidence.examination import Examination
from taichi_erosion.evidence.findings import Noise, ObservableMisfit, ObservableNoise, Rows
from taichi_erosion.evidence.misfit import chance_of_quadratic, residuals_of
from taichi_erosion.evidence.problem import Floats
from taichi_erosion.evidence.scales import from_scale

ASK_REPEATS = (
    "Neither an sd nor repeated measurements are given, so no effect can be named. Repeat at least 4 "
    "conditions 3 times or more, or state the sd of a single measurement."
)
SUSPECT = 0.05  # probability below which stated and found scatter disagree


def rows_table(exam: Examination, expansion: Expansion) -> Rows:
    """Measured beside predicted."""
    rows = exam.rows
    measured, predicted = np.empty(rows.size), np.empty(rows.size)
    for index, observable in enumerate(rows.observables):
        chosen = rows.which == index
        measured[chosen] = from_scale(observable, rows.z[chosen])
        predicted[chosen] = from_scale(observable, expansion.mean[chosen])
    steep = np.where(rows.slope > 0.0, rows.slope, np.nan)
    shared = np.sum(rows.shared**2, axis=1)
    own = np.sum(expansion.shared**2, axis=1) - shared  # of the model itself
    return Rows(
        observable=tuple(rows.observables[i].name for i in rows.which),
        group=rows.group,
        conditions=rows.conditions,
        measured=measured,
        measured_sd=np.sqrt(rows.variance + shared) / steep,
        predicted=predicted,
        predicted_sd=np.sqrt(np.maximum(exam.variance - rows.variance + own, 0.0)) / steep,
        residual=working((rows.z - expansion.mean) / exam.sd, rows.censored).residual,
    )


def chi_square(exam: Examination, expansion: Expansion) -> float:
    """Misfit of the measurements alone, shared errors at their best: r^T V^-1 r."""
    work = working((exam.rows.z - expansion.mean) / exam.sd, exam.rows.censored)
    shared = expansion.shared / exam.sd[:, np.newaxis] * work.weight[:, np.newaxis]
    part = projection(np.zeros((work.residual.size, 0)), shared)
    stacked = np.concatenate([work.residual, np.zeros(shared.shape[1])])
    free = part.free(stacked)
    return float(free @ free)


def freedom(exam: Examination, expansion: Expansion) -> float:
    """Degrees of freedom that calibration leaves: n minus the leverage of what it removes."""
    left = residuals_of(exam, expansion)
    return float(exam.rows.size - np.sum(left.basis**2))


def observable_misfits(exam: Examination, expansion: Expansion, table: Rows) -> dict[str, ObservableMisfit]:
    """Agreement observable by observable; p tests its own rows with calibration accounted for."""
    left, found = residuals_of(exam, expansion), {}
    for index, observable in enumerate(exam.rows.observables):
        chosen = exam.rows.which == index
        if not chosen.any():
            continue
        gap = (table.measured - table.predicted)[chosen]
        part = left.basis[chosen]
        eigenvalues = np.maximum(np.linalg.eigvalsh(np.eye(int(chosen.sum())) - part @ part.T), 0.0)
        free = left.free[chosen]
        p = chance_of_quadratic(float(free @ free), eigenvalues)
        whole = left.whole[chosen]
        found[observable.name] = ObservableMisfit(
            int(chosen.sum()), float(whole @ whole), float(np.sqrt(np.mean(gap**2))), float(gap.mean()), p
        )
    return found


def noise_table(exam: Examination, correlation: Floats | None, known: bool = True) -> Noise:
    """Noise budget with the simulator's share, and what must be said about it; `known` unless guessed."""
    budgets, sentences = {}, []
    simulated = np.sqrt(np.maximum(exam.variance - exam.rows.variance, 0.0))
    for index, observable in enumerate(exam.rows.observables):
        given = exam.rows.noise[observable.name]
        chosen = exam.rows.which == index
        paired = correlation[chosen] if correlation is not None else np.full(int(chosen.sum()), np.nan)
        seeds = float(np.nanmedian(paired)) if np.any(np.isfinite(paired)) else float("nan")
        own = float(np.median(simulated[chosen])) if chosen.any() else float("nan")
        budgets[observable.name] = ObservableNoise(
            given.lab, own, given.shared, given.numerical, given.repeats, given.stated_factor, given.p, seeds
        )
        sentences += noise_words(observable.name, given)
    return Noise(budgets, known, tuple(sentences) if known else (ASK_REPEATS,))


def noise_words(name: str, given: ObservableNoise) -> list[str]:
    """What one observable's noise check says."""
    if given.stated_factor == given.stated_factor and given.p < SUSPECT:
        relation = "larger" if given.stated_factor > 1.0 else "smaller"
        return [
            f"{name}: repeated measurements scatter {given.stated_factor:.2g} times as much as stated, "
            f"{relation} than chance allows (p = {given.p:.2g}); the stated sd was corrected."
        ]
    if given.lab != given.lab:
        return [f"{name}: its noise is unknown; it is shown but decides nothing."]
    return []
