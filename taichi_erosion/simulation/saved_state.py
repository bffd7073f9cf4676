"""State of a run as plain arrays independent of capacities: for checkpoints and for growing lists."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from taichi_erosion.core.effect_device import effect_state_fields
from taichi_erosion.core.transfer import download, download_field, record_members, upload, write_field
from taichi_erosion.grains.clumps import NOWHERE
from taichi_erosion.grains.frozen_drag import FrozenDrag
from taichi_erosion.grains.neighbour_list import ENGAGED
from taichi_erosion.grains.sleep import SAVED_FIELDS
from taichi_erosion.grains.state import REACH_FIELDS
from taichi_erosion.simulation.assemble import Simulation, reallocate_fields
from taichi_erosion.simulation.capacities import double_list_capacities

Arrays = dict[str, NDArray[Any]]

CLOCK = ("step", "rebuilds", "status", "time_step", "gravity", "wall_travel")
REPLICA = ("partitions", "released", "removed", *CLOCK)
MOTION = ("origin", "shift", "velocity", "spin")
GRAIN = (*MOTION, "radius", "mass_inverse", "skin_squared", "material", "ident")
FAULT = ("fault_grain", "fault_partner", "fault_value")
RATE = ("acceleration", "spin_rate")
SPRINGS = ("tangential_displacement", "rolling_displacement")
PAIR = ("neighbour", "label", "separation", "root_radius", "damping", "rolling_damping", *SPRINGS)
WALL_PAIR = ("wall", "label", "root_radius", "damping", "rolling_damping", *SPRINGS)
SURFACE = (
    *("present", "moving", "has_moved", "shift", "turn", "velocity", "spin", "centre", "sweep"),
    *("row", "row_count", "start_step", "servo", "axis", "target", "fastest", "servo_speed", "servo_reach"),
)
AIR_CELLS = (
    *("velocity_x", "velocity_y", "velocity_z", "pressure", "void_fraction", "void_before"),
    *("exchange_coefficient", "exchange_force", "eddy_face"),
)
FROZEN = record_members(FrozenDrag)
AIR_NUMBERS = ("time", "friction_velocity")
EXCHANGE = ("residual_momentum", "rise_velocity", "pressure_lift", "through_flow")
# likewise of a grid of air alone
GRID_CELLS = ("impulse", "gradient")
GRID_NUMBERS = ("driving_gradient",)
GRID_EXCHANGE = ("last_exchange",)
BODY = ("position", "velocity", "momentum", "orientation")


def download_members(prefix: str, owner: Any, names: tuple[str, ...], first: int, count: int) -> Arrays:
    """Members of a record by name: `count` places from `first` on."""
    arrays = download([getattr(owner, name) for name in names], first, count)
    return {prefix + name: values for name, values in zip(names, arrays, strict=True)}


def saved_fields(prefix: str, owner: Any, names: tuple[str, ...], state: Arrays) -> list[tuple[Any, Any]]:
    """Fields of a record, each with its values in a checkpoint."""
    return [(getattr(owner, name), state[prefix + name]) for name in names]


def export_state(sim: Simulation) -> Arrays:
    """Everything that the next step depends on and that a Setup does not state."""
    world, count = sim.world, len(sim.setups)
    state = download_members("", world.replicas, REPLICA, 0, count)
    side, stale = download([world.replicas.side, world.replicas.stale], 0, count)
    state["stale"] = np.maximum(stale, download_field(world.replicas.need)[:count].max(axis=1) > 0)
    state |= {name: download_field(getattr(world.replicas, name)) for name in FAULT}
    state |= download_members("surface_", world.walls, SURFACE, 0, count * sim.capacities.surfaces)
    for r in range(count):
        block = 2 * r + int(side[r])
        part = export_replica(sim, r, block, int(state["released"][r]))
        state |= {f"replica{r}_{name}": values for name, values in part.items()}
    return state | {name: download_field(field) for name, field in air_and_exchange_fields(sim).items()}


def export_replica(sim: Simulation, r: int, block: int, count: int) -> Arrays:
    """Released grains, lists and bodies of one replica; `block` counts sides over all replicas."""
    world, first, bodies = sim.world, block * sim.capacities.grains, sim.capacities.bodies
    out = download_members("", world.grains, GRAIN, first, count)
    out |= download_members("", world.grains, RATE, r * sim.capacities.grains, count)
    out["bounds"] = download_field(world.replicas.bounds)[r]
    if world.has_external_forces:
        out |= download_members("frozen_", world.frozen_drag, FROZEN, first, count)
    if world.sleeps:
        out |= download_members("sleep_", world.sleep, SAVED_FIELDS, first, count)
    for name, (numbers, _) in effect_state_variables(sim).items():
        out[f"effect_{name}"] = download([numbers], first, count)[0]
    for prefix, table, names in (("pair_", world.pairs, PAIR), ("wall_", world.wall_pairs, WALL_PAIR)):
        start, stop = (a.astype(np.int64) for a in download([table.start, table.stop], first, count))
        entries = download_members(prefix, table, names, block * table.capacity, table.capacity)
        stride = getattr(table, "stride", 1)
        number = (stop - start) // stride
        places = entry_places(start, number, stride) - block * table.capacity
        out[f"{prefix}number"] = number
        out |= {name: values[places] for name, values in entries.items()}
    out["wall_wall"] = out["wall_wall"] - r * sim.capacities.primitives
    if world.has_clumps:
        out |= download_members("body_", world.clumps, BODY, r * bodies, bodies)
    return out


def export_bed(sim: Simulation, replica: int) -> Arrays:
    """Grains of one replica with all their contacts; neither its clock nor its air."""
    fields = [sim.world.replicas.side, sim.world.replicas.released]
    side, released = (int(values[0]) for values in download(fields, replica, 1))
    return export_replica(sim, replica, 2 * replica + side, released)


def import_bed(sim: Simulation, replica: int, bed: Arrays) -> None:
    """Put the grains of one replica back where `export_bed` saw them; its clock runs on."""
    replicas = sim.world.replicas
    upload([(replicas.side, [0.0]), (replicas.stale, [1.0])], replica)
    need = download_field(replicas.need)
    need[replica] = 0
    write_field(replicas.need, need)
    import_replica(sim, replica, bed)


def remove_grains_from_state(state: Arrays, replica: int, idents: Sequence[int]) -> Arrays:
    """An exported state in which some grains of a replica count as taken out, with their contacts."""
    prefix, after = f"replica{replica}_", {name: values.copy() for name, values in state.items()}
    part = {k.removeprefix(prefix): values for k, values in state.items() if k.startswith(prefix)}
    stays, partners = ~np.isin(part["ident"], idents), part["pair_neighbour"].astype(int)
    part["pair_neighbour"] = (np.cumsum(stays) - 1)[partners]
    rows = {}  # of the lists, by the beginning of their columns' names
    for table in ("pair_", "wall_"):
        owner = np.repeat(np.arange(len(stays)), part.pop(f"{table}number"))
        rows[table] = stays[owner] & (stays[partners] if table == "pair_" else True)
        after[f"{prefix}{table}number"] = np.bincount(owner[rows[table]], minlength=len(stays))[stays]
    count, partitions = stays.sum(), int(state["partitions"][replica])
    after[f"{prefix}bounds"] = np.arange(partitions + 1) * count // partitions
    for name, values in part.items():
        if not name.startswith(("bounds", "body_")):
            after[prefix + name] = values[rows.get(name[:5], stays)]
    after["released"][replica], after["stale"][replica] = count, 1
    after["removed"][replica] += len(stays) - count
    return after


def restore_springs_of_beds(sim: Simulation) -> None:
    """Give the grains that begin as the bed of another run the springs that they had with each other."""
    world = sim.world
    for r, setup in enumerate(sim.setups):
        if (bed := setup.bed) is None:
            continue
        count, first = len(bed["ident"]), 2 * r * sim.capacities.grains
        part = download_members("sleep_", world.sleep, SAVED_FIELDS, first, count) if world.sleeps else {}
        if world.has_external_forces:
            part |= download_members("frozen_", world.frozen_drag, FROZEN, first, count)
        ident = np.argsort(np.argsort(bed["ident"]))  # without grains that had left
        acts = bed["pair_label"].astype(int) & ENGAGED > 0  # the others are found anew
        owner = np.repeat(np.arange(count), bed["pair_number"])[acts]
        partitions = int(download([world.replicas.partitions], r, 1)[0][0])
        part |= {name: values[acts] for name, values in bed.items() if name in {f"pair_{n}" for n in PAIR}}
        part |= {f"wall_{name}": bed[f"wall_{name}"][:0] for name in WALL_PAIR}
        part |= {"pair_number": np.bincount(owner, minlength=count), "wall_number": np.zeros(count, int)}
        part |= {"bounds": np.arange(partitions + 1) * count // partitions, "ident": ident}
        part |= {"material": setup.grains.material[ident], "mass_inverse": 1.0 / setup.grains.mass[ident]}
        import_bed(sim, r, dict(bed) | part)


def entry_places(start: NDArray[np.int64], number: NDArray[np.int64], stride: int = 1) -> NDArray[np.int64]:
    """Places of the entries of every grain, joined: its first place, how many, and from one to the next."""
    within = np.arange(number.sum()) - np.repeat(np.cumsum(number) - number, number)
    return np.repeat(start, number) + stride * within


def import_state(sim: Simulation, state: Arrays) -> None:
    """Put an exported state on the device; the Setups must be those it was exported with."""
    ensure_capacity(sim, state)
    world, count = sim.world, len(sim.setups)
    replicas = world.replicas
    clocks = saved_fields("", replicas, REPLICA, state)
    upload([*clocks, (replicas.stale, state["stale"]), (replicas.side, np.zeros(count))])
    for name in FAULT:  # by replica and partition, of which there may be others now; zero where none is saved
        field, numbers = getattr(replicas, name), state[name]
        rows, columns = np.minimum(numbers.shape, field.shape)
        column = np.zeros(field.shape, numbers.dtype)
        column[:rows, :columns] = numbers[:rows, :columns]
        write_field(field, column)
    sums = (world.walls.push, world.walls.stiffness)
    for stale in (replicas.need, world.grains.force, world.grains.torque, *sums):
        write_field(stale, 0)
    if sim.capacities.surfaces:
        upload(saved_fields("surface_", world.walls, SURFACE, state))
    for r in range(count):
        prefix = f"replica{r}_"
        import_replica(sim, r, {k.removeprefix(prefix): v for k, v in state.items() if k.startswith(prefix)})
    for name, field in air_and_exchange_fields(sim).items():
        whole = download_field(field)  # of another number of replicas where the grains were divided otherwise
        rows = min(len(whole), len(state[name]))
        whole[:rows] = state[name][:rows]
        write_field(field, whole)


def ensure_capacity(sim: Simulation, state: Arrays) -> None:
    """Grow the lists until those of a state fit."""
    pairs, wall_pairs = (needed_entry_capacity(state, prefix) for prefix in ("pair", "wall"))
    if sim.buffers is not None:  # as many places for every grain as the fullest list and reverse list take
        pairs = sim.world.pairs.stride * largest_list_length(state, len(sim.setups))
    capacities = sim.capacities
    while capacities.pairs < pairs or capacities.wall_pairs < wall_pairs:
        capacities = double_list_capacities(capacities)
    if capacities != sim.capacities:
        reallocate_fields(sim, capacities)


def largest_list_length(state: Arrays, replicas: int) -> int:
    """Entries of the fullest list of a grain or reverse list."""
    lists = [state[f"replica{r}_pair_number"] for r in range(replicas)]
    second = [state[f"replica{r}_pair_neighbour"].astype(np.int64) for r in range(replicas)]
    return int(max(number.max(initial=0) for number in (*lists, *map(np.bincount, second))))


def needed_entry_capacity(state: Arrays, prefix: str) -> int:
    """Entries a replica and side with which the fullest partition of all replicas fits its share."""
    capacity = 0
    for r, partitions in enumerate(state["partitions"].astype(int)):
        joined = np.concatenate([[0], np.cumsum(state[f"replica{r}_{prefix}_number"])]).astype(int)
        bounds = state[f"replica{r}_bounds"][: partitions + 1]
        capacity = max(capacity, int(partitions * np.diff(joined[bounds]).max()))
    return capacity


def import_replica(sim: Simulation, r: int, part: Arrays) -> None:
    """Grains, lists and bodies of one replica, on side 0."""
    world, rows = sim.world, sim.capacities.grains
    if sim.buffers is not None:
        part = part | {"bounds": np.array([0, len(part["ident"])])}
        upload([(world.replicas.partitions, [1.0])], r)
    upload(saved_fields("", world.grains, GRAIN, part), 2 * r * rows)
    upload(saved_fields("", world.grains, RATE, part), r * rows)
    if world.has_external_forces:
        upload(saved_fields("frozen_", world.frozen_drag, FROZEN, part), 2 * r * rows)
    if world.sleeps:
        upload(saved_fields("sleep_", world.sleep, SAVED_FIELDS, part), 2 * r * rows)
    for name, (numbers, start) in effect_state_variables(sim).items():
        fresh = np.full(len(part["ident"]), download([start], r, 1)[0][0])  # of an effect that was not there
        upload([(numbers, part.get(f"effect_{name}", fresh))], 2 * r * sim.capacities.grains)
    import_lists(sim, r, part)
    if world.has_clumps:
        upload(saved_fields("body_", world.clumps, BODY, part), r * sim.capacities.bodies)
        rank = np.full(rows, NOWHERE)
        rank[part["ident"].astype(np.int64)] = np.arange(len(part["ident"]))
        upload([(world.clumps.rank, rank)], r * rows)


def import_lists(sim: Simulation, r: int, part: Arrays) -> None:
    """Partitions and lists of one replica, on side 0."""
    world, rows = sim.world, sim.capacities.grains
    bounds = download_field(world.replicas.bounds)
    bounds[r, : len(part["bounds"])] = part["bounds"]
    write_field(world.replicas.bounds, bounds)
    part = part | {"wall_wall": part["wall_wall"] + r * sim.capacities.primitives}
    for prefix, table, names in (("pair_", world.pairs, PAIR), ("wall_", world.wall_pairs, WALL_PAIR)):
        number = part[f"{prefix}number"].astype(np.int64)
        entries = saved_fields(prefix, table, names, part)
        entries.append((table.owner, np.repeat(np.arange(len(number)), number)))
        by_grain = sim.buffers is not None and table is world.pairs
        (upload_entries_by_grain if by_grain else upload_entries_by_partition)(sim, r, table, number, entries)
    upload([(world.wall_pairs.clearance_squared, np.zeros(rows))], 2 * r * rows)
    if sim.buffers is not None:
        near = np.flatnonzero(part["wall_number"])
        upload([(sim.buffers.walled, [len(near)])], r)
        upload([(sim.buffers.walled_rank, near)], r * rows)


def air_and_exchange_fields(sim: Simulation) -> dict[str, Any]:
    """Fields of air and exchange that the next step depends on, by their names in a checkpoint."""
    air, exchange, on_grid = sim.coupling.air, sim.coupling.exchange, sim.coupling.host_driven
    if air is None:
        return {}
    state = {f"air_{name}": getattr(air, name) for name in AIR_CELLS + GRID_CELLS * on_grid}
    state |= {f"air_{name}": getattr(air.numbers, name) for name in AIR_NUMBERS + GRID_NUMBERS * on_grid}
    names = EXCHANGE + GRID_EXCHANGE * on_grid
    return state | {f"exchange_{name}": getattr(exchange, name) for name in names}


def effect_state_variables(sim: Simulation) -> dict[str, tuple[Any, Any]]:
    """State variables of all effects, as `effect_state_fields` of each place."""
    return effect_state_fields(sim.world.pair_effects) | effect_state_fields(sim.world.grain_effects)


def upload_entries_by_grain(
    sim: Simulation, r: int, table: Any, number: NDArray[np.int64], columns: list[Any]
) -> None:
    """Lay the joined entries of a replica out by rank, on side 0, with the reverse lists and no forces."""
    assert sim.buffers is not None
    buffers, stride, block = sim.buffers, table.stride, r * table.capacity
    start = np.arange(len(number))
    places, most = entry_places(start, number, stride), stride * int(number.max(initial=0))
    for field, values in columns:
        upload([(field, scatter_to_places(places, values, most))], 2 * block)
    ends = [(table.start, 2 * block + start), (table.stop, 2 * block + start + stride * number)]
    upload(ends, 2 * r * stride)
    second = columns[0][1].astype(np.int64)
    partners = np.bincount(second, minlength=len(number))
    reverse = entry_places(start, partners, stride), places[np.lexsort((places, second))]
    upload([(buffers.partner_entry, scatter_to_places(*reverse, table.capacity))], block)
    upload([(buffers.partners, partners)], r * stride)
    upload([(buffers.listed, [most])], r)
    for rows_out in (buffers.force, buffers.torque, buffers.back, buffers.acts):
        write_field(rows_out, 0)


def scatter_to_places(places: NDArray[np.int64], values: Any, count: int) -> NDArray[Any]:
    """`count` rows with the values at their places, zero elsewhere."""
    rows = np.zeros((count, *np.shape(values)[1:]))
    rows[places] = values
    return rows


def upload_entries_by_partition(
    sim: Simulation, r: int, table: Any, number: NDArray[np.int64], columns: list[Any]
) -> None:
    """Lay the joined entries of a replica out by partition and write where each grain's begin and end."""
    partitions = int(download([sim.world.replicas.partitions], r, 1)[0][0])
    bounds = download_field(sim.world.replicas.bounds)[r]
    count = len(number)
    begin = np.zeros(count, np.int64)
    joined = np.cumsum(number) - number
    block = 2 * r * table.capacity
    reach = []
    for p in range(partitions):
        first, last = int(bounds[p]), int(bounds[p + 1])
        if first < last:
            place = block + table.capacity // partitions * p
            begin[first:last] = place + joined[first:last] - joined[first]
            entries = slice(int(joined[first]), int(joined[last - 1] + number[last - 1]))
            upload([(field, values[entries]) for field, values in columns], place)
            reach.append((first, last, entries))
    upload([(table.start, begin), (table.stop, begin + number)], 2 * r * sim.capacities.grains)
    if table is sim.world.pairs:
        upload_partition_reach(sim, r, reach, columns[0][1])


def upload_partition_reach(
    sim: Simulation, r: int, reach: list[tuple[int, int, slice]], neighbour: NDArray[Any]
) -> None:
    """Ranks that the forces of every partition reach, as the list search notes them."""
    replicas = sim.world.replicas
    table = {name: download_field(getattr(replicas, name)) for name in REACH_FIELDS}
    count = max((last for _, last, _ in reach), default=0)
    for p, (first, last, entries) in enumerate(reach):
        partners = neighbour[entries]
        before, behind = partners[partners < first], partners[partners >= last]
        table["before_low"][r, p] = before.min(initial=first)
        table["before_high"][r, p] = before.max(initial=-1) + 1
        table["after_low"][r, p] = behind.min(initial=count)
        table["after_high"][r, p] = behind.max(initial=-1) + 1
    for name, values in table.items():
        write_field(getattr(replicas, name), values)
