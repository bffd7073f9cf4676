"""What has been simulated outlives a disk that refuses to hold all of it."""

from math import inf
from typing import Any

from taichi_erosion.core.errors import BadInput
from taichi_erosion.recording import stream
from taichi_erosion.recording.room import is_short_of_room
from taichi_erosion.run.play import Play
from taichi_erosion.run.watch import Camera, Keeper, Properties, finish, watch_replica


def watch_while_there_is_room(camera: Camera, stage_play: Play) -> None:
    """Record; while the disk still has room for the results, close the recording whole and go on without."""
    if camera.interval < inf and is_short_of_room(camera.recording.path):
        words = f"the disk is nearly full: the recording ends at {stage_play.time:.6g} s"
        stream.log_text(camera.recording, "WARN", words)
        stream.close(camera.recording)
        camera.interval = inf
        note(stage_play, camera.replica, words)
    if camera.interval < inf:
        watch_replica(camera, stage_play)


def save_when_due(keeper: Keeper, stage_play: Play) -> None:
    """Write a checkpoint; where that fails the one before stays, and the run goes on."""
    try:
        keeper.watch(stage_play)
    except BadInput as error:
        note(stage_play, 0, str(error))


def note(stage_play: Play, replica: int, words: str) -> None:
    """Warn once."""
    warnings = stage_play.actors[replica].warnings
    if words not in warnings:
        warnings.append(words)


def finish_or_warn(
    camera: Camera, stage_play: Play, record: dict[str, Any], properties: Properties
) -> dict[str, str]:
    """Files of a replica by kind; what cannot be written becomes a warning beside what was measured."""
    try:
        return finish(camera, stage_play, record, properties)
    except BadInput as error:
        record["warnings"].insert(0, str(error))
        return {}
