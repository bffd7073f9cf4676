"""Recordings of a small heap under a falling grain, and readers of what they hold."""

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from taichi_erosion.core.setup import Floats
from taichi_erosion.core.snapshot import Snapshot, Totals
from taichi_erosion.recording.readback import NANOSECOND, POSITION, component_rows, read_chunks
from taichi_erosion.recording.stream import Recording, RunHeader, close, log_frame, log_totals, open_recording
from taichi_erosion.recording.wall_mesh import WallMesh

MOVING = 1e-2  # m s-1
FRAME_TIME = 0.01  # s
QUARTER_TURN = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])  # about z
CORNERS = np.array([[-0.05, -0.05, 0.0], [0.05, -0.05, 0.0], [0.05, 0.05, 0.0], [-0.05, 0.05, 0.0]])
FLOOR = WallMesh("plate", CORNERS, np.array([[0, 1, 2], [0, 2, 3]], dtype=np.int32), moving=False)


def pyramid(levels: int = 8, radius: float = 1e-3) -> Floats:
    """Square pyramid of touching spheres: centres [n, 3] m."""
    layers = []
    for level in range(levels):
        side = np.arange(levels - level) - 0.5 * (levels - level - 1)
        x, y = np.meshgrid(side, side)
        z = np.full(x.size, 1.0 + level * np.sqrt(2.0))
        layers.append(radius * np.stack([2.0 * x.ravel(), 2.0 * y.ravel(), z], axis=-1))
    return np.concatenate(layers)


def heap_snapshot(frame: int = 0) -> Snapshot:
    """A pyramid at rest and, last in the table, one grain that falls on it from 40 mm."""
    resting, time = pyramid(), frame * FRAME_TIME
    position = np.concatenate([resting, [[0.0, 0.0, 0.04 - 0.5 * 9.81 * time**2]]])
    count, nothing = len(position), np.zeros_like(position)
    velocity = nothing.copy()
    velocity[-1, 2] = -9.81 * time
    radius, mass = np.linspace(0.9e-3, 1.1e-3, count), np.full(count, 1e-5)
    contacts, ident = np.full(count, 6, dtype=np.int32), np.arange(count, dtype=np.int32)
    columns = (position, velocity, nothing, radius, mass, contacts, ident)
    age, force = np.linspace(0.0, 1.0, count), np.tile([0.0, 0.0, -1e-5 * 9.81], (count, 1))
    return Snapshot(time, 100 * frame, *columns, 0, {"ageing.age": age}, force)


def totals(frame: int) -> Totals:
    """Energies that fall by a decade every ten frames, and contacts that grow by three a frame."""
    energy = 10.0 ** (-0.1 * frame)
    energies = {"kinetic_translation": energy, "kinetic_rotation": 0.0, "potential": 2e-3}
    counts = {"contacts": 3 * frame, "released": 205, "rebuilds": frame}
    extremes = {"overlap_largest": 0.01, "speed_largest": 1.0}
    return Totals(frame * FRAME_TIME, 100 * frame, elastic=0.01 * energy, **energies, **counts, **extremes)


def header(kind: str = "repose") -> RunHeader:
    return RunHeader("Little heap", kind, 'kind = "repose"', heap_snapshot().radius, (FLOOR,))


@contextmanager
def recorded(path: Path, header: RunHeader) -> Iterator[Recording]:
    """A recording that is closed whatever happens inside."""
    recording = open_recording(path, header)
    try:
        yield recording
    finally:
        close(recording)


def record_heap(path: Path) -> list[Snapshot]:
    """Write a recording of the heap and return what was written."""
    snapshots = [heap_snapshot(frame) for frame in range(5)]
    with recorded(path, header()) as recording:
        for frame, snapshot in enumerate(snapshots):
            log_frame(recording, snapshot, MOVING)
            log_totals(recording, totals(frame))
    return snapshots


def write_elsewhere(program: str, *words: object) -> subprocess.CompletedProcess[str]:
    """A program that records in a process of its own, and may import from the folder of these tests."""
    places = os.pathsep.join([str(Path(__file__).parent), *sys.path])
    command, environment = [sys.executable, "-c", program, *map(str, words)], {"PYTHONPATH": places}
    environment = os.environ | environment
    return subprocess.run(command, env=environment, capture_output=True, text=True, timeout=600, check=False)


def moved(snapshot: Snapshot, grain: int, distance: float = 0.0, speed: float = 0.0) -> Snapshot:
    """The snapshot with one grain shifted along x [m] and moving along x [m s-1]."""
    position, velocity = snapshot.position.copy(), snapshot.velocity.copy()
    position[grain, 0] += distance
    velocity[grain, 0] += speed
    return replace(snapshot, position=position, velocity=velocity)


def read_frames(path: Path, entity: str) -> list[tuple[float, NDArray[np.float32]]]:
    """Positions [n, 3] m that an entity was given, each with its time [s]."""
    return [(time * NANOSECOND, row[POSITION]) for time, row in component_rows(path, entity, POSITION)]


def read_series(path: Path, entity: str) -> tuple[Floats, Floats]:
    """Times [s] and values of a curve, such as ledger/contacts."""
    rows = component_rows(path, entity, "Scalars:scalars")
    times = np.array([time for time, _ in rows], dtype=np.float64) * NANOSECOND
    return times, np.array([row["Scalars:scalars"][0] for _, row in rows], dtype=np.float64)


def read_properties(path: Path) -> dict[str, dict[str, Any]]:
    """Properties of the run by group: result, scene, doe."""
    groups: dict[str, dict[str, Any]] = {}
    for chunk in read_chunks(path):
        if chunk.entity_path.startswith("/__properties/"):
            group = groups.setdefault(chunk.entity_path.removeprefix("/__properties/"), {})
            batch = chunk.to_record_batch()
            for name, column in zip(batch.schema.names, batch.columns, strict=True):
                if not name.startswith("rerun.controls"):
                    listed = column[-1].as_py()
                    group[name] = listed[0] if len(listed) == 1 else listed
    return groups
