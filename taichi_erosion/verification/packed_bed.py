"""V31: air that rises through a bed loses the pressure that Ergun's equation says, and carries it from there on.

The fixed bed is a lattice with the published void fraction, looked at before its grains have moved: what is
tested is the chain from superficial velocity through drag on single grains to pressure. The bed that is
fluidised was poured; its velocity of fluidisation is where the parabola a U + b U^2 through its pressures
while it is packed meets its weight, and is held against Ergun's with the bed's own void fraction.

Reference: Ergun (1952), Chem. Eng. Prog. 48, 89; numbers of the public case ErgunTestMPI of CFDEMcoupling.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from taichi_erosion.core.setup import Coupling, Laws, Setup
from taichi_erosion.simulation import Simulation, advance, air_profile, set_through_flow, snapshot
from taichi_erosion.verification.bench_run import bench, states
from taichi_erosion.verification.bench_setup import (
    FLOOR,
    Touch,
    contact_table,
    planes,
    sphere_setup,
    spheres,
)
from taichi_erosion.verification.claim import Outcome, relative
from taichi_erosion.verification.coupled_setup import (
    GRAVITY,
    in_air,
    lattice_edge,
    regular_bed,
    still_air,
)
from taichi_erosion.verification.reference.drag import Stream, fluidising_velocity, pressure_gradient

Floats = NDArray[np.float64]

DIAMETER, SOLID = 1e-3, 2000.0  # m, kg m-3
GAS = Stream(0.0, DIAMETER, density=10.0, viscosity=1.5e-3)  # kg m-3, Pa s
VOID = 0.451335  # of the published bed [1]
LENGTH = 15.6e-3  # m, of the published bed
PUBLISHED = {0.002: 22.99, 0.01: 115.1, 0.02: 230.5}  # Pa at a superficial velocity [m s-1]
LAWS = Laws(drag="gidaspow")
LATTICE_CELLS = (3, 3, 10)
INSTANT = 1e-9  # s, in which no grain of the lattice moves
LAST = len(PUBLISHED) - 1  # replica with the fastest air
STEP = 1.2e-5  # s
TOUCH = Touch(1.5e6, 1e6, restitution=0.5, friction=0.3)

POURED = (8, 8, 20)  # grains along each side of the loose filling
SPACING = 1.08  # of the loose filling [d]
SETTLE, HOLD = 0.25, 0.08  # s
PACKED = np.array([0.35, 0.5, 0.65, 0.8])  # velocities over that of fluidisation
FLUID = np.array([1.2, 1.35])


def lattice_setup(superficial: float) -> Setup:
    """The regular bed between floor and lid, without weight."""
    bed = regular_bed(DIAMETER, SOLID, VOID, LATTICE_CELLS)
    edge = lattice_edge(DIAMETER, VOID)
    high = edge * np.array(LATTICE_CELLS)
    faces = np.linspace(0.0, high[2], LATTICE_CELLS[2] + 1)
    air = still_air(faces, (float(high[0]), float(high[1])), GAS.density, GAS.viscosity)
    setup = sphere_setup(bed, contact_table(TOUCH, TOUCH), INSTANT)
    return in_air(setup, air, Coupling(look_steps=1, through_flow=superficial), DIAMETER)


def poured_setup() -> Setup:
    """Grains that settle on a floor."""
    rng = np.random.default_rng(11)
    side = SPACING * DIAMETER * POURED[0]
    place = np.stack(np.meshgrid(*map(np.arange, POURED), indexing="ij"), axis=-1).reshape(-1, 3) + 0.55
    place = SPACING * DIAMETER * (place + rng.uniform(-0.03, 0.03, place.shape))
    speed = rng.normal(0.0, 0.05, place.shape)
    grains = spheres(place, speed, 0.0, DIAMETER / 2.0, SOLID * np.pi / 6.0 * DIAMETER**3)
    setup = sphere_setup(grains, contact_table(TOUCH, TOUCH), STEP, planes(FLOOR), GRAVITY)
    # layers of two diameters: thinner ones see the layers in which grains lie on a floor
    faces = np.arange(0.0, 1.5 * POURED[2] + 1.0, 2.0) * DIAMETER
    air = still_air(faces, (side, side), GAS.density, GAS.viscosity)
    return in_air(setup, air, Coupling(look_steps=5, rising=True), 10.0 * DIAMETER)


def pressure_drop(sim: Simulation, replica: int = 0) -> float:
    """Pressure that the air loses on its way up [Pa]."""
    profile = air_profile(sim, replica)
    return float((profile.lift * np.diff(profile.face)).sum())


def fixed_bed() -> Iterator[Outcome]:
    """Pressure of the regular bed, and the force that its grains feel."""
    sim = bench([lattice_setup(velocity) for velocity in PUBLISHED], "f64", LAWS)
    # the first look finds grains that do not know the air yet, the second one the drag
    advance(sim, [2.0 * INSTANT] * len(PUBLISHED))
    before = snapshot(sim, LAST)
    advance(sim, [3.0 * INSTANT] * len(PUBLISHED))
    edge = lattice_edge(DIAMETER, VOID)
    for replica, (velocity, wanted) in enumerate(PUBLISHED.items()):
        found = pressure_drop(sim, replica) * LENGTH / (edge * LATTICE_CELLS[2])
        yield relative(f"fixed bed: pressure drop at {velocity} m/s [Pa]", found, wanted, 0.02, "f64")
    gained = (snapshot(sim, LAST).velocity - before.velocity)[:, 2]
    force = float((before.mass * gained).sum()) / INSTANT
    area = (edge * LATTICE_CELLS[0]) ** 2
    name = "fixed bed: force on all grains over pressure drop and area"
    yield relative(name, force / (pressure_drop(sim, LAST) * area), 1.0, 1e-3, "f64")


@dataclass(frozen=True)
class Bed:
    """The poured bed as it lies."""

    void: float  # between a third and two thirds of its height [1]
    pressure: float  # weight less buoyancy over area [Pa]
    fluidising: float  # superficial velocity after Ergun [m s-1]


def poured_bed(sim: Simulation) -> Bed:
    """Void fraction and weight of the settled bed."""
    state, profile = states(sim, 1)[0], air_profile(sim, 0)
    area = (SPACING * DIAMETER * POURED[0]) ** 2
    weight = float(state.mass.sum()) * (1.0 - GAS.density / SOLID) * -GRAVITY[2]
    top = float(np.quantile(state.position[:, 2], 0.98))
    inside = (profile.face[:-1] > top / 3.0) & (profile.face[1:] < 2.0 * top / 3.0)
    void = float(profile.void_fraction[inside].mean())
    specific = (1.0 - void) * (SOLID - GAS.density) * -GRAVITY[2]
    return Bed(void, weight / area, fluidising_velocity(void, specific, GAS))


def pressures(sim: Simulation, velocities: Floats, start: float) -> Floats:
    """Mean pressure drop over the second half of a hold at each velocity, one after the other [Pa]."""
    found, time = [], start
    for velocity in velocities:
        set_through_flow(sim, 0, float(velocity))
        seen = []
        for k in range(8):
            advance(sim, [time + HOLD * (k + 1) / 8.0])
            seen.append(pressure_drop(sim))
        time += HOLD
        found.append(np.mean(seen[4:]))
    return np.array(found)


def packed_bed() -> Iterator[Outcome]:
    """V31."""
    yield from fixed_bed()
    sim = bench([poured_setup()], "f32", LAWS)
    advance(sim, [SETTLE])
    bed = poured_bed(sim)
    packed = pressures(sim, PACKED * bed.fluidising, SETTLE)
    fluid = pressures(sim, FLUID * bed.fluidising, SETTLE + HOLD * len(PACKED))
    name = f"poured bed (void {bed.void:.4f}): pressure at {PACKED[1]:.2g} of fluidisation over Ergun's"
    ergun = pressure_gradient(bed.void, float(PACKED[1] * bed.fluidising), GAS)
    height = bed.pressure / ((1.0 - bed.void) * (SOLID - GAS.density) * -GRAVITY[2])
    yield relative(name, packed[1] / (ergun * height), 1.0, 0.02, "f32")
    speed = PACKED * bed.fluidising
    a, b = np.linalg.lstsq(np.column_stack([speed, speed**2]), packed, rcond=None)[0]
    meets = (np.sqrt(a * a + 4.0 * b * bed.pressure) - a) / (2.0 * b)
    yield relative("velocity of fluidisation [m/s] against Ergun", meets, bed.fluidising, 0.05, "f32")
    yield relative("plateau over the weight of the bed", float(fluid.mean()) / bed.pressure, 1.0, 0.02, "f32")
