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

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from taichi_erosion.campaign.execute import SIMULATE, run_requests
from taichi_erosion.campaign.ledger import Ledger
from taichi_erosion.campaign.request import RunRequest, RunResult, request_of_file
from taichi_erosion.campaign.study_file import CalibrationStudy, WorkersEntry
from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.setup import Floats
from taichi_erosion.execution import Report
from taichi_erosion.experiments import design as designs
from taichi_erosion.experiments.anova import Effect, curvature_test, effects, eliminate_terms
from taichi_erosion.experiments.confirm import Confirmation, Sample, welch_test
from taichi_erosion.experiments.fit import Fit, fit_model, model_matrix, overfit_warning
from taichi_erosion.experiments.optimise import Goal, Optimisation, optimise

SEEDS_APART = 1000  # seeds reserved for one stage: no two runs of a study share their noise
STAGES = ("screen", "climb", "surface", "confirm")


@dataclass(frozen=True)
class DesignRun:
    """One run of a stage, as the table of all runs shows it."""

    stage: str
    row: int  # of its design, from 1
    seed: int
    settings: dict[str, float]
    result: RunResult


@dataclass
class DesignRunner:
    """How the runs of a study are made, and all that were requested so far."""

    file: CalibrationStudy
    ledger: Ledger
    workers: WorkersEntry = field(default_factory=WorkersEntry)
    progress: Report | None = None
    function: str = SIMULATE
    stages: Sequence[str] = STAGES  # to be made
    runs: list[DesignRun] = field(default_factory=list)


def run_design(runner: DesignRunner, stage: str, design: designs.Design) -> designs.Design:
    """The design with the values of all targets; NaN where a run gave none."""
    file, report = runner.file, runner.progress
    first = file.study.study.seed + SEEDS_APART * STAGES.index(stage)
    plan = [(int(row), scene) for row in np.argsort(design.run_order) for scene in file.scenes]
    settings = [add_unvaried_settings(file, design.settings(row)) for row in range(len(design))]
    requests = [design_request(runner, scene, settings[row], stage, row, first + row) for row, scene in plan]
    place, count = runner.stages.index(stage), len(runner.stages)  # every stage counts alike
    results = run_requests(
        requests,
        runner.ledger,
        workers=runner.workers.workers,
        scheduler=runner.workers.scheduler,
        progress=report and (lambda share, words: report((place + share) / count, f"{stage}: {words}")),
        function=runner.function,
    )
    results_by_run = dict(zip(plan, results, strict=True))
    runner.runs += [
        DesignRun(stage, row + 1, first + row, settings[row], results_by_run[row, scene])
        for row in range(len(design))
        for scene in file.scenes
    ]
    columns = {
        name: [results_by_run[row, file.scene(name)].value(file.measure(name)) for row in range(len(design))]
        for name in file.study.targets
    }
    return design.with_responses(**columns)


def add_unvaried_settings(file: CalibrationStudy, settings: dict[str, float]) -> dict[str, float]:
    """Value of every parameter of the study; one that a design does not vary stays at its centre."""
    return {path: 0.5 * (entry.low + entry.high) for path, entry in file.study.parameters.items()} | settings


def scene_overrides(file: CalibrationStudy, settings: dict[str, float]) -> list[str]:
    """PATH=VALUE changes of a scene, those that hold for all runs first."""
    entries = file.study.parameters
    links = {path: value for main, value in settings.items() for path in entries[main].also}
    return [*file.study.study.settings, *(f"{path}={value!r}" for path, value in (settings | links).items())]


def design_request(
    runner: DesignRunner, scene: Path, settings: dict[str, float], stage: str, row: int, seed: int
) -> RunRequest:
    file = runner.file
    extra: dict[str, Any] = {"device": runner.workers}
    if file.study.design.record in (stage, "all"):
        columns = {path.replace(".", "_").replace("-", "_"): value for path, value in settings.items()}
        extra["record"] = file.folder / "recordings" / f"{stage}-{row + 1}-{seed}.rrd"
        extra["properties"] = {"doe": {"stage": stage, "row": row + 1} | columns}
    return request_of_file(scene, scene_overrides(file, settings), seed, file.effect_files, **extra)


def effects_and_limits(fit: Fit) -> tuple[list[Effect], dict[str, float]]:
    """Effects in the order of the terms, and their limits; without centre points those of the plain model.

    With a centre: the same model on the corners alone, its error that of the model with the curvature.
    """
    corner = np.any(np.abs(fit.coded) > designs.SAME_POINT, axis=1)
    bent = curvature_test(fit)
    part = replace(fit, coded=fit.coded[corner], values=fit.values[corner], rows=fit.rows[corner])
    if bent is None or np.linalg.matrix_rank(model_matrix(part.coded, fit.terms)) <= len(fit.terms):
        return effects(fit)
    return effects(part, (bent.ms_error, bent.df_error))


@dataclass(frozen=True, eq=False)
class Screening:
    """The screening, its linear models by target, and the factors that go on, largest effect first."""

    design: designs.Design
    fits: dict[str, Fit]
    leading: tuple[designs.Factor, ...]


@dataclass(frozen=True, eq=False)
class Climb:
    """The path, and its best row."""

    design: designs.Design
    best: int


@dataclass(frozen=True, eq=False)
class ResponseSurface:
    """The surface design, its full quadratic models by target, and those models reduced."""

    design: designs.Design
    full: dict[str, Fit]
    fits: dict[str, Fit]


def screening_design(file: CalibrationStudy) -> designs.Design:
    """Plackett-Burman design in all parameters of the study, in random order."""
    study = file.study
    factors = [designs.Factor(path, p.low, p.high, p.unit) for path, p in study.parameters.items()]
    return designs.plackett_burman(factors, centre_points=study.design.screen_centre, seed=study.study.seed)


def run_screening(runner: DesignRunner) -> Screening:
    study = runner.file.study
    design = run_design(runner, "screen", screening_design(runner.file))
    fits = {name: fit_model(design, name, "linear") for name in study.targets}
    # effects of different responses are compared in standard deviations of their own runs
    sizes = [np.abs(response_slopes(fit)) / (fit.values.std() or 1.0) for fit in fits.values()]
    order = np.argsort(-np.max(sizes, axis=0), kind="stable")[: study.design.surface_factors]
    return Screening(design, fits, tuple(design.factors[place] for place in order))


def response_slopes(fit: Fit) -> Floats:
    """Response to one coded unit of every factor."""
    return np.array([0.5 * effect.value for effect in effects_and_limits(fit)[0]])


def climb_steepest_path(runner: DesignRunner, screening: Screening) -> Climb:
    """Run the steepest path from the centre of the screening towards the first target."""
    study = runner.file.study
    name, target = next(iter(study.targets.items()))
    fit = screening.fits[name]
    upwards = target.value >= mean_centre_response(screening.design, name, float(fit.coefficients[0]))
    design = designs.steepest_ascent(
        screening.leading,
        response_slopes(fit)[[fit.factors.index(factor) for factor in screening.leading]],
        steps=study.design.climb_steps + 1,
        step=study.design.climb_step if upwards else -study.design.climb_step,
        limits={path: entry.limits for path, entry in study.parameters.items()},
    )
    design = run_design(runner, "climb", design)
    distance = np.abs(design.responses[name] - target.value)
    if not np.isfinite(distance).any():
        raise BadInput(f"{runner.file.path}: no run of the climb gave a {name}")
    return Climb(design, int(np.nanargmin(distance)))


def mean_centre_response(design: designs.Design, name: str, otherwise: float) -> float:
    """Mean response of the centre points, where the path begins; a curved surface lies far from its plane."""
    finite = design.responses[name][np.array(design.kinds) == "centre"]
    finite = finite[np.isfinite(finite)]
    return float(finite.mean()) if len(finite) else otherwise


def surface_factor_ranges(runner: DesignRunner, screening: Screening, path: Climb) -> list[designs.Factor]:
    """Ranges around the best point of the climb, moved where they would leave the limits."""
    study = runner.file.study
    factors = []
    for factor, level in zip(screening.leading, path.design.natural[path.best], strict=True):
        low, high = study.parameters[factor.path].limits
        half = min(study.design.surface_half * factor.half_range, 0.5 * (high - low))
        middle = float(np.clip(level, low + half, high - half))
        factors.append(designs.Factor(factor.path, middle - half, middle + half, factor.unit))
    return factors


def surface_design(file: CalibrationStudy, factors: Sequence[designs.Factor]) -> designs.Design:
    """The study's choice of a design over these ranges, in random order."""
    sizes, seed = file.study.design, file.study.study.seed
    if sizes.surface == "latin_hypercube":
        return designs.latin_hypercube(factors, sizes.hypercube_runs, seed, sizes.surface_centre)
    if sizes.surface == "central_composite":
        return designs.central_composite(factors, sizes.surface_centre, sizes.surface_axial, seed)
    return designs.box_behnken(factors, centre_points=sizes.surface_centre, seed=seed)


def refuse_axial_points_outside(file: CalibrationStudy, design: designs.Design) -> None:
    """Raise BadInput for a point beyond a parameter's limits, rounding apart."""
    for factor, levels in zip(design.factors, design.natural.T, strict=True):
        low, high = file.study.parameters[factor.path].limits
        slack = designs.SAME_POINT * factor.half_range
        for level, side, bound in ((levels.min(), "below", low), (levels.max(), "above", high)):
            if not low - slack <= level <= high + slack:
                words = f"star point {factor.path} = {level:.4g} lies {side} the limit {bound:g}"
                remedy = 'set surface_axial = "faced" in [design]'
                raise BadInput(f"{file.path}: central composite: {words}; {remedy}")


def fit_response_surface(runner: DesignRunner, factors: list[designs.Factor]) -> ResponseSurface:
    """Run the design of the surface and fit its quadratics."""
    planned = surface_design(runner.file, factors)
    refuse_axial_points_outside(runner.file, planned)
    design = run_design(runner, "surface", planned)
    full = {name: fit_model(design, name, "quadratic") for name in runner.file.study.targets}
    smaller = {name: eliminate_terms(fit) for name, fit in full.items()}
    return ResponseSurface(design, full, {n: fit if fit.terms else full[n] for n, fit in smaller.items()})


def find_optimum(runner: DesignRunner, surface: ResponseSurface) -> Optimisation:
    """Settings that meet all targets, with a warning where a surface does not predict new runs."""
    goals = [Goal(name, target.value) for name, target in runner.file.study.targets.items()]
    fits = list(surface.fits.values())
    optimisation = optimise(fits, goals)
    warnings = [line for fit in fits if (line := overfit_warning(fit))]
    remedy = "; a larger surface_half in [design] lets the factors stand out"
    return replace(optimisation, sentences=(*optimisation.sentences, *(line + remedy for line in warnings)))


def confirm_optimum(
    runner: DesignRunner, surface: ResponseSurface, optimisation: Optimisation
) -> tuple[designs.Design, dict[str, Confirmation]]:
    """Fresh seeds at the most certain optimum, and their tests against the measurements."""
    study, targets = runner.file.study, runner.file.study.targets.items()
    points = np.tile(optimisation.optima[0].coded, (study.design.confirm, 1))
    planned = designs.stack_parts("confirmation", surface.design.factors, [("added", points)])
    design = run_design(runner, "confirm", planned)
    samples = {name: Sample(target.value, target.sd, target.n) for name, target in targets}
    return design, {n: welch_test(design.responses[n].tolist(), sample) for n, sample in samples.items()}
