"""A calibration up to a step: tables, written as each step has ended, JSON document, calibrated scenes."""

import time
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Literal, get_args

import pandas as pd

from taichi_erosion.campaign import calibration_steps as calculate
from taichi_erosion.campaign.calibration_steps import STAGES, Climb, DesignRunner, ResponseSurface
from taichi_erosion.campaign.execute import SIMULATE
from taichi_erosion.campaign.ledger import close_ledger, open_ledger
from taichi_erosion.campaign.study_file import CalibrationStudy, read_calibration_study, with_entry
from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.files import ListedFolder, mark_toml, refuse_foreign_file, remove_mark, write_atomic
from taichi_erosion.execution import Report
from taichi_erosion.execution.checks import read_scene
from taichi_erosion.experiments import fit as fits
from taichi_erosion.experiments.anova import anova, curvature_test
from taichi_erosion.experiments.design import Design, design_csv
from taichi_erosion.experiments.optimise import Optimisation
from taichi_erosion.scene import resolve, scene_hash
from taichi_erosion.scene.load import fault_lines, parse_scene, read_text_of_file
from taichi_erosion.scene.paths import parse_toml_value
from taichi_erosion.scene.schema.geometry import Mesh

Document = dict[str, Any]
Step = Literal["design", "run", "analyse", "climb", "surface", "optimise", "confirm"]
STEPS: tuple[Step, ...] = get_args(Step)
LAST_STEP = {"screen": "run", "climb": "climb", "surface": "surface", "confirm": "confirm"}  # by stage
TABLES = (*(f"{stage}.csv" for stage in STAGES), "runs.csv")
DIGITS = 6  # of a calibrated number
SCHEMA_LINE = "#:schema"  # a relative path, which another folder breaks
PAGE, PICTURES = "README.md", "pictures"  # page of a calibration, and the folder of its figures


@dataclass
class Calibration:
    """Findings so far; `document` is what --json prints."""

    file: CalibrationStudy
    document: Document = field(default_factory=dict)
    climb: Climb | None = None
    surface: ResponseSurface | None = None
    optimum: Optimisation | None = None


def calibrate(
    path: Path,
    until: Step = "confirm",
    overrides: Mapping[str, Any] | None = None,
    progress: Report | None = None,
    function: str = SIMULATE,
    force: bool = False,
) -> Calibration:
    """Carry a study out up to a step. Raises BadInput for what cannot be done; what was run is kept.

    `overrides` are entries of its [campaign], in place of those of its file. `force` replaces files in
    the study's folder that no calibration wrote, or that were changed since.
    """
    start = time.perf_counter()
    file = read_calibration_study(path)
    refuse_unmeasured_targets(file)
    calibration = Calibration(file)
    design = calculate.screening_design(file)
    calibration.document = {"study": str(path), "until": until, "design": design_rows_document(design)}
    refuse_foreign_calibration(file, until, force)
    write_design(calibration, "screen", design)
    if until != "design":
        steps = STEPS[: STEPS.index(until) + 1]
        ledger = open_ledger(file.folder)
        workers = file.study.campaign.model_copy(update=overrides or {})
        stages = [stage for stage in STAGES if LAST_STEP[stage] in steps]
        runner = DesignRunner(file, ledger, workers, progress, function, stages)
        try:
            run_further_steps(calibration, runner, steps)
        finally:
            close_ledger(ledger)
        records = (run.result.record for run in runner.runs)
        measures = dict.fromkeys(name for each in records for name in each.get("measures", {}))
        table = pd.DataFrame(
            {"stage": run.stage, "row": run.row, "seed": run.seed, "key": run.result.key}
            | {path: f"{run.settings[path]:.6g}" for path in file.study.parameters}
            | {name: "" if (y := run.result.value(name)) != y else f"{y:.7g}" for name in measures}
            | {"failure": run.result.failure, "cpu_s": f"{run.result.record.get('cpu_s', 0.0):.1f}"}
            for run in runner.runs
        )
        text = table.to_csv(index=False, lineterminator="\n")
        ListedFolder(file.folder).write_file("runs.csv", text.encode())
        calibration.document["runs"] = len(runner.runs)
        calibration.document["cpu_s"] = sum(run.result.record.get("cpu_s", 0.0) for run in runner.runs)
    calibration.document["wall_s"] = time.perf_counter() - start
    return calibration


def refuse_unmeasured_targets(file: CalibrationStudy) -> None:
    """Raise BadInput for targets that their scenes do not measure."""
    changes, effects = file.study.study.settings, file.effect_files
    measures = {scene: read_scene(scene, changes, effects).measure for scene in file.scenes}
    lines = [
        f"targets.{name}: {scene.name} does not measure {measure}, but {', '.join(measures[scene])}"
        for name in file.study.targets
        if (measure := file.measure(name)) not in measures[scene := file.scene(name)]
    ]
    if lines:
        raise BadInput(*fault_lines(file.path.name, lines))


def refuse_foreign_calibration(file: CalibrationStudy, until: Step, force: bool) -> None:
    """Raise BadInput where a step would replace a file that no calibration wrote."""
    pictures = [p.name for name in file.study.targets for p in (file.folder / PICTURES).glob(f"*_{name}.png")]
    last = [PAGE, *(f"{PICTURES}/{name}" for name in pictures)] if until == STEPS[-1] else []
    for scene in file.scenes if until == STEPS[-1] else []:
        refuse_foreign_file(calibrated_scene_path(file, scene), file.path, force)
    tables = TABLES[:1] if until == "design" else TABLES
    ListedFolder(file.folder).refuse_foreign_files([*tables, *last], force)


def run_further_steps(calibration: Calibration, runner: DesignRunner, steps: tuple[Step, ...]) -> None:
    """Screen, then every further step that was asked for."""
    document, labels = calibration.document, calibration.file.labels
    screening = calculate.run_screening(runner)
    write_design(calibration, "screen", screening.design)
    document["screen"] = design_rows_document(screening.design)
    if "analyse" in steps:
        responses = {name: effect_document(fit, labels) for name, fit in screening.fits.items()}
        document["analyse"] = {"responses": responses, "kept": [factor.path for factor in screening.leading]}
    if "climb" not in steps:
        return
    path = calibration.climb = calculate.climb_steepest_path(runner, screening)
    write_design(calibration, "climb", path.design)
    document["climb"] = design_rows_document(path.design) | {"best": path.best + 1}
    if "surface" not in steps:
        return
    factors = calculate.surface_factor_ranges(runner, screening, path)
    surface = calibration.surface = calculate.fit_response_surface(runner, factors)
    write_design(calibration, "surface", surface.design)
    document["surface"] = surface_document(surface, labels)
    if "optimise" not in steps:
        return
    optimum = calibration.optimum = calculate.find_optimum(runner, surface)
    document["optimise"] = optimum_document(optimum)
    if "confirm" not in steps:
        return
    design, tests = calculate.confirm_optimum(runner, surface, optimum)
    write_design(calibration, "confirm", design)
    document["confirm"] = {
        "settings": design.settings(0),
        "values": {name: column.tolist() for name, column in design.responses.items()},
        "tests": {name: asdict(test) for name, test in tests.items()},
    }
    values = calculate.add_unvaried_settings(calibration.file, design.settings(0)).items()
    rounded = {path: float(f"{value:.{DIGITS}g}") for path, value in values}
    overrides = calculate.scene_overrides(calibration.file, rounded)
    paths = [write_calibrated_scene(calibration.file, scene, overrides) for scene in calibration.file.scenes]
    document["calibrated_scenes"] = [str(path) for path in paths]


def write_design(calibration: Calibration, name: str, design: Design) -> Path:
    """Write a design with its responses as a CSV table."""
    return ListedFolder(calibration.file.folder).write_file(f"{name}.csv", design_csv(design).encode())


def design_rows_document(design: Design) -> Document:
    columns = {name: column.tolist() for name, column in design.responses.items()}
    responses = ({name: column[row] for name, column in columns.items()} for row in range(len(design)))
    return {"rows": [{"settings": design.settings(k), "responses": row} for k, row in enumerate(responses)]}


def effect_document(fit: fits.Fit, labels: Mapping[str, str]) -> Document:
    """Effects of one response with their limits, curvature and figures of merit."""
    bent = curvature_test(fit)
    effect_list, limits = calculate.effects_and_limits(fit)
    ordered = sorted(effect_list, key=lambda effect: -abs(effect.value))
    return {
        "effects": [asdict(effect) | {"label": fits.term_label(effect.name, labels)} for effect in ordered],
        "limits": limits,
        "curvature": None if bent is None else asdict(bent),
        "quality": asdict(fits.figures_of_merit(fit)),
    }


def surface_document(surface: ResponseSurface, labels: Mapping[str, str]) -> Document:
    """Variance, figures of merit and equations of every response."""
    document = {}
    for name, full in surface.full.items():
        smaller = surface.fits[name]
        document[name] = {
            "anova": [asdict(row) | {"label": fits.term_label(row.source, labels)} for row in anova(full)],
            "quality": asdict(fits.figures_of_merit(full)),
            "quality_reduced": asdict(fits.figures_of_merit(smaller)),
            "coded": fits.equation_text(full, fits.coded_polynomial(full)),
            "coded_reduced": fits.equation_text(smaller, fits.coded_polynomial(smaller)),
            "natural_reduced": fits.equation_text(smaller, fits.natural_polynomial(smaller)),
            "warning": fits.overfit_warning(smaller),
        }
    return {"ranges": {f.path: (f.low, f.high) for f in surface.design.factors}, "responses": document}


def optimum_document(optimisation: Optimisation) -> Document:
    """Optima, reach of the surface, and sentences about both."""
    optima = []
    for optimum in optimisation.optima:
        predicted = {name: asdict(one) for name, one in optimum.predictions.items()}
        numbers = {"settings": optimum.settings, "desirability": optimum.desirability}
        optima.append(numbers | {"predicted": predicted})
    document = {"optima": optima, "reach": {name: asdict(one) for name, one in optimisation.reach.items()}}
    return document | {"met": optimisation.is_met, "sentences": list(optimisation.sentences)}


def calibrated_scene_path(file: CalibrationStudy, scene: Path) -> Path:
    """Calibrated scene in the folder of the study; beside the old one where that has mesh files."""
    if any(isinstance(wall, Mesh) for wall in read_scene(scene, ()).geometry.values()):
        return scene.with_name(f"{scene.stem}_{file.path.stem}_calibrated.toml")
    return file.folder / f"{scene.stem}_calibrated.toml"


def write_calibrated_scene(file: CalibrationStudy, scene: Path, overrides: Sequence[str]) -> Path:
    """Write a scene with the settings of the confirmation runs, below a comment that says so.

    Comments of the scene stay where the changed text is that scene.
    """
    import tomlkit

    result = read_scene(scene, tuple(overrides))
    lines = read_text_of_file(scene, str(scene)).splitlines(keepends=True)
    text = "".join(line for line in lines if not line.startswith(SCHEMA_LINE))
    try:
        for override in overrides:
            path, _, value = override.partition("=")
            text = with_entry(text, path.strip().split("."), parse_toml_value(value.strip()))
        is_same = scene_hash(parse_scene(tomllib.loads(text), str(scene), scene.parent)) == scene_hash(result)
    except BadInput:
        is_same = False
    body = remove_mark(text if is_same else tomlkit.dumps(resolve(result)))
    last = "with the numbers that its last step confirmed"
    head = f"# Written by `doe calibrate` {file.path.name}: {scene.name} {last}.\n"
    path = calibrated_scene_path(file, scene)
    return write_atomic(path, mark_toml(path, file.path, head + body))
