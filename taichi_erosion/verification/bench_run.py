"""Running small scenes and sampling them."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from taichi_erosion.core.setup import Laws, Numerics, Setup
from taichi_erosion.core.snapshot import Snapshot
from taichi_erosion.run.play import Play, play
from taichi_erosion.run.stages import Actor
from taichi_erosion.scene import Scene, build_setup
from taichi_erosion.scene import laws as laws_of
from taichi_erosion.simulation import Simulation, advance, assemble, failure, snapshot
from taichi_erosion.verification.claim import Precision

Floats = NDArray[np.float64]

HERTZ = Laws()  # Hertz, Mindlin, no rolling resistance


class Stopped(Exception):
    """A replica that should have run to its end did not."""


@dataclass(frozen=True)
class Trace:
    """Samples of an ensemble; replicas with fewer grains than others are filled up with NaN."""

    time: Floats  # [samples, replicas] s
    position: Floats  # [samples, replicas, grains, 3] m
    velocity: Floats  # [samples, replicas, grains, 3] m s-1
    spin: Floats  # [samples, replicas, grains, 3] rad s-1


def bench(setups: Sequence[Setup], precision: Precision, laws: Laws = HERTZ, threads: int = 0) -> Simulation:
    """The scenes on the CPU."""
    return assemble(setups, laws, Numerics(threads=threads, precision=precision))


def played_out(scenes: Sequence[Scene], seed: int) -> Play:
    """Scenes of one law, each a replica of the seed, played to their ends on the CPU in single precision."""
    sim = assemble([build_setup(scene, seed) for scene in scenes], laws_of(scenes[0]), Numerics())
    whole = Play(list(scenes), sim, [Actor(seed) for _ in scenes])
    play(whole, [])
    return whole


def states(sim: Simulation, replicas: int) -> list[Snapshot]:
    """Snapshots of all replicas; raises Stopped where one has failed."""
    for replica in range(replicas):
        if fault := failure(sim, replica):
            raise Stopped(f"replica {replica} stopped: {fault}")
    return [snapshot(sim, replica) for replica in range(replicas)]


def final_states(
    setups: Sequence[Setup], durations: ArrayLike, precision: Precision, laws: Laws = HERTZ
) -> list[Snapshot]:
    """Snapshots after `durations` [s], one number or one per replica."""
    sim = bench(setups, precision, laws)
    ends = np.broadcast_to(np.asarray(durations, dtype=float), len(setups))
    advance(sim, [float(end) for end in ends])
    return states(sim, len(setups))


def sample(sim: Simulation, times: Floats) -> Trace:
    """Samples at `times` [samples, replicas] in s."""
    rows = []
    for row in times:
        advance(sim, [float(time) for time in row])
        rows.append(states(sim, times.shape[1]))
    return Trace(
        time=np.array([[state.time for state in row] for row in rows]),
        position=stacked(rows, "position"),
        velocity=stacked(rows, "velocity"),
        spin=stacked(rows, "spin"),
    )


def stacked(rows: list[list[Snapshot]], name: str) -> Floats:
    """One vector of the state [samples, replicas, most grains, 3]."""
    most = max(len(state.radius) for state in rows[0])
    whole = np.full((len(rows), len(rows[0]), most, 3), np.nan)
    for moment, row in zip(whole, rows, strict=True):
        for place, state in zip(moment, row, strict=True):
            place[: len(state.radius)] = getattr(state, name)
    return whole


def every_step(setups: Sequence[Setup], steps: int) -> Floats:
    """Times of the first steps [steps, replicas] in s."""
    counts = np.arange(1.0, steps + 1.0)
    return counts[:, None] * np.array([setup.time_step for setup in setups])[None, :]


def crossing(time: Floats, value: Floats, level: float = 0.0) -> float:
    """First time at which a sampled value falls through `level`, interpolated; NaN if it never does."""
    falls = np.flatnonzero((value[:-1] > level) & (value[1:] <= level))
    if falls.size == 0:
        return float("nan")
    k = int(falls[0])
    share = (value[k] - level) / (value[k] - value[k + 1])
    return float(time[k] + share * (time[k + 1] - time[k]))


def acceleration(trace: Trace) -> Floats:
    """Central second difference of the positions [samples - 2, replicas, grains, 3] in m s-2.

    With samples one step apart a leapfrog step makes this exactly force over mass at the middle sample.
    """
    step = np.diff(trace.time, axis=0)[:-1, :, None, None]
    second = trace.position[2:] - 2.0 * trace.position[1:-1] + trace.position[:-2]
    return second / step**2
