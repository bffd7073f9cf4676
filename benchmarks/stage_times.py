"""Cost of each stage of a step, repeated alone on the state of a run, which spoils that state."""

import time
from typing import Any

from taichi_erosion.core.ti import ti
from taichi_erosion.core.transfer import download_field
from taichi_erosion.coupling.exchange import exchange_momentum
from taichi_erosion.grains.integrate import add_partition_buffers, advance_grains
from taichi_erosion.grains.pair_contacts import add_pair_forces
from taichi_erosion.grains.wall_contacts import add_wall_forces
from taichi_erosion.simulation.assemble import Simulation
from taichi_erosion.simulation.control import request_rebuild_and_wake
from taichi_erosion.simulation.readback import counters_of_replica
from taichi_erosion.simulation.step import sort_and_rebuild_lists

REPEATS = 50  # of a stage within one launch
COPIED = 1 << 25  # numbers of 32 bits: more than caches hold
COPIES = 10  # timed


@ti.func
def all_pairs(world_out: ti.template(), coupling_out: ti.template()):
    for p in range(world_out.replicas.partitions[0]):
        add_pair_forces(world_out, 0, p)


@ti.func
def all_walls(world_out: ti.template(), coupling_out: ti.template()):
    for p in range(world_out.replicas.partitions[0]):
        add_wall_forces(world_out, 0, p)


@ti.func
def all_motion(world_out: ti.template(), coupling_out: ti.template()):
    for p in range(world_out.replicas.partitions[0]):
        add_partition_buffers(world_out, 0, p)
        advance_grains(world_out, 0, p, 1, False)


@ti.func
def one_rebuild(world_out: ti.template(), coupling_out: ti.template()):
    sort_and_rebuild_lists(world_out, 0, 0, 1, 1)


@ti.func
def one_exchange(world_out: ti.template(), coupling_out: ti.template()):
    exchange_momentum(world_out, coupling_out, 0, 0, 1, 1)


@ti.kernel
def repeat(stage: ti.template(), repeats: ti.i32, world_out: ti.template(), coupling_out: ti.template()):
    """Writes `coupling_out`: what `stage` writes.
    Writes `world_out`: what `stage` writes.
    """
    ti.loop_config(serialize=True)
    for _ in range(repeats):
        stage(world_out, coupling_out)


# the motion comes last, since it moves the grains
STAGES: dict[str, Any] = {
    "pairs": all_pairs,
    "walls": all_walls,
    "rebuild": one_rebuild,
    "motion": all_motion,
}


@ti.kernel
def copy_numbers(numbers: ti.template(), copy_out: ti.template()):
    for n in range(numbers.shape[0]):
        copy_out[n] = numbers[n]


def copy_bandwidth() -> float:
    """Bytes per second that the device reads and writes when it copies a large field."""
    numbers, copy = (ti.field(ti.f32, shape=COPIED) for _ in range(2))
    copy_numbers(numbers, copy)
    ti.sync()
    start = time.perf_counter()
    for _ in range(COPIES):
        copy_numbers(numbers, copy)
    ti.sync()
    return COPIES * 2 * 4 * COPIED / (time.perf_counter() - start)


def stage_times(sim: Simulation) -> dict[str, float]:
    """Nanoseconds per grain and step of every stage of replica 0, on one thread; of `rebuild` per call.

    An exchange with the air (`looks`), of which there is one in many steps, is shared among those; a grid of
    air has none here, since the host drives it.
    """
    _, released, _, _ = counters_of_replica(sim, 0)
    times = {}
    inside = (sim.world.has_external_forces or sim.world.has_state) and not sim.coupling.host_driven
    for name, stage in (({"looks": one_exchange} if inside else {}) | STAGES).items():
        repeat(stage, 1, sim.world, sim.coupling)
        start = time.perf_counter()
        repeat(stage, REPEATS, sim.world, sim.coupling)
        times[name] = 1e9 * (time.perf_counter() - start) / (REPEATS * max(released, 1))
    if inside:
        times["looks"] /= float(download_field(sim.coupling.exchange.look_steps)[0])
    request_rebuild_and_wake(sim, 0)
    return times
