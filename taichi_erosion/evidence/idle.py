"""Effects that a scene cannot show: told from the scene itself, before a run is spent on them."""

from taichi_erosion.core.effect import Effect, read_params
from taichi_erosion.core.errors import BadInput
from taichi_erosion.evidence.problem import Candidate
from taichi_erosion.evidence.screen import expected_strength
from taichi_erosion.evidence.simulator import Simulator, read_scene_once
from taichi_erosion.evidence.surface_plan import Bench, Row, cells
from taichi_erosion.simulation.prepare import conditions_of, effective_scene


def why_idle(simulator: Simulator, bench: Bench, candidate: Candidate) -> str | None:
    """Why an effect changes nothing that a scene answers, None where it may."""
    effect, scene = simulator.library[candidate.name], bench.answer.scene
    rows, strength = cells(bench, simulator, (candidate.name,)), expected_strength(candidate)
    if not rows:
        return "none of the conditions lets it act"
    try:
        still = all(changes_nothing(simulator, bench, effect, strength, row) for row in rows)
    except BadInput as error:
        return str(error)
    return f"{scene.name} does not depend on it" if still else None


def changes_nothing(simulator: Simulator, bench: Bench, effect: Effect, strength: float, row: Row) -> bool:
    """Whether an effect leaves the scene and all readings as they are."""
    if effect.place not in ("scene", "instrument"):
        return False
    words = simulator.overrides(bench.answer, row, {}, {effect.name: strength})
    scene = read_scene_once(bench.answer.scene, words)
    if effect.place == "scene":
        return effective_scene(scene, simulator.library) is scene
    params, _ = read_params(effect, scene.effects[effect.name])
    measures = [simulator.answers[name].measure for name in bench.observables]
    readings = [effect.act(params, strength, conditions_of(scene), measure, 1.0) for measure in measures]
    return all(reading == 1.0 for reading in readings)
