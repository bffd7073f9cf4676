"""V31: air that rises through a bed loses pressure as in Ergun's equation, until it fluidises the bed.

The fixed bed is a lattice with the published void fraction, looked at before its grains have moved. The bed
that is fluidised was poured and pressed together by air from above. Its velocity of fluidisation is where the
parabola a U + b U^2 through its pressures while it is packed meets its weight; it is held against Ergun's
equation with the void fraction of its layers.

Reference: Ergun (1952), Chem. Eng. Prog. 48, 89; numbers of the public case ErgunTestMPI of CFDEMcoupling.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.optimize import root_scalar

from taichi_erosion.core.setup import Coupling, Floats, Laws, Setup
from taichi_erosion.simulation import Simulation, advance, air_profile, set_upflow, snapshot
from taichi_erosion.verification.claims import Outcome, relative
from tests.verification import small_scenes as small
from tests.verification.reference.flow import Stream, pressure_gradient

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
TOUCH = small.Touch(1.5e6, 1e6, restitution=0.5, friction_sliding=0.3)

POURED = (8, 8, 20)  # grains along each side of the loose filling
SPACING = 1.08  # of the loose filling [d]
SETTLE, HOLD = 0.3, 0.08  # s
PRESS = 0.03  # m s-1, of the air that presses the loose filling together: it would sink slowly by its weight
PACKED = np.array([0.4, 0.6, 0.8])  # velocities over that of fluidisation
FLUID = np.array([1.2, 1.35])


def lattice_setup(superficial: float) -> Setup:
    """The regular bed between floor and lid, without weight."""
    bed = small.regular_bed(DIAMETER, SOLID, VOID, LATTICE_CELLS)
    high = small.lattice_edge(DIAMETER, VOID) * np.array(LATTICE_CELLS)
    faces = np.linspace(0.0, high[2], LATTICE_CELLS[2] + 1)
    air = small.still_air(faces, (float(high[0]), float(high[1])), GAS.density, GAS.viscosity)
    setup = small.sphere_setup(bed, TOUCH, INSTANT)
    return small.in_air(setup, air, Coupling(look_steps=1, through_flow=superficial), DIAMETER)


def poured_setup() -> Setup:
    rng = np.random.default_rng(11)
    side = SPACING * DIAMETER * POURED[0]
    place = np.stack(np.meshgrid(*map(np.arange, POURED), indexing="ij"), axis=-1).reshape(-1, 3) + 0.55
    place = SPACING * DIAMETER * (place + rng.uniform(-0.03, 0.03, place.shape))
    speed = rng.normal(0.0, 0.05, place.shape)
    grains = small.spheres(place, speed, 0.0, DIAMETER / 2.0, SOLID * np.pi / 6.0 * DIAMETER**3)
    setup = small.sphere_setup(grains, TOUCH, STEP, small.FLAT, small.GRAVITY)
    # layers of two diameters: thinner ones see the layers in which grains lie on a floor
    faces = np.arange(0.0, 1.5 * POURED[2] + 1.0, 2.0) * DIAMETER
    air = small.still_air(faces, (side, side), GAS.density, GAS.viscosity)
    return small.in_air(setup, air, Coupling(look_steps=5, rising=True), 10.0 * DIAMETER)


def pressure_drop(sim: Simulation, replica: int = 0) -> float:
    """Pressure that the air loses on its way up [Pa]."""
    profile = air_profile(sim, replica)
    return float((profile.lift * np.diff(profile.face)).sum())


def fixed_bed() -> Iterator[Outcome]:
    """Pressure of the regular bed, and the force on its grains."""
    sim = small.simulation_of([lattice_setup(velocity) for velocity in PUBLISHED], "f64", LAWS)
    advance(sim, [2.0 * INSTANT] * len(PUBLISHED))
    before = snapshot(sim, LAST)
    advance(sim, [3.0 * INSTANT] * len(PUBLISHED))
    edge = small.lattice_edge(DIAMETER, VOID)
    for replica, (velocity, wanted) in enumerate(PUBLISHED.items()):
        found = pressure_drop(sim, replica) * LENGTH / (edge * LATTICE_CELLS[2])
        yield relative(f"fixed bed: pressure drop at {velocity} m/s [Pa]", found, wanted, 0.02, "f64")
    force = float((before.mass * (snapshot(sim, LAST).velocity - before.velocity)[:, 2]).sum()) / INSTANT
    area = (edge * LATTICE_CELLS[0]) ** 2
    name = "fixed bed: force on all grains over pressure drop and area"
    yield relative(name, force / (pressure_drop(sim, LAST) * area), 1.0, 1e-3, "f64")


@dataclass(frozen=True)
class Bed:
    void: Floats  # of its layers [1]
    height: Floats  # of its layers [m]
    pressure: float  # weight less buoyancy over area [Pa]

    def ergun(self, superficial: float) -> float:
        """Pressure drop after Ergun [Pa] at a superficial velocity [m s-1]."""
        rises = [pressure_gradient(float(void), superficial, GAS) for void in self.void]
        return float((np.array(rises) * self.height).sum())

    @property
    def fluidising(self) -> float:
        """Superficial velocity at which Ergun's pressure carries the bed [m s-1]."""
        return root_scalar(lambda u: self.ergun(u) - self.pressure, bracket=(0.0, 1.0), xtol=1e-9).root


def poured_bed(sim: Simulation) -> Bed:
    """Void fraction and weight of the settled bed."""
    state, profile = small.states(sim)[0], air_profile(sim, 0)
    area = (SPACING * DIAMETER * POURED[0]) ** 2
    weight = float(state.mass.sum()) * (1.0 - GAS.density / SOLID) * -small.GRAVITY[2]
    filled = profile.void_fraction < 1.0
    return Bed(profile.void_fraction[filled], np.diff(profile.face)[filled], weight / area)


def pressures(sim: Simulation, velocities: Floats, start: float) -> Floats:
    """Mean pressure drop over the second half of a hold at each velocity, one after the other [Pa]."""
    found = []
    for number, velocity in enumerate(velocities):
        set_upflow(sim, 0, float(velocity))
        seen = []
        for k in range(1, 9):
            advance(sim, [start + HOLD * (number + k / 8.0)])
            seen.append(pressure_drop(sim))
        found.append(np.mean(seen[4:]))
    return np.array(found)


def packed_bed() -> Iterator[Outcome]:
    """V31."""
    yield from fixed_bed()
    sim = small.simulation_of([poured_setup()], "f32", LAWS)
    set_upflow(sim, 0, -PRESS)
    advance(sim, [0.5 * SETTLE])
    set_upflow(sim, 0, 0.0)
    advance(sim, [SETTLE])
    bed = poured_bed(sim)
    speed = PACKED * bed.fluidising
    packed = pressures(sim, speed, SETTLE)
    fluid = pressures(sim, FLUID * bed.fluidising, SETTLE + HOLD * len(PACKED))
    for share, found in zip(PACKED, packed, strict=True):
        name = f"poured bed: pressure at {share:.2g} of fluidisation over Ergun's"
        yield relative(name, found / bed.ergun(float(share * bed.fluidising)), 1.0, 0.02, "f32")
    a, b = np.linalg.lstsq(np.column_stack([speed, speed**2]), packed, rcond=None)[0]
    meets = (np.sqrt(a * a + 4.0 * b * bed.pressure) - a) / (2.0 * b)
    yield relative("velocity of fluidisation [m/s] against Ergun's", meets, bed.fluidising, 0.05, "f32")
    yield relative("plateau over the weight of the bed", float(fluid.mean()) / bed.pressure, 1.0, 0.02, "f32")
