"""V33, V34: discharge of silos and angles of repose, by a few hundred to a few thousand soft glass grains.

Grains are 2 mm glass with the shear modulus lowered to 5 MPa, so that 15 us is a fifth of the Rayleigh
time; in beds of a few centimetres the overlap stays below 0.3 % of the radius, where flow and angle do not
depend on stiffness.

V34. Angles of repose rise with friction, rolling friction and adhesion; the angle of a plate heap is that
of Zhou's formula. Heaps of a lifted tube, an ensemble of settings and seeds in one launch; the angle is
measured on side silhouettes. They are small (a few hundred grains), so the angles are those of this
apparatus, good for trends. The plate heap is the discharge apparatus of Zhou et al. (2002) in the limit of a
thick container.

V33. Grains flow out of flat-bottomed silos as (D - k d)^(5/2) through round holes, with 3/2 through slots.

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

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from taichi_erosion.core.setup import Floats, GrainTable, Laws, Motion, PrimitiveKind, PrimitiveTable, Setup
from taichi_erosion.core.snapshot import Snapshot
from taichi_erosion.measures.repose import repose_angle
from taichi_erosion.simulation import Simulation, advance, move_surface, remove_surface, snapshot
from taichi_erosion.verification import small_scenes
from taichi_erosion.verification.claim import Outcome, Precision, holds
from taichi_erosion.verification.reference import flow as exact
from taichi_erosion.verification.reference.contact import Solid, sphere_mass
from taichi_erosion.verification.small_scenes import Touch

DIAMETER = 2e-3  # m
SOFT_GLASS = Solid(1.25e7, 0.25, 2500.0)
MASS = sphere_mass(DIAMETER / 2.0, SOFT_GLASS.density)
TIME_STEP = 1.5e-5  # s
GRAVITY = (0.0, 0.0, -9.81)  # m s-2
LATTICE = 1.1  # grain diameters between the centres of a loose filling [1]
SLOT_LENGTH = 5.6 * DIAMETER  # m, five rows of a loose filling; the period along a slot
TRAY = (0.0, 0.0, -30.0 * DIAMETER, 0.0, 0.0, 1.0)  # plane far below a silo
PLUG = "wall2"  # of a silo's opening


def soft_touch(friction: float, friction_rolling: float, surface_energy: float = 0.0) -> Touch:
    """Contact of two soft glass grains; walls are given the same."""
    return replace(
        small_scenes.touch_of(SOFT_GLASS, SOFT_GLASS, restitution=0.5, friction=friction),
        friction_rolling=friction_rolling,
        rolling_damping=0.3,
        surface_energy=surface_energy,
    )


def loose_grains(count: int, half_width: tuple[float, float], round_base: bool, seed: int) -> GrainTable:
    """`count` grains on a shaken lattice above z = 0, within a circle or a rectangle about the origin [m]."""
    rng = np.random.default_rng(seed)
    spacing = LATTICE * DIAMETER
    room = np.array(half_width) - 0.55 * DIAMETER
    numbers = np.floor(room / spacing).astype(int)
    x, y = (spacing * np.arange(-n, n + 1) for n in numbers)
    layer = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2)
    if round_base:
        layer = layer[np.hypot(layer[:, 0], layer[:, 1]) <= room[0]]
    layers = -(-count // len(layer))
    height = spacing * (np.arange(layers) + 0.55)
    place = np.concatenate([np.column_stack([layer, np.full(len(layer), z)]) for z in height])[:count]
    place += rng.uniform(-0.04, 0.04, place.shape) * DIAMETER
    return small_scenes.spheres(place, rng.normal(0.0, 0.05, place.shape), 0.0, DIAMETER / 2.0, MASS)


def revolved_segment(first: tuple[float, float], second: tuple[float, float]) -> PrimitiveTable:
    """Segment between two points (radius, height) [m], turned about the z axis."""
    return small_scenes.primitive_table(
        PrimitiveKind.REVOLVED, [(0.0, 0.0, 0.0, 0.0, 0.0, 1.0, *first, *second)]
    )


def column_scene(touch: Touch, count: int, radius: float, seed: int) -> Setup:
    """Grains in a tube on a floor: surface wall0 is the floor, wall1 the tube."""
    grains = loose_grains(count, (radius, radius), True, seed)
    tube = revolved_segment((radius, 0.0), (radius, 60.0 * DIAMETER))
    return small_scenes.sphere_setup(
        grains, touch, TIME_STEP, small_scenes.joined(small_scenes.planes(small_scenes.FLOOR), tube), GRAVITY
    )


def silo_scene(touch: Touch, count: int, width: float, hole: float, seed: int) -> Setup:
    """A flat-bottomed round silo with a round hole [m].

    wall0 tube, wall1 bottom, wall2 plug, wall3 tray below.
    """
    radius, reach = width / 2.0, hole / 2.0
    grains = loose_grains(count, (radius, radius), True, seed)
    walls = small_scenes.joined(
        revolved_segment((radius, 0.0), (radius, 80.0 * DIAMETER)),
        revolved_segment((reach, 0.0), (radius, 0.0)),
        revolved_segment((0.0, 0.0), (reach, 0.0)),
        small_scenes.planes(TRAY),
    )
    return small_scenes.sphere_setup(grains, touch, TIME_STEP, walls, GRAVITY)


def slot_scene(touch: Touch, count: int, width: float, slot: float, seed: int) -> Setup:
    """A flat-bottomed silo with a slot [m], periodic along it.

    wall0 and wall1 sides, wall2 plug, wall3 bottom, wall4 tray below.
    """
    half, reach = width / 2.0, slot / 2.0
    walls = small_scenes.joined(
        small_scenes.planes((-half, 0.0, 0.0, 1.0, 0.0, 0.0), (half, 0.0, 0.0, -1.0, 0.0, 0.0)),
        small_scenes.primitive_table(PrimitiveKind.TRIANGLE, strip(-reach, reach)),
        small_scenes.primitive_table(PrimitiveKind.TRIANGLE, strip(-half, -reach) + strip(reach, half)),
        small_scenes.planes(TRAY),
    )
    grains = loose_grains(count, (half, SLOT_LENGTH / 2.0), False, seed)
    return periodic(small_scenes.sphere_setup(grains, touch, TIME_STEP, walls, GRAVITY), SLOT_LENGTH)


def strip(left: float, right: float) -> list[list[float]]:
    """Two triangles at z = 0 between two x [m], along y much longer than any period."""
    y = 100.0 * DIAMETER
    corners = [[left, -y, 0.0], [right, -y, 0.0], [right, y, 0.0], [left, y, 0.0]]
    return [corners[0] + corners[1] + corners[2], corners[0] + corners[2] + corners[3]]


def periodic(setup: Setup, width: float) -> Setup:
    """The scene in a domain with a period along y [m], open elsewhere."""
    corner = np.array([np.inf, width / 2.0, np.inf])
    low, high = tuple(map(float, -corner)), tuple(map(float, corner))
    return replace(setup, domain=(low, high), period=(0.0, width, 0.0))


def plate_scene(touch: Touch, count: int, half_length: float, seed: int) -> Setup:
    """Grains on a plate between dams, periodic along y; wall0 plate, wall1 and wall2 dams, wall3 floor.

    The front and back walls of the apparatus are left out: its formula is for containers so thick that they
    do not matter.
    """
    width, x = 5.0 * DIAMETER, half_length
    dams = (-x, 0.0, 0.0, 1.0, 0.0, 0.0), (x, 0.0, 0.0, -1.0, 0.0, 0.0)
    floor = (0.0, 0.0, -12.0 * DIAMETER, 0.0, 0.0, 1.0)
    walls = small_scenes.joined(
        small_scenes.primitive_table(PrimitiveKind.TRIANGLE, strip(-x, x)), small_scenes.planes(*dams, floor)
    )
    grains = loose_grains(count, (x, width / 2.0), False, seed)
    return periodic(small_scenes.sphere_setup(grains, touch, TIME_STEP, walls, GRAVITY), width)


ADHESIVE, ROLLING = Laws(normal="jkr", rolling="elastic_plastic"), Laws(rolling="elastic_plastic")
COUNT, TUBE_RADIUS = 800, 6.0 * DIAMETER
HEAP_SETTLE, LIFT_SPEED, LIFTED, REST = 0.12, 0.08, 0.24, 0.20  # s, m s-1, s, s
SEEDS = (1, 2, 3)
PLATE_COUNT, PLATE_HALF = 1500, 16.0 * DIAMETER
PLATE_FRICTION, PLATE_ROLLING = 0.4, 0.02


@dataclass(frozen=True)
class Setting:
    """What the angle is asked to depend on."""

    friction: float = 0.5
    friction_rolling: float = 0.1
    bond: float = 0.0  # pull-off force 3 pi gamma R* over the weight of a grain [1]


BASE = Setting()
TRENDS: dict[str, Sequence[Setting]] = {
    "friction 0.15, 0.3, 0.6": [replace(BASE, friction=mu) for mu in (0.15, 0.3, 0.6)],
    "rolling friction 0.02, 0.1, 0.4": [replace(BASE, friction_rolling=mu) for mu in (0.02, 0.1, 0.4)],
    "Bond number 0, 2, 8": [replace(BASE, bond=bond) for bond in (0.0, 2.0, 8.0)],
}


def heap_scene(setting: Setting, seed: int) -> Setup:
    """A column in a tube that will be lifted."""
    energy = setting.bond * MASS * 9.81 / (3.0 * np.pi * DIAMETER / 4.0)
    touch = soft_touch(setting.friction, setting.friction_rolling, energy)
    return column_scene(touch, COUNT, TUBE_RADIUS, seed)


def heap_angles(runs: Sequence[tuple[Setting, int]], precision: Precision) -> Floats:
    """Angle of repose of each (setting, seed) [deg]."""
    sim = small_scenes.simulation_of(
        [heap_scene(setting, seed) for setting, seed in runs], precision, ADHESIVE
    )
    small_scenes.advance_all(sim, HEAP_SETTLE)
    for replica in range(len(runs)):
        move_surface(sim, replica, "wall1", Motion(velocity=(0.0, 0.0, LIFT_SPEED)))
    small_scenes.advance_all(sim, HEAP_SETTLE + LIFTED)
    for replica in range(len(runs)):
        remove_surface(sim, replica, "wall1")
    small_scenes.advance_all(sim, HEAP_SETTLE + LIFTED + REST)
    return np.array([repose_angle(state).value for state in small_scenes.states(sim)])


def repose_trends() -> Iterator[Outcome]:
    """V34."""
    settings = list(dict.fromkeys(setting for group in TRENDS.values() for setting in group))
    runs = [(setting, seed) for setting in settings for seed in SEEDS]
    found = heap_angles(runs, "f32").reshape(len(settings), len(SEEDS))
    mean = dict(zip(settings, found.mean(axis=1), strict=True))
    sd = float(np.sqrt(np.mean(found.var(axis=1, ddof=1))))
    for name, group in TRENDS.items():
        angles = [mean[setting] for setting in group]
        listed = ", ".join(f"{angle:.1f}" for angle in angles)
        sentence = f"repose angle rises with {name}: {listed} deg, seed sd {sd:.1f} deg"
        yield holds(sentence, bool(np.all(np.diff(angles) > 0.0)), "f32")
    yield from plate_outcomes()


def plate_outcomes() -> Iterator[Outcome]:
    """Plate heap of 2 mm glass against Zhou's formula, 3 deg."""
    touch = soft_touch(PLATE_FRICTION, PLATE_ROLLING)
    setups = [plate_scene(touch, PLATE_COUNT, PLATE_HALF, seed) for seed in SEEDS]
    sim = small_scenes.simulation_of(setups, "f32", ROLLING)
    small_scenes.advance_all(sim, HEAP_SETTLE)
    for replica in range(len(setups)):
        remove_surface(sim, replica, "wall1")
        remove_surface(sim, replica, "wall2")
    small_scenes.advance_all(sim, HEAP_SETTLE + 0.9)
    angles = np.array([plate_angle(state) for state in small_scenes.states(sim)])
    # the torque mu_r R* F is a length times F: R* is a quarter of the diameter between grains, half of it
    # at the plate
    lengths = PLATE_ROLLING * DIAMETER / 4.0, PLATE_ROLLING * DIAMETER / 2.0
    wanted = exact.zhou_angle(PLATE_FRICTION, PLATE_FRICTION, *lengths, DIAMETER)
    name = f"plate heap of 2 mm glass against Zhou (2002) [deg], seed sd {angles.std(ddof=1):.1f} deg"
    yield Outcome(name, float(angles.mean()), wanted, 3.0, "f32")


def plate_angle(state: Snapshot) -> float:
    """Mean slope of the two flanks of the heap on the plate [deg].

    Height of the highest grain in bins of one diameter along x; a line through the bins from 20 % to 80 %
    of the way from the edge of the plate to the ridge.
    """
    on_plate = (np.abs(state.position[:, 0]) < PLATE_HALF) & (state.position[:, 2] > 0.0)
    x, top = state.position[on_plate, 0], state.position[on_plate, 2] + state.radius[on_plate]
    edges = np.arange(-PLATE_HALF, PLATE_HALF + 0.5 * DIAMETER, DIAMETER)
    bins = np.digitize(x, edges) - 1
    middle = 0.5 * (edges[1:] + edges[:-1])
    height = np.array([top[bins == k].max() if np.any(bins == k) else 0.0 for k in range(len(middle))])
    inner = (np.abs(middle) > 0.2 * PLATE_HALF) & (np.abs(middle) < 0.8 * PLATE_HALF)
    slopes = [
        np.polyfit(np.abs(middle[side]), height[side], 1)[0]
        for side in (inner & (middle < 0), inner & (middle > 0))
    ]
    return float(np.degrees(np.arctan(-np.mean(slopes))))


HEAD = 1.2  # of the filling over the width of the silo when the reading ends [1]
GRAINS_PER_CUBE = 1.15  # grains per cube of the diameter in a filling of packing 0.6, denser than ours [1]
SILO_SETTLE, SAMPLE, LONGEST = 0.17, 0.005, 2.0  # s
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
        return GRAINS_PER_CUBE * self.mouths * self.openings

    @property
    def until(self) -> Floats:
        """Grains that have left each silo when reading ends."""
        narrowest = self.openings == self.openings.min()
        return self.before + np.where(narrowest, READ_NARROWEST, READ)

    @property
    def stock(self) -> Floats:
        """Grains in each silo."""
        return np.ceil(GRAINS_PER_CUBE * HEAD * self.widths * self.sections + self.until)


def with_holes(*holes: float) -> Silos:
    """Round silos of 2.5 holes."""
    opening = np.array(holes)
    width = 2.5 * opening
    sections = 0.25 * np.pi * width**2, 0.25 * np.pi * opening**2
    return Silos("round holes", exact.HOLE_EXPONENT, opening, width, *sections, 1.0, silo_scene)


def with_slots(*slots: float) -> Silos:
    """Silos 30 diameters wider than their slots."""
    opening, length = np.array(slots), SLOT_LENGTH / DIAMETER
    width = opening + 30.0
    sections = length * width, length * opening
    return Silos("slots", exact.SLOT_EXPONENT, opening, width, *sections, SLOT_LENGTH, slot_scene)


HOLES, SLOTS = with_holes(6.0, 7.5, 9.0), with_slots(6.0, 8.0, 11.0)


def opening_flow() -> Iterator[Outcome]:
    """V33."""
    for silos in (HOLES, SLOTS):
        yield discharged(silos)


def settled(silos: Silos) -> Simulation:
    """The silos with their fillings at rest."""
    touch = soft_touch(FRICTION, FRICTION_ROLLING)
    rows = zip(silos.stock, silos.widths * DIAMETER, silos.openings * DIAMETER, strict=True)
    setups = [silos.scene(touch, int(n), width, opening, k) for k, (n, width, opening) in enumerate(rows)]
    sim = small_scenes.simulation_of(setups, "f32", ROLLING)
    small_scenes.advance_all(sim, SILO_SETTLE)
    return sim


def discharged(silos: Silos) -> Outcome:
    """Exponent of the flow in the width of one kind of opening."""
    sim = settled(silos)
    density = bulk_density(sim, silos)
    flow = MASS * discharge_rates(sim, silos)
    opening = silos.openings * DIAMETER
    edge, exponent = exact.discharge_fit(opening, DIAMETER, flow)
    plain, _ = exact.discharge_exponent(opening, DIAMETER, flow, exact.BEVERLOO_EDGE)
    given = exact.discharge_edge(opening, DIAMETER, flow, silos.exponent)
    factors = exact.discharge_coefficient(flow / silos.length, density, opening, DIAMETER, silos.exponent)
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
    for state in small_scenes.states(sim):
        height = state.position[:, 2] / DIAMETER
        masses.append(MASS * np.count_nonzero((height > low) & (height < high)))
    return np.array(masses) / (silos.sections * (high - low) * DIAMETER**3)


def discharge_rates(sim: Simulation, silos: Silos) -> Floats:
    """Grains per second through each opening once its plug is taken out."""
    replicas = len(sim.setups)
    for replica in range(replicas):
        remove_surface(sim, replica, PLUG)
    times, passed = [], []
    ends = np.full(replicas, SILO_SETTLE)
    while ends.max() < SILO_SETTLE + LONGEST:
        left = [int(np.count_nonzero(snapshot(sim, k).position[:, 2] < 0.0)) for k in range(replicas)]
        times.append(ends.copy())
        passed.append(left)
        flowing = np.array(left) < silos.until
        if not flowing.any():
            break
        ends = ends + SAMPLE * flowing
        advance(sim, [float(end) for end in ends])
    small_scenes.states(sim)
    series = zip(np.array(times).T, np.array(passed).T, silos.before, silos.until, strict=True)
    return np.array([steady_slope(*silo) for silo in series])


def steady_slope(time: Floats, passed: Floats, first: float, last: float) -> float:
    """Slope of grains passed against time while between two numbers of them have left [s-1]."""
    steady = (passed > first) & (passed < last)
    return float(np.polyfit(time[steady], passed[steady], 1)[0])
