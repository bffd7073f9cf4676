"""A posterior as the record of an answer: what every candidate, number, level and error comes to.

For a signature g of strength 1 about the bare model, with P = V^-1 under nothing and K of the rows alone,

    limit = max(s, 0) + 2.33 i^-1/2,   s = g^T P y / i,   i = g^T P g      (above which 99 % exclude it)
    unseen below 3.3 i^-1/2,   absorption = 1 - (g^T P g / g^T K g)^1/2

Reference: Cowan et al. (2011), Eur. Phys. J. C 71, 1554 (upper limits of a strength that is not negative).
"""

import re
from collections.abc import Iterator, Mapping
from dataclasses import astuple, replace
from math import nan
from typing import Literal

import numpy as np
from scipy import special

from taichi_erosion.evidence import record as parts
from taichi_erosion.evidence.data.comparison_rows import ComparisonRows, join_rows, repeat_fit_p
from taichi_erosion.evidence.data.problem import Floats, Observable
from taichi_erosion.evidence.data.transforms import axis_position, from_scale, value_on_axis
from taichi_erosion.evidence.models.predictor import axis_scale_of
from taichi_erosion.evidence.models.run_store import BudgetSpentError
from taichi_erosion.evidence.race.adequacy import chi_square_of_fit, fit_residual, is_adequate, misfit_p_value
from taichi_erosion.evidence.race.blocks import AND, columns_of, smooth_columns
from taichi_erosion.evidence.race.decision import Decision, decide_cause, fit_of_decision
from taichi_erosion.evidence.race.dose_laws import Law
from taichi_erosion.evidence.race.fit import OUTSIDE, Fit, Hypothesis, Race
from taichi_erosion.evidence.race.posterior import Posterior, quantiles
from taichi_erosion.evidence.race.priors import KEEP, SEED, SURE
from taichi_erosion.evidence.record import Interval, Record
from taichi_erosion.mechanisms.dose_forms import Form
from taichi_erosion.tables.number_columns import vary_together

EXCLUDED = float(special.ndtri(0.99))  # sd above which a strength is excluded, wrongly one time in a hundred
CLEAR = float(special.ndtri(0.99))  # likewise 1 %: of several observables one may follow nothing
ONE_SIDED = float(special.ndtri(0.95))  # sd beyond which 5 % of a normal distribution lie
MOST_POINTS, MOST_ROWS = 12, 30  # of a curve, and over which it is a mean
POWERS = 4  # of a condition, beside which another one has a trend of its own


def race_record(posterior: Posterior, decision: Decision | None = None) -> Record:
    decision_used, race = decision or decide_cause(posterior), posterior.race
    after, model = fit_of_decision(posterior, decision_used), race.model
    bare = weigh_rows_alike(race.bare, after)
    sound = is_adequate(posterior.best_fit)  # else what is missing looks like an error of rows and levels
    return Record(
        **vars(decision_used.decision_record),
        effects={name: effect_part(posterior, decision_used, name) for name in model.candidates},
        mechanisms=mechanism_parts(decision_used),
        parameters=parameter_parts(posterior),
        levels=tuple(observable_level_parts(posterior)) if sound else (),
        errors=tuple(inferred_error_parts(posterior)) if sound else (),
        scatter=tuple(scatter_parts(race)),
        repeats=tuple(parts.RepeatPart(x.observable, x.lines, x.gap) for x in race.prepared.rows.unmerged),
        n=race.prepared.rows.size,
        chi2_before=chi_square_of_fit(bare),
        chi2_after=chi_square_of_fit(after),
        p_misfit=misfit_p_value(bare, levels=False),
        p_misfit_after=misfit_p_value(after, levels=True),
        p_lack_of_fit=lack_of_fit_p(race, bare),
        p_lack_of_fit_after=lack_of_fit_p(race, after),
        where=tuple(residual_trends(race, bare)),
        rows=measured_and_predicted_rows(race, bare, after),
        curves=tuple(unlisted_curve_parts(posterior, decision_used)),
        settings=model.settings,
        runs=race.prepared.predictor.cost.runs,
        stopped="budget" if race.out_of_budget else "",
    )


def weigh_rows_alike(fit: Fit, other: Fit) -> Fit:
    """A fit at its scales with the weights of another: what the other one follows is no bad row."""
    evidence, weight = fit.evidence, other.evidence.solution.rows.weight
    solution = replace(evidence.solution.rows, weight=weight).at_scales(evidence.solution.u)
    return replace(fit, evidence=replace(evidence, solution=solution, bad=other.evidence.bad))


def mechanism_parts(decided: parts.DecisionPart, law: Law | None = None) -> dict[str, parts.MechanismPart]:
    """Mechanisms that may act, and the one of which a law is known."""
    shares, names = decided.probabilities, decided.acting_mechanisms
    alone = {name: parts.MechanismPart(shares.get(name, 0.0)) for name in names}
    return alone | ({law[0]: mechanism_part_with_law(law, shares.get(law[0], 0.0))} if law else {})


def scatter_parts(race: Race) -> Iterator[parts.ScatterPart]:
    """Scatter of single measurements, and whether repeated rows gave it or check what is stated."""
    for observable, mask in race.prepared.observables_with_row_masks():
        scatter, kind = race.prepared.rows.noise[observable.name].scatter, difference_kind(observable)
        slope = float(np.median(race.prepared.rows.slope[mask])) if kind == "offset" else 1.0
        sd = float(np.sqrt(np.nanmedian(scatter.variance))) / slope
        yield parts.ScatterPart(observable.name, kind, sd, int(scatter.pure[1]), scatter.factor)


def difference_kind(observable: Observable) -> Literal["factor", "offset"]:
    """What a difference on the comparison scale is."""
    return "offset" if observable.transform == "identity" else "factor"


def lack_of_fit_p(race: Race, fit: Fit) -> float:
    """Chance that repeats scatter as far from a fit as their means do; NaN without repeats."""
    p = race.prepared
    slopes, bad = p.whiten(fit.jacobian), list(fit.evidence.bad)
    gain = np.linalg.solve(slopes.T @ slopes + np.eye(slopes.shape[1]), slopes.T)
    leverage = np.einsum("ij,ji->i", slopes, gain)
    remainder = fit_residual(fit)
    leverage[bad], remainder[bad] = 1.0, 0.0
    return repeat_fit_p(p.rows, p.variance, remainder, leverage)


def weighted_interval(values: Floats, weight: Floats) -> Interval:
    low, middle, high = quantiles(values, weight)
    return Interval(float(middle), float(low), float(high))


def parameter_parts(posterior: Posterior) -> dict[str, parts.ParameterPart]:
    """Every calibrated number if nothing is missing, and averaged over all explanations."""
    (values, weight), model, bare = posterior.number_draws, posterior.race.model, posterior.race.bare
    sd, numbers = np.sqrt(np.diag(bare.setting_covariance)), {}
    ends = (bare.linear_target + z * sd for z in (0.0, -ONE_SIDED, ONE_SIDED))
    before = np.array([model.numbers_in_units(end) for end in ends])
    least, most = (model.axis_numbers(np.full(model.count, z)) for z in (-ONE_SIDED, ONE_SIDED))
    for j, axis in enumerate(posterior.race.prepared.parameter_axes):
        now = weighted_interval(values[:, j], weight)
        low, at, high = (axis_position(axis, each) for each in (now.low, now.value, now.high))
        tenth = 0.1 * (axis.high - axis.low)
        at_end = bool(np.isfinite(tenth) and not axis.low + tenth < at < axis.high - tenth)
        share, usual = (high - low) / float(most[j] - least[j]), Interval(*map(float, before[:, j]))
        part = {"start": value_on_axis(axis, 0.0), "before": usual, "prior_share": share, "at_end": at_end}
        numbers[axis.name] = parts.ParameterPart(**vars(now), **part)
    return numbers


def effect_part(posterior: Posterior, decision: Decision, name: str) -> parts.EffectPart:
    """One candidate, from its explanations and its signature about the likeliest explanation without it."""
    race, most = posterior.race, posterior.race.model.candidates[name].maximum
    bare, single = race.bare, race.fits.get(Hypothesis((name,)))
    strength, share = weighted_interval(*posterior.strength_draws(name)), decision.inclusion[name]
    if single is None:
        return parts.EffectPart("untestable", share, *vars(strength).values(), most=most)
    best = posterior.best_fit
    about = bare if name in best.hypothesis.names or best.dose is not None else best
    column = race.prepared.whiten(effect_signature(race, about, name))
    action, gram = about.evidence.solution.project(column[:, np.newaxis])
    alone = float(column @ (about.evidence.solution.inverse_variance_of_rows * column))
    information = max(float(gram[0, 0]), 1e-12)
    sd = information**-0.5
    factor = single.log_evidence - bare.log_evidence
    absorption = 1.0 - (information / alone) ** 0.5 if alone > 0.0 else 1.0
    limit = max(float(action[0]) / information, 0.0) + EXCLUDED * sd if is_adequate(about) else np.inf
    if chi_square_of_fit(single) < chi_square_of_fit(about):  # it may do less than its slope at 0 promises
        end = float(single.v[-1] + EXCLUDED * single.setting_covariance[-1, -1] ** 0.5)
        limit = max(limit, race.model.strength(name, end))
    alike = tuple(other for other in decision.group if other != name) if name in decision.group else ()
    status, unseen = effect_status(name, decision, factor, limit, most, absorption), 2.0 * ONE_SIDED * sd
    above = [success for strength, success in race.model.candidates[name].trials if strength >= limit]
    if status == "excluded" and 2 * sum(above) <= len(above) > 0:  # most runs that would show it have stopped
        status = "untestable"
    value, low, high = (nan, 0.0, limit) if status == "excluded" else vars(strength).values()
    numbers = limit, factor, absorption, unseen
    return parts.EffectPart(status, share, value, low, high, *numbers, alike, most)


def effect_signature(race: Race, about: Fit, name: str) -> Floats:
    """Change (n,) per unit of strength beside a fit, at the end of a budget alone; 0 without a value."""
    model, names = race.model, tuple(sorted((*about.hypothesis.names, name)))
    v = np.insert(about.v, model.count + names.index(name), 0.0)
    try:
        change = model.predict_mean(names, v) - model.predict_mean(about.hypothesis.names, about.v)
    except BudgetSpentError:
        single = race.fits[Hypothesis((name,))]
        steps = np.array([model.strength(name, float(single.v[-1]) + h) for h in (-0.05, 0.05)])
        return single.jacobian[:, -1] * 0.1 / max(float(np.ptp(steps)), 1e-9)
    return np.nan_to_num(change) / model.strength(name, 0.0)


def effect_status(
    name: str, decision: Decision, factor: float, limit: float, most: float, absorption: float
) -> parts.Status:
    if name in decision.named:
        return "present"
    if factor > -np.log(KEEP) and decision.verdict == "outside_library":
        return "better_but_not_sufficient"
    if name in decision.group or decision.inclusion[name] > 1.0 - SURE:
        return "open"
    if limit < 1.0:
        return "excluded"
    return "untestable" if absorption > SURE or most < limit < np.inf else "open"


def unlisted_curve_parts(posterior: Posterior, decision: Decision) -> Iterator[parts.CurvePart]:
    """What something unlisted does along each condition with which it acts for SURE, against its first value.

    It is all that the rows show beside the effects that are named.
    """
    names, race = tuple(sorted(decision.named)), posterior.race
    acting = {h: p for h, p in posterior.probability.items() if OUTSIDE in h.extra}
    unlisted = {h: p for h, p in acting.items() if {*names} <= {*h.names}}
    is_sure = decision.verdict == "outside_library" or (names and decision.unlisted >= SURE)
    if not (unlisted and is_sure) or decision.acting_mechanisms:
        return
    best = max(unlisted, key=lambda h: unlisted[h])
    rows, fit = race.prepared.rows, race.fits.get(replace(best, names=names), race.fits[best])
    for name, column in rows.conditions.items():
        alike = [each for each, x in rows.conditions.items() if each == name or vary_together(column, x)]
        share = sum(p for h, p in unlisted.items() if not h.along or {*alike} & {*h.along.split(AND)})
        first = next((each for each in alike if each in best.along.split(AND)), alike[0])
        acts = share / sum(unlisted.values()) if name == first else 0.0
        for index, block in enumerate(fit.blocks):
            points = np.unique(column[(np.array(rows.names) == block.observable) & np.isfinite(column)])
            if acts < SURE or block.kind != "unlisted" or points.size < 2:
                continue
            some = np.linspace(0, points.size - 1, min(points.size, MOST_POINTS)).round().astype(int)
            curve = curve_part(name, fit, points[some], index, rows)
            if curve.shape != "varies":
                others = tuple(each for each in alike if each != name)
                yield replace(curve, unread=name in race.prepared.problem.unread, alike=others)


def curve_part(along: str, fit: Fit, points: Floats, index: int, rows: ComparisonRows) -> parts.CurvePart:
    """A curve with its shape: differences between its turn and its ends count beyond 98 %.

    It is the mean of a block over the other conditions of the rows, the same at each point.
    """
    now, block = fit.evidence.solution, fit.blocks[index]
    measured = np.flatnonzero(np.array(rows.names) == block.observable)
    some = rows.select_rows(np.sort(np.random.default_rng(SEED).permutation(measured)[:MOST_ROWS]))
    set_to = ({**some.conditions, along: np.full(some.size, x)} for x in points)
    both = join_rows([rows, *(replace(some, conditions=each) for each in set_to)])
    mask, inside = np.arange(both.size) < rows.size, now.rows.block == index
    wide = smooth_columns(both, block.observable, mask, block.size, fit.hypothesis.along)[rows.size :]
    wide = now.tau[inside][0] * wide.reshape(points.size, some.size, -1).mean(axis=1)
    columns, beyond = np.split(wide - wide[0], [block.columns.shape[1] - 1], axis=1)
    columns = np.pad(columns, ((0, 0), (0, 1)))  # of its level, the same everywhere
    mean = columns @ now.centre[inside]
    covariance = columns @ now.inverse[np.ix_(inside, inside)] @ columns.T + beyond @ beyond.T

    def sign_of_difference(i: int, j: int) -> int:
        gap, sd = mean[i] - mean[j], np.sqrt(covariance[i, i] + covariance[j, j] - 2.0 * covariance[i, j])
        return int(np.sign(gap)) if abs(gap) > CLEAR * sd else 0

    last, top, bottom = points.size - 1, int(np.argmax(mean)), int(np.argmin(mean))
    ways: dict[int, parts.Shape] = {1: "rises", -1: "falls", 0: "varies"}
    turns: tuple[tuple[parts.Shape, int, int], ...] = (("peak", top, 1), ("trough", bottom, -1))
    shape, turn = ways[sign_of_difference(last, 0)], nan
    for name, at, way in turns:
        if 0 < at < last and sign_of_difference(at, 0) == way == sign_of_difference(at, last):
            shape, turn = name, float(points[at])
    half = ONE_SIDED * np.sqrt(np.diag(covariance))
    ends = np.array([mean, mean - half, mean + half]).T
    kind = difference_kind(rows.observables[rows.which[measured[0]]])
    ends = ends if kind == "offset" else np.exp(ends)
    places = (parts.PointPart(*e, at=x) for x, e in zip(points.tolist(), ends.tolist(), strict=True))
    return parts.CurvePart(block.observable, along, kind, shape, turn, tuple(places))


def mechanism_part_with_law(law: Law, probability: float) -> parts.MechanismPart:
    mechanism, best, share = law
    form, draws = best.form, best.draw_numbers()
    numbers = dict(zip(("a", *form.names), map(best_value_interval, best.numbers, draws.T), strict=True))
    values = {name: f"{each.value:.3g}" for name, each in numbers.items()}
    columns = [best.rows.conditions[name].tolist() for name in form.conditions]
    at = sorted(set(zip(*columns, strict=True))) or [()]
    sets = dict(zip(form.conditions, np.array(at).T, strict=True)) or {"": np.zeros(1)}
    spread = np.array([form.dose(sets, each) for each in draws]).T
    sizes = map(best_value_interval, form.dose(sets, best.numbers), spread)
    settings = [dict(zip(form.conditions, each, strict=True)) for each in at]
    doses = (parts.DosePart(at, *astuple(size)) for at, size in zip(settings, sizes, strict=True))
    powers = [(condition, numbers[name]) for condition, name in form.exponents.items()]
    exponents, low, high = ({at: getattr(x, end) for at, x in powers} for end in ("value", "low", "high"))
    python = form.python.format(**{name: f"params.{name}" for name in values})
    head = mechanism, form.conditions, form.name, form.text.format(**values), python
    part = parts.LawPart(*head, numbers, exponents, low, high, share, *law_with_names(form, numbers))
    return parts.MechanismPart(probability, tuple(doses), part)


def law_with_names(form: Form, numbers: Mapping[str, Interval]) -> tuple[str, dict[str, tuple[str, float]]]:
    """The expression with sizes of conditions named, and these; none where a number has another unit."""
    if form.name == "exponential":
        return "", {}
    pattern, names = re.compile(r"(?<=/ )[\d.e+-]+(?=\))"), iter(form.conditions)
    pairs = zip(form.conditions, pattern.findall(form.text), strict=False)
    sizes = {f"{name}_0": (name, float(size)) for name, size in pairs}
    text = pattern.sub(lambda _: f"{{{next(names)}_0}}", form.text)
    return text, sizes | ({"k": (form.conditions[0], numbers["k"].value)} if "k" in numbers else {})


def best_value_interval(value: float, draws: Floats) -> Interval:
    return Interval(float(value), *map(float, np.quantile(draws, (0.05, 0.95))))


def observable_level_parts(posterior: Posterior) -> Iterator[parts.LevelPart]:
    """Level of an observable with the stated error that rows share, where it is off and of a sure sign."""
    race, rows = posterior.race, posterior.race.prepared.rows
    weight = np.concatenate([each.weight for each in posterior.draws])
    for observable, mask in race.prepared.observables_with_row_masks():
        sizes = np.array([])
        unit = np.median(race.prepared.row_sd[mask])
        shared = np.mean(rows.shared[mask], axis=0)
        for each in posterior.draws:
            index = [(b.kind, b.observable) for b in each.fit.blocks].index(("level", observable.name))
            column = int(np.argmax(each.fit.evidence.solution.rows.block == index))
            shifts = each.values[:, each.fit.v.size : each.fit.v.size + shared.size] @ shared
            sizes = np.append(sizes, unit * each.values[:, column] + shifts)
        chance = float(weight @ (np.abs(sizes) > 0.5 * unit)) / float(weight.sum())
        shift = weighted_interval(sizes, weight)
        if chance > 0.5 and shift.low * shift.high > 0.0:
            name = difference_kind(observable)
            size = weighted_interval(np.exp(sizes), weight) if name == "factor" else shift
            yield parts.LevelPart(**vars(size), observable=observable.name, kind=name, probability=chance)


def inferred_error_parts(posterior: Posterior) -> Iterator[parts.ErrorPart]:
    """Errors of sources, groups, rows and scatter that the likeliest explanation finds, beyond 90 %.

    A row is bad where the explanations that find it so have SURE together.
    """
    race, fit = posterior.race, posterior.best_fit
    now, rows = fit.evidence.solution, race.prepared.rows
    for index, block in enumerate(fit.blocks):
        if block.kind in ("source", "group"):
            yield from shared_error_parts(block.kind, fit, index, race)
    for row in sorted(fit.evidence.bad):
        if sum(p for h, p in posterior.probability.items() if row in race.fits[h].evidence.bad) < SURE:
            continue
        half = ONE_SIDED * float(race.prepared.row_sd[row])
        scale, expected = rows.observables[rows.which[row]], fit.mean[row] + np.array([0.0, half, -half])
        gap = from_scale(scale, rows.z[row]) - from_scale(scale, expected)
        label = str(rows.lines[row][0])
        yield parts.ErrorPart(*gap.tolist(), kind="row", observable=rows.names[row], label=label)
    spread = np.sqrt(np.diag(np.linalg.inv(now.gradient_and_curvature()[1])))
    for j in range(now.rows.block_count, now.u.size):
        low, middle, high = (float(np.exp(now.u[j] + z * spread[j])) for z in (-ONE_SIDED, 0.0, ONE_SIDED))
        if low > 1.0 or high < 1.0:
            name = now.rows.scales.names[j].removeprefix("scatter ")
            yield parts.ErrorPart(middle, low, high, "scatter", name, "")


def shared_error_parts(
    kind: Literal["source", "group"], fit: Fit, index: int, race: Race
) -> Iterator[parts.ErrorPart]:
    """How far rows of one source or group lie from all others of their observable; of two, the second."""
    now, rows = fit.evidence.solution, race.prepared.rows
    at, columns = now.rows.block == index, columns_of(fit.blocks[index], fit.jacobian[:, : race.model.count])
    best, root = (now.tau * now.centre)[at], now.tau[at]
    covariance = now.inverse[np.ix_(at, at)] * np.outer(root, root)
    labels = np.array(rows.source_names if kind == "source" else rows.group)
    for observable, mask in race.prepared.observables_with_row_masks():
        names = list(dict.fromkeys(labels[mask]))
        for label in names[1:] if len(names) == 2 else names:
            some, others = mask & (labels == label), mask & (labels != label)
            if not (others.any() and some.sum() > 1):
                continue
            gap = columns[some].mean(axis=0) - columns[others].mean(axis=0)
            value, sd = float(gap @ best), float(np.sqrt(gap @ covariance @ gap))
            if abs(value) > max(ONE_SIDED * sd, float(np.median(race.prepared.row_sd[some]))):
                ends = value + sd * np.array([0.0, -ONE_SIDED, ONE_SIDED])
                factor = difference_kind(observable) == "factor"
                size, low, high = map(float, np.exp(ends) if factor else ends / np.median(rows.slope[some]))
                other, name = str(names[0]) if len(names) == 2 else "", observable.name
                yield parts.ErrorPart(size, low, high, kind, name, str(label), other, factor)


def residual_trends(race: Race, bare: Fit) -> Iterator[parts.PlacePart]:
    """Trends of the bare model's residual along every condition, clearest first (Holm).

    The line and the POWERS of a clearer one are columns beside the next: where conditions are not fully
    crossed, one shows the trend of another. Rows scatter as stated, or by what is left (Student's law).
    """
    rows, named, columns = race.prepared.rows, [], []
    linear, _ = race.linear(replace(bare, blocks=tuple(b for b in bare.blocks if b.kind != "discrepancy")))
    u = bare.evidence.solution.scales_for(linear.scales)
    u[linear.block_count :] = 0.0  # of few rows a fitted scatter is too small by chance
    for measured, rows_of in race.prepared.observables_with_row_masks():
        for name, values in rows.conditions.items():
            axis = axis_scale_of(values[rows_of])
            if axis is not None:
                named.append((measured.name, name))
                powers = (np.where(rows_of, axis(values) ** k, 0.0) for k in range(1, POWERS + 1))
                columns += map(race.prepared.whiten, powers)
    now = linear.at_scales(u)
    along, gram = now.project(np.reshape(columns, (-1, rows.size)).T)
    alone, remaining, least = gram.diagonal().copy(), [*range(len(named))], np.zeros(2)
    freedom = 0.5 / race.priors.doubt**2  # degrees of freedom of the scatter that is stated
    rest, free = freedom + float(now.whitened[0] @ linear.y), freedom + rows.size - bare.v.size - 1
    while remaining:
        length, degrees = np.sqrt(np.maximum(gram.diagonal(), 1e-12)), max(free, freedom)
        size = np.where(gram.diagonal() > 1e-6 * alone, along / length, 0.0)
        z = size / np.sqrt(np.maximum((rest - size**2) / degrees, 1.0))
        k = max(remaining, key=lambda k: abs(z[POWERS * k]))
        far = np.abs([z[POWERS * k], size[POWERS * k]])
        shape = (degrees if far[0] < far[1] else np.inf), np.inf  # Student's law; as stated the normal one
        # an adjusted p is no smaller than those before it
        least = np.maximum(least, np.minimum(2.0 * len(remaining) * special.stdtr(shape, -far), 1.0))
        (observable, name), sign = named[k], 1 if z[POWERS * k] > 0.0 else -1
        yield parts.PlacePart(observable, name, sign, float(least[0]), float(least[1]))
        remaining.remove(k)
        for j in range(POWERS * k, POWERS * (k + 1)):
            if gram[j, j] > 1e-6 * alone[j]:
                share = gram[j] / gram[j, j]
                rest, free = rest - along[j] ** 2 / gram[j, j], free - 1
                along, gram = along - share * along[j], gram - np.outer(share, gram[j])


def measured_and_predicted_rows(race: Race, bare: Fit, after: Fit) -> parts.RowsPart:
    """Measured and predicted values in the units of the observables, with what is not in the list."""
    rows, columns, now = race.prepared.rows, [], after.evidence.solution
    size, blocks = now.tau * now.centre, enumerate(after.blocks)
    unlisted = [each.columns @ size[now.rows.block == k] for k, each in blocks if each.kind == "unlisted"]
    sd = race.prepared.row_sd / np.maximum(rows.slope, 1e-300)
    half = np.where(np.isfinite(rows.reach), rows.reach, 0.0)
    for values in (rows.z, rows.z - half, rows.z + half, bare.mean, after.mean + np.sum(unlisted, axis=0)):
        column = np.empty(rows.size)
        for observable, mask in race.prepared.observables_with_row_masks():
            column[mask] = from_scale(observable, values[mask])
        columns.append(column)
    measured, low, high, before, adjusted = columns
    low, high = np.where(rows.reach == -np.inf, -np.inf, low), np.where(rows.reach == np.inf, np.inf, high)
    return parts.RowsPart(rows.names, rows.conditions, measured, low, high, sd, before, adjusted)
