"""Laws of a mechanism: how a file that a discovery wrote gives a mechanism its dose, and checks itself."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from taichi_erosion.core.effect import Check, Conditions, Constants, Effect, Probe
from taichi_erosion.core.effect_probe import TYPICAL
from taichi_erosion.mechanisms.factors import SAMPLE_WIND
from taichi_erosion.mechanisms.library import dose_range
from taichi_erosion.scene import Scene, resolve
from taichi_erosion.scene.change import sample_scene
from taichi_erosion.scene.schema.fields import all_numbers_in

DoseOf = Callable[[Any, Mapping[str, Any]], Any]  # (params, conditions) -> dose [1]
Point = tuple[dict[str, float], float, float]  # conditions, dose there [1], response of a device effect there


def law_constants(mechanism: Effect, dose_of: DoseOf) -> Callable[[Any, float, Conditions], Constants] | None:
    """Constants of a mechanism on the device at the dose of a law; None for one of the host."""
    constants = mechanism.constants
    if constants is None:
        return None

    def constants_of_law(params: Any, strength: float, conditions: Conditions) -> Constants:
        return constants(params_at(mechanism, strength * float(dose_of(params, conditions))), 1.0, conditions)

    return constants_of_law


def law_act(mechanism: Effect, dose_of: DoseOf) -> Callable[..., Any]:
    """`act` of a mechanism at the dose of a law."""
    if mechanism.constants is not None:
        return mechanism.act

    def act(params: Any, strength: float, conditions: Conditions, scene: Scene) -> Scene:
        """The changed scene."""
        dose = strength * float(dose_of(params, conditions))
        return mechanism.act(params_at(mechanism, dose), 1.0, conditions, scene)

    return act


def params_at(mechanism: Effect, dose: float) -> Any:
    """Parameters of a mechanism at one dose, held within its range."""
    return mechanism.params(dose=float(np.clip(dose, *dose_range(mechanism))))


def law_checks(mechanism: Effect, probe: Probe, params: Any, points: Sequence[Point]) -> Iterator[Check]:
    """One line for each point: the effect does there what the mechanism does at the dose of the point."""
    for conditions, dose, response in points:
        where = ", ".join(f"{name} = {value:g}" for name, value in conditions.items())
        claim = f"at {where} the dose is {dose:.4g}"
        if mechanism.place == "scene":
            scene = sample_scene(wind=SAMPLE_WIND)
            got = probe(params, conditions, scene=scene)
            want = mechanism.act(params_at(mechanism, dose), 1.0, conditions, scene)
            numbers = (all_numbers_in(resolve(each)) for each in (got, want))
            differences = (abs(a - b) / max(abs(a), abs(b), 1e-12) for a, b in zip(*numbers, strict=True))
            yield Check(claim, max(differences), 0.0, atol=1e-4)
        else:
            yield Check(claim, device_response(mechanism, probe, params, conditions), response, rtol=1e-3)


def device_response(mechanism: Effect, probe: Probe, params: Any, conditions: Conditions) -> float:
    """Largest component of what an effect on the device does in a typical situation."""
    answer = np.ravel(probe(params, conditions, **TYPICAL[mechanism.place]))
    return float(answer[int(np.argmax(np.abs(answer)))])
