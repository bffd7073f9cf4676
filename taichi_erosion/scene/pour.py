"""Pouring: layers of discs without overlap that pass a plane one after another."""

from dataclasses import dataclass
from math import pi, sqrt

import numpy as np

from taichi_erosion.core.setup import Floats
from taichi_erosion.scene.schema_grains import Pour

CLEARANCE = 1.05  # distance of two layers over the sum of their largest radii [1]
TRIES = 400  # random places tried for a grain before its layer is closed [1]


@dataclass(frozen=True)
class Layers:
    """Grains of a pour in order of release."""

    place: Floats  # [n, 2] m, from the centre of the disc
    release_time: Floats  # [n] s


def clearing_time(distance: float, speed: float, gravity: float) -> float:
    """Time in which a grain falls a distance [s]:  distance = v t + g t^2 / 2."""
    return 2.0 * distance / (speed + sqrt(speed * speed + 2.0 * gravity * distance))


def pour_layers(fill: Pour, radius: Floats, gravity: float, places: np.random.Generator) -> Layers:
    """Random places and release times of grains with the given bounding radii [m].

    A layer is released at once, the next one when this one has fallen clear of the plane. A rate makes
    layers as thin as it can keep them, so that the flow is steady; where one grain a layer is still too
    fast, layers wait.
    """
    clear = clearing_time(2.0 * CLEARANCE * float(radius.max()), fill.speed, gravity)
    most = max(1, round(fill.rate * clear)) if fill.rate else len(radius)
    place = np.empty((len(radius), 2))
    release = np.empty(len(radius))
    first, time = 0, 0.0
    while first < len(radius):
        layer = random_layer(fill, radius[first : first + most], places)
        last = first + len(layer)
        place[first:last], release[first:last] = layer, time
        time += max(clear, len(layer) / fill.rate if fill.rate else 0.0)
        first = last
    return Layers(place, release)


def random_layer(fill: Pour, radius: Floats, places: np.random.Generator) -> Floats:
    """Random sequential addition of the next grains until the wanted coverage is reached, [n, 2] m."""
    allowed = np.searchsorted(np.cumsum(radius**2), fill.coverage * fill.radius**2, side="right")
    wanted = max(1, min(int(allowed), len(radius)))
    found = np.empty((wanted, 2))
    for k in range(wanted):
        place = free_place(fill.radius - radius[k], found[:k], radius[:k] + radius[k], places)
        if place is None:
            return found[:k]
        found[k] = place
    return found


def free_place(bound: float, others: Floats, distance: Floats, places: np.random.Generator) -> Floats | None:
    """A place in a disc of radius `bound`, farther than `distance` from the others, or None."""
    for _ in range(TRIES):
        angle, r = places.uniform(0.0, 2.0 * pi), bound * sqrt(places.uniform())
        place = np.array([r * np.cos(angle), r * np.sin(angle)])
        if np.all(np.sum((others - place) ** 2, axis=1) >= distance**2):
            return place
    return None
