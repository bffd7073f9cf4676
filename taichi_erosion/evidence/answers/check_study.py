"""Validation of a study without a run: its file, its table, its scenes or model, and what an answer costs."""

from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from taichi_erosion.campaign.calibration import refuse_unmeasured_targets
from taichi_erosion.campaign.ledger import close_ledger
from taichi_erosion.campaign.study_file import read_calibration_study, read_study_file
from taichi_erosion.evidence.answers.rounds import MOST_POINTS
from taichi_erosion.evidence.answers.set_up import stale_faults, table_faults
from taichi_erosion.evidence.data.problem import Measurements
from taichi_erosion.evidence.data.tables.rows import Faults
from taichi_erosion.evidence.emulator.plan_cost import MINUTE, PlanCost, cost_in_words, plan_cost
from taichi_erosion.evidence.emulator.training_runs import TrainingRuns, initial_training_runs
from taichi_erosion.evidence.models.load_study import NO_OPTIONS, PLANS, Study, StudyOptions, load_study
from taichi_erosion.execution.checks import read_scene
from taichi_erosion.tables.number_words import with_unit
from taichi_erosion.verification.effect_contract import examine_file

Document = dict[str, Any]


def check_study(path: Path, options: StudyOptions = NO_OPTIONS) -> Document:
    """What a valid study holds, and what an answer costs. Raises BadInput.

    Effect files are examined against the contract of effects, which starts the device.
    """
    faults = Faults()
    file = Faults().of(read_study_file, path, lambda _: iter(()))  # one that cannot be read is told of below
    if file is not None and file.targets and not file.study.measurements:
        calibration = read_calibration_study(path)
        names = list(calibration.study.observables)
        for scene in dict.fromkeys(map(calibration.scene, names)):
            faults.of(read_scene, scene, ())
        faults.raise_if_any()
        refuse_unmeasured_targets(calibration)
        return {"study": str(path), "kind": "calibration", "observables": names}
    study = load_study(path, options)
    examined = [faults.of(examine_file, each) for each in study.effect_files]
    faults.raise_if_any()
    measurements = study.problem.measurements
    set_up = (*table_faults(study.problem), *stale_faults(study.path, study.file))
    return {
        "study": str(study.path),
        "kind": "evidence",
        "rows": measurements.size,
        "held_out": len(study.problem.vault.rows),
        "drawn_from": study.vault_digest,
        "observables": {name: measurements.observable.count(name) for name in study.file.observables},
        "conditions": {name: condition_range_text(measurements, name) for name in study.file.conditions},
        "parameters": [parameter.path for parameter in study.problem.parameters],
        "candidates": study.problem.candidate_names,
        "notes": [*(fault.sentence for fault in set_up), *study.notes],
        "cost": discovery_cost(study),
        "effects": examined,
    }


def condition_range_text(measurements: Measurements, name: str) -> str:
    """`5.5 to 7 deg`: range of a condition in the unit of the table."""
    column, units = measurements.conditions[name], measurements.table_units
    if np.isnan(column).all():
        return "not stated"
    low, high = (units.condition(name, float(end(column))) for end in (np.nanmin, np.nanmax))
    return with_unit(f"{low:g} to {high:g}", units.condition_unit(name))


def discovery_cost(study: Study) -> dict[str, Any]:
    """Cost of a discovery with all candidates, by the size of its plan."""
    effects = study.problem.candidate_names
    document: dict[str, Any] = {}
    for name in PLANS:
        planned = initial_training_runs(study, effects, name)
        if planned is None:
            sentence = cost_in_words(study, len(effects))
            return {"full": {"sentence": sentence}} if sentence else {}
        cost = plan_cost_without_new_ledger(planned)
        document[name] = {"sentence": cost.cost_text, "core_minutes": cost.seconds * cost.workers / MINUTE}
    return document


def plan_cost_without_new_ledger(planned: TrainingRuns) -> PlanCost:
    """Cost of a plan; a study that has no ledger gets none by the question."""
    with TemporaryDirectory() as folder:
        simulator = planned.simulator
        if is_new := not simulator.folder.exists():
            simulator = replace(simulator, folder=Path(folder), ledger=None)
        rounds = planned.plan_size.rounds
        cost = plan_cost(replace(planned, simulator=simulator), rounds, MOST_POINTS, missing=True)
        if is_new:
            close_ledger(simulator.shared_ledger())
    return cost
