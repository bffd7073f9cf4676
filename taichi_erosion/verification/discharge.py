"""V33: grains flow out of flat-bottomed silos as (D - k d)^(5/2) through round holes, with 3/2 through slots.

    W = C rho_b sqrt(g) (D - k d)^(5/2)        round hole
    W = C rho_b sqrt(g) l (D - k d)^(3/2)      slot of length l

with D the diameter of the hole or the width of the slot [m], d that of the grain [m], rho_b the density of
the filling [kg m-3]; C is near 0.6 for holes and near 1 for slots. The law is stated for openings of six
grains and more, in silos wider than 2.5 D and filled higher than 1.2 times their width; some ask for D + 30 d
too, others find that two holes are enough. Holes of 6, 7.5 and 9 d lie here in silos of 2.5 D, slots of 6, 8
and 11 d, periodic along their length, in silos of D + 30 d. What is let out comes on top of a filling of 1.2
widths; reading begins when as many grains have left as a prism over the opening, D high, holds.

Fitted are c and n of W = c (D - k d)^n for every k from 1.2 to 1.6, which is where spheres lie; the k of the
least squares is kept and printed. Three openings carry n and k only together, so what n becomes with
Beverloo's k = 1.4, and k with the law's n, is printed beside it and not judged.

Reference: Beverloo, Leniger & van de Velde (1961), Chem. Eng. Sci. 15, 260; Nedderman (1992), Statics and
Kinematics of Granular Materials, ch. 10; the range: Mankoc et al. (2007), Granular Matter 9, 407; Zhang et
al. (2019), Chin. Phys. B 28, 018101.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from taichi_erosion.core.setup import Laws, Setup
from taichi_erosion.simulation import Simulation, advance, remove_surface, snapshot
from taichi_erosion.verification.bench_run import bench, states
from taichi_erosion.verification.bench_setup import Touch
from taichi_erosion.verification.bulk_scenes import (
    DIAMETER,
    MASS,
    PLUG,
    SLOT_LENGTH,
    silo_scene,
    slot_scene,
    soft_touch,
)
from taichi_erosion.verification.claim import Outcome
from taichi_erosion.verification.reference import bulk

Floats = NDArray[np.float64]

LAWS = Laws(rolling="elastic_plastic")
HEAD = 1.2  # of the filling over the width of the silo when the reading ends [1]
CROWD = 1.15  # grains per cube of the diameter in a filling of packing 0.6, denser than ours [1]
SETTLE, SAMPLE, LONGEST = 0.17, 0.005, 2.0  # s
FRICTION, FRICTION_ROLLING = 0.5, 0.05  # of grains on each other and on all walls [1]
READ = 800  # grains let out while the flow is read
READ_NARROWEST = 1600  # there the flow over 500 grains scatters by 4 %, elsewhere by 2 %


@dataclass(frozen=True)
class Silos:
    """Silos with openings of one kind; lengths in grain diameters, one number for every silo."""

    kind: str
    exponent: float  # of the law [1]
    openings: Floats
    widths: Floats
    sections: Floats  # of the silo
    mouths: Floats  # area of the opening
    length: float  # m, of a slot; 1 for holes
    scene: Callable[[Touch, int, float, float, int], Setup]

    @property
    def before(self) -> Floats:
        """Grains that leave each silo before the flow is read."""
        return CROWD * self.mouths * self.openings

    @property
    def until(self) -> Floats:
        """Grains that have left each silo when reading ends."""
        narrowest = self.openings == self.openings.min()
        return self.before + np.where(narrowest, READ_NARROWEST, READ)

    @property
    def stock(self) -> Floats:
        """Grains in each silo."""
        return np.ceil(CROWD * HEAD * self.widths * self.sections + self.until)


def with_holes(*holes: float) -> Silos:
    """Round silos of 2.5 holes."""
    opening = np.array(holes)
    width = 2.5 * opening
    sections = 0.25 * np.pi * width**2, 0.25 * np.pi * opening**2
    return Silos("round holes", bulk.HOLE_EXPONENT, opening, width, *sections, 1.0, silo_scene)


def with_slots(*slots: float) -> Silos:
    """Silos 30 diameters wider than their slots."""
    opening, length = np.array(slots), SLOT_LENGTH / DIAMETER
    width = opening + 30.0
    sections = length * width, length * opening
    return Silos("slots", bulk.SLOT_EXPONENT, opening, width, *sections, SLOT_LENGTH, slot_scene)


HOLES, SLOTS = with_holes(6.0, 7.5, 9.0), with_slots(6.0, 8.0, 11.0)


def opening_flow() -> Iterator[Outcome]:
    """V33."""
    for silos in (HOLES, SLOTS):
        yield discharged(silos)


def filled(silos: Silos) -> Simulation:
    """The silos with their fillings at rest."""
    touch = soft_touch(FRICTION, FRICTION_ROLLING)
    rows = zip(silos.stock, silos.widths * DIAMETER, silos.openings * DIAMETER, strict=True)
    setups = [silos.scene(touch, int(n), width, opening, k) for k, (n, width, opening) in enumerate(rows)]
    sim = bench(setups, "f32", LAWS)
    advance(sim, [SETTLE] * len(setups))
    return sim


def discharged(silos: Silos) -> Outcome:
    """Exponent of the flow in the width of one kind of opening."""
    sim = filled(silos)
    density = bulk_density(sim, silos)
    flow = MASS * discharge_rates(sim, silos)
    opening = silos.openings * DIAMETER
    edge, exponent = bulk.discharge_fit(opening, DIAMETER, flow)
    plain, _ = bulk.discharge_exponent(opening, DIAMETER, flow, bulk.BEVERLOO_EDGE)
    given = bulk.discharge_edge(opening, DIAMETER, flow, silos.exponent)
    factors = bulk.discharge_coefficient(flow / silos.length, density, opening, DIAMETER, silos.exponent)
    rates, widths = (", ".join(format(x, ".4g") for x in column) for column in (1e3 * flow, silos.openings))
    name = (
        f"Beverloo: exponent of (D - {edge:.2f} d), flow {rates} g/s through {silos.kind} of {widths} d "
        f"(k = 1.4 given: exponent {plain:.2f}, C {np.mean(factors):.2f}; "
        f"exponent {silos.exponent:g} given: k {given:.2f})"
    )
    return Outcome(name, exponent, silos.exponent, 0.1, "f32")


def bulk_density(sim: Simulation, silos: Silos) -> Floats:
    """Density of every settled filling between two and twelve diameters above the bottom [kg m-3]."""
    low, high = 2.0, 12.0
    masses = []
    for state in states(sim, len(sim.setups)):
        height = state.position[:, 2] / DIAMETER
        masses.append(MASS * np.count_nonzero((height > low) & (height < high)))
    return np.array(masses) / (silos.sections * (high - low) * DIAMETER**3)


def discharge_rates(sim: Simulation, silos: Silos) -> Floats:
    """Grains per second through each opening once its plug is taken out."""
    replicas = len(sim.setups)
    for replica in range(replicas):
        remove_surface(sim, replica, PLUG)
    times, passed = [], []
    ends = np.full(replicas, SETTLE)
    while ends.max() < SETTLE + LONGEST:
        left = [int(np.count_nonzero(snapshot(sim, k).position[:, 2] < 0.0)) for k in range(replicas)]
        times.append(ends.copy())
        passed.append(left)
        flowing = np.array(left) < silos.until
        if not flowing.any():
            break
        ends = ends + SAMPLE * flowing
        advance(sim, [float(end) for end in ends])
    states(sim, replicas)
    series = zip(np.array(times).T, np.array(passed).T, silos.before, silos.until, strict=True)
    return np.array([steady_slope(*silo) for silo in series])


def steady_slope(time: Floats, passed: Floats, first: float, last: float) -> float:
    """Slope of grains passed against time while between two numbers of them have left [s-1]."""
    steady = (passed > first) & (passed < last)
    return float(np.polyfit(time[steady], passed[steady], 1)[0])
