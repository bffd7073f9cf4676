"""What the calibrated model says at new conditions, with intervals, and how well such intervals have held."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import nan

import numpy as np
from scipy import stats

from taichi_erosion.evidence.answers.compare import SEED, calibrated_base, no_progress
from taichi_erosion.evidence.answers.held_out_misfit import (
    held_out_prediction,
    held_out_problem,
    silent_scatter,
)
from taichi_erosion.evidence.answers.next_experiments import repeat_variance
from taichi_erosion.evidence.data.findings import Estimate
from taichi_erosion.evidence.data.problem import Conditions, Floats, Integers, Measurements, Problem, Progress
from taichi_erosion.evidence.data.transforms import from_scale, slope
from taichi_erosion.evidence.inference.intervals.estimates import estimates_alone
from taichi_erosion.evidence.inference.map_fit import Fit
from taichi_erosion.evidence.inference.marginal_likelihood import (
    ScoredHypothesis,
    projected_residual,
    slopes_of,
)
from taichi_erosion.evidence.inference.prepared_problem import PreparedProblem
from taichi_erosion.evidence.models.condition_errors import error_columns
from taichi_erosion.evidence.models.new_conditions import NewConditions
from taichi_erosion.evidence.models.predictor import LOG_SPAN
from taichi_erosion.evidence.prediction.discrepancy_mixture import (
    JointPrediction,
    JointRows,
    joint_prediction,
)
from taichi_erosion.scene.schema.units import Scale

SHARE = 0.9  # of the probability that an interval holds
LEAST_CHANCE = 0.05  # of as few rows inside, below which intervals are called too narrow
CLEAR_ODDS = 3.0  # Bayes factor from which a discrepancy is told
FEW_ROWS = 5  # of a check, below which its share tells little


@dataclass(frozen=True)
class PredictedRow:
    """One prediction, in the unit of its observable; NaN where the model has no value."""

    line: int  # row of the table
    observable: str
    conditions: Mapping[str, float]  # in the units of the table
    condition_units: Mapping[str, str]
    unit: str
    value: float  # median: calibrated model with the discrepancy that its residuals show
    low: float  # 90 % interval of what many repeats would give on average
    high: float
    model: float  # the calibrated model alone
    measured_low: float  # 90 % interval of one measurement, the laboratory's scatter in it
    measured_high: float
    sd: Mapping[str, float]  # by source; those of the residuals are correlated and do not add up
    outside: tuple[str, ...]  # conditions beyond those that were measured, in words


@dataclass(frozen=True)
class PredictiveCheck:
    """Measured values beside intervals that did not use them."""

    n: int
    inside: int  # the 90 % interval
    p: float  # chance of as few or fewer inside where the intervals are right


@dataclass(frozen=True, kw_only=True)
class Prediction:
    """Answer of `predict`."""

    rows: tuple[PredictedRow, ...]
    fitted: PredictiveCheck  # every fitted row, predicted from the others
    held_out: PredictiveCheck | None  # of an open vault
    discrepancy_odds: float  # Bayes factor of a smooth discrepancy that calibration leaves [1]
    parameters: Mapping[str, Estimate]
    noise_known: bool
    unstated_scatter: tuple[str, ...] = ()  # of held-out sources that state none: a sentence each
    sentences: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()
    failures: int = 0
    runs: int = 0


def predict(
    problem: Problem,
    wanted: NewConditions,
    progress: Progress = no_progress,
    seed: int = SEED,
    opened: bool = False,
) -> Prediction:
    """Predictions at new rows, and checks of their intervals; `opened`: the vault may be compared with.

    An observable without a row of known scatter gets no interval.
    """
    prepared, base, known = calibrated_base(problem, seed, progress)
    progress("predicting", 0.7)
    wanted, lost = answerable(prepared, wanted)
    found, mean = joint(prepared, base, wanted, seed)
    told = predicted_rows(prepared, wanted, found, mean)
    held, silent = held_out_rows(prepared, base) if opened else (None, [])
    prediction = Prediction(
        rows=tuple(told),
        fitted=fitted_check(prepared, base, found),
        held_out=None if held is None else held_out_check(prepared, base, held, seed),
        discrepancy_odds=found.discrepancy_odds,
        parameters=estimates_alone(prepared, base)[1],
        noise_known=known,
        unstated_scatter=tuple(silent),
        warnings=(*prepared.warnings, *lost),
        failures=prepared.predictor.cost.failures,
        runs=prepared.predictor.cost.runs,
    )
    return replace(prediction, sentences=tuple(sentences_of(prediction)))


def answerable(prepared: PreparedProblem, wanted: NewConditions) -> tuple[NewConditions, list[str]]:
    """The rows whose observable has a known scatter, and a sentence about every other observable."""
    known = set(prepared.rows.names)
    lost = [name for name in dict.fromkeys(wanted.observable) if name not in known]
    kept = np.array([name in known for name in wanted.observable], dtype=np.bool_)
    rows = replace(
        wanted,
        observable=tuple(name for name in wanted.observable if name in known),
        conditions={name: column[kept] for name, column in wanted.conditions.items()},
        lines=tuple(np.array(wanted.lines, dtype=int)[kept].tolist()) if wanted.lines else (),
        written=tuple(row for row, keep in zip(wanted.written, kept, strict=False) if keep),
    )
    return rows, [f"{name} is not predicted: none of its rows has a known scatter." for name in lost]


def joint(
    prepared: PreparedProblem, base: ScoredHypothesis, wanted: NewConditions, seed: int
) -> tuple[JointPrediction, Floats]:
    """Predictive distributions of new rows, and the calibrated model alone there, on the comparison scale."""
    both = with_new_rows(prepared, wanted)
    n, fit = prepared.rows.size, base.expansion.fit
    mean = both.predictor.mean(fit.x, fit.acting(), prepared.seeds.scoring)
    mean[:n] = base.expansion.mean
    jacobian = slopes_of(both, fit)
    stuck = projected_residual(prepared, base.expansion).stuck
    jacobian[:, stuck] = 0.0
    work, start = prepared.working(base.expansion.mean), jacobian @ fit.x
    sds = [prepared.sd[prepared.rows.which == k] for k in range(len(prepared.rows.observables))]
    typical = [float(np.median(own)) if own.size else 1.0 for own in sds]
    rows = JointRows(
        residual=prepared.whitening(work).back(work.residual) + start[:n],
        variance=(prepared.sd / work.weight) ** 2,
        covariance=prepared.rows.covariance,
        mean=np.nan_to_num(mean[n:]) - start[n:],
        parts={
            "calibration": jacobian,
            "instrument": instrument_errors(prepared, both, mean),
            "emulator": both.predictor.model_errors(fit.x, fit.acting()),
            **errors_of_conditions(prepared, fit, mean.size),
        },
        axes=standard_axes(prepared.rows.conditions, both.rows.conditions),
        which=both.rows.which,
        typical=np.array(typical),
        noise=prepared.doubt,
    )
    return joint_prediction(rows, seed), mean[n:]


def errors_of_conditions(prepared: PreparedProblem, fit: Fit, size: int) -> dict[str, Floats]:
    """Columns of the errors of stated conditions, where there are any; new conditions are exact."""
    if prepared.condition_errors is None:
        return {}
    own = error_columns(prepared.condition_errors, prepared.predictor, fit.x, fit.acting())
    return {"conditions": np.vstack([own, np.zeros((size - own.shape[0], own.shape[1]))])}


def with_new_rows(prepared: PreparedProblem, wanted: NewConditions) -> PreparedProblem:
    """The prepared problem with rows without a value below its own."""
    rows = prepared.rows
    which = rows.index_of(wanted.observable)
    m = which.size
    joined = replace(
        rows,
        which=np.concatenate([rows.which, which]),
        z=np.append(rows.z, np.zeros(m)),
        variance=np.append(rows.variance, np.ones(m)),
        censored=np.append(rows.censored, np.zeros(m, dtype=np.bool_)),
        reach=np.append(rows.reach, np.zeros(m)),
        shared=np.vstack([rows.shared, np.zeros((m, rows.shared.shape[1]))]),
        conditions={
            name: np.concatenate([column, wanted.conditions[name]])
            for name, column in rows.conditions.items()
        },
        group=(*rows.group, *([""] * m)),
        source=(*rows.source, *([""] * m)),
        slope=np.append(rows.slope, np.zeros(m)),
        covariance=None,
    )
    predictor = prepared.predictor.over(joined.observables, joined.which, joined.conditions)
    return replace(
        prepared, rows=joined, predictor=predictor, variance=np.append(prepared.variance, np.ones(m))
    )


def instrument_errors(prepared: PreparedProblem, both: PreparedProblem, mean: Floats) -> Floats:
    """Errors that all rows of an instrument share (n + m, q), those of new rows at the predicted values."""
    found, n = both.rows.shared.copy(), prepared.rows.size
    for index, observable in enumerate(both.rows.observables):
        own = both.rows.which == index
        columns = np.flatnonzero(np.any(prepared.rows.shared[own[:n]] != 0.0, axis=0))
        new = np.flatnonzero(own[n:]) + n
        value = from_scale(observable, mean[new])
        size = np.hypot(observable.sd_shared, observable.sd_shared_relative * value)
        found[np.ix_(new, columns)] = np.nan_to_num(size * slope(observable, value))[:, np.newaxis]
    return found


def standard_axes(fitted: Conditions, both: Conditions) -> Floats:
    """Conditions that vary among the fitted rows, (rows, conditions), standardised as there."""
    found = []
    for name, column in fitted.items():
        values = column[np.isfinite(column)]
        if values.size < 2 or np.ptp(values) <= 1e-12 * np.abs(values).max():
            continue
        logarithmic = values.min() > 0.0 and values.max() > LOG_SPAN * values.min()
        raised = np.maximum(both[name], 1e-3 * values.min()) if logarithmic else both[name]
        scaled, own = (np.log(raised), np.log(values)) if logarithmic else (raised, values)
        found.append(np.nan_to_num((scaled - own.mean()) / own.std()))
    size = next((column.size for column in both.values()), 0)
    return np.column_stack(found) if found else np.zeros((size, 0))


def predicted_rows(
    prepared: PreparedProblem, wanted: NewConditions, found: JointPrediction, mean: Floats
) -> list[PredictedRow]:
    """Predictions in the units of the observables."""
    which = prepared.rows.index_of(wanted.observable)
    simulated, tolerance = simulated_variance(prepared, which), tolerance_variance(prepared, which)
    whole = found.whole.widened(simulated + tolerance)
    scatter = np.array([repeat_variance(prepared, int(k)) for k in which])
    single = whole.widened(found.factor[:, np.newaxis] ** 2 * scatter)
    ends = [whole.quantile(s) for s in (0.5, 0.5 - 0.5 * SHARE, 0.5 + 0.5 * SHARE)]
    ends += [mean, *(single.quantile(s) for s in (0.5 - 0.5 * SHARE, 0.5 + 0.5 * SHARE))]
    values = [np.where(np.isfinite(mean), in_unit(prepared, which, end), nan) for end in ends]
    sd = {name: part.sd() for name, part in found.parts.items()}
    own = {"simulator": simulated, "tolerance": tolerance, "laboratory": scatter}
    sd |= {name: np.sqrt(variance) for name, variance in own.items()}
    steep = [
        slope(prepared.rows.observables[k], np.array([v]))[0] for k, v in zip(which, values[0], strict=True)
    ]
    units = dict(
        zip(prepared.problem.measurements.observable, prepared.problem.measurements.unit, strict=True)
    )
    return [
        PredictedRow(
            wanted.lines[i] if wanted.lines else i + 1,
            name,
            wanted.written[i] if wanted.written else {c: float(v[i]) for c, v in wanted.conditions.items()},
            {c: scale.unit for c, scale in wanted.scales.items()},
            units[name],
            *(float(column[i]) for column in values),
            sd={key: float(column[i] / steep[i]) if steep[i] > 0.0 else nan for key, column in sd.items()},
            outside=tuple(beyond(prepared.problem.visible(), name, wanted, i)),
        )
        for i, name in enumerate(wanted.observable)
    ]


def in_unit(prepared: PreparedProblem, which: Integers, scaled: Floats) -> Floats:
    """Values of the comparison scale in the units of their observables; a floored one is not below 0."""
    found = np.empty(which.size)
    for index, observable in enumerate(prepared.rows.observables):
        own = which == index
        value = from_scale(observable, scaled[own])
        found[own] = np.maximum(value, 0.0) if observable.transform == "log_floor" else value
    return found


def simulated_variance(prepared: PreparedProblem, which: Integers) -> Floats:
    """Variance of the simulated mean at new rows: that of one seed over the number of seeds."""
    found = np.zeros(which.size)
    for index in np.unique(which):
        own = prepared.rows.which == index
        found[which == index] = float(np.median(prepared.seed_variance[own])) / prepared.seeds.scoring.size
    return found


def tolerance_variance(prepared: PreparedProblem, which: Integers) -> Floats:
    """Variance of new rows by the declared tolerance of the model."""
    rows = prepared.rows
    return np.array([rows.noise[rows.observables[k].name].numerical ** 2 for k in which])


def beyond(table: Measurements, observable: str, wanted: NewConditions, row: int) -> list[str]:
    """Conditions of a new row outside the range in which its observable was measured."""
    own, found = np.array([name == observable for name in table.observable]), []
    for name, column in wanted.conditions.items():
        scale = wanted.scales.get(name, table.table_units.conditions.get(name, Scale()))
        measured = table.conditions[name][own]
        measured = measured[np.isfinite(measured)]
        value = float(column[row])
        if not measured.size or not np.isfinite(value):
            continue
        span = 1e-9 * max(np.ptp(measured), np.abs(measured).max())
        for end, out in (
            (measured.min(), value < measured.min() - span),
            (measured.max(), value > measured.max() + span),
        ):
            if out:
                asked, limit = scale.written(value), scale.written(float(end))
                found.append(f"{name} {asked:.4g} beyond {limit:.4g} {scale.unit}".rstrip())
    return found


def fitted_check(
    prepared: PreparedProblem, base: ScoredHypothesis, found: JointPrediction
) -> PredictiveCheck:
    """Fitted rows inside the intervals that the other rows give; censored ones are left out."""
    ordinary = ~prepared.rows.censored
    start = base.expansion.jacobian.copy()
    start[:, projected_residual(prepared, base.expansion).stuck] = 0.0
    value = prepared.rows.z - base.expansion.mean + start @ base.expansion.fit.x
    low, high = (found.left_out.quantile(0.5 + sign * 0.5 * SHARE) for sign in (-1.0, 1.0))
    return check_of((value >= low) & (value <= high), ordinary)


def held_out_rows(
    prepared: PreparedProblem, base: ScoredHypothesis
) -> tuple[PreparedProblem | None, list[str]]:
    """Rows of the vault, those of sources that state no scatter with an estimated one as in `adopt`.

    Comes with sentences about these sources.
    """
    held = held_out_problem(prepared)
    if held is None:
        return None, []
    return silent_scatter(prepared, [held_out_prediction(prepared, base.expansion, held)])


def held_out_check(
    prepared: PreparedProblem, base: ScoredHypothesis, held: PreparedProblem, seed: int
) -> PredictiveCheck:
    """Held-out rows inside their intervals; censored ones are left out."""
    found, mean = joint(prepared, base, NewConditions(held.rows.names, held.rows.conditions), seed)
    which = prepared.rows.index_of(held.rows.names)
    fit, error = base.expansion.fit, found.factor[:, np.newaxis] ** 2 * held.rows.variance
    own = errors_of_conditions(held, fit, held.rows.size).get("conditions", np.zeros((held.rows.size, 0)))
    error = error + np.sum(own**2, axis=1)
    whole = found.whole.widened(error + simulated_variance(prepared, which))
    low, high = (whole.quantile(0.5 + sign * 0.5 * SHARE) for sign in (-1.0, 1.0))
    inside = (held.rows.z >= low) & (held.rows.z <= high)
    return check_of(inside, ~held.rows.censored & np.isfinite(mean))


def check_of(inside: Sequence[bool] | np.ndarray, counted: np.ndarray) -> PredictiveCheck:
    """Count of rows inside, and the chance of as few."""
    n, hits = int(np.sum(counted)), int(np.sum(np.asarray(inside) & counted))
    return PredictiveCheck(n, hits, float(stats.binom.cdf(hits, n, SHARE)) if n else nan)


def sentences_of(found: Prediction) -> list[str]:
    """What the intervals rest on, and how they have held."""
    told = [] if found.noise_known else ["The scatter is guessed from the residuals: no sd, no repeats."]
    if found.discrepancy_odds > CLEAR_ODDS:
        told.append(
            f"The calibrated model leaves a smooth discrepancy (Bayes factor {found.discrepancy_odds:.2g}): "
            "`value` is corrected by it, and the intervals hold what is uncertain of it."
        )
    else:
        told.append("The residuals show no clear discrepancy; the intervals allow for what they could hide.")
    outside = sum(bool(row.outside) for row in found.rows)
    if outside:
        told.append(
            f"Outside the measured conditions: {outside} of {len(found.rows)} predictions; nothing there "
            "checks the model."
        )
    told.append(check_sentence("fitted rows, each predicted from the others,", found.fitted))
    if found.held_out is not None:
        told.append(check_sentence("held-out rows", found.held_out))
    told += found.unstated_scatter
    return told


def check_sentence(rows: str, check: PredictiveCheck) -> str:
    """How many measured values lie inside their intervals."""
    if not check.n:
        return f"There are no {rows.rstrip(',')} to check the intervals with."
    share = f"{100 * check.inside / check.n:.0f} %"
    words = f"{check.inside} of {check.n} {rows} lie inside their {100 * SHARE:.0f} % interval ({share})"
    if check.p < LEAST_CHANCE:
        return f"{words}: fewer than chance allows (p = {check.p:.2g}); the intervals are too narrow."
    return f"{words}; too few rows to tell much." if check.n < FEW_ROWS else f"{words}."
