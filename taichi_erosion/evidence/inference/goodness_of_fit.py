"""Goodness of fit: chi^2 of the whole, of every observable, and smooth structure along every condition.

Along an axis the projected residual e is tested for smooth structure,

    T = e^T M K M e  ~  sum lambda_j chi^2_1

with K a squared-exponential kernel along that condition within the observable, and its null distribution from
the eigenvalues lambda_j; probabilities are adjusted by Holm's method over all axes and levels.

Reference: Imhof (1961), Biometrika 48, 419 (three-moment approximation of the null).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import special

from taichi_erosion.evidence.data.findings import (
    MisfitPlace,
    Noise,
    ObservableMisfit,
    ObservableNoise,
    RowMisfit,
    RowOff,
    Rows,
    Stretch,
)
from taichi_erosion.evidence.data.linear_algebra import projection
from taichi_erosion.evidence.data.problem import Floats
from taichi_erosion.evidence.data.table_units import TableUnits
from taichi_erosion.evidence.data.transforms import from_scale
from taichi_erosion.evidence.inference.marginal_likelihood import (
    Expansion,
    ProjectedResidual,
    projected_residual,
)
from taichi_erosion.evidence.inference.model_discrepancy import squared_distance
from taichi_erosion.evidence.inference.prepared_problem import PreparedProblem
from taichi_erosion.evidence.inference.verdict_levels import (
    NOISE_LEVEL,
    ONE_ROW,
    ROW_ALONE,
    ROW_OFF,
    fails,
    p_text,
)
from taichi_erosion.evidence.models.predictor import standard_axis

LENGTH = 0.7  # of the kernel, in sd of a condition
PROMISE, PROMISE_NOISY = 2.0, 4.0  # misfit [1]; without noise, and per number of a model with noise
LEAST_OWN = 0.2  # of a row, that calibration leaves free: below, its residual says little [1]
BINS = 4  # along an axis, of about equal numbers of rows
MOST_LEVELS_TOLD = 6  # levels of a condition up to which each is a bin of its own
TREND_END = 1.5  # mean residual at either end, in its standard errors, from which both ends are told
CLEAR = 1.0  # the same of a neighbouring bin that belongs to the range that is told
LEVEL_AXIS = "level"
ASK_REPEATS = (
    "Neither an sd nor repeated measurements are given, so no effect can be named. Repeat at least 4 "
    "conditions 3 times or more, or state the sd of a single measurement."
)


def quadratic_form_p(value: Floats | float, matrix: Floats) -> Floats:
    """P(sum lambda_j chi^2_1 > value), lambda of a matrix, by matching three moments to a shifted chi^2."""
    square = matrix @ matrix  # sums of powers of the eigenvalues are traces
    traces = float(np.trace(matrix)), float(np.trace(square)), float(np.sum(square * matrix))
    return shifted_chi2_p(value, traces)


def shifted_chi2_p(value: Floats | float, traces: tuple[float, float, float]) -> Floats:
    """The same from the traces of the first three powers of the matrix."""
    first, second, third = traces
    if second <= 0.0 or third <= 0.0:
        return np.ones_like(value)
    freedom = second**3 / third**2
    position = (value - first) * np.sqrt(freedom / second) + freedom
    return np.asarray(special.chdtrc(freedom, np.maximum(position, 0.0)), dtype=np.float64)


def projection_traces(basis: Floats) -> tuple[float, float, float]:
    """Traces of the first three powers of 1 - B B^T, B (n, d), from those of B^T B."""
    small = basis.T @ basis
    square, size = small @ small, basis.shape[0]
    first, second, third = float(np.trace(small)), float(np.trace(square)), float(np.sum(square * small))
    return size - first, size - 2.0 * first + second, size - 3.0 * (first - second) - third


def misfit_p(prepared: PreparedProblem, expansion: Expansion) -> float:
    """Probability that a complete model would leave as much, calibration and shared errors accounted for.

    |M e|^2 over all stacked rows has n degrees of freedom when the truth is drawn from the prior.
    """
    return float(misfit_p_by_noise(prepared, expansion, np.ones(1))[0])


def misfit_p_by_noise(prepared: PreparedProblem, expansion: Expansion, factors: Floats) -> Floats:
    """The same where the scatter is `factors` times as large as stated."""
    left = projected_residual(prepared, expansion)
    value = float(left.free @ left.free) + max(left.promised - promise_limit(prepared), 0.0)
    return shifted_chi2_p(value / factors**2, projection_traces(left.row_basis))


def promise_limit(prepared: PreparedProblem) -> float:
    """Misfit that slopes may promise to remove although the fit, made with other seeds, did not."""
    return PROMISE_NOISY * (1.0 + len(prepared.axes)) if prepared.noisy else PROMISE


def stuck_numbers(prepared: PreparedProblem, expansion: Expansion) -> list[str]:
    """Calibrated numbers at an end of their range that would leave it."""
    stuck = projected_residual(prepared, expansion).stuck[expansion.local.shape[1] :]
    return [axis.name for axis, at_end in zip(prepared.axes, stuck, strict=True) if at_end]


def structure_p(left: ProjectedResidual, factor: Floats) -> float:
    """Chance of as much structure of the rows, each over its own sd, along one kernel factor (n, r)."""
    factor = left.white.unmixed(factor)
    projected = factor.T @ left.free
    return float(quadratic_form_p(float(projected @ projected), factor.T @ left.project(factor)))


def told_residual(prepared: PreparedProblem, expansion: Expansion, left: ProjectedResidual) -> Floats:
    """Residual over its sd by which places of a misfit are told, with errors that rows share at their best.

    Beside a number that ends at its bound it is that of the fit as it stands, which figures show: errors that
    rows share, such as those of an emulator far outside its runs, would do what the number cannot.
    """
    if not left.stuck.any():
        return left.own
    rows = prepared.rows
    return np.where(rows.censored, left.own, (rows.z - expansion.mean) / prepared.sd)


def misfit_places(prepared: PreparedProblem, expansion: Expansion) -> tuple[MisfitPlace, ...]:
    """Every observable as a whole and along each condition, worst first, with its adjusted chance."""
    left, units = projected_residual(prepared, expansion), prepared.problem.measurements.table_units
    own = told_residual(prepared, expansion, left)
    found: list[tuple[str, str, float, str, tuple[Stretch, ...]]] = []
    for observable, rows in prepared.by_observable():
        if observable.name not in prepared.levels:
            level = rows.astype(float)[:, np.newaxis] / prepared.sd[:, np.newaxis]
            p = structure_p(left, level / np.linalg.norm(level))
            sign = 1 if float(np.sum(own[rows] / prepared.sd[rows])) > 0.0 else -1
            whole = (Stretch(sign, None, None),)
            found.append((observable.name, LEVEL_AXIS, p, f"{direction(sign)} on average", whole))
        for name, column in prepared.rows.conditions.items():
            axis = standard_axis(column[rows])
            if axis is None:
                continue
            values, vectors = np.linalg.eigh(np.exp(-0.5 * squared_distance(axis, LENGTH)))
            factor = np.zeros((prepared.rows.size, axis.size))
            factor[rows] = vectors * np.sqrt(np.maximum(values, 0.0))
            words = failing_range(name, column[rows], own[rows], units)
            where = failing_stretches(column[rows], own[rows])
            found.append((observable.name, name, structure_p(left, factor), words, where))
    adjusted = holm([p for _, _, p, *_ in found])
    places = [
        MisfitPlace(name, axis, p, place_sentence(name, axis, words, p), where)
        for (name, axis, _, words, where), p in zip(found, adjusted, strict=True)
    ]
    return tuple(sorted(places, key=lambda place: place.p))


def holm(p: list[float]) -> list[float]:
    """Holm's step-down adjustment."""
    adjusted, last = [0.0] * len(p), 0.0
    for rank, index in enumerate(np.argsort(p)):
        last = max(last, min(1.0, (len(p) - rank) * p[index]))
        adjusted[index] = last
    return adjusted


@dataclass(frozen=True)
class AxisBin:
    """Rows of one level of a condition, or of neighbouring levels; rows of one value are never parted."""

    low: float
    high: float
    count: int
    mean: float  # of the residual, in sd

    @property
    def size(self) -> float:
        """Mean over its standard error."""
        return float(self.mean * np.sqrt(self.count))


def axis_bins(column: Floats, free: Floats) -> list[AxisBin]:
    """Residual along a condition: level by level, or in BINS bins of about as many rows for many levels."""
    known = np.isfinite(column)
    values, inverse, counts = np.unique(column[known], return_inverse=True, return_counts=True)
    number = np.arange(values.size)
    if values.size > MOST_LEVELS_TOLD:
        middle = np.cumsum(counts) - 0.5 * counts
        number = np.minimum((BINS * middle / counts.sum()).astype(int), BINS - 1)
    found = []
    for k in np.unique(number):
        own, inside = values[number == k], free[known][number[inverse] == k]
        found.append(AxisBin(float(own[0]), float(own[-1]), inside.size, float(inside.mean())))
    return found


def failing_range(axis: str, column: Floats, free: Floats, units: TableUnits) -> str:
    """Where along an axis the model fails, and in which direction: a trend, or one range."""
    bins = axis_bins(column, free)
    runs = failing_runs(bins)
    words = " and ".join(
        f"{direction(bins[run[0]].size)} {range_words(axis, bins, run, units)}" for run in runs
    )
    if len(runs) == 1:
        return words
    way = "rises" if bins[-1].size > 0.0 else "falls"
    return f"{words}: measured less model {way} with {axis}"


def failing_runs(bins: list[AxisBin]) -> list[tuple[int, int]]:
    """First and last bin of the range in which the model fails; of a trend those at both ends."""
    first, last = bins[0].size, bins[-1].size
    opposite = first * last < 0.0 and max(abs(first), abs(last)) > 2.0 * TREND_END
    if opposite and min(abs(first), abs(last)) > TREND_END:
        return [run_from(bins, 0), run_from(bins, len(bins) - 1)]
    return [run_from(bins, int(np.argmax([abs(each.size) for each in bins])))]


def failing_stretches(column: Floats, free: Floats) -> tuple[Stretch, ...]:
    """The same as numbers."""
    bins = axis_bins(column, free)
    return tuple(
        Stretch(
            1 if bins[first].size > 0.0 else -1,
            None if first == 0 else bins[first].low,
            None if last == len(bins) - 1 else bins[last].high,
            bins[first].low if bins[first].low == bins[last].high else None,
        )
        for first, last in failing_runs(bins)
    )


def direction(residual: float) -> str:
    """Direction of the model's error."""
    return "too low" if residual > 0.0 else "too high"


def run_from(bins: list[AxisBin], start: int) -> tuple[int, int]:
    """First and last of the neighbouring bins around one in which the model errs clearly in its direction."""
    sign = np.sign(bins[start].size)
    low = high = start
    while low > 0 and sign * bins[low - 1].size > CLEAR:
        low -= 1
    while high < len(bins) - 1 and sign * bins[high + 1].size > CLEAR:
        high += 1
    return low, high


def range_words(axis: str, bins: list[AxisBin], run: tuple[int, int], units: TableUnits) -> str:
    """A range of bins in words."""
    if run == (0, len(bins) - 1):
        return f"at every {axis}"
    low, high = (units.condition_text(axis, end) for end in (bins[run[0]].low, bins[run[1]].high))
    if low == high:
        return f"at {axis} = {high}"
    if run[0] == 0:
        return f"up to {axis} = {high}"
    if run[1] == len(bins) - 1:
        return f"from {axis} = {low}"
    return f"for {axis} between {low} and {high}"


def place_sentence(observable: str, axis: str, words: str, p: float) -> str:
    """One place in words, for a failure its direction too."""
    if fails(p):
        return f"{observable}: the model is {words} ({p_text(p)})"
    where = "as a whole" if axis == LEVEL_AXIS else f"along {axis}"
    return f"{observable}: no misfit seen {where} ({p_text(p)})"


def calibration_covariance(prepared: PreparedProblem, expansion: Expansion) -> Floats:
    """Covariance of strengths, then calibrated numbers in prior sd, as the rows leave them uncertain."""
    white = prepared.whitening(prepared.working(expansion.mean))
    slopes = expansion.slopes
    part = projection(white(slopes), white(expansion.shared), expansion.local.shape[1])
    return part.covariance()[: slopes.shape[1], : slopes.shape[1]]


def shared_shift(prepared: PreparedProblem, expansion: Expansion) -> Floats:
    """Change of the mean by instruments' errors and free levels at their best; not by errors of the model."""
    work = prepared.working(expansion.mean)
    shared, count = expansion.shared, prepared.rows.shared.shape[1]
    part = projection(np.zeros((work.residual.size, 0)), prepared.whitening(work)(shared))
    sizes = part.solve(np.concatenate([work.residual, np.zeros(shared.shape[1])]))
    return shared[:, :count] @ sizes[:count]


@dataclass(frozen=True)
class RowErrors:
    """Residuals of rows with the errors on which they, chi2 and p rest, on the comparison scale."""

    residual: Floats  # over the square root of `variance`, an ordinary one for a censored row
    shift: Floats  # of the mean by errors that rows share, where it is not shifted already
    calibrated: Floats  # variance of the mean by what the visible rows leave uncertain
    variance: Floats  # of measured minus predicted


def fitted_errors(prepared: PreparedProblem, expansion: Expansion) -> RowErrors:
    """Residuals of the rows to which the model is calibrated, shared errors at their best.

    What calibration leaves uncertain is no error of theirs: they lie as near as it brings them, for which p
    and the degrees of freedom account.
    """
    slopes = expansion.slopes
    covariance = calibration_covariance(prepared, expansion)
    calibrated = np.maximum(np.einsum("ij,jk,ik->i", slopes, covariance, slopes), 0.0)
    left = projected_residual(prepared, expansion)
    residual = left.white.unmixed(left.whole)
    variance = prepared.variance + model_variance(prepared, expansion)
    return RowErrors(residual, shared_shift(prepared, expansion), calibrated, variance)


def model_variance(prepared: PreparedProblem, expansion: Expansion) -> Floats:
    """Variance of the mean by the model's own errors, such as those of an emulator."""
    return np.asarray(np.sum(expansion.shared[:, prepared.rows.shared.shape[1] :] ** 2, axis=1))


def rows_table(prepared: PreparedProblem, expansion: Expansion, errors: RowErrors | None = None) -> Rows:
    """Measured beside predicted, in the observables' own units; without `errors` those of fitted rows."""
    errors = fitted_errors(prepared, expansion) if errors is None else errors
    rows = prepared.rows
    measured, predicted, shifted, low, high = (np.empty(rows.size) for _ in range(5))
    between = np.isfinite(rows.reach) & (rows.reach > 0.0)
    reach = np.where(between, rows.reach, 0.0)
    for observable, chosen in prepared.by_observable():
        measured[chosen] = from_scale(observable, rows.z[chosen])
        low[chosen] = from_scale(observable, (rows.z - reach)[chosen])
        high[chosen] = from_scale(observable, (rows.z + reach)[chosen])
        predicted[chosen] = from_scale(observable, expansion.mean[chosen])
        shifted[chosen] = from_scale(observable, (expansion.mean + errors.shift)[chosen])
    steep = np.where(rows.slope > 0.0, rows.slope, np.nan)
    shared = np.sum(rows.shared[:, len(prepared.levels) :] ** 2, axis=1)  # a free level is no error bar
    simulated = np.maximum(prepared.variance - rows.variance + model_variance(prepared, expansion), 0.0)
    return Rows(
        observable=rows.names,
        group=rows.group,
        conditions=rows.conditions,
        measured=measured,
        measured_sd=np.sqrt(rows.variance + shared) / steep,
        predicted=predicted,
        predicted_sd=np.sqrt(simulated) / steep,
        residual=errors.residual,
        residual_error=np.sqrt(errors.variance) / steep,
        model_sd=np.sqrt(errors.calibrated + simulated) / steep,
        shift=shifted - predicted,
        limit=rows.limits,
        low=tuple(np.where(between, low, np.nan).tolist()),
        high=tuple(np.where(between, high, np.nan).tolist()),
    )


def chi_square(prepared: PreparedProblem, expansion: Expansion) -> float:
    """Sum of the squared residuals of the rows, shared errors at their best."""
    whole = projected_residual(prepared, expansion).whole
    return float(whole @ whole)


def misfit_with_shared(prepared: PreparedProblem, expansion: Expansion) -> float:
    """The same with the squared sizes of the shared errors: r^T V^-1 r."""
    work = prepared.working(expansion.mean)
    shared = prepared.whitening(work)(expansion.shared)
    part = projection(np.zeros((work.residual.size, 0)), shared)
    free = part.free(np.concatenate([work.residual, np.zeros(shared.shape[1])]))
    return float(free @ free)


def scatter_factor(prepared: PreparedProblem, expansion: Expansion) -> float:
    """True over stated sd that would make the misfit what chance leaves on average."""
    left = projected_residual(prepared, expansion)
    return float(np.sqrt(left.free @ left.free / max(freedom(left), 1.0)))


def worst_row(prepared: PreparedProblem, expansion: Expansion) -> RowMisfit | None:
    """The row without which most of the misfit is gone; None where no row holds `levels.ONE_ROW` of it.

    With row i left out e - M d (d^T e) / (d^T M d) is left, d an error of that row alone, of covariance
    M - M d d^T M / (d^T M d).
    """
    left = projected_residual(prepared, expansion)
    matrix, lone = np.eye(left.whole.size) - left.row_basis @ left.row_basis.T, left.white.lone()
    along, moved = lone.T @ left.free, matrix @ lone
    own = np.maximum(np.einsum("ij,ij->j", lone, moved), 1e-9)
    falls = along**2 / own
    row, total = int(np.argmax(falls)), float(left.free @ left.free)
    share = min(float(falls[row]) / max(total, 1e-300), 1.0)
    if left.whole.size < 3 or share < ONE_ROW or own[row] < LEAST_OWN:
        return None
    others = left.free - moved[:, row] * along[row] / own[row]
    freed = matrix - np.outer(moved[:, row], moved[:, row]) / own[row]
    conditions = prepared.rows.conditions_at(row)
    return RowMisfit(
        observable=prepared.rows.observable_at(row).name,
        conditions=conditions,
        setting=prepared.problem.measurements.table_units.setting_text(conditions),
        residual_sd=float(along[row] / np.sqrt(own[row])),
        share=share,
        p_without=float(quadratic_form_p(float(others @ others), freed)),
    )


def row_off(prepared: PreparedProblem, expansions: Sequence[Expansion]) -> RowOff | None:
    """The row that lies `levels.ROW_OFF` or more to one side of the model under every explanation, alone.

    Where others lie as far off, it is the explanations that fail, not a row.
    """
    found = []
    for expansion in expansions:
        left = projected_residual(prepared, expansion)
        own, along = left.white.lone_squares(left.row_basis), left.white.lone().T @ left.free
        found.append(np.where(own > LEAST_OWN, along / np.sqrt(np.maximum(own, LEAST_OWN)), 0.0))
    every = np.array(found)
    least = np.where(np.abs(np.sum(np.sign(every), axis=0)) == len(found), np.min(np.abs(every), axis=0), 0.0)
    largest = np.sort(np.append(least, [0.0, 0.0]))[-2:]
    if largest[1] < max(ROW_OFF, ROW_ALONE * largest[0]):
        return None
    row = int(np.argmax(least))
    conditions = prepared.rows.conditions_at(row)
    return RowOff(
        observable=prepared.rows.observable_at(row).name,
        setting=prepared.problem.measurements.table_units.setting_text(conditions),
        source=prepared.rows.source[row],
        residual_sd=float(np.copysign(least[row], every[0, row])),
    )


def explained_share(prepared: PreparedProblem, base: Expansion, other: Expansion) -> float:
    """Share of the bare model's excess misfit that another removes: (S_0 - S_k) / (S_0 - n), at most 1."""
    before, after = misfit_with_shared(prepared, base), misfit_with_shared(prepared, other)
    return min((before - after) / max(before - prepared.rows.size, 1.0), 1.0)


def freedom(left: ProjectedResidual) -> float:
    """Degrees of freedom that calibration leaves: n minus the leverage of what it removes."""
    return float(left.whole.size - np.sum(left.row_basis**2))


def observable_misfits(
    prepared: PreparedProblem, expansion: Expansion, table: Rows
) -> dict[str, ObservableMisfit]:
    """Agreement observable by observable; p tests its own rows with calibration accounted for."""
    left, found = projected_residual(prepared, expansion), {}
    for observable, chosen in prepared.by_observable():
        gap = (table.measured - table.predicted)[chosen]
        count, free, whole = gap.size, left.own[chosen], left.white.unmixed(left.whole)[chosen]
        if left.white.root is None:
            p = float(shifted_chi2_p(float(free @ free), projection_traces(left.row_basis[chosen])))
        else:
            p = structure_p(left, np.eye(chosen.size)[:, chosen])
        rmse = float(np.sqrt(np.mean(gap**2)))
        found[observable.name] = ObservableMisfit(count, float(whole @ whole), rmse, float(gap.mean()), p)
    return found


def noise_table(prepared: PreparedProblem, correlation: Floats | None = None, known: bool = True) -> Noise:
    """Noise budget with the simulator's share, and warnings about it; `known` unless guessed."""
    budgets, sentences = {}, []
    simulated = np.sqrt(prepared.seed_variance / prepared.seeds.scoring.size)
    for index, observable in enumerate(prepared.rows.observables):
        given: ObservableNoise = prepared.rows.noise[observable.name]
        chosen = prepared.rows.which == index
        paired = correlation[chosen] if correlation is not None else np.zeros(0)
        seeds = float(np.nanmedian(paired)) if np.any(np.isfinite(paired)) else float("nan")
        own = float(np.median(simulated[chosen])) if chosen.any() else float("nan")
        budgets[observable.name] = replace(given, simulator=own, seed_correlation=seeds)
        sentences += noise_sentences(observable.name, given)
    return Noise(budgets, known, tuple(sentences) if known else (ASK_REPEATS,))


def noise_sentences(name: str, given: ObservableNoise) -> list[str]:
    """Where repeats contradict the stated scatter of one observable, or where its noise is unknown."""
    if given.stated_factor == given.stated_factor and given.p < NOISE_LEVEL:
        relation = "larger" if given.stated_factor > 1.0 else "smaller"
        return [
            f"{name}: repeated measurements scatter {given.stated_factor:.2g} times as much as stated, "
            f"{relation} than chance allows (p = {given.p:.2g}); the stated sd was corrected."
        ]
    if given.lab != given.lab:
        return [f"{name}: its noise is unknown; it is shown but decides nothing."]
    return []
