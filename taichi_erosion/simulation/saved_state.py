"""The whole state of a run as plain arrays that know no capacities: for checkpoints and for growing lists."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from taichi_erosion.core.effect_device import memory_fields
from taichi_erosion.core.transfer import download, read, upload, write
from taichi_erosion.grains.frozen_drag import HELD
from taichi_erosion.grains.sleep import CARRIED
from taichi_erosion.grains.state import REACHED
from taichi_erosion.simulation.assemble import Simulation, reallocate
from taichi_erosion.simulation.capacities import grown
from taichi_erosion.simulation.wind_driver import export_surroundings, import_surroundings

Arrays = dict[str, NDArray[Any]]

REPLICA = ("partitions", "released", "step", "rebuilds", "status", "time_step", "gravity", "wall_travel")
MOTION = ("origin", "shift", "velocity", "spin")
GRAIN = (*MOTION, "radius", "mass_inverse", "travel_squared", "material", "ident")
FAULT = ("fault_grain", "fault_partner", "fault_value")
RATE = ("acceleration", "spin_rate")
PAIR = ("neighbour", "label", "separation", "root_radius", "damping", "rolling_damping", "slip", "tilt")
WALL_PAIR = ("wall", "label", "root_radius", "damping", "rolling_damping", "slip", "tilt")
SURFACE = ("present", "moving", "moved", "shift", "turn", "velocity", "spin", "centre", "sweep")
BODY = ("position", "velocity", "momentum", "orientation")


def fields_of(owner: Any, names: tuple[str, ...]) -> list[Any]:
    """Fields of a record by name."""
    return [getattr(owner, name) for name in names]


def export_state(sim: Simulation) -> Arrays:
    """Everything that the next step depends on and that a Setup does not state."""
    world, count = sim.world, len(sim.setups)
    state: Arrays = dict(zip(REPLICA, download(fields_of(world.replicas, REPLICA), 0, count), strict=True))
    side, stale = download([world.replicas.side, world.replicas.stale], 0, count)
    state["stale"] = np.maximum(stale, read(world.replicas.need)[:count].max(axis=1) > 0)
    state |= {name: read(getattr(world.replicas, name)) for name in FAULT}
    surfaces = download(fields_of(world.walls, SURFACE), 0, count * sim.sizes.surfaces)
    state |= {f"surface_{name}": values for name, values in zip(SURFACE, surfaces, strict=True)}
    for r in range(count):
        block = 2 * r + int(side[r])
        part = export_replica(sim, r, block, int(state["released"][r]))
        state |= {f"replica{r}_{name}": values for name, values in part.items()}
    return state | export_surroundings(sim)


def export_replica(sim: Simulation, r: int, block: int, count: int) -> Arrays:
    """Released grains, lists and bodies of one replica; `block` counts sides over all replicas."""
    world, rows = sim.world, sim.sizes.grains
    out: Arrays = dict(zip(GRAIN, download(fields_of(world.grains, GRAIN), block * rows, count), strict=True))
    out |= dict(zip(RATE, download(fields_of(world.grains, RATE), r * rows, count), strict=True))
    out["bounds"] = read(world.replicas.bounds)[r]
    if world.driven:
        held = download(fields_of(world.held, HELD), block * rows, count)
        out |= {f"held_{name}": values for name, values in zip(HELD, held, strict=True)}
    if world.sleeps:
        sleep = download(fields_of(world.sleep, CARRIED), block * rows, count)
        out |= {f"sleep_{name}": values for name, values in zip(CARRIED, sleep, strict=True)}
    for name, (numbers, _) in remembered(sim).items():
        out[f"memory_{name}"] = download([numbers], block * rows, count)[0]
    for prefix, table, names in (("pair", world.pairs, PAIR), ("wall", world.wall_pairs, WALL_PAIR)):
        start, stop = (a.astype(np.int64) for a in download([table.start, table.stop], block * rows, count))
        entries = download(fields_of(table, names), block * table.capacity, table.capacity)
        kept = entry_places(start, stop) - block * table.capacity
        out[f"{prefix}_number"] = stop - start
        out |= {f"{prefix}_{name}": values[kept] for name, values in zip(names, entries, strict=True)}
    out["wall_wall"] = out["wall_wall"] - r * sim.sizes.primitives
    if world.clumped:
        bodies = download(fields_of(world.clumps, BODY), r * sim.sizes.bodies, sim.sizes.bodies)
        out |= {f"body_{name}": values for name, values in zip(BODY, bodies, strict=True)}
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
    need = read(replicas.need)
    need[replica] = 0
    write(replicas.need, need)
    import_replica(sim, replica, bed)


def entry_places(start: NDArray[np.int64], stop: NDArray[np.int64]) -> NDArray[np.int64]:
    """Places from start to stop of every grain, joined."""
    number = stop - start
    within = np.arange(number.sum()) - np.repeat(np.cumsum(number) - number, number)
    return np.repeat(start, number) + within


def import_state(sim: Simulation, state: Arrays) -> None:
    """Put an exported state on the device; the Setups must be those it was exported with."""
    make_room(sim, state)
    world, count = sim.world, len(sim.setups)
    replicas = world.replicas
    columns = list(zip(fields_of(replicas, REPLICA), (state[name] for name in REPLICA), strict=True))
    upload([*columns, (replicas.stale, state["stale"]), (replicas.side, np.zeros(count))])
    for name in FAULT:
        write(getattr(replicas, name), state[name])
    for gone in (replicas.need, world.grains.force, world.grains.torque):
        write(gone, 0)
    if sim.sizes.surfaces:
        upload([(getattr(world.walls, name), state[f"surface_{name}"]) for name in SURFACE])
    for r in range(count):
        prefix = f"replica{r}_"
        import_replica(sim, r, {k.removeprefix(prefix): v for k, v in state.items() if k.startswith(prefix)})
    import_surroundings(sim, state)


def make_room(sim: Simulation, state: Arrays) -> None:
    """Grow the lists until a state fits whose own lists had been grown."""
    pairs, wall_pairs = (capacity_wanted(state, prefix) for prefix in ("pair", "wall"))
    sizes = sim.sizes
    while sizes.pairs < pairs or sizes.wall_pairs < wall_pairs:
        sizes = grown(sizes)
    if sizes != sim.sizes:
        reallocate(sim, sizes)


def capacity_wanted(state: Arrays, prefix: str) -> int:
    """Entries a replica and side with which the fullest partition of all replicas fits its share."""
    wanted = 0
    for r, partitions in enumerate(state["partitions"].astype(int)):
        joined = np.concatenate([[0], np.cumsum(state[f"replica{r}_{prefix}_number"])]).astype(int)
        bounds = state[f"replica{r}_bounds"][: partitions + 1]
        wanted = max(wanted, int(partitions * np.diff(joined[bounds]).max()))
    return wanted


def import_replica(sim: Simulation, r: int, part: Arrays) -> None:
    """Grains, lists and bodies of one replica, on side 0."""
    world, rows = sim.world, sim.sizes.grains
    upload([(getattr(world.grains, name), part[name]) for name in GRAIN], 2 * r * rows)
    upload([(getattr(world.grains, name), part[name]) for name in RATE], r * rows)
    if world.driven:
        upload([(getattr(world.held, name), part[f"held_{name}"]) for name in HELD], 2 * r * rows)
    if world.sleeps:
        upload([(getattr(world.sleep, name), part[f"sleep_{name}"]) for name in CARRIED], 2 * r * rows)
    import_memory(sim, r, part)
    bounds = read(world.replicas.bounds)
    bounds[r] = part["bounds"]
    write(world.replicas.bounds, bounds)
    part = part | {"wall_wall": part["wall_wall"] + r * sim.sizes.primitives}
    for prefix, table, names in (("pair", world.pairs, PAIR), ("wall", world.wall_pairs, WALL_PAIR)):
        number = part[f"{prefix}_number"].astype(np.int64)
        columns = [(getattr(table, name), part[f"{prefix}_{name}"]) for name in names]
        columns.append((table.owner, np.repeat(np.arange(len(number)), number)))
        upload_entries(sim, r, table, number, columns)
    upload([(world.wall_pairs.clear_squared, np.zeros(rows))], 2 * r * rows)
    if world.clumped:
        upload([(getattr(world.clumps, name), part[f"body_{name}"]) for name in BODY], r * sim.sizes.bodies)
        rank = np.zeros(rows)
        rank[part["ident"].astype(np.int64)] = np.arange(len(part["ident"]))
        upload([(world.clumps.rank, rank)], r * rows)


def remembered(sim: Simulation) -> dict[str, tuple[Any, Any]]:
    """What all effects remember, as `memory_fields` of each place."""
    return memory_fields(sim.world.pair_effects) | memory_fields(sim.world.grain_effects)


def import_memory(sim: Simulation, r: int, part: Arrays) -> None:
    """What effects remember of grains; for one that the state did not know, all of them enter now."""
    count = len(part["ident"])
    for name, (numbers, start) in remembered(sim).items():
        begun = np.full(count, download([start], r, 1)[0][0])
        upload([(numbers, part.get(f"memory_{name}", begun))], 2 * r * sim.sizes.grains)


def upload_entries(
    sim: Simulation, r: int, table: Any, number: NDArray[np.int64], columns: list[Any]
) -> None:
    """Lay the joined entries of a replica out by partition and write where each grain's begin and end."""
    partitions = int(download([sim.world.replicas.partitions], r, 1)[0][0])
    bounds = read(sim.world.replicas.bounds)[r]
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
    upload([(table.start, begin), (table.stop, begin + number)], 2 * r * sim.sizes.grains)
    if table is sim.world.pairs:
        upload_touched(sim, r, reach, columns[0][1])


def upload_touched(
    sim: Simulation, r: int, reach: list[tuple[int, int, slice]], neighbour: NDArray[Any]
) -> None:
    """Ranks that the forces of every partition reach, as the list search notes them."""
    replicas = sim.world.replicas
    table = {name: read(getattr(replicas, name)) for name in REACHED}
    count = max((last for _, last, _ in reach), default=0)
    for p, (first, last, entries) in enumerate(reach):
        partners = neighbour[entries]
        before, behind = partners[partners < first], partners[partners >= last]
        table["before_low"][r, p] = before.min(initial=first)
        table["before_high"][r, p] = before.max(initial=-1) + 1
        table["after_low"][r, p] = behind.min(initial=count)
        table["after_high"][r, p] = behind.max(initial=-1) + 1
    for name, values in table.items():
        write(getattr(replicas, name), values)
