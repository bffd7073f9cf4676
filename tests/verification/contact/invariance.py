"""V14, V15, V22: energy stays or falls; ends depend neither on the observer nor on the precision.

V14. Without friction and damping the springs give back what they took: 1e-4 of the energy at 50 steps per
contact. With them the sum of kinetic, gravitational and spring energy may only fall. The total-form
tangential spring stiffens as the contact grows: an impact with e = 1 and mu = 10 gains or loses a little, as
the fine-step integration of the law does.

V15. Grains collide with each other and a floor, with friction, rolling resistance and damping; ends seen in
another way and transformed back must agree. Rounding of 1e-16 (6e-8) grows about a hundredfold in each of the
few collisions on the way.

V22. Single precision, as graphics processors have it, against double, for one contact and for a heap.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from taichi_erosion.core.setup import Floats, Laws, Setup
from taichi_erosion.core.snapshot import Snapshot
from taichi_erosion.simulation import energy_totals
from taichi_erosion.verification.claims import PRECISIONS, Outcome, Precision, below, relative
from tests.verification import small_scenes as small
from tests.verification.contact import bulk
from tests.verification.contact.normal_impact import hertz_cases
from tests.verification.contact.oblique_impact import OXIDE, impact_at, scenes, simulated
from tests.verification.reference.contact import Impact, Rebound, rebound

RADIUS, DENSITY, SPEED = 1e-3, 2500.0, 1.0  # m, kg m-3, m s-1
TOUCH = small.Touch(1e8, 2.5e7, 0.6, 0.4, friction_rolling=0.1, rolling_damping=0.3)
LAWS = Laws(rolling="elastic_plastic")
DURATION = 4e-3  # s, a handful of collisions
SHIFT = np.array([0.7, -0.3, 0.2])  # m s-1, of the moving frame
TURN = Rotation.from_euler("xyz", [0.3, -0.8, 1.1]).as_matrix()
MIRROR = np.diag([-1.0, 1.0, 1.0])
LIMIT: dict[Precision, float] = {"f64": 1e-9, "f32": 2e-2}


@dataclass(frozen=True)
class View:
    """A scene seen in another way; `matrix` is orthogonal, `order` renumbers the grains."""

    name: str
    matrix: Floats
    drift: Floats  # m s-1
    order: NDArray[np.int64]


def cluster(wall: bool) -> Setup:
    """Seven grains that fly at each other above a floor."""
    rng = np.random.default_rng(7)
    directions = np.vstack([np.kron(np.eye(3), [[1], [-1]]), np.zeros(3)])
    position = [0.0, 0.0, 4.5e-3] + 2.4 * RADIUS * directions + rng.uniform(-0.1, 0.1, (7, 3)) * RADIUS
    velocity = -0.5 * SPEED * directions + rng.normal(0.0, 0.1, (7, 3)) - np.array([0.0, 0.0, 0.6])
    spin = rng.normal(0.0, 0.2 * SPEED / RADIUS, (7, 3))
    impact = small.head_on(TOUCH, DENSITY, SPEED, RADIUS, RADIUS)
    grains = small.spheres(position, velocity, spin, RADIUS, 2.0 * impact.mass)
    walls, step = small.FLAT if wall else small.NONE, impact.duration / 100.0
    return small.sphere_setup(grains, TOUCH, step, walls, small.GRAVITY)


def seen(setup: Setup, view: View) -> Setup:
    """The scene in another view; spins turn with the sign of the determinant."""
    matrix, old = view.matrix, setup.grains
    position, velocity = old.position @ matrix.T, old.velocity @ matrix.T + view.drift
    turned = {"position": position, "velocity": velocity, "spin": np.linalg.det(matrix) * old.spin @ matrix.T}
    grains = replace(old, **{name: column[view.order] for name, column in turned.items()})
    shape = setup.primitives.shape.copy()
    shape[:, 0:3], shape[:, 3:6] = shape[:, 0:3] @ matrix.T, shape[:, 3:6] @ matrix.T
    x, y, z = map(float, matrix @ np.array(setup.gravity))
    return replace(setup, grains=grains, primitives=replace(setup.primitives, shape=shape), gravity=(x, y, z))


def brought_back(state: Snapshot, view: View) -> Floats:
    """Position [radii], velocity [speed] and spin [speed/radius] in the original view, [n, 9]."""
    matrix, back = view.matrix, np.argsort(view.order)
    position = (state.position - view.drift * state.time) @ matrix / RADIUS
    velocity = (state.velocity - view.drift) @ matrix / SPEED
    spin = np.linalg.det(matrix) * state.spin @ matrix * RADIUS / SPEED
    return np.concatenate([position, velocity, spin], axis=1)[back]


def invariance() -> Iterator[Outcome]:
    """V15."""
    one, still, ahead = np.eye(3), np.zeros(3), np.arange(7)
    plain = View("as it is", one, still, ahead)
    # a moving frame would set the floor in motion: it is tried without one
    views = [View("moving frame", one, SHIFT, ahead), View("turned scene", TURN, still, ahead)]
    views.append(View("mirror image", MIRROR, still, ahead))
    views.append(View("grains numbered backwards", one, still, ahead[::-1]))
    with_wall, without = cluster(wall=True), cluster(wall=False)
    bare = [without if view.drift.any() else with_wall for view in views]
    setups = [with_wall, without, *(map(seen, bare, views))]
    for precision, limit in LIMIT.items():
        on_wall, free, *others = small.final_states(setups, DURATION, precision, LAWS)
        for view, state in zip(views, others, strict=True):
            wanted = brought_back(free if view.drift.any() else on_wall, plain)
            name = f"{view.name}: change of the end state [radii, speeds]"
            yield below(name, brought_back(state, view) - wanted, limit, precision)


SIDE = 4  # grains along an edge of the starting lattice
STIFF = small.Touch(1e8, 2.5e7)
ROUGH = replace(STIFF, restitution=0.7, friction_sliding=0.5, friction_rolling=0.1, rolling_damping=0.3)
STICKING_ANGLES = np.array([60.0, 70.0, 80.0, 85.0])  # deg


def gas(touch: small.Touch, steps_per_contact: float, seed: int) -> Setup:
    """64 grains on a loose lattice with random velocities and spins, in a box of six planes."""
    rng = np.random.default_rng(seed)
    spacing = 3.0 * RADIUS
    axis = spacing * (np.arange(SIDE) + 0.5)
    position = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1).reshape(-1, 3)
    position += rng.uniform(-0.3, 0.3, position.shape) * RADIUS
    velocity = rng.normal(0.0, SPEED / 4.0, position.shape)
    spin = rng.normal(0.0, SPEED / 4.0 / RADIUS, position.shape)
    impact = small.head_on(touch, DENSITY, SPEED, RADIUS, RADIUS)
    corners = np.repeat([[0.0], [spacing * SIDE]], 3, axis=0) * np.ones(3)
    grains = small.spheres(position, velocity, spin, RADIUS, 2.0 * impact.mass)
    walls = small.planes(*np.hstack([corners, np.vstack([np.eye(3), -np.eye(3)])]))
    return small.sphere_setup(grains, touch, impact.duration / steps_per_contact, walls, small.GRAVITY)


def energy_balance() -> Iterator[Outcome]:
    """V14."""
    setups = [gas(STIFF, 50.0, seed=1), gas(ROUGH, 50.0, seed=2)]
    times = np.linspace(0.0, 0.05, 201)[1:]
    for precision in PRECISIONS:
        sim, sums = small.simulation_of(setups, precision, LAWS), []
        for time in times:
            small.advance_all(sim, time)
            parts = [energy_totals(sim, replica) for replica in range(len(setups))]
            sums.append([p.kinetic_translation + p.kinetic_rotation + p.potential + p.elastic for p in parts])
        conserved, lost = np.array(sums).T
        error = conserved / conserved[0] - 1.0
        yield below("conservative gas: change of energy, relative", error, 1e-4, precision)
        rise = np.maximum(np.diff(lost), 0.0) / lost[0]
        name = "dissipative gas: largest rise of energy between samples, relative"
        yield below(name, rise, 1e-6, precision)
        yield from sticking_outcomes(precision)


def sticking_outcomes(precision: Precision) -> Iterator[Outcome]:
    """Kinetic energy after over before for e = 1, mu = 10, beside the law's own fine-step figure."""
    impact = replace(impact_at(OXIDE, STICKING_ANGLES), restitution=1.0, friction=10.0)
    after, reference = simulated([impact], precision)[0], rebound(impact)
    before = impact.normal**2 + impact.tangential**2
    found, wanted = energy_after(impact, after) / before, energy_after(impact, reference) / before
    for angle, got, want in zip(STICKING_ANGLES, found, wanted, strict=True):
        name = f"e = 1, mu = 10 at {angle:.0f} deg: energy after over before (1 + what the law creates)"
        yield relative(name, got, want, 5e-3, precision)


def energy_after(impact: Impact, after: Rebound) -> Floats:
    """Twice the kinetic energy per mass [m2 s-2]."""
    return after.normal**2 + after.tangential**2 + 0.4 * (impact.radius * after.spin) ** 2


HEAP_SEEDS = (11, 12, 13, 14)


def single_and_double() -> Iterator[Outcome]:
    """V22: impacts to 1e-5 of the speed of approach, a heap within the scatter of its seeds."""
    head_on = [case.setup for case in hertz_cases().values()]
    oblique = scenes(impact_at(OXIDE, np.array([10.0, 30.0, 60.0])))
    for name, setups, steps in (("head-on", head_on, 220), ("oblique", oblique, 2400)):
        ends = [steps * setup.time_step for setup in setups]
        double, single = (small.final_states(setups, ends, p) for p in PRECISIONS)
        errors = []  # largest difference in velocity or spin times radius, over the speed before the impact
        for wide, narrow, setup in zip(double, single, setups, strict=True):
            moving = np.abs(narrow.velocity - wide.velocity).max()
            turning = np.abs((narrow.spin - wide.spin) * wide.radius[:, None]).max()
            errors.append(max(moving, turning) / np.linalg.norm(setup.grains.velocity, axis=1).max())
        yield below(f"{name} impacts: rebound f32 - f64, over the speed", errors, 1e-5, "f32")
    angles = {p: bulk.heap_angles([(bulk.BASE, seed) for seed in HEAP_SEEDS], p) for p in PRECISIONS}
    mean = {name: float(np.mean(found)) for name, found in angles.items()}
    scatter = float(np.std(np.concatenate(list(angles.values())), ddof=1))
    name = f"heap angle [deg], f32 against f64, mean of {len(HEAP_SEEDS)} seeds within their sd"
    yield Outcome(name, mean["f32"], mean["f64"], scatter, "f32")
