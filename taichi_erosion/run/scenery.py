"""Walls in recordings and pictures: as they stand at the moment that is shown."""

from dataclasses import dataclass, field, replace

import numpy as np
import scipy

from taichi_erosion.core.setup import Floats, Setup, Triple
from taichi_erosion.recording import stream
from taichi_erosion.recording.wall_mesh import WallMesh, wall_meshes
from taichi_erosion.scene import Scene
from taichi_erosion.simulation import Simulation, WallPose, wall_poses


@dataclass
class Scenery:
    """Walls of one replica."""

    walls: tuple[WallMesh, ...]  # as they stood at the start
    gone: set[str] = field(default_factory=set)  # those that the recording has been told are gone
    poses: dict[str, tuple[Floats, Floats]] = field(default_factory=dict)  # last written, by name
    is_rewritten: bool = False  # a session went back: what it wrote of later times no longer holds


def scenery_of(scene: Scene, setup: Setup, box: tuple[Triple, Triple]) -> Scenery:
    """All walls, endless ones as far as the box reaches [m]."""
    moving = frozenset(wall for stage in scene.stages for wall in (*stage.remove, *stage.move))
    return Scenery(wall_meshes(setup, box, moving))


def standing(scenery: Scenery, sim: Simulation, replica: int) -> tuple[WallMesh, ...]:
    """The walls that are there, where they are."""
    if not any(wall.moving for wall in scenery.walls):
        return scenery.walls
    poses = wall_poses(sim, replica)
    return tuple(placed(wall, poses[wall.name]) for wall in scenery.walls if poses[wall.name].present)


def placed(wall: WallMesh, pose: WallPose) -> WallMesh:
    """A wall at its pose."""
    return replace(wall, vertices=wall.vertices @ pose.rotation.T + pose.translation) if wall.moving else wall


def log_scenery(recording: stream.Recording, scenery: Scenery, sim: Simulation, replica: int) -> None:
    """Write what has moved or vanished since the last call, at the recording's present time."""
    movable = [wall for wall in scenery.walls if wall.moving]
    poses = wall_poses(sim, replica) if movable else {}
    for wall in movable:
        if poses[wall.name].present:
            log_standing(recording, scenery, wall, poses[wall.name])
        elif wall.name not in scenery.gone:
            stream.log_wall_removed(recording, wall.name)
            scenery.gone.add(wall.name)


def log_standing(recording: stream.Recording, scenery: Scenery, wall: WallMesh, pose: WallPose) -> None:
    """Write a wall that is there, if it is not as it was last written."""
    rotation, translation = scenery.poses.get(wall.name, (np.eye(3), np.zeros(3)))
    if scenery.is_rewritten:
        stream.log_wall(recording, wall)
        scenery.gone.discard(wall.name)
    elif np.array_equal(rotation, pose.rotation) and np.array_equal(translation, pose.translation):
        return
    x, y, z, w = scipy.spatial.transform.Rotation.from_matrix(pose.rotation).as_quat().tolist()
    along, across, up = pose.translation.tolist()
    stream.log_wall_pose(recording, wall.name, (along, across, up), (w, x, y, z))
    scenery.poses[wall.name] = (pose.rotation, pose.translation)
