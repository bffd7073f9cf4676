"""V34: angles of repose of a few hundred to a few thousand soft glass grains.

Grains are 2 mm glass with the shear modulus lowered to 5 MPa, so that 15 us is a fifth of the Rayleigh time;
the overlap stays below 0.3 % of the radius, where flow and angle do not depend on stiffness. Angles of small
heaps of a lifted tube, on side silhouettes, show trends. The plate heap is the discharge apparatus of Zhou et
al. (2002) in the limit of a thick container.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import binned_statistic

from taichi_erosion.core.setup import Floats, GrainTable, Laws, Motion, PrimitiveKind, PrimitiveTable, Setup
from taichi_erosion.core.snapshot import Snapshot
from taichi_erosion.measures.heap import repose_angle
from taichi_erosion.simulation import move_surface, remove_surface
from taichi_erosion.verification.claims import Outcome, Precision, holds
from taichi_erosion.verification.closed_forms import sphere_mass
from tests.verification import small_scenes as small
from tests.verification.reference import flow as exact
from tests.verification.reference.contact import Solid

DIAMETER = 2e-3  # m
SOFT_GLASS = Solid(1.25e7, 0.25, 2500.0)
MASS = sphere_mass(DIAMETER / 2.0, SOFT_GLASS.density)
TIME_STEP = 1.5e-5  # s
LATTICE = 1.1  # grain diameters between the centres of a loose filling [1]


def soft_touch(friction: float, friction_rolling: float, surface_energy: float = 0.0) -> small.Touch:
    """Contact of two soft glass grains; walls are given the same."""
    touch = small.touch_of(SOFT_GLASS, SOFT_GLASS, restitution=0.5, friction=friction)
    rolling = {"friction_rolling": friction_rolling, "rolling_damping": 0.3}
    return replace(touch, surface_energy=surface_energy, **rolling)


def loose_grains(
    count: int, half_width: tuple[float, float], round_base: bool, seed: int, pitch: float = LATTICE
) -> GrainTable:
    """`count` grains on a shaken lattice above z = 0, within a circle or a rectangle about the origin [m]."""
    rng = np.random.default_rng(seed)
    spacing = pitch * DIAMETER
    room = np.array(half_width) - 0.55 * DIAMETER
    numbers = np.floor(room / spacing).astype(int)
    x, y = (spacing * np.arange(-n, n + 1) for n in numbers)
    layer = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2)
    if round_base:
        layer = layer[np.hypot(layer[:, 0], layer[:, 1]) <= room[0]]
    height = spacing * (np.arange(-(-count // len(layer))) + 0.55)
    place = np.concatenate([np.column_stack([layer, np.full(len(layer), z)]) for z in height])[:count]
    place += rng.uniform(-0.04, 0.04, place.shape) * DIAMETER
    return small.spheres(place, rng.normal(0.0, 0.05, place.shape), 0.0, DIAMETER / 2.0, MASS)


def revolved_segment(first: tuple[float, float], second: tuple[float, float]) -> PrimitiveTable:
    """Segment between two points (radius, height) [m], turned about the z axis."""
    return small.primitive_table(PrimitiveKind.REVOLVED, (*small.FLOOR, *first, *second))


def strip(left: float, right: float) -> list[list[float]]:
    """Two triangles at z = 0 between two x [m], along y much longer than any period."""
    y = 100.0 * DIAMETER
    a, b, c, d = [left, -y, 0.0], [right, -y, 0.0], [right, y, 0.0], [left, y, 0.0]
    return [a + b + c, a + c + d]


def periodic(setup: Setup, width: float) -> Setup:
    """The scene in a domain with a period along y [m], open elsewhere."""
    corner = np.array([np.inf, width / 2.0, np.inf])
    low, high = tuple(map(float, -corner)), tuple(map(float, corner))
    return replace(setup, domain=(low, high), period=(0.0, width, 0.0))


def plate_scene(touch: small.Touch, seed: int) -> Setup:
    """Grains on a plate between dams, periodic along y; wall0 plate, wall1 and wall2 dams, wall3 floor."""
    width, x = 5.0 * DIAMETER, PLATE_HALF
    dams = (-x, 0.0, 0.0, 1.0, 0.0, 0.0), (x, 0.0, 0.0, -1.0, 0.0, 0.0)
    plate = small.primitive_table(PrimitiveKind.TRIANGLE, strip(-x, x))
    walls = small.joined(plate, small.planes(*dams, (0.0, 0.0, -12.0 * DIAMETER, 0.0, 0.0, 1.0)))
    grains = loose_grains(PLATE_COUNT, (x, width / 2.0), False, seed)
    return periodic(small.sphere_setup(grains, touch, TIME_STEP, walls, small.GRAVITY), width)


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
    """A column in a tube that will be lifted: surface wall0 is the floor, wall1 the tube."""
    energy = setting.bond * MASS * 9.81 / (3.0 * np.pi * DIAMETER / 4.0)
    touch = soft_touch(setting.friction, setting.friction_rolling, energy)
    grains = loose_grains(COUNT, (TUBE_RADIUS, TUBE_RADIUS), True, seed)
    walls = small.joined(small.FLAT, revolved_segment((TUBE_RADIUS, 0.0), (TUBE_RADIUS, 60.0 * DIAMETER)))
    return small.sphere_setup(grains, touch, TIME_STEP, walls, small.GRAVITY)


def heap_angles(runs: Sequence[tuple[Setting, int]], precision: Precision) -> Floats:
    """Angle of repose of each (setting, seed) [deg]."""
    sim = small.simulation_of([heap_scene(*run) for run in runs], precision, ADHESIVE)
    small.advance_all(sim, HEAP_SETTLE)
    for replica in range(len(runs)):
        move_surface(sim, replica, "wall1", Motion(velocity=(0.0, 0.0, LIFT_SPEED)))
    small.advance_all(sim, HEAP_SETTLE + LIFTED)
    for replica in range(len(runs)):
        remove_surface(sim, replica, "wall1")
    small.advance_all(sim, HEAP_SETTLE + LIFTED + REST)
    return np.array([repose_angle(state).value for state in small.states(sim)])


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
    setups = [plate_scene(touch, seed) for seed in SEEDS]
    sim = small.simulation_of(setups, "f32", ROLLING)
    small.advance_all(sim, HEAP_SETTLE)
    for replica in range(len(setups)):
        remove_surface(sim, replica, "wall1")
        remove_surface(sim, replica, "wall2")
    small.advance_all(sim, HEAP_SETTLE + 0.9)
    angles = np.array([plate_angle(state) for state in small.states(sim)])
    # the torque mu_r R* F is a length times F: R* is a quarter of the diameter between grains, half of it
    # at the plate
    lengths = PLATE_ROLLING * DIAMETER / 4.0, PLATE_ROLLING * DIAMETER / 2.0
    wanted = exact.zhou_angle(PLATE_FRICTION, PLATE_FRICTION, *lengths, DIAMETER)
    name = f"plate heap of 2 mm glass against Zhou (2002) [deg], seed sd {angles.std(ddof=1):.1f} deg"
    yield Outcome(name, float(angles.mean()), wanted, 3.0, "f32")


def plate_angle(state: Snapshot) -> float:
    """Mean slope of the two flanks of the heap on the plate, without its edge and its ridge [deg]."""
    on_plate = (np.abs(state.position[:, 0]) < PLATE_HALF) & (state.position[:, 2] > 0.0)
    x, top = state.position[on_plate, 0], state.position[on_plate, 2] + state.radius[on_plate]
    bins = binned_statistic(x, top, "max", round(2.0 * PLATE_HALF / DIAMETER), (-PLATE_HALF, PLATE_HALF))
    middle, height = 0.5 * (bins.bin_edges[1:] + bins.bin_edges[:-1]), np.nan_to_num(bins.statistic)
    inner = (np.abs(middle) > 0.2 * PLATE_HALF) & (np.abs(middle) < 0.8 * PLATE_HALF)
    flanks = inner & (middle < 0), inner & (middle > 0)
    slopes = [np.polyfit(np.abs(middle[side]), height[side], 1)[0] for side in flanks]
    return float(np.degrees(np.arctan(-np.mean(slopes))))
