"""State variables of effects: they move with their grain, and a crust that has broken stays broken."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from math import pi
from typing import Any

import numpy as np
import pytest
from grain_worlds import MASS, NONE, RADIUS, contacts, fingerprint, grains, heap, setup
from own_effects import LIBRARY, acted_on

from taichi_erosion import simulation
from taichi_erosion.core.device import stop_device
from taichi_erosion.core.effect import quantity, replica_effect
from taichi_erosion.core.setup import Laws, Numerics, Setup
from taichi_erosion.core.ti import ti
from taichi_erosion.simulation import Simulation

LAWS = Laws(rolling="elastic_plastic")
GRAINS, HALF, WHOLE = 120, 0.01, 0.02  # s
STRONG = {"tensile_strength": 1e4, "setting": 2e-3}
STRENGTH = 1e4 * pi * (0.1 * 2.0 * RADIUS) ** 2  # of the bond of a grain with a wall [N]


@dataclass(frozen=True)
class Mark:
    """Mass of a grain at its first update, and the number of updates."""

    mass: float = quantity(0.0, "kg", "as first seen")
    updates: float = quantity(0.0, "1", "so far")


@ti.func
def note(constants, grain, state):
    after = state
    if state.updates == 0.0:
        after.mass = grain.mass
    after.updates = state.updates + 1.0
    return after


@ti.func
def no_pull(constants, pair, state_i, state_j):
    return 0.0 * constants.nothing


MARK = replace(LIBRARY["ageing_pull"], name="mark", act=no_pull, grain_state=Mark, update_state=note)
MARK = replace(MARK, constants=lambda params, strength, conditions: {"nothing": 0.0})


def sticky() -> Setup:
    """A heap whose grains attract each other the harder the longer they lie."""
    return acted_on(heap(GRAINS, 1), {}, ageing_pull={"pull_off": 3e-5, "ageing": 5e-3, "still": 0.02})


def unlike() -> Setup:
    """A heap in which every grain has a mass of its own."""
    bare, mass = heap(GRAINS, 1), MASS * (1.0 + 1e-3 * np.arange(GRAINS))
    marked = (replica_effect(MARK, MARK.params(), 1.0, {}, RADIUS),)
    return replace(bare, grains=replace(bare.grains, mass=mass), effects=marked)


def lying(count: int = 1) -> Setup:
    """Grains that lie on a plate, cemented to it as soon as they have lain still."""
    place = [[3.0 * RADIUS * k, 0.0, 0.9999 * RADIUS] for k in range(count)]
    return acted_on(setup(grains(place), law=contacts()), {}, surface_crust=STRONG)


def triangle() -> Setup:
    place = [[0.0, 0.0, 0.0], [2.0 * RADIUS, 0.0, 0.0], [1.0 * RADIUS, 1.732 * RADIUS, 0.0]]
    return setup(grains(place), NONE, law=contacts(0.5), gravity=(0.0, 0.0, 0.0))


SETUPS = {"unlike": unlike(), "sticky": sticky(), "lying": lying(), "beside": lying(2)}
SETUPS |= {"cemented": acted_on(triangle(), {}, surface_crust=STRONG), "free": triangle()}
PLACE = {name: replica for replica, name in enumerate(SETUPS)}


@pytest.fixture(scope="module")
def compiled() -> Iterator[Simulation]:
    """All setups in one ensemble: kernels compile once."""
    yield simulation.assemble(list(SETUPS.values()), LAWS, Numerics("cpu", 1, "f64"))
    stop_device()


@pytest.fixture(name="sim")
def at_its_start(compiled: Simulation) -> Simulation:
    return begun(compiled)


def begun(sim: Simulation) -> Simulation:
    """The ensemble in empty fields, as a new one would have them."""
    assert simulation.reuse_or_assemble(sim, list(SETUPS.values()), sim.laws, sim.numerics) is sim
    return sim


def go(sim: Simulation, time: float, *names: str) -> None:
    simulation.advance(sim, [time if name in names else 0.0 for name in SETUPS])


def state_of(sim: Simulation, name: str, replica: int = 0) -> Any:
    bed = simulation.export_bed(sim, replica)
    return bed[f"effect_{name}"][np.argsort(bed["ident"])]


def calm(sim: Simulation, name: str) -> Any:
    return state_of(sim, "surface_crust.calm", PLACE[name])


def test_a_memory_goes_where_its_grain_goes(sim):
    go(sim, WHOLE, "unlike")
    assert int(simulation.export_state(sim)["rebuilds"][0]) > 5, "must have been sorted"
    assert state_of(sim, "mark.mass") == pytest.approx(unlike().grains.mass, rel=1e-15)
    assert list(simulation.snapshot(sim, 0).effect_state["mark.mass"]) == list(state_of(sim, "mark.mass"))
    # one update in ten steps of 1e-5 s; the first exchange is done twice and counts once
    assert list(state_of(sim, "mark.updates")) == [200.0] * GRAINS


def test_a_resumed_run_remembers_to_the_last_bit(sim):
    go(sim, HALF, "sticky")
    kept = simulation.export_state(sim)
    ends = []
    for _ in range(2):
        go(sim, WHOLE, "sticky")
        ends.append((fingerprint(simulation.snapshot(sim, 1)), list(state_of(sim, "ageing_pull.age", 1))))
        simulation.import_state(begun(sim), kept)
    assert ends[0] == ends[1]


def test_grains_of_a_state_that_knew_no_memory_enter_now(sim):
    go(sim, 0.01, "lying", "beside")
    assert calm(sim, "beside").any()
    kept = {name: values for name, values in simulation.export_state(sim).items() if "_effect_" not in name}
    simulation.import_state(begun(sim), kept)
    assert not calm(sim, "beside").any()


def drawn(sim: Simulation, pull: float, time: float) -> float:
    """Height of the grain over the plate [m] after gravity has drawn it upwards with a force [N]."""
    simulation.set_replica_gravity(sim, PLACE["lying"], (0.0, 0.0, pull / MASS))
    go(sim, time, "lying")
    return float(simulation.snapshot(sim, PLACE["lying"]).position[0, 2])


def test_a_cemented_grain_holds_a_force_and_a_grain_that_has_broken_out_none(sim):
    go(sim, 0.01, "lying")
    bed = simulation.export_bed(sim, PLACE["lying"])
    # a force that begins at once stretches a bond without loss to twice its length at rest
    assert drawn(sim, 0.45 * STRENGTH, 0.03) < 1.02 * RADIUS
    assert drawn(sim, 1.1 * STRENGTH, 0.033) > 1.1 * RADIUS
    assert calm(sim, "lying")[0] == -1.0
    assert drawn(sim, -100.0 * MASS, 0.08) < RADIUS, "must lie on the plate again"
    assert drawn(sim, 0.01 * STRENGTH, 0.1) > 1.1 * RADIUS
    simulation.import_bed(sim, PLACE["lying"], bed)
    assert drawn(sim, 0.45 * STRENGTH, 0.12) < 1.02 * RADIUS


def pushed(sim: Simulation, name: str, ident: int, velocity: tuple[float, float, float]) -> dict[str, Any]:
    """The present state with another velocity of one grain [m s-1]."""
    state, prefix = simulation.export_state(sim), f"replica{PLACE[name]}"
    state[f"{prefix}_velocity"][np.flatnonzero(state[f"{prefix}_ident"] == ident)[0]] = velocity
    return state


def test_a_broken_crust_frees_the_grain_that_moved_and_no_other(sim):
    go(sim, 0.01, "beside")
    simulation.import_state(sim, pushed(sim, "beside", 1, (0.0, 1.0, 0.0)))
    go(sim, 0.02, "beside")
    assert list(calm(sim, "beside") < 0.0) == [False, True]


def test_a_cement_pulls_both_partners_alike(sim):
    go(sim, 1e-5, "cemented", "free")
    simulation.import_state(sim, pushed(sim, "free", 0, (-0.01, 0.0, 0.0)))
    state, prefix = pushed(sim, "cemented", 0, (-0.01, 0.0, 0.0)), f"replica{PLACE['cemented']}"
    for name, values in zip("xyz", state[f"{prefix}_origin"].T, strict=True):
        state[f"{prefix}_effect_surface_crust.{name}"] = values
    state[f"{prefix}_effect_surface_crust.calm"] = np.ones(3)
    simulation.import_state(sim, state)
    go(sim, 1e-3, "cemented", "free")
    cemented, free = (simulation.snapshot(sim, PLACE[name]).velocity for name in ("cemented", "free"))
    # f64 sums of a hundred steps
    assert cemented.sum(axis=0) == pytest.approx(state[f"{prefix}_velocity"].sum(axis=0), abs=1e-12)
    assert np.abs(cemented - free).max() > 1e-3, "must have acted"


@pytest.mark.slow
def test_workers_that_share_grains_with_a_memory_change_no_bit(same_in_teams):
    """The last test: it stops the device."""

    def aged(sim: Simulation) -> tuple[str, list[float]]:
        simulation.advance(sim, [HALF])
        return fingerprint(simulation.snapshot(sim, 0)), list(state_of(sim, "ageing_pull.age"))

    same_in_teams(sticky(), LAWS, aged)
