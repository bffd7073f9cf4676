"""Steps of a calibration by designed experiments.

    screen     Plackett-Burman in all parameters; the largest effects go on, the others stay at their centre
    climb      along the steepest path of those, towards the first target
    surface    Box-Behnken, central composite or Latin hypercube around the best point of the path, a
               quadratic in each response
    optimise   the settings at which the surface meets all targets, or the nearest it comes
    confirm    fresh seeds there, tested against the measurement

Every step rests on the runs of those before it, and a run that stands in the ledger is not repeated: a step
may be called again, after a crash or alone, and ends the same.

Centre points and corners of the screening have means of their own, so that curvature is neither taken for
noise nor for an effect: effects follow from the corners, the error from their residuals and from the centre's
runs.

Reference: Box & Wilson (1951), J. R. Stat. Soc. B 13, 1; Myers, Montgomery & Anderson-Cook (2016), Response
Surface Methodology, 4th ed., ch. 5 and 6; Montgomery (2017), Design and Analysis of Experiments, 9th ed.,
6.8 (curvature and the corners).
"""

from dataclasses import dataclass, replace
from math import nan

import numpy as np
from scipy import stats

from taichi_erosion.campaign.design_runs import DesignRunner, run_design
from taichi_erosion.campaign.study_file import CalibrationStudy
from taichi_erosion.core.errors import BadInput
from taichi_erosion.experiments.anova import (
    CONFIDENCE,
    Effect,
    EffectLimits,
    curvature,
    effect_limits,
    effects,
    reduced,
)
from taichi_erosion.experiments.confirm import Confirmation, Sample, confirm
from taichi_erosion.experiments.design import (
    box_behnken,
    central_composite,
    latin_hypercube,
    plackett_burman,
    steepest_path,
)
from taichi_erosion.experiments.design_table import SAME_POINT, Design, Factor, Floats, arranged
from taichi_erosion.experiments.fit import Fit, fit_model
from taichi_erosion.experiments.optimise import Goal, Optimisation, Optimum, optimise
from taichi_erosion.experiments.terms import linear_terms


def screened_effects(fit: Fit) -> tuple[list[Effect], EffectLimits]:
    """Effects in the order of the terms, and their limits; without centre points those of the plain model."""
    corners, bent = corner_fit(fit), curvature(fit)
    if corners is None or bent is None:
        return effects(fit), effect_limits(fit)
    # standard error of every effect, in the response's unit
    spread = 2.0 * np.sqrt(bent.ms_error * np.diag(corners.unscaled_covariance)[1:])
    found = [tested(one, error, bent.df_error) for one, error in zip(effects(corners), spread, strict=True)]
    tail, largest = 0.5 * (1.0 - CONFIDENCE), float(spread.max())
    limits = EffectLimits(
        single=float(stats.t.isf(tail, bent.df_error)) * largest,
        bonferroni=float(stats.t.isf(tail / len(found), bent.df_error)) * largest,
        lenth_margin=nan,
        lenth_simultaneous=nan,
    )
    return found, limits


def corner_fit(fit: Fit) -> Fit | None:
    """The same model on the corners alone; None without a centre, or where too few corners have a result."""
    corner = np.any(np.abs(fit.coded) > SAME_POINT, axis=1)
    part = replace(
        fit, **{name: getattr(fit, name)[corner] for name in ("coded", "values", "blocks", "rows")}
    )
    coefficients = len(fit.terms) + len(np.unique(fit.blocks))
    full_rank = np.linalg.matrix_rank(part.results.model.exog) == coefficients
    return part if full_rank and not corner.all() else None


def tested(effect: Effect, error: float, df: int) -> Effect:
    """The effect with t and p for a standard error."""
    t = effect.value / float(error) if error > 0.0 else nan
    return replace(effect, t=t, p=2.0 * float(stats.t.sf(abs(t), df)))


@dataclass(frozen=True, eq=False)
class Screening:
    """The screening, its linear models by target, and the factors that go on, largest effect first."""

    design: Design
    fits: dict[str, Fit]
    kept: tuple[Factor, ...]


@dataclass(frozen=True, eq=False)
class Climb:
    """The path, and its best row."""

    design: Design
    best: int


@dataclass(frozen=True, eq=False)
class ResponseSurface:
    """The surface design, its full quadratic models by target, and those models reduced."""

    design: Design
    full: dict[str, Fit]
    fits: dict[str, Fit]


@dataclass(frozen=True, eq=False)
class Confirmed:
    """Fresh runs at one optimum, and their tests by target."""

    design: Design
    optimum: Optimum
    tests: dict[str, Confirmation]


def screening_design(file: CalibrationStudy) -> Design:
    """Plackett-Burman design in all parameters of the study, in random order."""
    study = file.study
    factors = [Factor(path, p.low, p.high, p.unit) for path, p in study.parameters.items()]
    return plackett_burman(factors, centre_points=study.design.screen_centre, seed=study.study.seed)


def screen(runner: DesignRunner) -> Screening:
    """Run and analyse the screening."""
    study = runner.file.study
    design = run_design(runner, "screen", screening_design(runner.file))
    terms = linear_terms(len(design.factors))
    fits = {name: fit_model(design, name, terms) for name in study.targets}
    # effects of different responses are compared in standard deviations of their own runs
    sizes = [effect_sizes(fit) / (fit.values.std() or 1.0) for fit in fits.values()]
    order = np.argsort(-np.max(sizes, axis=0), kind="stable")[: study.design.surface_factors]
    return Screening(design, fits, tuple(design.factors[place] for place in order))


def effect_sizes(fit: Fit) -> Floats:
    """Sizes of the effects, in the response's unit."""
    return np.abs([effect.value for effect in screened_effects(fit)[0]])


def climb(runner: DesignRunner, screening: Screening) -> Climb:
    """Run the steepest path from the centre of the screening towards the first target."""
    study = runner.file.study
    name, target = next(iter(study.targets.items()))
    fit = screening.fits[name]
    slopes = {effect.name: 0.5 * effect.value for effect in screened_effects(fit)[0]}
    upwards = target.value >= centre_value(screening.design, name, float(fit.coefficients[0]))
    design = steepest_path(
        screening.kept,
        {factor.path: slopes[factor.path] for factor in screening.kept},
        steps=study.design.climb_steps + 1,
        step=study.design.climb_step if upwards else -study.design.climb_step,
        limits={path: entry.limits for path, entry in study.parameters.items()},
    )
    design = run_design(runner, "climb", design)
    distance = np.abs(design.responses[name] - target.value)
    if not np.isfinite(distance).any():
        raise BadInput(f"{runner.file.path}: no run of the climb gave a {name}")
    return Climb(design, int(np.nanargmin(distance)))


def centre_value(design: Design, name: str, otherwise: float) -> float:
    """Mean response of the centre points, where the path begins; a curved surface lies far from its plane."""
    centre = np.array([kind == "centre" for kind in design.kinds])
    known = design.responses[name][centre & np.isfinite(design.responses[name])]
    return float(known.mean()) if len(known) else otherwise


def surface_factors(runner: DesignRunner, screening: Screening, path: Climb) -> list[Factor]:
    """Ranges around the best point of the climb, moved where they would leave the limits."""
    study, found = runner.file.study, []
    for factor, level in zip(screening.kept, path.design.natural[path.best], strict=True):
        low, high = study.parameters[factor.path].limits
        half = min(study.design.surface_half * factor.half, 0.5 * (high - low))
        middle = float(np.clip(level, low + half, high - half))
        found.append(Factor(factor.path, middle - half, middle + half, factor.unit))
    return found


def surface_design(file: CalibrationStudy, factors: list[Factor]) -> Design:
    """The study's choice of a design over these ranges, in random order.

    Raises BadInput for a star point beyond the limits of its parameter.
    """
    sizes, seed = file.study.design, file.study.study.seed
    if sizes.surface == "latin_hypercube":
        return latin_hypercube(factors, sizes.hypercube_runs, seed, sizes.surface_centre)
    if sizes.surface == "central_composite":
        design = central_composite(factors, sizes.surface_centre, sizes.surface_axial, seed)
        refuse_star_outside_limits(file, design)
        return design
    return box_behnken(factors, centre_points=sizes.surface_centre, seed=seed)


def refuse_star_outside_limits(file: CalibrationStudy, design: Design) -> None:
    """Raise BadInput for a point beyond a parameter's limits, rounding apart."""
    for factor, levels in zip(design.factors, design.natural.T, strict=True):
        low, high = file.study.parameters[factor.path].limits
        slack = SAME_POINT * factor.half
        for level, side, bound in ((levels.min(), "below", low), (levels.max(), "above", high)):
            if not low - slack <= level <= high + slack:
                raise BadInput(
                    f"{file.path}: central composite: star point {factor.path} = {level:.4g} lies {side} "
                    f'the limit {bound:g}; set surface_axial = "faced" in [design]'
                )


def fit_response_surface(runner: DesignRunner, factors: list[Factor]) -> ResponseSurface:
    """Run the design of the surface and fit its quadratics."""
    study = runner.file.study
    design = run_design(runner, "surface", surface_design(runner.file, factors))
    full = {name: fit_model(design, name, "quadratic") for name in study.targets}
    smaller = {name: reduced(fit).fit for name, fit in full.items()}
    return ResponseSurface(
        design, full, {name: fit if fit.terms else full[name] for name, fit in smaller.items()}
    )


def find_optimum(runner: DesignRunner, surface: ResponseSurface) -> Optimisation:
    """Settings that meet all targets."""
    goals = [Goal(name, "target", target.value) for name, target in runner.file.study.targets.items()]
    return optimise(list(surface.fits.values()), goals)


def confirm_optimum(runner: DesignRunner, surface: ResponseSurface, found: Optimisation) -> Confirmed:
    """Run fresh seeds at the most certain optimum and test them against the measurements."""
    study, optimum = runner.file.study, found.optima[0]
    points = np.tile(optimum.coded, (study.design.confirm, 1))
    design = arranged("confirmation", surface.design.factors, [("added", points)])
    design = run_design(runner, "confirm", design)
    tests = {
        name: confirm(design.responses[name].tolist(), Sample(target.value, target.sd, target.n))
        for name, target in study.targets.items()
    }
    return Confirmed(design, optimum, tests)
