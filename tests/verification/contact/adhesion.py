"""V17-V20: JKR landmarks, the speed of sticking, the limit of no adhesion, and the caps of friction.

Two spheres without damping touch at zero overlap, where the neck snaps in, dip, and part when the neck
tears; forces are second differences of the path, so they are those of the simulator. Overlaps are in units
of L^2/R*, forces in pi gamma R*.
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from taichi_erosion.core.setup import Floats, Laws, Setup
from taichi_erosion.simulation import advance
from taichi_erosion.verification.claims import PRECISIONS, Outcome, Precision, below, holds, relative
from taichi_erosion.verification.closed_forms import sphere_mass
from tests.verification import small_scenes as small
from tests.verification.reference import contact as jkr

RADIUS, DENSITY = 0.5e-3, 2500.0  # m, kg m-3
MASS = sphere_mass(RADIUS, DENSITY)
TOUCH = small.Touch(1e8, 2.5e7, surface_energy=0.5)
PAIR = jkr.AdhesivePair(TOUCH.young_effective, RADIUS / 2.0, MASS / 2.0, TOUCH.surface_energy)
JKR = Laws(normal="jkr")
EDEM = Laws(normal="jkr", adhesion_branch="edem", friction_cap="edem")
SPEED = 1.1 * PAIR.speed_sticking  # m s-1, slow where the neck tears
PULL_OFF_AT, TEAR_AT = jkr.overlap_at(jkr.CUBE_PULL_OFF), jkr.overlap_at(jkr.CUBE_TEAR)
BALANCE_AT = jkr.overlap_at(jkr.CUBE_BALANCE)
STEPS_PER_DEPTH = 800  # in which the pair moves by L^2/R* at its first speed [1]
LONGEST_BOUNCE = 16  # times in which the pair moves by L^2/R* at its first speed [1]
NEAR, SPARSE = 0.06, 40  # L^2/R* around a landmark, and steps between samples elsewhere [1]


def pair_scene(speed: float, steps_per_depth: float, overlap: float = -1e-3) -> Setup:
    """Two spheres along x that approach with relative speed `speed` from `overlap` [L^2/R*]."""
    step = PAIR.depth / speed / steps_per_depth
    half = RADIUS - 0.5 * overlap * PAIR.depth
    place, velocity = [[-half, 0, 0], [half, 0, 0]], [[speed / 2, 0, 0], [-speed / 2, 0, 0]]
    return small.sphere_setup(small.spheres(place, velocity, 0.0, RADIUS, MASS), TOUCH, step)


def bounce() -> tuple[Floats, Floats]:
    """Overlap [L^2/R*] and force [pi gamma R*] along one bounce, at every step near landmarks."""
    setup = pair_scene(SPEED, STEPS_PER_DEPTH)
    sim = small.simulation_of([setup], "f64", JKR)
    found: list[tuple[int, float]] = []
    step = 1
    while step < LONGEST_BOUNCE * STEPS_PER_DEPTH:
        advance(sim, [step * setup.time_step])
        state = small.states(sim)[0]
        found.append((state.step, state.position[1, 0] - state.position[0, 0]))
        overlap = (2.0 * RADIUS - found[-1][1]) / PAIR.depth
        nearest = min(abs(overlap - landmark) for landmark in (TEAR_AT, PULL_OFF_AT, 0.0, BALANCE_AT))
        dense = nearest < NEAR and overlap > TEAR_AT - 0.02  # past the tear nothing happens any more
        # three samples in a row give one force
        step = state.step + (1 if dense or len(found) % 3 else SPARSE)
    step, gap = np.array(found).T
    middle = np.flatnonzero((np.diff(step)[:-1] == 1) & (np.diff(step)[1:] == 1)) + 1
    pull = (gap[middle + 1] - 2.0 * gap[middle] + gap[middle - 1]) / setup.time_step**2
    return (2.0 * RADIUS - gap[middle]) / PAIR.depth, PAIR.mass * pull / PAIR.force_scale


def landmarks() -> Iterator[Outcome]:
    """V17: 0.1 % of each landmark; forces in double precision, which their second differences need."""
    overlap, force = bounce()
    acts = np.flatnonzero(np.abs(force) > 0.5)
    parting = slice(int(np.argmax(np.diff(overlap) < 0.0)) + 1, int(acts[-1]) + 1)
    d, f = overlap[parting], force[parting]
    before, near = d > 0.5 * BALANCE_AT, np.abs(d - PULL_OFF_AT) < NEAR
    turns = np.real(np.asarray(np.polynomial.Polynomial.fit(d[near], f[near], 3).deriv().roots()))
    for name, got, want in (
        ("force at zero overlap [pi gamma R*]", np.interp(0.0, d[::-1], f[::-1]), -8.0 / 3.0),
        ("pull-off force [pi gamma R*]", f.min(), -3.0),
        ("overlap at pull-off [L^2/R*]", turns[np.argmin(np.abs(turns - PULL_OFF_AT))], PULL_OFF_AT),
        ("overlap of zero force [L^2/R*]", np.interp(0.0, f[before][::-1], d[before][::-1]), BALANCE_AT),
        ("overlap at the tear [L^2/R*]", d[-1], TEAR_AT),
    ):
        yield relative(f"JKR: {name}", got, want, 1e-3, "f64")
    error = (f - [jkr.branch_force(one) for one in d]) / 3.0
    yield below("JKR: force while parting off the law, over the pull-off force", error, 1e-3, "f64")
    for precision in PRECISIONS:
        yield from energy_outcomes(precision)
        yield from branch_outcomes(precision)


def energy_outcomes(precision: Precision) -> Iterator[Outcome]:
    """Work lost in a bounce, restitution sqrt(1 - (v_s/v)^2), and energy astray beyond that work."""
    shares = np.array([1.05, 1.2, 1.5, 2.0, 4.0, 10.0])
    speeds = shares * PAIR.speed_sticking
    # the force jumps at first touch: the energy is right to the first order of the step only
    setups = [pair_scene(speed, 8000.0) for speed in speeds]
    ends = small.final_states(setups, 30.0 * PAIR.depth / PAIR.speed_sticking, precision, JKR)
    out = np.array([end.velocity[1, 0] - end.velocity[0, 0] for end in ends])
    brought = 0.5 * PAIR.mass * speeds**2
    lost = brought - 0.5 * PAIR.mass * out**2
    work = lost[0] / (np.pi * PAIR.energy * PAIR.length**2)
    yield relative("JKR: work lost in a bounce [pi gamma L^2]", work, jkr.WORK_LOST, 1e-3, precision)
    error = out / speeds - np.sqrt(1.0 - shares**-2.0)
    name = "JKR: restitution minus sqrt(1 - (v_s/v)^2), v/v_s from 1.05 to 10"
    yield below(name, error, 1e-3, precision)
    name = "JKR: energy drift of a bounce beyond the work lost, over the energy brought"
    # single precision adds its rounding over a hundred thousand steps
    limit = 1e-4 if precision == "f64" else 1e-3
    yield below(name, (lost - PAIR.work_lost) / brought, limit, precision)


def branch_outcomes(precision: Precision) -> Iterator[Outcome]:
    """Branch `touch` does not pull before contact; branch `edem` does, and gives back what it took."""
    for laws in (JKR, EDEM):
        setup = pair_scene(SPEED, STEPS_PER_DEPTH, 0.5 * TEAR_AT)
        path = small.trace([setup], setup.time_step * np.arange(1.0, 4.0), precision, laws)
        place = path.position[:, 0, :, 0]
        force = -MASS * np.diff(place[:, 1], 2)[0] / np.diff(path.time[:, 0])[0] ** 2 / PAIR.force_scale
        at = (2.0 * RADIUS - place[1, 1] + place[1, 0]) / PAIR.depth
        wanted = -jkr.branch_force(at) if laws is EDEM else 0.0
        name = f"JKR branch {laws.adhesion_branch}: pull before touch [pi gamma R*]"
        yield Outcome(name, float(force), float(wanted), 3e-3, precision)
    approaching = pair_scene(SPEED, 8000.0, 1.01 * TEAR_AT)
    end = small.final_states([approaching], 30.0 * PAIR.depth / SPEED, precision, EDEM)[0]
    ratio = (end.velocity[1, 0] - end.velocity[0, 0]) / SPEED
    yield relative("JKR branch edem: restitution of a bounce", ratio, 1.0, 1e-3, precision)


def sticking_speed() -> Iterator[Outcome]:
    """V18: the slowest approach that parts again, 1 %; the neck tears at a gap of 1.19 L^2/R*."""
    shares = np.linspace(0.95, 1.05, 41)
    setups = [pair_scene(share * PAIR.speed_sticking, 500.0) for share in shares]
    for precision in PRECISIONS:
        ends = small.final_states(setups, 200.0 * PAIR.depth / PAIR.speed_sticking, precision, JKR)
        gaps = np.array([end.position[1, 0] - end.position[0, 0] for end in ends]) - 2.0 * RADIUS
        parted = gaps > 2.4 * PAIR.depth
        slowest = shares[parted].min() if parted.any() else np.nan
        wanted = PAIR.speed_sticking
        yield relative("sticking speed [m/s]", slowest * wanted, wanted, 0.01, precision)
        in_order = bool(np.all(np.diff(parted * 1) >= 0))
        yield holds("all slower pairs stick, all faster ones part", in_order, precision)


def vanishing_adhesion() -> Iterator[Outcome]:
    """V19: with gamma -> 0 an oblique, damped impact under the JKR law is the one under Hertz, 1e-6."""
    energies = (0.0, 1e-15, 1e-12)
    bare = replace(TOUCH, restitution=0.7, friction_sliding=0.4, surface_energy=0.0)
    impact = small.head_on(bare, DENSITY, 1.0, RADIUS)
    step = impact.duration / 500.0
    grain = small.spheres([[0.0, 0.0, RADIUS + 3.5 * step]], [[0.8, 0.0, -1.0]], 0.0, RADIUS, MASS)
    touches = [replace(bare, surface_energy=energy) for energy in energies]
    setups = [small.sphere_setup(grain, touch, step, small.FLAT) for touch in touches]
    times = np.linspace(0.0, 2.0 * impact.duration, 101)[1:]
    for precision in PRECISIONS:
        hertz = small.trace(setups[:1], times, precision).velocity
        errors = (small.trace(setups, times, precision, JKR).velocity - hertz) / impact.speed
        for k, energy in enumerate(energies):
            name = f"JKR with gamma = {energy:g} J/m2 against Hertz: velocity along an impact, over its speed"
            yield below(name, errors[:, k], 1e-6 if precision == "f64" else 1e-4, precision)


def friction_caps() -> Iterator[Outcome]:
    """V20: at F = 0 friction slides at mu 6 pi gamma R* (`thornton`) or mu 12 pi gamma R* (`edem`), 0.1 %."""
    friction = 0.3
    touch = replace(TOUCH, friction_sliding=friction, restitution=0.5)
    stuck = jkr.AdhesivePair(touch.young_effective, RADIUS, MASS, touch.surface_energy)
    for laws, factor in ((JKR, 6.0), (EDEM, 12.0)):
        speed = 2e-3 * (friction * factor * stuck.force_scale) / MASS * 7.0 / 2.0  # rolls after 2 ms
        step = small.head_on(touch, DENSITY, 0.1, RADIUS).duration / 100.0
        height = RADIUS - BALANCE_AT * stuck.depth
        grain = small.spheres([[0, 0, height]], [[speed, 0, 0]], 0.0, RADIUS, MASS)
        for precision in PRECISIONS:
            setup = small.sphere_setup(grain, touch, step, small.FLAT)
            path = small.trace([setup], np.array([0.5e-3, 1.5e-3]), precision, laws)
            force = -MASS * np.diff(path.velocity[:, 0, 0, 0]) / np.diff(path.time[:, 0])
            name = f"friction at F = 0, cap {laws.friction_cap}, over mu pi gamma R*"
            yield relative(name, force[0] / (friction * stuck.force_scale), factor, 1e-3, precision)
