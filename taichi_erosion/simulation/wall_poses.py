"""Where the walls of a running simulation are."""

from dataclasses import dataclass

from taichi_erosion.core.setup import Floats
from taichi_erosion.core.transfer import download
from taichi_erosion.simulation.assemble import Simulation


@dataclass(frozen=True)
class WallPose:
    """A wall as it stands: a point p of it at the start is now at  R p + t."""

    present: bool  # False once removed
    rotation: Floats  # R [3, 3]
    translation: Floats  # t [3] m


def wall_poses(sim: Simulation, replica: int) -> dict[str, WallPose]:
    """Pose of every wall of one replica, by name."""
    walls, names = sim.world.walls, [surface.name for surface in sim.setups[replica].surfaces]
    fields = [walls.present, walls.turn, walls.shift, walls.centre]
    present, turn, shift, centre = download(fields, replica * sim.sizes.surfaces, len(names))
    return {
        # it turns about its centre
        name: WallPose(bool(present[k]), turn[k], centre[k] + shift[k] - turn[k] @ centre[k])
        for k, name in enumerate(names)
    }
