"""Training runs along the doses of mechanisms: made once, they serve every law of every condition.

A mechanism reads no condition, so that its runs spread over its dose, the calibrated numbers, and conditions
that change the bare scene; what moisture or angularity would do to its dose is left to inference. They stand
in the ledger of the study, beside the runs of the bare model and of listed effects, which train them too.
"""

from dataclasses import replace

from taichi_erosion.core.errors import BadInput
from taichi_erosion.evidence.data.problem import Mechanism
from taichi_erosion.evidence.emulator import design
from taichi_erosion.evidence.emulator.design import StudyScene, TrainingRun
from taichi_erosion.evidence.emulator.training_runs import TrainingRuns
from taichi_erosion.evidence.models.simulator import Simulator
from taichi_erosion.mechanisms.library import dose_range, load_mechanisms, physical_mechanisms
from taichi_erosion.simulation.scene_setup import effective_scene


def with_mechanisms(training: TrainingRuns) -> TrainingRuns:
    """The runs with those along the dose of every mechanism that a scene of the study shows."""
    names = list(
        dict.fromkeys(name for scene in training.scenes for name in scene_mechanisms(training, scene))
    )
    simulator = training.simulator.with_mechanisms(names)
    scenes = tuple(replace(scene, simulator=simulator) for scene in training.scenes)
    mechanisms = tuple(Mechanism(name, *dose_range(load_mechanisms()[name])) for name in names)
    wider = replace(training, simulator=simulator, scenes=scenes, mechanisms=mechanisms)
    more = [run for scene in scenes for run in dose_runs(wider, scene)]
    return replace(wider, runs=(*training.runs, *more))


def scene_mechanisms(training: TrainingRuns, scene: StudyScene) -> list[str]:
    """Mechanisms that can act in one scene, of those that the study asks for."""
    wanted = training.study.file.candidates.mechanisms
    wind = training.simulator.scene(scene.measure.scene).wind is not None
    able = physical_mechanisms(wind)
    return [name for name in able if wanted is None or name in wanted]


def dose_runs(training: TrainingRuns, scene: StudyScene) -> list[TrainingRun]:
    """Runs along the doses of all mechanisms that change one scene."""
    size, tag = training.plan_size, training.study.fresh
    return [
        run
        for mechanism in training.mechanisms
        if mechanism.name in scene_mechanisms(training, scene) and changes(scene, mechanism)
        for run in design.mechanism_runs(scene, mechanism, size, tag)
    ]


def changes(scene: StudyScene, mechanism: Mechanism) -> bool:
    """Whether a mechanism changes a scene at all, such as walls that it does not have."""
    simulator: Simulator = scene.simulator
    if simulator.library[mechanism.name].place != "scene":
        return True
    try:
        words = simulator.overrides(scene.measure, scene.rows[0], {}, {mechanism.name: 0.5 * mechanism.high})
        changed = simulator.scene(scene.measure.scene, words)
        return effective_scene(changed, simulator.library) is not changed
    except BadInput:
        return False
