"""What each stage of a step costs: it is repeated alone on the state of a run, which spoils that state."""

import time
from collections.abc import Callable
from functools import partial
from typing import Any

from taichi_erosion.core.ti import ti
from taichi_erosion.core.transfer import read
from taichi_erosion.coupling.exchange import exchange_momentum
from taichi_erosion.grains.integrate import advance_grains, gather_forces
from taichi_erosion.grains.pair_contacts import add_pair_forces
from taichi_erosion.grains.wall_contacts import add_wall_forces
from taichi_erosion.simulation.assemble import Simulation
from taichi_erosion.simulation.control import make_stale
from taichi_erosion.simulation.readback import replica_row
from taichi_erosion.simulation.step import rebuild

REPEATS = 50  # of a stage within one launch


@ti.kernel
def repeat_pairs(
    # parameters
    repeats: ti.i32,
    # out
    world_out: ti.template(),
):
    ti.loop_config(serialize=True)
    for _ in range(repeats):
        for p in range(world_out.replicas.partitions[0]):
            add_pair_forces(world_out, 0, p)


@ti.kernel
def repeat_walls(
    # parameters
    repeats: ti.i32,
    # out
    world_out: ti.template(),
):
    ti.loop_config(serialize=True)
    for _ in range(repeats):
        for p in range(world_out.replicas.partitions[0]):
            add_wall_forces(world_out, 0, p)


@ti.kernel
def repeat_motion(
    # parameters
    repeats: ti.i32,
    # out
    world_out: ti.template(),
):
    ti.loop_config(serialize=True)
    for _ in range(repeats):
        for p in range(world_out.replicas.partitions[0]):
            gather_forces(world_out, 0, p)
            advance_grains(world_out, 0, p, 1, False)


@ti.kernel
def repeat_rebuild(
    # parameters
    repeats: ti.i32,
    # out
    world_out: ti.template(),
):
    ti.loop_config(serialize=True)
    for _ in range(repeats):
        rebuild(world_out, 0, 0, 1, 1)


@ti.kernel
def repeat_looks(
    # parameters
    repeats: ti.i32,
    # out
    world_out: ti.template(),
    coupling_out: ti.template(),
):
    ti.loop_config(serialize=True)
    for _ in range(repeats):
        exchange_momentum(world_out, coupling_out, 0, 0, 1, 1)


STAGES: dict[str, Any] = {
    "pairs": repeat_pairs,
    "walls": repeat_walls,
    "rebuild": repeat_rebuild,
    "motion": repeat_motion,
}


def stage_times(sim: Simulation) -> dict[str, float]:
    """Nanoseconds per grain and step of every stage of replica 0, on one thread; of `rebuild` per call.

    The motion comes last, since it moves the grains. Looks at the air, of which there is one in many steps,
    are shared among those.
    """
    _, released, _, _ = replica_row(sim, 0)
    times = {}
    # looks at a grid of air are the host's
    inside = (sim.world.driven or sim.world.has_state) and not sim.coupling.host_driven
    looks = {"looks": partial(repeat_looks, coupling_out=sim.coupling)} if inside else {}
    for name, kernel in (looks | STAGES).items():
        run: Callable[[], None] = partial(kernel, REPEATS, sim.world)
        kernel(1, sim.world)
        start = time.perf_counter()
        run()
        times[name] = 1e9 * (time.perf_counter() - start) / (REPEATS * max(released, 1))
    if looks:
        times["looks"] /= float(read(sim.coupling.exchange.look_steps)[0])
    make_stale(sim, 0)
    return times
