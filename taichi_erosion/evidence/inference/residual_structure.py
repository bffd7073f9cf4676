"""Structure of the residual where no listed effect explains it: axis, sign, scaling exponent, a fitted law.

The scaling exponent b belongs to residual ~ c x^b on the comparison scale (an additive term) fitted with
what calibration can imitate projected out; its interval is the profile of the misfit. The law is a hypothesis
found by exhaustive search over products of powers of at most two conditions, one or two terms, scored on
left-out groups.
"""

from collections.abc import Iterator
from itertools import combinations, product

import numpy as np
from scipy import stats

from taichi_erosion.evidence.data.findings import Law, MisfitPlace, ResidualTrend, VaryingNumber
from taichi_erosion.evidence.data.number_words import heading
from taichi_erosion.evidence.data.problem import Bools, Floats, Integers
from taichi_erosion.evidence.data.table_units import TableUnits
from taichi_erosion.evidence.inference import verdict_levels as levels
from taichi_erosion.evidence.inference.cross_validation import fold_numbers
from taichi_erosion.evidence.inference.goodness_of_fit import LEVEL_AXIS, axis_bins, freedom
from taichi_erosion.evidence.inference.marginal_likelihood import (
    Expansion,
    ProjectedResidual,
    projected_residual,
)
from taichi_erosion.evidence.inference.model_discrepancy import condition_axes
from taichi_erosion.evidence.inference.prepared_problem import PreparedProblem
from taichi_erosion.evidence.inference.verdict_levels import SECOND_TERM, fails

POWERS = (-2.0, -1.5, -1.0, -0.5, 0.5, 1.0, 1.5, 2.0)  # of a condition in a term
EXPONENTS = np.linspace(-4.0, 4.0, 161)  # at which the scaling is profiled
FALL = float(stats.chi2.ppf(0.9, 1))  # misfit above the best at the ends of a 90 % interval
LEAST_POWER = 0.1  # of an exponent that is told
LEAST_BINS = 4  # levels or bins of a condition from which an extremum is looked for
CLEAR_TURN = 3.0  # sd by which an extremum differs from both ends
MOST_AXES = 4  # conditions from which a law is built
FIRST_TERMS = 12  # single terms that are tried with a second one


def residual_trends(
    prepared: PreparedProblem, base: Expansion, places: tuple[MisfitPlace, ...]
) -> tuple[ResidualTrend, ...]:
    """The trend of every observable in which the model fails, worst first."""
    left, trends = projected_residual(prepared, base), []
    for observable, rows in prepared.by_observable():
        failing = [place for place in places if place.observable == observable.name and fails(place.p)]
        if failing and rows.sum() > 2:
            axes = [place for place in failing if place.axis != LEVEL_AXIS] or failing
            trends.append((failing[0].p, residual_trend(prepared, left, rows, axes[0])))
    return tuple(trend for _, trend in sorted(trends, key=lambda item: item[0]))


def residual_trend(
    prepared: PreparedProblem, left: ProjectedResidual, rows: Bools, place: MisfitPlace
) -> ResidualTrend:
    """Axis, sign, exponent and law of one observable."""
    law = best_law(prepared, left, rows, place.observable)
    told, units = "", prepared.problem.measurements.table_units
    if law is not None:
        share = f"explains {law.held_out_share:.0%} of the misfit of left-out groups"
        told = f"; hypothesis: {law.sentence} ({share})"
    column = prepared.rows.conditions.get(place.axis)
    if column is None:
        sign = int(np.sign(left.free[rows].sum()))
        words = f"{place.observable}: off as a whole, along no condition in particular{told}"
        return ResidualTrend(place.observable, place.axis, sign, np.nan, np.nan, np.nan, words, law)
    order = np.argsort(column[rows])
    upper = left.free[rows][order][-max(2, int(rows.sum()) // 3) :]
    sign = 1 if upper.sum() > 0.0 else -1
    exponent, low, high = scaling(prepared, left, rows, column)
    words = f"{place.observable}: measured minus predicted "
    turn = extremum(column[rows], left.free[rows])
    if turn is not None:
        shape, at = turn
        words += f"{shape} {place.axis} = {units.condition_text(place.axis, at)}"
    else:
        words += f"{'rises' if sign > 0 else 'falls'} with {place.axis}"
        if np.isfinite(exponent):
            words += f", scaling like {place.axis}^{exponent:.2g} ({low:.2g} to {high:.2g})"
    return ResidualTrend(place.observable, place.axis, sign, exponent, low, high, words + told, law)


def extremum(column: Floats, free: Floats) -> tuple[str, float] | None:
    """Kind and place of the residual's extremum, if both ends lie clearly to the same side of it."""
    bins = axis_bins(column, free)
    if len(bins) < LEAST_BINS:
        return None
    for sign, words in ((1.0, "has a bump at"), (-1.0, "has a dip at")):
        top = max(range(len(bins)), key=lambda k: sign * bins[k].mean)
        ends = (bins[0], bins[-1])
        gaps = [
            sign * (bins[top].mean - end.mean) / np.sqrt(1.0 / bins[top].count + 1.0 / end.count)
            for end in ends
        ]
        if 0 < top < len(bins) - 1 and min(gaps) > CLEAR_TURN:
            return words, 0.5 * (bins[top].low + bins[top].high)
    return None


def varying_number(prepared: PreparedProblem, base: Expansion) -> VaryingNumber | None:
    """The calibrated number and condition for which a number that varies along it takes most misfit away."""
    left = projected_residual(prepared, base)
    excess = float(left.free @ left.free) - freedom(left)
    best: VaryingNumber | None = None
    for name, axis in condition_axes(prepared).items():
        columns = left.white(base.jacobian * axis[:, np.newaxis])
        falls = misfit_fall(left, columns)
        for j, fall in enumerate(falls):
            share = min(float(fall) / max(excess, 1.0), 1.0)
            if share > max(levels.NUMBER_SHARE, 0.0 if best is None else best.share):
                number = prepared.axes[j].name
                way = "rose" if float(columns[:, j] @ left.free) > 0.0 else "fell"
                sentence = f"{share:.0%} of the misfit would go if {number} {way} with {name}."
                best = VaryingNumber(number, name, share, sentence)
    return best


def misfit_fall(left: ProjectedResidual, white: Floats) -> Floats:
    """Fall of the misfit by each whitened column (n, c) alone, recalibration included."""
    energy = np.einsum("ij,ij->j", white, left.project(white))
    return np.where(energy > 1e-9, (white.T @ left.free) ** 2 / np.maximum(energy, 1e-9), 0.0)


def scaling(
    prepared: PreparedProblem, left: ProjectedResidual, rows: Bools, column: Floats
) -> tuple[float, float, float]:
    """Exponent b of c x^b with its 90 % interval.

    NaN where the condition is not positive everywhere, where an end of the interval lies beyond the exponents
    that are tried, and for a power that hardly differs from a level.
    """
    values = column[rows]
    if not np.all(values > 0.0) or np.ptp(values) == 0.0:
        return np.nan, np.nan, np.nan
    shape = np.zeros((prepared.rows.size, EXPONENTS.size))
    logs = np.log(values / np.exp(np.mean(np.log(values))))
    exponents = np.where(np.abs(EXPONENTS) < 1e-9, 1e-3, EXPONENTS)
    shape[rows] = np.exp(np.outer(logs, exponents))
    fall = misfit_fall(left, prepared.white(shape))
    kept = EXPONENTS[fall > fall.max() - FALL]
    if (
        kept[0] <= EXPONENTS[0]
        or kept[-1] >= EXPONENTS[-1]
        or abs(EXPONENTS[int(np.argmax(fall))]) < LEAST_POWER
    ):
        return np.nan, np.nan, np.nan
    return float(EXPONENTS[int(np.argmax(fall))]), float(kept.min()), float(kept.max())


def terms_of(prepared: PreparedProblem, rows: Bools) -> Iterator[dict[str, float]]:
    """Products of powers of at most two conditions; only whole positive powers where one reaches zero."""
    allowed: dict[str, tuple[float, ...]] = {}
    for name, column in prepared.rows.conditions.items():
        values = column[rows]
        if np.all(np.isfinite(values)) and np.ptp(values) > 0.0 and len(allowed) < MOST_AXES:
            if np.all(values > 0.0):
                allowed[name] = POWERS
            elif np.all(values >= 0.0):
                allowed[name] = tuple(power for power in POWERS if power > 0.0)
            else:
                allowed[name] = (1.0, 2.0)
    for name, powers in allowed.items():
        yield from ({name: power} for power in powers)
    for first, second in combinations(allowed, 2):
        yield from ({first: a, second: b} for a, b in product(allowed[first], allowed[second]))


def term_column(prepared: PreparedProblem, rows: Bools, term: dict[str, float]) -> Floats:
    """One term on its rows, scaled by the typical size of each condition; zero elsewhere."""
    column = np.zeros(prepared.rows.size)
    column[rows] = 1.0
    for name, power in term.items():
        values = prepared.rows.conditions[name][rows]
        column[rows] *= np.sign(values) ** int(power) * (np.abs(values) / typical(values)) ** power
    return column


def typical(values: Floats) -> float:
    """Median of the non-zero sizes."""
    sizes = np.abs(values[values != 0.0])
    return float(np.median(sizes)) if sizes.size else 1.0


def best_law(prepared: PreparedProblem, left: ProjectedResidual, rows: Bools, observable: str) -> Law | None:
    """The law of one or two terms that predicts left-out groups best; None if none predicts them at all."""
    terms = list(terms_of(prepared, rows))
    if not terms:
        return None
    columns = np.column_stack([term_column(prepared, rows, term) for term in terms])
    columns[~np.isfinite(columns)] = 0.0
    white = prepared.white(columns)
    ranked = [int(i) for i in np.argsort(-misfit_fall(left, white))][:FIRST_TERMS]
    folds = fold_numbers(prepared)

    def held_out(chosen: list[int]) -> float:
        return held_out_share(left, left.project(white[:, chosen]), folds)

    chosen = max(([i] for i in ranked), key=held_out)
    share = held_out(chosen)
    limit = share + SECOND_TERM
    for pair in map(list, combinations(ranked, 2)):
        value = held_out(pair)
        if value > limit:
            limit = share = value
            chosen = pair
    if share < levels.LAW_SHARE:
        return None
    solved = np.linalg.lstsq(left.project(white[:, chosen]), left.free, rcond=None)[0]
    coefficients = tuple(float(value) for value in solved)
    law = tuple(terms[i] for i in chosen)
    texts = [
        expression(prepared, rows, observable, (law, coefficients), units)
        for units in (TableUnits(), prepared.problem.measurements.table_units)
    ]
    return Law(observable, texts[0], law, coefficients, share, texts[1])


def held_out_share(left: ProjectedResidual, free: Floats, folds: Integers) -> float:
    """Share of the left-out misfit explained by columns whose coefficients come from the other groups."""
    before = after = 0.0
    for fold in np.unique(folds):
        out = folds == fold
        coefficients = np.linalg.lstsq(free[~out], left.free[~out], rcond=None)[0]
        before += float(left.free[out] @ left.free[out])
        gap = left.free[out] - free[out] @ coefficients
        after += float(gap @ gap)
    return 1.0 - after / before if before > 0.0 else 0.0


def expression(
    prepared: PreparedProblem,
    rows: Bools,
    observable: str,
    law: tuple[tuple[dict[str, float], ...], tuple[float, ...]],
    units: TableUnits,
) -> str:
    """A law, its terms and coefficients, in writing: every condition over its typical value."""
    terms, coefficients = law
    scale = next(o.transform for o in prepared.rows.observables if o.name == observable)
    left_side = f"change of ln {observable}"
    if scale == "identity":
        left_side = f"change of {heading(observable, units.value_unit(observable))}"
        coefficients = tuple(units.value(observable, each) or 0.0 for each in coefficients)
    written = []
    for term, coefficient in zip(terms, coefficients, strict=True):
        factors = [
            f"({name} / {units.size_text(name, typical(prepared.rows.conditions[name][rows]))})^{power:g}"
            for name, power in term.items()
        ]
        written.append(f"{coefficient:+.3g} {' '.join(factors)}")
    return f"{left_side} = {' '.join(written)}"
