"""Assembly of a simulation: the laws that a run names become device functions, its setups become fields.

An ensemble can run in the fields, and with the kernels, of one of its kind that has ended: for new fields
Taichi reads the source of every kernel again and makes machine code of it, seconds of a core, more than
sixteen heaps of a hundred grains take. Reused fields are zeroed first, so that no result depends on the
ensemble before.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, fields, replace

import numpy as np

from taichi_erosion.core.device import start_device
from taichi_erosion.core.effect import first_contact_struct_type, longest_effect_reaches, pair_struct_type
from taichi_erosion.core.effect_device import DeviceEffects, bind, write_effect_constants
from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.setup import Laws, Numerics, Setup
from taichi_erosion.core.ti import impl
from taichi_erosion.core.transfer import device_fields, download_field, write_field
from taichi_erosion.coupling.coupling_state import CouplingState, allocate_coupling, upload_exchange_settings
from taichi_erosion.grains import World
from taichi_erosion.grains.cells import PERIOD_CELLS_LEAST, allocate_cells
from taichi_erosion.grains.clumps import allocate_clumps
from taichi_erosion.grains.contact import ContactLaws, compile_contact_laws
from taichi_erosion.grains.frozen_drag import allocate_frozen_drag
from taichi_erosion.grains.materials import allocate_materials
from taichi_erosion.grains.neighbour_list import allocate_neighbour_list
from taichi_erosion.grains.partition import CPU_CHUNK
from taichi_erosion.grains.simd_batch import LANES, batch_struct_type
from taichi_erosion.grains.sleep import allocate_sleep
from taichi_erosion.grains.state import allocate_grains, allocate_replicas, allocate_source
from taichi_erosion.grains.wall_contacts import allocate_wall_list
from taichi_erosion.grains.walls import allocate_walls
from taichi_erosion.simulation.capacities import (
    Capacities,
    has_grid,
    has_servo,
    initial_capacities,
    pad_setups_with_copies,
    partitions_of_replica,
    refuse_thread_per_grain,
    refuse_too_many_entries,
)
from taichi_erosion.simulation.grain_decomposition.buffers import GrainBuffers, allocate_buffers
from taichi_erosion.simulation.grain_decomposition.exchange import CHUNK, chunks_for_grains
from taichi_erosion.simulation.grain_decomposition.rebuild import release_grains_at_start
from taichi_erosion.simulation.schedule import Schedule, allocate_schedule
from taichi_erosion.simulation.step import release_grains_before_start
from taichi_erosion.simulation.team import Team
from taichi_erosion.simulation.upload import upload_world

EXCLUSIVE = ("first_contact", "grain")  # places of effects that all replicas of an ensemble must share
POOL_LEAST = 2  # threads: runs on one core and on two share their kernels; an idle thread sleeps


@dataclass
class Simulation:
    """A running ensemble: setups, fields, and the number of workers."""

    setups: list[Setup]
    laws: Laws
    numerics: Numerics
    workers: int
    chunk: int
    capacities: Capacities
    world: World
    coupling: CouplingState
    schedule: Schedule
    buffers: GrainBuffers | None = None  # of the grain decomposition
    pace: float = 0.0  # steps a second and replica seen so far
    has_launched: bool = False  # the first launch compiles and does not count for the pace
    team: Team = field(default_factory=Team)
    device: object = field(default_factory=impl.get_runtime)

    @property
    def device_fields_exist(self) -> bool:
        """Whether its fields exist: the device has not been started again since."""
        return impl.get_runtime() is self.device


def build_world(setups: list[Setup], laws: Laws, capacities: Capacities, by_grain: bool) -> World:
    """Fields of all setups, one per replica, and the device functions; the device must have been started."""
    lanes, buffers, stride = (1, 2, capacities.grains) if by_grain else (LANES, capacities.partitions, 1)
    contact_laws = compile_contact_laws(laws)
    external, sleeps = has_external_forces(setups), any(s.coupling.sleep_exchanges > 0 for s in setups)
    effects, places = [s.effects for s in setups], 2 * capacities.replicas * capacities.grains
    pair_effects, grain_effects = (bind(place, effects, places) for place in ("pair", "grain"))
    world = World(
        grains=allocate_grains(capacities.replicas, buffers, capacities.grains),
        source=allocate_source(capacities.replicas, capacities.grains),
        replicas=allocate_replicas(capacities.replicas, capacities.partitions),
        cells=allocate_cells(capacities.replicas, capacities.grains, capacities.cells),
        pairs=allocate_neighbour_list(capacities.replicas, capacities.grains, capacities.pairs, stride),
        walls=allocate_walls(
            capacities.replicas,
            capacities.primitives,
            capacities.surfaces,
            capacities.motion_rows,
            capacities.servos,
        ),
        wall_pairs=allocate_wall_list(capacities.replicas, capacities.grains, capacities.wall_pairs),
        materials=allocate_materials(capacities.replicas, capacities.materials),
        laws=contact_laws,
        lanes=lanes,
        batch_type=batch_struct_type(lanes),
        has_clumps=setups[0].clumps is not None,
        clumps=allocate_clumps(capacities.replicas, capacities.bodies, capacities.grains),
        pair_effects=pair_effects,
        pair_type=pair_struct_type(),
        first_contact_effects=bind("first_contact", effects),
        first_contact_type=first_contact_struct_type(),
        grain_effects=grain_effects,
        has_state=pair_effects.has_state or grain_effects.has_state,
        has_external_forces=external,
        frozen_drag=allocate_frozen_drag(
            capacities.replicas if external else 1, capacities.grains if external else 1
        ),
        sleeps=sleeps,
        sleep=allocate_sleep(capacities.replicas if sleeps else 1, capacities.grains if sleeps else 1),
    )
    upload_setups(world, setups)
    return world


def upload_setups(world: World, setups: list[Setup]) -> None:
    """Write the Setups to the fields, one a replica. Raises BadInput where a period is too narrow."""
    reaches = np.array([contact_gap_reach_of_setup(s, world.laws) for s in setups])
    most = world.replicas.need.shape[1]
    upload_world(world, setups, reaches, [min(partitions_of_replica(s), most) for s in setups])
    number = download_field(world.cells.number)
    for r, setup in enumerate(setups):
        for axis in range(3):
            if setup.period[axis] > 0.0 and number[r, axis] < PERIOD_CELLS_LEAST:
                period = f"period along {'xyz'[axis]} = {setup.period[axis]} m"
                raise BadInput(
                    f"{period} holds fewer than {PERIOD_CELLS_LEAST} cells of the largest grain; "
                    "make the box wider or the grains smaller"
                )


def contact_gap_reach_of_setup(setup: Setup, laws: ContactLaws) -> tuple[float, float]:
    """Longest gap across which contacts may act, and how much less it is where grains have not touched [m].

    Walls double the effective radius.
    """
    table, largest = setup.contacts, float(setup.grains.radius.max())
    reach = laws.zero_force_gap(np.pi * table.surface_energy, table.young_effective, largest)
    law_reach = reach if np.isfinite(reach) else 0.0
    longest, free = longest_effect_reaches(setup.effects)
    return max(law_reach, longest), max(law_reach, longest) - max(law_reach, free)


def has_external_forces(setups: list[Setup]) -> bool:
    """Whether air or grain effects act between contacts."""
    by_effects = any(acting.effect.place == "grain" for setup in setups for acting in setup.effects)
    return by_effects or any(setup.air is not None for setup in setups)


def refuse_mixed_setups(setups: list[Setup]) -> None:
    """Raise BadInput where replicas differ in what is compiled in, or combine what excludes each other."""
    if len({s.clumps is None for s in setups}) > 1:
        raise BadInput("an ensemble mixes clumps and single spheres; run them apart")
    if len({s.air is None for s in setups}) > 1:
        raise BadInput("an ensemble mixes runs with and without air; run them apart")
    if setups[0].clumps is not None and has_external_forces(setups):
        raise BadInput("air and grain effects act on single spheres; leave grains.clump out")


def assemble(setups: Sequence[Setup], laws: Laws, numerics: Numerics) -> Simulation:
    """Start the device and put an ensemble on it.

    All setups share the laws and the kind of grain (spheres or clumps). Raises BadInput for what cannot run.
    """
    setup_list = list(setups)
    refuse_mixed_setups(setup_list)
    capacities = initial_capacities(setup_list, numerics.by_grain)
    if numerics.by_grain:
        refuse_thread_per_grain(has_grid(setup_list), has_servo(setup_list))
        refuse_too_many_entries(capacities)
    threads = start_device(numerics, POOL_LEAST)
    on_cpu = numerics.arch == "cpu"
    workers = threads if on_cpu else len(setup_list)
    chunk = CPU_CHUNK if on_cpu else 1
    fields = allocate_all_fields(setup_list, laws, numerics, workers, capacities)
    sim = Simulation(setup_list, laws, numerics, workers, chunk, capacities, *fields)
    release_initial_grains(sim)
    return sim


def release_initial_grains(sim: Simulation) -> None:
    """Release the grains that are there from the start, those of beds with their contacts."""
    (release_grains_at_start if sim.numerics.by_grain else release_grains_before_start)(sim.world)
    if any(setup.bed is not None for setup in sim.setups):
        from taichi_erosion.simulation.saved_state import restore_springs_of_beds  # stands on this module

        restore_springs_of_beds(sim)


def allocate_all_fields(
    setups: list[Setup], laws: Laws, numerics: Numerics, workers: int, capacities: Capacities
) -> tuple[World, CouplingState, Schedule, GrainBuffers | None]:
    everyone = pad_setups_with_copies(setups, capacities)
    schedule = allocate_schedule(max(workers, POOL_LEAST), capacities.replicas)
    world = build_world(everyone, laws, capacities, numerics.by_grain)
    if not numerics.by_grain:
        return world, allocate_coupling(everyone, laws, capacities.partitions), schedule, None
    coupling = allocate_coupling(everyone, laws, chunks_for_grains(capacities.grains), CHUNK)
    return world, coupling, schedule, allocate_buffers(capacities, workers)


def reallocate_fields(sim: Simulation, capacities: Capacities) -> None:
    """Give the run other capacities; the caller carries its state over.

    The device is restarted: the old fields are gone, and the kernels are those of a new run.
    """
    if sim.numerics.by_grain:
        refuse_too_many_entries(capacities)
    start_device(sim.numerics, POOL_LEAST)
    sim.capacities, sim.device = replace(capacities), impl.get_runtime()
    fields = allocate_all_fields(sim.setups, sim.laws, sim.numerics, sim.workers, sim.capacities)
    sim.world, sim.coupling, sim.schedule, sim.buffers = fields


def reuse_or_assemble(
    before: Simulation | None, setups: Sequence[Setup], laws: Laws, numerics: Numerics
) -> Simulation:
    """An ensemble that is ready to run, in the fields of the one `before` where they fit.

    `before` must not be used any more. Raises BadInput for what cannot run.
    """
    setup_list = list(setups)
    refuse_mixed_setups(setup_list)
    if before is None or not is_reusable(before, setup_list, laws, numerics):
        return assemble(setup_list, laws, numerics)
    for record in (before.world, before.coupling, *([before.buffers] if before.buffers else [])):
        for table in device_fields(record):
            write_field(table, 0)
    before.setups = setup_list
    everyone = pad_setups_with_copies(setup_list, before.capacities)
    for effects in device_effects_by_place(before.world).values():
        write_effect_constants(effects, [setup.effects for setup in everyone])
    upload_setups(before.world, everyone)
    upload_exchange_settings(before.coupling.exchange, everyone)
    release_initial_grains(before)
    return before


def is_reusable(before: Simulation, setups: list[Setup], laws: Laws, numerics: Numerics) -> bool:
    """Whether an ensemble would compile what the one before has compiled, and fits in its fields."""
    demand = initial_capacities(setups, numerics.by_grain)
    same_laws = (before.laws, before.numerics) == (laws, numerics)
    alike = (before.setups[0].clumps is None) == (setups[0].clumps is None)
    without_air = not before.coupling.has_air and all(setup.air is None for setup in setups)
    return (
        same_laws
        and alike
        and without_air
        and all(getattr(before.capacities, f.name) >= getattr(demand, f.name) for f in fields(Capacities))
        and before.capacities.materials == demand.materials  # tables of contacts have the same size
        and can_reuse_compiled_effects(before, setups)
    )


def device_effects_by_place(world: World) -> dict[str, DeviceEffects]:
    pair, first, grain = world.pair_effects, world.first_contact_effects, world.grain_effects
    return {"pair": pair, "first_contact": first, "grain": grain}


def can_reuse_compiled_effects(before: Simulation, setups: list[Setup]) -> bool:
    """Whether all effects are compiled in, and no others that would change a replica without them."""
    present = {(one.effect.place, one.effect.name): one.effect for s in setups for one in s.effects}
    bounds = device_effects_by_place(before.world)
    compiled = {(place, name) for place, effects in bounds.items() for name in effects.names}
    same = all(effect.act in bounds[place].functions for (place, _), effect in present.items())
    return same and not any(place in EXCLUSIVE for place, _ in compiled - present.keys())
