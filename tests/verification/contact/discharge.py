"""V33: grains flow out of flat-bottomed silos as (D - k d)^(5/2) through round holes, with 3/2 through slots.

    W = C rho_b sqrt(g) (D - k d)^(5/2)        round hole
    W = C rho_b sqrt(g) l (D - k d)^(3/2)      slot of length l

with D the diameter of the hole or the width of the slot [m], d that of the grain [m], rho_b the density of
the filling [kg m-3]; C is near 0.6 for holes and near 1 for slots, k is Beverloo's 1.4. The law is stated for
openings of six grains and more, in silos wider than 2.5 D and filled higher than 1.2 times their width.
Reading begins when as many grains have left as a prism over the opening, D high, holds.

Flows scatter from filling to filling, and c, k and the exponent follow only with one another. Judged are

    exponent    slope of ln W against ln(D - k d) with Beverloo's k; its standard error must be at most half
                of the tolerance, or the check could not tell
    law         with its exponent given, c and k are fitted, and the mean flows of the openings scatter about
                it no more than fillings of one opening do among themselves (F-test of the lack of fit)

Reference: Beverloo, Leniger & van de Velde (1961), Chem. Eng. Sci. 15, 260; Nedderman (1992), Statics and
Kinematics of Granular Materials, ch. 10; the range: Mankoc et al. (2007), Granular Matter 9, 407; Zhang et
al. (2019), Chin. Phys. B 28, 018101; Draper & Smith (1998), Applied Regression Analysis, 3rd ed., ch. 2.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from taichi_erosion.core.setup import Floats, GrainTable, PrimitiveKind, Setup
from taichi_erosion.simulation import Simulation, advance, remove_surface, snapshot
from taichi_erosion.verification.claims import Outcome, below, holds
from tests.verification import small_scenes as small
from tests.verification.contact import bulk
from tests.verification.contact.bulk import DIAMETER
from tests.verification.reference import flow as exact

HEAD = 1.2  # of the filling over the width of the silo when the reading ends [1]
WIDTH = 2.5  # of the silo over the opening [1]
GRAINS_PER_CUBE = 1.15  # grains per cube of the diameter in a filling of packing 0.6, denser than ours [1]
SOFTER = 8.0  # than the glass of heaps: overlaps stay below 1.5 % of the radius, and steps are longer
TIME_STEP = bulk.TIME_STEP * SOFTER**0.5  # s
SETTLE, SAMPLE, LONGEST = 0.2, 0.004, 2.0  # s
FRICTION, FRICTION_ROLLING = 0.5, 0.05  # of grains on each other and on all walls [1]
READ = 800  # grains let out while the flow is read
SLOT_LENGTH = 6.1  # diameters, five rows of a loose filling; the period along a slot
SPREAD = 0.1  # half width of the diameters about their mean [1]; equal spheres lie in rows along walls
PITCH = 1.2  # mean diameters between the centres of a loose filling: those of the largest do not meet [1]
TRAY = (0.0, 0.0, -30.0 * DIAMETER, 0.0, 0.0, 1.0)  # plane far below a silo
PLUG = "wall2"  # of a silo's opening
TOLERANCE = 0.1  # of an exponent [1]
SENSIBLE = 0.5 * TOLERANCE  # standard error with which a check of the exponent can tell [1]
UNLIKELY = 0.01  # chance of a lack of fit below which the law is refuted [1]


def touch() -> small.Touch:
    """Contact of two grains; walls are given the same."""
    stiff = bulk.soft_touch(FRICTION, FRICTION_ROLLING)
    young, shear = stiff.young_effective / SOFTER, stiff.shear_effective / SOFTER
    return replace(stiff, young_effective=young, shear_effective=shear)


def filling(count: int, half_width: tuple[float, float], round_base: bool, seed: int) -> GrainTable:
    """Grains of diameters that scatter evenly by `SPREAD` about their mean, on a loose lattice."""
    grains = bulk.loose_grains(count, half_width, round_base, seed, PITCH)
    size = 1.0 + SPREAD * np.random.default_rng([seed, count]).uniform(-1.0, 1.0, count)
    return replace(grains, radius=grains.radius * size, mass=grains.mass * size**3)


def silo_scene(count: int, width: float, hole: float, seed: int) -> Setup:
    """A flat-bottomed round silo with a round hole [m]; walls are tube, bottom, plug and a tray below."""
    radius, reach = width / 2.0, hole / 2.0
    grains = filling(count, (radius, radius), True, seed)
    ends = (radius, radius, 80.0 * DIAMETER), (reach, radius, 0.0), (0.0, reach, 0.0)
    walls = [bulk.revolved_segment((first, 0.0), (second, height)) for first, second, height in ends]
    whole = small.joined(*walls, small.planes(TRAY))
    return small.sphere_setup(grains, touch(), TIME_STEP, whole, small.GRAVITY)


def slot_scene(count: int, width: float, slot: float, seed: int) -> Setup:
    """A flat-bottomed silo, periodic along its slot [m]; walls are two sides, plug, bottom and a tray."""
    half, reach, length = width / 2.0, slot / 2.0, SLOT_LENGTH * DIAMETER
    plug, bottom = bulk.strip(-reach, reach), bulk.strip(-half, -reach) + bulk.strip(reach, half)
    sides = small.planes((-half, 0.0, 0.0, 1.0, 0.0, 0.0), (half, 0.0, 0.0, -1.0, 0.0, 0.0))
    triangles = (small.primitive_table(PrimitiveKind.TRIANGLE, each) for each in (plug, bottom))
    walls = small.joined(sides, *triangles, small.planes(TRAY))
    grains = filling(count, (half, length / 2.0), False, seed)
    return bulk.periodic(small.sphere_setup(grains, touch(), TIME_STEP, walls, small.GRAVITY), length)


@dataclass(frozen=True)
class Silos:
    """Silos with openings of one kind, several fillings of each; arrays have one number for every silo."""

    kind: str
    exponent: float  # of the law [1]
    openings: Floats  # diameters
    area: Callable[[Floats], Floats]  # of silos or openings by their widths, squares of a diameter
    length: float  # m, of a slot; 1 for holes
    scene: Callable[[int, float, float, int], Setup]

    @property
    def before(self) -> Floats:
        """Grains that leave each silo before the flow is read; `READ` more, and reading ends."""
        return GRAINS_PER_CUBE * self.area(self.openings) * self.openings


# how many fillings flow through each width in diameters
HOLE, SLOT = np.repeat([6.0, 7.5, 9.0, 12.0], [3, 3, 2, 1]), np.repeat([6.0, 8.0, 11.0, 16.0], [3, 3, 2, 2])
LENGTH = SLOT_LENGTH * DIAMETER
HOLES = Silos("round holes", exact.HOLE_EXPONENT, HOLE, lambda w: 0.25 * np.pi * w**2, 1.0, silo_scene)
SLOTS = Silos("slots", exact.SLOT_EXPONENT, SLOT, lambda w: SLOT_LENGTH * w, LENGTH, slot_scene)


def opening_flow() -> Iterator[Outcome]:
    """V33."""
    for silos in (HOLES, SLOTS):
        sim = settled(silos)
        density = bulk_density(sim, silos)
        flow = discharge_rates(sim, silos)
        opening = silos.openings * DIAMETER
        exponent, error = exact.discharge_exponent(opening, DIAMETER, flow, exact.BEVERLOO_EDGE)
        open_width = opening - exact.BEVERLOO_EDGE * DIAMETER
        factors = flow / silos.length / (density * np.sqrt(9.81) * open_width**silos.exponent)
        sizes = np.unique(silos.openings)
        means = ", ".join(f"{1e3 * flow[silos.openings == size].mean():.4g}" for size in sizes)
        listed = ", ".join(f"{size:g}" for size in sizes)
        law = f"exponent of (D - 1.4 d), {exponent:.2f} +- {error:.2f}, C {np.mean(factors):.2f}"
        name = f"Beverloo, {silos.kind} of {listed} d, {len(flow)} fillings, flow {means} g/s: {law}"
        yield Outcome(name, exponent, silos.exponent, TOLERANCE, "f32")
        yield below(f"standard error of the exponent, {silos.kind}", error, SENSIBLE, "f32")
        edge, error, chance = exact.discharge_edge(opening, DIAMETER, flow, silos.exponent)
        name = f"{silos.kind}: exponent {silos.exponent:g} given, k = {edge:.2f} +- {error:.2f}, lack of fit "
        yield holds(f"{name}is no more than chance (p = {chance:.2g})", chance > UNLIKELY, "f32")


def settled(silos: Silos) -> Simulation:
    widths = WIDTH * silos.openings
    stock = np.ceil(GRAINS_PER_CUBE * HEAD * widths * silos.area(widths) + silos.before + READ)
    rows = zip(stock, widths * DIAMETER, silos.openings * DIAMETER, strict=True)
    setups = [silos.scene(int(n), width, opening, k) for k, (n, width, opening) in enumerate(rows)]
    sim = small.simulation_of(setups, "f32", bulk.ROLLING)
    small.advance_all(sim, SETTLE)
    return sim


def bulk_density(sim: Simulation, silos: Silos) -> Floats:
    """Density of every settled filling between two and twelve diameters above the bottom [kg m-3]."""
    masses = []
    for state in small.states(sim):
        height = state.position[:, 2] / DIAMETER
        masses.append(state.mass[(height > 2.0) & (height < 12.0)].sum())
    return np.array(masses) / (silos.area(WIDTH * silos.openings) * 10.0 * DIAMETER**3)


def discharge_rates(sim: Simulation, silos: Silos) -> Floats:
    """Mass per second through each opening once its plug is taken out [kg s-1]."""
    replicas = range(len(sim.setups))
    for replica in replicas:
        remove_surface(sim, replica, PLUG)
    rows = []  # time, grains and mass that have left, of all silos
    ends = np.full(len(replicas), SETTLE)
    flowing = ends > 0.0
    while ends.max() < SETTLE + LONGEST and flowing.any():
        seen = [snapshot(sim, replica) for replica in replicas]
        masses = [state.mass[state.position[:, 2] < 0.0] for state in seen]
        rows.append((ends, [len(mass) for mass in masses], [mass.sum() for mass in masses]))
        flowing = np.array(rows[-1][1]) < silos.before + READ
        ends = ends + SAMPLE * flowing
        advance(sim, [float(end) for end in ends])
    small.states(sim)
    time, count, mass = np.array(rows, dtype=float).transpose(1, 2, 0)
    steady = (count > silos.before[:, None]) & (count < silos.before[:, None] + READ)
    return np.array([np.polyfit(time[k][steady[k]], mass[k][steady[k]], 1)[0] for k in replicas])
