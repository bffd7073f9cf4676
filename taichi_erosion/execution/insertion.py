"""Grains that are let into a live session, or taken out of it."""

from collections.abc import Sequence
from dataclasses import replace
from math import inf, sqrt
from typing import Any

import numpy as np
from scipy.spatial.distance import cdist

from taichi_erosion import simulation
from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.setup import GrainTable
from taichi_erosion.execution import stages as staging
from taichi_erosion.execution.session import Session, build_ensemble, keep_state_if_due, lay_bed_of_search
from taichi_erosion.scene import replica_setup
from taichi_erosion.scene.preparation.fill import pour_with_inlets_open
from taichi_erosion.scene.preparation.setup import append_grains_by_release
from taichi_erosion.scene.preparation.walls import distance_to_wall
from taichi_erosion.simulation import Simulation
from taichi_erosion.simulation.saved_state import remove_grains_from_state

MOST = 10_000  # grains that are let in at once: more are a scene of their own [1]


def insert_grains(session: Session, count: int, at: Sequence[float], inlet: str) -> None:
    """Let grains of the scene in from now on, as `pour_with_inlets_open` says. Raises BadInput."""
    scene, setup = session.ensemble.scenes[0], session.sim.setups[0]
    if not 1 <= count <= MOST or setup.clumps is not None or (count > 1 and not any(setup.gravity)):
        raise BadInput(f"insert: 1 to {MOST:,} spheres, with gravity, or they would not fall clear")
    sample = {"grains": scene.grains.model_copy(update={"count": count})}
    fill = {"fill": pour_with_inlets_open(scene, session.time, at, inlet, setup.grains.release_time.max())}
    new = replica_setup(scene.model_copy(update=sample | fill), session.seed + len(setup.grains.mass)).grains
    if at:
        refuse_place_outside(session, new)
    release_count = len(setup.grains.mass) - simulation.count_waiting_spheres(session.sim, 0)
    refuse_place_of_grains(session, new, release_count)
    keep_state_if_due(session, is_due=True)
    lay_bed_of_search(session)
    state, place = simulation.export_state(session.sim), f" through {inlet}" if inlet else ""
    grains = append_grains_by_release(setup.grains, release_count, new)
    place = f" at {' '.join(repr(float(x)) for x in at)}" if at else place
    sim = build_ensemble(session.scene, session.seed, session.library, grains).sim
    replace_simulation(session, sim, state, f"insert {count}{place}")


def refuse_place_outside(session: Session, new: GrainTable) -> None:
    """Raise BadInput where grains would begin outside the domain, above its air, or in a wall as it is."""
    setup, radius = session.sim.setups[0], new.radius
    low, high = np.array(setup.domain)
    if setup.air is not None:
        high[2] = setup.air.high[2]
    if ((new.position < low) | (new.position > high)).any():
        corners = " and ".join(" ".join(f"{x:.4g}" for x in corner) for corner in (low, high))
        raise BadInput(f"insert: the place is outside; grains and air have the box between {corners} m")
    for name, pose in simulation.wall_poses(session.sim, 0).items():
        places = (new.position - pose.translation) @ pose.rotation
        if pose.present and (distance_to_wall(session.scene, name, places) < radius).any():
            raise BadInput(f"insert: the wall '{name}' is there; name another place")


def refuse_place_of_grains(session: Session, new: GrainTable, release_count: int) -> None:
    """Raise BadInput where the first grains would begin in one that is there, or soon comes there."""
    table, here, time = session.sim.setups[0].grains, simulation.snapshot(session.sim, 0), session.time
    gravity, largest = float(np.linalg.norm(session.sim.setups[0].gravity)), float(table.radius.max())
    clear = time + sqrt(4.0 * largest / gravity) if gravity else inf  # s, when the first have fallen clear
    soon, first = np.flatnonzero(table.release_time < clear), new.release_time <= time
    soon = soon[soon >= release_count]
    places = np.concatenate([here.position, table.position[soon]])
    radii = np.concatenate([here.radius, table.radius[soon]])
    gaps = cdist(new.position[first], places) - new.radius[first][:, None] - radii
    if gaps.min(initial=inf) < 0.0:
        raise BadInput("insert: a grain lies there already; name another place")


def remove_grains(session: Session, *numbers: int) -> None:
    """Take grains out by their numbers. Raises BadInput for one that is not there, and for clumps."""
    missing = set(numbers) - set(simulation.snapshot(session.sim, 0).ident.tolist())
    if missing or session.sim.world.has_clumps:
        raise BadInput(f"remove: no sphere of its own has the number {min(missing or numbers)}")
    keep_state_if_due(session, is_due=True)
    lay_bed_of_search(session)
    state = remove_grains_from_state(simulation.export_state(session.sim), 0, numbers)
    replace_simulation(session, session.sim, state, f"remove {' '.join(map(str, numbers))}")


def replace_simulation(session: Session, sim: Simulation, state: dict[str, Any], line: str) -> None:
    """Go on in a simulation with a state to which a command has led."""
    simulation.import_state(sim, state)
    session.ensemble = replace(session.ensemble, sim=sim)
    staging.begin_readings(sim, session.ensemble.scenes[0], 0, session.state, session.time)
    session.history.append(line)
    session.latest_change, session.revision = ("", 0.0), session.revision + 1
