"""What a race says of rows that it has not seen: the same generative model, conditioned on the fitted rows.

    z' = m' + J' (v - v^) + S' (w' - w^') + sum_b tau_b F'_b u_b + e',   w' = tau L' s,  e' ~ N(0, kappa^2 V')

m', J' and S' are the model and its slopes at the other rows, at the best setting v^ of a hypothesis and the
doses w^' that its kernel carries there. F and L are built over fitted and other rows together, so that each
coefficient has a column in both; with X' all columns and c, C mean and covariance of the coefficients,

    E z' = m' - J' v^ - S' w^' + X' c,   cov z' = X' C X'^T + kappa^2 V'

Hypotheses are averaged by their probability, scales by draws (`posterior`): quantiles are those of a mixture
of normal distributions, and what is said of a row does not depend on what else is asked. The misfit of
held-out rows takes physics, levels and sources alone: no smooth discrepancy may earn what an effect should.

References: Rasmussen & Williams (2006), Gaussian Processes, 2.2 (conditioning); Hoeting et al. (1999), Stat.
Sci. 14, 382 (averaging over models).
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from scipy import special

from taichi_erosion.evidence.data.comparison_rows import (
    ComparisonRows,
    comparison_rows,
    join_rows,
    shared_error_columns,
)
from taichi_erosion.evidence.data.heap_correlation import add_correlation
from taichi_erosion.evidence.data.problem import Bools, Floats, Integers, Observable, pick_rows
from taichi_erosion.evidence.data.transforms import from_scale, slope, working_residuals
from taichi_erosion.evidence.models.prepared_problem import PreparedProblem
from taichi_erosion.evidence.models.table_columns import NewConditions
from taichi_erosion.evidence.race.adequacy import NODES, WEIGHTS
from taichi_erosion.evidence.race.blocks import Block, columns_of, dose_factors, error_blocks, unlisted_blocks
from taichi_erosion.evidence.race.doses import dosing_of_fit
from taichi_erosion.evidence.race.expansion import RaceModel
from taichi_erosion.evidence.race.fit import UNLISTED, Doses, Fit, Hypothesis, Race, slips_of_decimal_point
from taichi_erosion.evidence.race.linear_evidence import LinearPosterior
from taichi_erosion.evidence.race.posterior import Posterior, draw_scales
from taichi_erosion.evidence.race.priors import BAD_SD, SEED
from taichi_erosion.evidence.record import HeldOutPart, Interval

SHARES = np.array([[0.5], [0.05], [0.95]])  # below the middle of an interval and its ends
FARTHEST, HALVINGS = 9.0, 60  # sd beyond which no quantile lies, and steps to it
SLIP_GAP = 3.0  # largest gap, in sd, of a held-out row with a corrected decimal point


@dataclass(frozen=True)
class JointRows:
    """Rows that a race has not seen, with the model bound to the fitted rows and these."""

    race: Race
    rows: ComparisonRows
    mean_variance: Floats  # (m,), variance of the simulated mean
    model: RaceModel
    runs: tuple[Bools, Floats, Floats] | None = None  # where runs answer (m,), their gap (m,), errors (m, q)

    def scatter_ratio(self, solved: LinearPosterior) -> Floats:
        """Scatter of these rows over what is stated (m,)."""
        ln_scales = dict(zip(solved.rows.scales.names, solved.u, strict=True))
        return np.exp([ln_scales.get(f"scatter {name}", 0.0) for name in self.rows.names])


def new_rows(prepared: PreparedProblem, wanted: NewConditions) -> ComparisonRows:
    """New conditions as rows without a value, each with the scatter of one repeat.

    They are of no source. Raises KeyError for an observable without a fitted row.
    """
    rows, table = prepared.rows, prepared.problem.visible_rows()
    which, m = rows.observable_indices(wanted.observable), len(wanted.observable)
    names, counts = np.array(table.observable), np.where(table.n >= 1.0, table.n, 1.0)
    variance = np.zeros(len(rows.observables))
    for k, observable in enumerate(rows.observables):
        repeats = counts[names == observable.name].sum() / max(int(np.sum(rows.which == k)), 1)
        noise = rows.noise[observable.name]
        variance[k] = repeats * noise.lab**2 + noise.numerical**2
    first = rows.select_rows(np.array([np.argmax(rows.which == k) for k in which], dtype=np.int64))
    conditions = {name: wanted.conditions[name] for name in rows.conditions}
    exact = {name: np.full(m, np.nan) for name in rows.condition_sd}
    new = replace(first, z=np.full(m, np.nan), slope=np.full(m, np.nan), variance=variance[which])
    new = replace(new, censored=np.zeros(m, dtype=np.bool_), reach=np.zeros(m), rounding=np.zeros(m))
    new = replace(new, conditions=conditions, condition_sd=exact, group=wanted.group or ("",) * m)
    return replace(new, source=("",) * m, heaps=({},) * m, covariance=None)


def held_out_rows(prepared: PreparedProblem) -> ComparisonRows | None:
    """Held-out rows of fitted observables, of unknown scatter with that of fitted ones; None without any."""
    problem, fitted = prepared.problem, prepared.rows
    if not problem.vault.rows.size:
        return None
    rows = comparison_rows(problem, problem.measurements_in_vault())
    rows = rows.select_rows(np.isin(rows.names, fitted.names))
    which = fitted.observable_indices(rows.names)
    rows = replace(rows, observables=fitted.observables, which=which, noise=fitted.noise)
    variance = np.where(rows.has_noise, rows.variance, row_medians(fitted, fitted.variance)[which])
    return add_correlation(replace(rows, variance=variance), prepared.heaps) if rows.size else None


def row_medians(rows: ComparisonRows, values: Floats) -> Floats:
    """Median of some values of rows for each observable; 0 where it has no row."""
    indices = [values[rows.which == k] for k in range(len(rows.observables))]
    return np.array([np.median(each) if each.size else 0.0 for each in indices])


def joint_rows(race: Race, rows: ComparisonRows) -> JointRows:
    """Other rows of the observables of a race, with the model there."""
    p = race.prepared
    both, seeds = join_to_fitted(p.rows, rows, np.zeros(rows.size)), row_medians(p.rows, p.seed_variance)
    predictor = p.predictor.at_rows(both.which, both.conditions)
    model = RaceModel(replace(p, rows=both, predictor=predictor), priors=race.priors)
    return JointRows(race, rows, seeds[rows.which] / p.seeds.scoring.size, model)


def join_to_fitted(fitted: ComparisonRows, other: ComparisonRows, mean: Floats) -> ComparisonRows:
    """Fitted rows, then the others at their predicted mean, with one shared error for each instrument."""
    steep, size = np.zeros(other.size), np.zeros(other.size)
    for k, observable in enumerate(other.observables):
        column = other.which == k
        value = from_scale(observable, mean[column])
        steep[column] = slope(observable, value)
        size[column] = np.hypot(observable.sd_shared, observable.sd_shared_relative * value) * steep[column]
    sizes = np.append(np.max(fitted.shared, axis=1, initial=0.0), np.nan_to_num(size))
    other_rows = replace(other, z=mean, slope=np.nan_to_num(steep), shared=np.zeros((other.size, 0)))
    both = join_rows([replace(fitted, shared=np.zeros((fitted.size, 0))), other_rows])
    places = enumerate(both.observables)
    columns = [shared_error_columns(each, sizes * (both.which == k), both.conditions) for k, each in places]
    shared = np.hstack(columns)
    return replace(both, shared=shared[:, np.any(shared != 0.0, axis=0)], covariance=None)


@dataclass(frozen=True)
class Outlook:
    """What one hypothesis says of other rows, on the comparison scale."""

    solution: LinearPosterior  # of the fitted rows
    start: Floats  # (m,), with every coefficient at 0; NaN where the model has no value
    columns: Floats  # (m, q + r), of the coefficients of fitted rows, then of those that these do not have
    scale_numbers: Integers  # (r,), scales of the latter; -1 where it is 1
    smooth: Bools  # (q + r,), columns of smooth discrepancies and of what no list holds

    def mean(self, smooth: bool = True) -> Floats:
        """Conditional mean (m,); without `smooth` that of physics, levels and sources alone."""
        return self.start + self.columns_over_sd(smooth)[0] @ self.solution.centre

    def conditional_covariance(self, smooth: bool = True) -> Floats:
        """Conditional covariance (m, m) of that mean."""
        factor, alone = self.columns_over_sd(smooth)
        return factor @ self.solution.inverse @ factor.T + alone @ alone.T

    def conditional_variance(self, smooth: bool = True) -> Floats:
        """Its diagonal (m,)."""
        factor, alone = self.columns_over_sd(smooth)
        return np.sum(factor @ self.solution.inverse * factor, axis=1) + np.sum(alone**2, axis=1)

    def columns_over_sd(self, smooth: bool) -> tuple[Floats, Floats]:
        """Columns in units of the sd of their coefficients: those of fitted rows, and the others."""
        tau = np.append(self.solution.tau, np.exp(np.append(self.solution.u, 0.0)[self.scale_numbers]))
        whole = self.columns * np.where(self.smooth & (not smooth), 0.0, tau)
        return whole[:, : self.solution.tau.size], whole[:, self.solution.tau.size :]


@dataclass(frozen=True)
class Forecast:
    """Mixtures of normal distributions of other rows, over hypotheses and scales, on the comparison scale."""

    rows: ComparisonRows
    weight: Floats  # (k,), their sum is 1
    centre: Floats  # (k, m)
    mean: Floats  # (k, m), sd of many measurements
    new_value: Floats  # (k, m), sd of one more

    def forecast_intervals(self, sd: Floats) -> list[Interval]:
        """Median and 90 % interval of every row in its unit, of `mean` or of `measured`, by bisection."""
        low, high = (self.centre - FARTHEST * sd).min(axis=0), (self.centre + FARTHEST * sd).max(axis=0)
        for _ in range(HALVINGS):
            middle = np.broadcast_to(0.5 * (low + high), (3, sd.shape[1]))
            less = self.weight @ special.ndtr((middle[:, np.newaxis] - self.centre) / sd) < SHARES
            low, high = np.where(less, middle, low), np.where(less, high, middle)
        pairs = zip(self.rows.which, low.T, strict=True)
        return [interval_in_unit(self.rows.observables[k], z) for k, z in pairs]

    def share_below(self) -> Floats:
        """Share of one more measurement that lies below each measured value (m,)."""
        return self.weight @ special.ndtr((self.rows.z - self.centre) / self.new_value)


def interval_in_unit(observable: Observable, z: Floats) -> Interval:
    """Middle and ends of an interval on the comparison scale in the unit of an observable."""
    least = 0.0 if observable.transform == "log_floor" else -np.inf
    return Interval(*map(float, np.maximum(from_scale(observable, z), least)))


def joint_expansion(place: JointRows, fit: Fit) -> tuple[Floats, Floats, Doses | None]:
    """Mean (n + m,) and slopes of the model at fitted and other rows, and the doses of a mechanism there."""
    model, names, v, n = place.model, fit.hypothesis.names, fit.v, fit.mean.size
    if fit.dose is None:
        return model.precise_mean(names, v), model.jacobian(names, v, model.predict_mean(names, v)), None
    both = model.prepared.rows
    kernels = dose_factors(both, np.arange(both.size) < n)
    dosing = dosing_of_fit(replace(place.race, model=model), fit, kernels[fit.hypothesis.along])
    mask = np.tile(np.arange(both.size) < n, len(fit.row_doses_of))
    w = dosing.factors @ np.linalg.lstsq(dosing.factors[mask], fit.dose.w, rcond=None)[0]
    w[mask] = fit.dose.w
    w, mean = dosing.clip_doses_and_predict(v, w)
    return mean, dosing.number_slopes(v, w, mean), Doses(w, dosing.dose_slope(v, w, mean), dosing.factors)


def joint_blocks(place: JointRows, fit: Fit, both: ComparisonRows, doses: Doses | None) -> list[Block]:
    p, n, priors = place.race.prepared, fit.mean.size, place.race.priors
    mask, unit = np.arange(both.size) < n, np.append(p.row_sd, np.ones(both.size - n))
    blocks, h = error_blocks(both, mask, unit, priors), fit.hypothesis
    if UNLISTED & h.acting:
        blocks += unlisted_blocks(both, mask, blocks, priors, p.problem.unread)[h.along]
    built = {block.scale.names[0]: block.columns for block in blocks}
    if doses is not None:
        built["dose"] = doses.change(doses.factor, both.size)
    return [replace(block, columns=built[block.scale.names[0]]) for block in fit.blocks]


def outlook(place: JointRows, fit: Fit) -> Outlook:
    """A hypothesis at other rows, conditioned on the fitted ones at the scales of the fit.

    Slopes of both are taken anew, since those of a fit may be updates only.
    """
    race, n, v, model = place.race, fit.mean.size, fit.v, place.model
    mean, jacobian, doses = joint_expansion(place, fit)
    both = join_to_fitted(race.prepared.rows, place.rows, mean[n:])
    varied = doses and fit.hypothesis.doses_of(doses.w)
    setting = model.numbers_and_strengths(fit.hypothesis.names, v)
    emulator = model.prepared.model_errors(*setting, varied, n)
    if place.runs is not None:
        mean, emulator[n:][place.runs[0]] = np.append(mean[:n], mean[n:] + place.runs[1]), 0.0
        emulator = np.hstack([emulator, np.vstack([np.zeros((n, place.runs[2].shape[1])), place.runs[2]])])
    errors, blocks = np.hstack([both.shared, emulator]), joint_blocks(place, fit, both, doses)
    first_blocks = tuple(replace(block, columns=block.columns[:n]) for block in blocks)
    dose = doses and Doses(**pick_rows(vars(doses), np.tile(np.arange(mean.size) < n, len(fit.row_doses_of))))
    first = {"mean": mean[:n], "jacobian": jacobian[:n], "errors": errors[:n], "blocks": first_blocks}
    rows = race.linear(replace(fit, **first, dose=dose))[0]
    active = np.any(rows.columns != 0.0, axis=0)
    order = np.argsort(~active, kind="stable")
    linear_rows = replace(rows, columns=rows.columns[:, active], block=rows.block[active])
    kinds = np.array([block.kind in ("discrepancy", "unlisted") for block in blocks] + [False])
    columns = [columns_of(block, jacobian[:, : model.count]) for block in blocks]
    solution = linear_rows.correct_bad_rows(fit.evidence.bad).at_scales(fit.evidence.solution.u)
    start = (mean - jacobian @ v - (doses.change(doses.w, mean.size) if doses else 0.0))[n:]
    every = np.hstack([jacobian, errors, *columns])[n:, order]
    return Outlook(solution, start, every, rows.block[~active], kinds[rows.block[order]])


def forecast(posterior: Posterior, place: JointRows) -> Forecast:
    """Other rows by every hypothesis that matters; NaN where one of them has no value."""
    random, parts = np.random.default_rng(SEED), []
    numerical = np.array([place.rows.noise[name].numerical for name in place.rows.names]) ** 2
    scatter = np.maximum(place.rows.variance - numerical, 0.0)
    for h, p in posterior.likely_hypotheses().items():
        view = outlook(place, place.race.fits[h])
        for now, _, weight in draw_scales(view.solution, p, random):
            at = replace(view, solution=now)
            mean = at.conditional_variance() + place.mean_variance + numerical
            parts.append((weight, at.mean(), mean, mean + place.scatter_ratio(now) ** 2 * scatter))
    weight, centre, mean, measured = map(np.array, zip(*parts, strict=True))
    return Forecast(place.rows, weight, centre, np.sqrt(mean), np.sqrt(measured))


def leave_one_out_shares(posterior: Posterior) -> Floats:
    """Share of its prediction by all other rows that lies below each fitted row (n,), whitened.

    With P = V^-1 at scales u of a hypothesis, and b by how much the variance of a bad row exceeds the usual,

        y_i - E[y_i | others] = [P y]_i / P_ii,   var[y_i | others] = 1 / P_ii,   1 / P_ii - b if it were good

    averaged over u and hypotheses with weights w / p(y_i | others, u).

    References: Rasmussen & Williams (2006), Gaussian Processes, 5.4.2 (leaving out); Gelfand, Dey & Chang
    (1992), Bayesian Statistics 4, 147 (weights).
    """
    weights, shares, random = [], [], np.random.default_rng(SEED)
    for h, p in posterior.likely_hypotheses().items():
        for now, _, weight in draw_scales(posterior.race.fits[h].evidence.solution, p, random):
            residual, diagonal = now.whitened
            gap, variance = residual / diagonal, 1.0 / diagonal
            weights.append(np.log(weight) + 0.5 * (gap**2 / variance + np.log(2.0 * np.pi * variance)))
            variance -= (1.0 - now.rows.weight) / now.inverse_variance_of_rows
            shares.append(special.ndtr(gap / np.sqrt(variance)))
    share = np.exp(weights - np.max(weights, axis=0))
    return np.sum(share * shares, axis=0) / np.sum(share, axis=0)


def held_out_part(posterior: Posterior, names: Iterable[str], seed: int) -> HeldOutPart | None:
    """Misfit of held-out rows by nothing, by the likeliest explanation, with `names`, and by another effect.

    The other one is drawn by the seed. None without held-out values: limits alone confirm nothing.
    """
    race = posterior.race
    rows = held_out_rows(race.prepared)
    if rows is None:
        return None
    others = [fit.hypothesis for fit in race.effect_sets(1) if fit.hypothesis.acting.isdisjoint(names)]
    wrong = [others[np.random.default_rng(seed).integers(len(others))]] if others else []
    alone = Hypothesis(tuple(sorted(names)))
    best = alone if alone in race.fits else posterior.best_fit.hypothesis
    place, chosen = joint_rows(race, rows), [Hypothesis(()), best, *wrong]
    outlooks = [outlook(place, race.fits[h]) for h in chosen]
    good = np.all([np.isfinite(each.start) for each in outlooks], axis=0)
    exact = good & ~rows.censored
    if not exact.any():
        return None
    # a wrong model expects large errors, so that they are those of the likeliest explanation of all
    share, linear = race.posterior_probabilities(), outlooks[1].solution.rows
    likeliest = race.fits[max(share, key=lambda each: share[each])].evidence.solution
    errors = replace(outlooks[1], solution=linear.at_scales(likeliest.scales_for(linear.scales)))
    size = np.sqrt(rows.variance + place.mean_variance + errors.conditional_variance(False))
    gaps, reach = [(rows.z - each.mean(False)) / size for each in outlooks], (rows.reach / size)[good]
    residuals = (working_residuals(gap[good], reach).residual for gap in gaps)
    before, after, *other = (float(np.mean(each**2)) for each in residuals)
    p_after = predicted_misfit_p_value(place, rows.z - outlooks[1].mean(False), errors, exact)
    change = (outlooks[1].mean(False) - outlooks[0].mean(False)) / size
    p_worse = p_of_small_misfit_change(change[exact], gaps[1][exact])
    control, name = (other[0], wrong[0].names[0]) if other else (np.nan, "")
    misfits = (int(good.sum()), before, after, control)
    pairs = {key: (x[good], race.prepared.rows.conditions[key]) for key, x in rows.conditions.items()}
    alike = {key: float(x[0]) for key, (x, others) in pairs.items() if np.ptp(x) == 0.0 < np.ptp(others)}
    corrected = np.abs(gaps[1][:, np.newaxis] - slips_of_decimal_point(rows, size))
    is_slip = (np.nanmin(corrected, axis=1, initial=np.inf) < SLIP_GAP) & (np.abs(gaps[1]) > BAD_SD[0])
    slips = tuple(rows.lines[k][0] for k in np.flatnonzero(is_slip))
    return HeldOutPart(
        *misfits, p_after, p_worse, race.prepared.problem.vault.opened + 1, tuple(names), name, alike, slips
    )


def predicted_misfit_p_value(place: JointRows, gaps: Floats, errors: Outlook, good: Bools) -> float:
    """Chance of as large a misfit r^T cov^-1 r of some rows, without smooth discrepancies (`adequacy`)."""
    noise = np.diag(place.rows.variance + place.mean_variance)
    if place.rows.covariance is not None:
        noise = noise + place.rows.covariance
    gap, chosen = gaps[good], np.ix_(good, good)
    physics, noise = errors.conditional_covariance(False)[chosen], noise[chosen]
    scatter = np.exp(2.0 * place.race.priors.doubt * NODES)
    size = [gap @ np.linalg.solve(physics + factor * noise, gap) for factor in scatter]
    return float(WEIGHTS @ special.chdtrc(gap.size, np.maximum(size, 0.0)) / WEIGHTS.sum())


def p_of_small_misfit_change(change: Floats, residual: Floats) -> float:
    """Chance that the misfit falls as little, or grows as much, if what is added acts.

    With d the change of the prediction and r the residual after it, both over the sd of the latter,

        (r + d)^2 - r^2 = d^2 + 2 d r,   r ~ N(0, 1)
    """
    return float(special.ndtr(change @ residual / max(float(np.sqrt(change @ change)), 1e-12)))
