"""Errors that nobody stated, in words: sources that differ, batches, rows that are off, uneven scatter."""

from math import exp

import numpy as np

from taichi_erosion.evidence.data.findings import NONE, OUTSIDE, ErrorFinding
from taichi_erosion.evidence.data.linear_algebra import projection
from taichi_erosion.evidence.data.problem import Floats, Observable
from taichi_erosion.evidence.inference import verdict_levels as levels
from taichi_erosion.evidence.inference.marginal_likelihood import Expansion
from taichi_erosion.evidence.inference.pipeline import Analysis
from taichi_erosion.evidence.inference.posterior import HALF_WIDTH, Posterior, label
from taichi_erosion.evidence.inference.prepared_problem import PreparedProblem
from taichi_erosion.evidence.inference.robustness.error_accounts import (
    ErrorAccount,
    SharedError,
    UnstatedScatter,
)

LEAST_TAU = 0.3  # of a row's sd, from which a shared error is told


def error_findings(found: Analysis) -> tuple[ErrorFinding, ...]:
    """Every error of the account on which an answer rests; none where it rests on the stated ones."""
    errors, prepared = found.errors, found.fitted.prepared
    if errors is None:
        return ()
    told = [each for each in errors.shared if each.tau > LEAST_TAU]
    words = [(each, shared_words(prepared, found.final.expansion, errors, each)) for each in told]
    shared = [ErrorFinding(errors.kind, each.observable, line) for each, line in words if line]
    rows = [ErrorFinding("rows", *row_words(found, row)) for row in errors.rows]
    scatter = [ErrorFinding("scatter", *scatter_words(errors))] if errors.scatter else []
    unstated = [ErrorFinding("scatter", *unstated_words(errors, prepared, each)) for each in errors.unstated]
    return *shared, *rows, *scatter, *unstated


def observable_of(prepared: PreparedProblem, name: str) -> tuple[Observable, str]:
    """An observable and the unit of its rows."""
    table = prepared.problem.measurements
    unit = next((u for n, u in zip(table.observable, table.unit, strict=True) if n == name), "")
    return prepared.rows.observable(name), unit


def shared_words(
    prepared: PreparedProblem, expansion: Expansion, errors: ErrorAccount, shared: SharedError
) -> str:
    """The two sources that differ most, or the sd of a batch; nothing of sources that hardly differ."""
    observable, unit = observable_of(prepared, shared.observable)
    typical = float(np.median(prepared.sd[prepared.rows.rows_of(observable)]))
    if errors.kind == "batch":
        size = size_words(observable, unit, shared.tau * typical)
        return (
            f"{observable.name}: rows of one group share an error of {size} beside their own scatter, "
            f"{shared.tau:.2g} times that of a row."
        )
    mean, covariance = shared_errors(prepared, expansion)
    at = shared.first + np.arange(len(shared.labels))
    size = mean[at] * shared.tau * typical
    low, high = int(np.argmin(size)), int(np.argmax(size))
    contrast = np.zeros(mean.size)
    contrast[at[high]], contrast[at[low]] = 1.0, -1.0
    spread = HALF_WIDTH * shared.tau * typical * float(np.sqrt(contrast @ covariance @ contrast))
    value = float(size[high] - size[low])
    if value < spread:
        return ""
    return (
        f"{observable.name}: {shared.labels[high]} reads {difference_words(observable, unit, value, spread)} "
        f"{shared.labels[low]} at the same conditions."
    )


def shared_errors(prepared: PreparedProblem, expansion: Expansion) -> tuple[Floats, Floats]:
    """Best sizes (q,) of the errors that rows share, in their sd, and their covariance; all numbers free."""
    work, shared = prepared.working(expansion.mean), expansion.shared
    white, loose = prepared.whitening(work), expansion.local.shape[1]
    columns = white(expansion.slopes)
    part = projection(columns, white(shared), loose)
    below = [work.residual, np.zeros(loose), -expansion.fit.x, np.zeros(shared.shape[1])]
    at = columns.shape[1]
    return part.solve(np.concatenate(below))[at:], part.covariance()[at:, at:]


def size_words(observable: Observable, unit: str, size: float) -> str:
    """A standard deviation on the comparison scale in the table's unit; on a logarithmic scale relative."""
    return f"{size:.2g} {unit}".strip() if observable.transform == "identity" else f"{size:.0%}"


def difference_words(observable: Observable, unit: str, value: float, spread: float) -> str:
    """A difference of two sources with its 90 % interval."""
    if observable.transform == "identity":
        interval = f"({value - spread:.3g} to {value + spread:.3g})"
        return " ".join(f"{value:.3g} {unit} {interval} higher than".split())
    return f"{exp(value):.3g} ({exp(value - spread):.3g} to {exp(value + spread):.3g}) times what is read by"


def row_words(found: Analysis, row: int) -> tuple[str, str]:
    """Observable and sentence of a row that lies far from every plausible explanation."""
    rows, errors = found.fitted.prepared.rows, found.errors
    assert errors is not None
    plain = np.sqrt(errors.stated_variance[row])
    tried = [found.fitted.base, *found.fitted.refits]
    chance = found.posterior.probability
    likely = [each for each in tried if chance.get(label(each.names), 0.0) > levels.PLAUSIBLE]
    gaps = [(rows.z[row] - each.expansion.mean[row]) / plain for each in likely or [found.final]]
    gap = float(min(gaps, key=abs))
    name = rows.observable_at(row).name
    at = ", ".join(f"{key} = {column[row]:.3g}" for key, column in rows.conditions.items())
    way = "above" if gap > 0.0 else "below"
    return name, (
        f"{name} at {at}: this row is {abs(gap):.2g} sd {way} every plausible explanation and hardly counts."
    )


def scatter_words(errors: ErrorAccount) -> tuple[str, str]:
    """Observable, if there is only one, and how the scatter differs from what is stated."""
    told = []
    for each in errors.scatter:
        if each.along:
            way = "grows" if each.log_factor > 0.0 else "falls"
            told.append(f"{way} {exp(abs(each.log_factor)):.2g}-fold over the range of {each.place}")
        else:
            told.append(f"of {each.place} is about {exp(each.log_factor):.2g} times as large")
    places = {each.place for each in errors.scatter if not each.along}
    return (
        places.pop() if len(places) == 1 else ""
    ), f"The scatter is not as stated: it {' and '.join(told)}."


def unstated_words(
    errors: ErrorAccount, prepared: PreparedProblem, unstated: UnstatedScatter
) -> tuple[str, str]:
    """Observable, and the scatter of a source that states none beside the median of the others."""
    observable, unit = observable_of(prepared, unstated.observable)
    own = prepared.rows.rows_of(observable) & prepared.rows.stated
    median = float(np.median(np.sqrt(errors.stated_variance[own])))
    size = size_words(observable, unit, unstated.factor * median)
    return observable.name, (
        f"{observable.name}: {unstated.source} states no scatter; its rows scatter by about {size}, "
        f"{unstated.factor:.2g} times the median of the stated ones."
    )


def likeliest_words(posterior: Posterior) -> str:
    """The likeliest explanation with its probability."""
    name, chance = max(posterior.probability.items(), key=lambda item: item[1])
    words = {NONE: "nothing missing", OUTSIDE: "something that is not in the list"}
    return f"{words.get(name, name.replace('+', ' and '))} (probability {chance:.2g})"
