"""What the answers of a study cost, told before a run: runs, core-minutes, and minutes on this machine."""

from typing import Any

from taichi_erosion.campaign.execute import WORK_MOST
from taichi_erosion.core.device import usable_cores
from taichi_erosion.evidence.emulator import training_runs
from taichi_erosion.evidence.models.load_study import Study

BATCH_MINUTES = 10.0  # of one core, in which it does WORK_MOST


def study_cost(study: Study) -> dict[str, Any]:
    """Runs of the first plans, `quick` and `full`, of all candidates; none where a function answers."""
    effects = [candidate.name for candidate in study.problem.candidates]
    return {name: plan_cost(study, effects, name) for name in ("quick", "full")}


def plan_cost(study: Study, effects: list[str], budget: str) -> dict[str, Any]:
    """Runs of one plan, and how long they take."""
    planned = training_runs.initial_training_runs(study, effects, budget)
    if planned is None:
        return {"runs": 0, "core_minutes": 0.0, "minutes_here": 0.0}
    _, requests, _ = training_runs.requested(planned)
    work = {request.key: request.work for request in requests}
    minutes = BATCH_MINUTES * sum(work.values()) / WORK_MOST
    cores = study.file.campaign.workers or usable_cores()
    return {"runs": len(work), "core_minutes": minutes, "minutes_here": minutes / cores}
