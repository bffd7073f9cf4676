"""What the answers of a study cost, told before a run: runs, core-minutes, and minutes on this machine."""

from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from taichi_erosion.campaign.ledger import close_ledger
from taichi_erosion.evidence.answers.rounds import MOST_POINTS
from taichi_erosion.evidence.answers.start_values import evaluations_sentence
from taichi_erosion.evidence.emulator import training_runs
from taichi_erosion.evidence.emulator.plan_cost import MINUTE, PlanCost, plan_cost
from taichi_erosion.evidence.emulator.training_runs import TrainingRuns
from taichi_erosion.evidence.models.load_study import Study

PLANS = ("quick", "full")


def study_cost(study: Study) -> dict[str, Any]:
    """Cost of a discovery with all candidates, by the size of its plan."""
    effects = [candidate.name for candidate in study.problem.candidates]
    found: dict[str, Any] = {}
    for name in PLANS:
        planned = training_runs.initial_training_runs(study, effects, name)
        if planned is None:
            found[name] = {"sentence": evaluations_sentence(study, name == "quick")}
            continue
        cost = without_a_trace(planned)
        found[name] = {
            "runs": cost.first + cost.later,
            "kept": cost.kept,
            "core_minutes": cost.seconds * cost.workers / MINUTE,
            "minutes_here": cost.seconds / MINUTE,
            "sentence": cost.sentence,
        }
    return found


def without_a_trace(planned: TrainingRuns) -> PlanCost:
    """Cost of a plan; a study that has no ledger gets none by the question."""
    rounds = planned.plan_size.rounds
    if planned.simulator.folder.exists():
        return plan_cost(planned, rounds, MOST_POINTS)
    with TemporaryDirectory() as folder:
        simulator = replace(planned.simulator, folder=Path(folder), ledger=None)
        cost = plan_cost(replace(planned, simulator=simulator), rounds, MOST_POINTS)
        close_ledger(simulator.opened())
    return cost
