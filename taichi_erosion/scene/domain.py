"""The box that no grain may leave."""

import numpy as np

from taichi_erosion.core.setup import Floats
from taichi_erosion.scene.schema import Scene
from taichi_erosion.scene.schema_field import Vector
from taichi_erosion.scene.walls import bounds_of, endless, wall_bounds

MARGIN_OPEN = 30.0  # side margin over the apparatus where a plane lets splashed grains roll away [1]
MARGIN_CLOSED = 0.5  # side margin otherwise [1]
MARGIN_HEIGHT = 0.5  # margin above and below over the height of the apparatus [1]
MARGIN_RADII = 20.0  # least margin, in largest radii [1]
MARGIN_RADII_OPEN = 500.0  # likewise to the sides where a plane lets grains slide away [1]


def domain_box(scene: Scene, centres: Floats, radius_largest: float) -> tuple[Vector, Vector]:
    """Low and high corner [m]: walls, starting grains and the way of moving walls, with a margin.

    A grain found outside is lost, and the run stops; the margin leaves room for a spreading heap.
    """
    boxes = [wall_bounds(scene, name) for name in scene.geometry] + [bounds_of(centres)]
    low = np.min([box.low for box in boxes], axis=0) + travel(scene, np.minimum)
    high = np.max([box.high for box in boxes], axis=0) + travel(scene, np.maximum)
    is_open = any(endless(wall) for wall in scene.geometry.values())
    share = MARGIN_OPEN if is_open else MARGIN_CLOSED
    least = MARGIN_RADII_OPEN if is_open else MARGIN_RADII
    extent = high - low
    side = max(share * max(extent[0], extent[1]), least * radius_largest)
    margin = np.maximum((side, side, MARGIN_HEIGHT * extent[2]), MARGIN_RADII * radius_largest)
    (x, y, z), (a, b, c) = (low - margin).tolist(), (high + margin).tolist()
    return (x, y, z), (a, b, c)


def travel(scene: Scene, extreme: np.ufunc) -> Floats:
    """Farthest shift of a wall along each coordinate, towards the low or the high side [m]."""
    farthest = np.zeros(3)
    reached: dict[str, Floats] = {}
    velocity: dict[str, Floats] = {}
    for stage in scene.stages:
        velocity |= {name: np.array(order.velocity) for name, order in stage.move.items()}
        for name, v in velocity.items():
            reached[name] = reached.get(name, np.zeros(3)) + v * stage.duration_max
            farthest = extreme(farthest, reached[name])
    return farthest
