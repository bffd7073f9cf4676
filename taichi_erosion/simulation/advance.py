"""Advance a simulation: launches of the device, growth of lists, and the failure of a replica."""

import time
from collections.abc import Sequence

import numpy as np

from taichi_erosion.core.setup import Integers
from taichi_erosion.core.snapshot import Failure, Status
from taichi_erosion.core.transfer import download, download_field, upload, write_field
from taichi_erosion.simulation.assemble import Simulation, reallocate_fields
from taichi_erosion.simulation.capacities import double_list_capacities
from taichi_erosion.simulation.grain_decomposition.step import run_steps
from taichi_erosion.simulation.saved_state import export_state, import_state
from taichi_erosion.simulation.schedule import assign_steps_to_workers, upload_schedule
from taichi_erosion.simulation.step import run_replicas_in_teams, run_scheduled_replicas
from taichi_erosion.simulation.team import adapt_team_size, most_barrier_spins, record_launch, team_size
from taichi_erosion.simulation.wind_driver import exchange_air_if_due

LAUNCH_SECONDS = 0.4  # Ctrl-C acts between launches
TEAM_SECONDS = 0.1  # of workers that share a replica: their number follows what the cores have left
FIRST_LAUNCH = 500  # steps before the pace is known
ROUNDING = 1e-6  # of a step: a time that lies on a step is not passed by one more


def steps_and_status_of_replicas(sim: Simulation) -> tuple[Integers, Integers, Integers]:
    """Steps done, status, and steps left of the last launch, by replica."""
    replicas = sim.world.replicas
    fields = [replicas.step, replicas.status, replicas.steps_left]
    step, status, remaining = (numbers.astype(np.int32) for numbers in download(fields, 0, len(sim.setups)))
    return step, status, remaining


def advance(sim: Simulation, until: Sequence[float]) -> Integers:
    """Run every replica that has not failed to its own time [s]; returns the status of each.

    A list that is too short is grown and the step repeated. Launches are short, so that signals reach the
    host; their length changes no result.
    """
    steps_done, status, _ = steps_and_status_of_replicas(sim)
    time_steps = np.array([setup.time_step for setup in sim.setups])
    total = np.ceil(np.asarray(until, np.float64) / time_steps - ROUNDING)
    remaining = np.maximum(total - steps_done, 0).astype(np.int32)
    while True:
        remaining = np.where(status == Status.RUNNING, remaining, 0)
        if not remaining.any():
            return status
        portion = np.minimum(remaining, steps_of_one_launch(sim))
        if sim.coupling.host_driven:
            portion = np.minimum(portion, exchange_air_if_due(sim, remaining > 0))
        status, undone = run_one_launch(sim, portion)
        remaining = remaining - (portion - undone)
        if (status == Status.OVERFLOW).any():
            state = export_state(sim)
            state["status"] = np.where(state["status"] == Status.OVERFLOW, Status.RUNNING, state["status"])
            reallocate_fields(sim, double_list_capacities(sim.capacities))
            import_state(sim, state)
            _, status, _ = steps_and_status_of_replicas(sim)


def steps_of_one_launch(sim: Simulation) -> int:
    """Steps that fill one launch at the pace seen so far."""
    is_team = team_size(sim.team, largest_team(sim)) > 1
    seconds = TEAM_SECONDS if is_team else LAUNCH_SECONDS
    return max(int(sim.pace * seconds), 1) if sim.pace > 0.0 else FIRST_LAUNCH


def run_one_launch(sim: Simulation, steps: Integers) -> tuple[Integers, Integers]:
    """Run once; returns the status of each replica, and the steps that it did not do."""
    replicas, count = sim.world.replicas, len(steps)
    upload([(replicas.steps_left, steps), (replicas.spins_most, [most_barrier_spins(sim.pace)] * count)])
    start, processor_time = time.perf_counter(), time.process_time()
    size = team_size(sim.team, largest_team(sim))
    if sim.buffers is not None:
        run_steps(sim.world, sim.coupling, sim.buffers, int(steps.max()))
    else:
        run_partitions(sim, steps, size)
    _, status, undone = steps_and_status_of_replicas(sim)
    wall, processor_time = time.perf_counter() - start, time.process_time() - processor_time
    if sim.has_launched:
        sim.pace = float((steps - undone).max()) / wall
        most = largest_team(sim)
        if most > 1 and sim.team.adapts:
            late = bool(download([replicas.late], 0, count)[0].any())
            record_launch(sim.team, count, size, wall, processor_time)
            adapt_team_size(sim.team, count, size, most, late)
    sim.has_launched = True
    return status, undone


def run_partitions(sim: Simulation, steps: Integers, size: int) -> None:
    """Run so many steps of every replica in its partitions, by teams of a size or by single workers."""
    replicas, count = sim.world.replicas, len(steps)
    for signal in (replicas.arrivals, replicas.late, replicas.pause):
        write_field(signal, 0)
    if largest_team(sim) > 1:
        # teams of one too: another kernel would have to be loaded first, a second of a core
        run_replicas_in_teams(count, size, sim.chunk, sim.world, sim.coupling)
    else:
        workers = min(sim.workers, count)
        upload_schedule(sim.schedule, assign_steps_to_workers(steps, workers))
        run_scheduled_replicas(workers, sim.chunk, sim.schedule, sim.world, sim.coupling)


def largest_team(sim: Simulation) -> int:
    return max(min(sim.workers // len(sim.setups), sim.capacities.partitions), 1)


def failure_of(sim: Simulation, replica: int) -> Failure | None:
    """Why a replica stopped; None while it runs."""
    steps, statuses, _ = steps_and_status_of_replicas(sim)
    if (status := Status(int(statuses[replica]))) == Status.RUNNING:
        return None
    replicas = sim.world.replicas
    value = download_field(replicas.fault_value)[replica]
    p = int(np.argmax(value != 0.0))  # also where it is not a number
    grain = int(download_field(replicas.fault_grain)[replica, p])
    partner = int(download_field(replicas.fault_partner)[replica, p])
    side = int(download([replicas.side], replica, 1)[0][0])
    first, rows = (2 * replica + side) * sim.capacities.grains, sim.capacities.grains
    ident = download([sim.world.grains.ident], first, rows)[0]  # by rank
    partner = int(ident[partner]) if partner >= 0 else -1 - (-1 - partner) % max(sim.capacities.primitives, 1)
    lone = status != Status.OVERLAP
    seconds = int(steps[replica]) * sim.setups[replica].time_step
    return Failure(status, seconds, int(ident[grain]), -1 if lone else partner, float(value[p]))
