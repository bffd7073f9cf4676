"""Bed slope: weight has a component along the bed.

    g = g (-sin t cos b, -sin t sin b, -cos t),    t = strength theta

with theta the slope of the conditions [deg], positive where the wind along x blows uphill, and b the angle
between wind and line of steepest ascent [deg]. The bed of the scene stays level and its gravity turns. What
holds grains is then the ratio u*_t(theta) / u*_t(0) = sqrt(cos theta + sin theta / tan phi), phi being the
angle of repose. Strength multiplies the slope. Holds for slopes below the angle of repose.

Reference: Iversen & Rasmussen (1994), Sedimentology 41, 721, eq. (12).
"""

from collections.abc import Mapping
from dataclasses import dataclass
from math import cos, radians, sin
from typing import Any

import numpy as np

from taichi_erosion.core.effect import Check, Checks, Conditions, Probe, effect_of, quantity
from taichi_erosion.scene import Scene
from taichi_erosion.scene.change import sample_scene, with_section
from taichi_erosion.scene.schema.fields import unit_vector


@dataclass(frozen=True)
class Params:
    bearing: float = quantity(0.0, "deg", "wind against the line of steepest ascent", low=-180.0, high=180.0)


def change(params: Params, strength: float, conditions: Conditions, scene: Scene) -> Scene:
    """The scene with gravity turned; it must point straight down before."""
    slope, bearing = radians(strength * conditions.get("slope", 0.0)), radians(params.bearing)
    if slope == 0.0:
        return scene
    direction = (-sin(slope) * cos(bearing), -sin(slope) * sin(bearing), -cos(slope))
    return with_section(scene, "gravity", direction=direction)


def can_act(conditions: Mapping[str, Any]) -> Any:
    """A level bed has no slope."""
    return np.asarray(conditions.get("slope", 0.0)) != 0.0


def checks(probe: Probe) -> Checks:
    def pull(axis: int, bearing: float, slope: float, strength: float = 1.0) -> float:
        changed = probe(Params(bearing), {"slope": slope}, scene=sample_scene(), strength=strength)
        return unit_vector(changed.gravity.direction)[axis]

    yield Check("up a slope of 30 deg half the weight pulls back", pull(0, 0.0, 30.0), -0.5)
    yield Check("and cos 30 deg presses on", pull(2, 0.0, 30.0), -(3.0**0.5) / 2.0)
    yield Check("down the slope it pulls forwards", pull(0, 0.0, -30.0), 0.5)
    yield Check("across the slope it pulls sidewards", pull(1, 60.0, 30.0), -0.5 * 3.0**0.5 / 2.0)
    yield Check("strength multiplies the angle", pull(0, 0.0, 60.0, 0.5), -0.5)
    yield Check("a level bed stays level", pull(0, 60.0, 0.0), 0.0)


EFFECT = effect_of(__name__, "slope of the bed", "scene", change, reads=("slope",), most=1.5)
