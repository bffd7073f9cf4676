"""Which measure answers an observable of a scene, and what it is given."""

from collections.abc import Callable
from dataclasses import dataclass
from math import inf

from taichi_erosion.core.snapshot import Snapshot
from taichi_erosion.measures import drum, heap, incline, repose
from taichi_erosion.measures.result import Measurement
from taichi_erosion.scene import Scene
from taichi_erosion.scene.schema import Measure
from taichi_erosion.scene.schema_geometry import Cylinder, Disc, Plane


@dataclass(frozen=True)
class Evidence:
    """What a measure may look at: the end of its stage, and what was kept on the way."""

    scene: Scene
    order: Measure
    end: Snapshot
    frames: tuple[Snapshot, ...]
    tilts: tuple[float, ...]  # rad, of the frames

    @property
    def base_height(self) -> float:
        """Height of the plate at the origin [m]."""
        plate = self.scene.geometry.get(self.order.plate or "")
        if isinstance(plate, Plane):
            return plate.point[2]
        return plate.centre[2] if isinstance(plate, Disc) else 0.0

    @property
    def plate_radius(self) -> float | None:
        """Radius of a round plate [m], None for one without an edge."""
        plate = self.scene.geometry.get(self.order.plate or "")
        return plate.radius if isinstance(plate, Disc) else None

    @property
    def azimuths(self) -> int:
        """Number of silhouettes."""
        return self.order.azimuths or AZIMUTHS


AZIMUTHS = 12  # silhouettes of a heap where the scene names no number


def turned_drum(evidence: Evidence) -> Measurement:
    """Dynamic angle in the cylinder that the measure names as its plate."""
    wall = evidence.scene.geometry.get(evidence.order.plate or "")
    if isinstance(wall, Cylinder):
        return drum.dynamic_angle(evidence.frames, wall.radius, wall.centre, wall.axis)
    return drum.dynamic_angle(evidence.frames, inf)


OBSERVABLES: dict[str, Callable[[Evidence], Measurement]] = {
    "repose_angle": lambda e: repose.repose_angle(e.end, e.plate_radius, e.base_height, e.azimuths),
    "cone_angle": lambda e: repose.cone_angle(e.end, e.base_height),
    "angle_of_repose": lambda e: heap.angle_of_repose_outline(e.end, e.base_height),
    "pile_height": lambda e: heap.pile_height(e.end, e.base_height),
    "centroid_height": lambda e: heap.centroid_height(e.end, e.base_height),
    "radius_90": lambda e: heap.radius_90(e.end),
    "runout_radius": lambda e: heap.runout_radius(e.end, e.base_height),
    "column_height": lambda e: heap.column_height(e.end, e.base_height),
    "dynamic_angle": turned_drum,
    "sliding_angle": lambda e: incline.sliding_angle(e.frames, e.tilts),
}


def measure(name: str, evidence: Evidence) -> Measurement:
    """Measure one observable by its name."""
    return OBSERVABLES[name](evidence)
