"""V05-V08: oblique and spinning impacts on a plane and between two spheres (tests 4 and 6-8 of Chung & Ooi).

Angles are of incidence, from the normal. The patch angle is that of the contact point's velocity after the
impact, atan((v_t' + R omega')/v_n'). While the contact slides throughout,

    v_t' = v_t - mu (1 + e) v_n,    R omega' = -(5/2) mu (1 + e) v_n,
    beta = -(1 - X),    X = 3.5 mu (1 + e) v_n / v_s,

exactly, where v_s is the speed of the contact point before and beta = -v_s'/v_s; the slip of two unequal
spheres falls by as much, whatever the masses. Equal spheres with opposite spins have no slip: spins and
tangential speeds come out as they went in.
"""

from collections.abc import Iterator
from math import atan, degrees

import numpy as np

from taichi_erosion.core.setup import Floats, GrainTable, Setup
from taichi_erosion.core.snapshot import Snapshot
from taichi_erosion.verification.claims import PRECISIONS, Outcome, Precision, below, relative
from taichi_erosion.verification.closed_forms import hertz_impact, sphere_mass
from tests.verification import small_scenes as small
from tests.verification.reference import published
from tests.verification.reference.contact import Impact, Rebound, Solid, rebound, series

OXIDE = Solid(3.8e11, 0.23, 4000.0)
ALLOY = Solid(7.0e10, 0.33, 2700.0)
COPPER = Solid(1.2e11, 0.35, 8900.0)
NYLON = Solid(2.5e9, 0.40, 1000.0)
SOLIDS = {"aluminium oxide": OXIDE, "aluminium alloy": ALLOY}  # test 4
SPINNING = {"aluminium alloy": ALLOY, "nylon": NYLON}  # test 6
SPEED, RADIUS, FRICTION, RESTITUTION = 3.9, 0.0025, 0.092, 0.98  # test 4: m s-1, m, 1, 1
ONSET_ANGLES = np.array([31.0, 32.0, 33.0, 34.0])  # deg
PER_CONTACT = 2000  # steps in one elastic contact time [1]
FINE = 20_000  # the same where damping is strong: its half-step lag is of first order in the step


def impact_on_plane(touch: small.Touch, solid: Solid, radius: float, *motion: Floats) -> Impact:
    """Impacts on a rigid plane; `motion` is normal and tangential speed [m s-1] and spin [rad s-1]."""
    law = touch.young_effective, touch.shear_effective, touch.restitution, touch.friction_sliding
    return Impact(*law, radius, sphere_mass(radius, solid.density), *motion)


def impact_at(solid: Solid, angle: Floats) -> Impact:
    touch, turn = small.touch_of(solid, None, RESTITUTION, FRICTION), np.radians(angle)
    return impact_on_plane(touch, solid, RADIUS, SPEED * np.cos(turn), SPEED * np.sin(turn), 0.0 * turn)


def scenes(impact: Impact, per_contact: int = PER_CONTACT) -> list[Setup]:
    """The impacts of `impact` as scenes; slip runs along x, spin about y."""
    touch = small.Touch(impact.young, impact.shear, impact.restitution, impact.friction)
    setups = []
    for normal, tangential, spin in zip(impact.normal, impact.tangential, impact.spin, strict=True):
        step = hertz_impact(impact.young, impact.radius, impact.mass, normal)[2] / per_contact
        start, velocity = [[0.0, 0.0, impact.radius + 3.5 * normal * step]], [[tangential, 0.0, -normal]]
        grain = small.spheres(start, velocity, [[0.0, -spin, 0.0]], impact.radius, impact.mass)
        setups.append(small.sphere_setup(grain, touch, step, small.FLAT))
    return setups


def simulated(impacts: list[Impact], precision: Precision, per_contact: int = PER_CONTACT) -> list[Rebound]:
    setups = [setup for impact in impacts for setup in scenes(impact, per_contact)]
    # with e = 0.5 the damped contact outlasts the elastic one by less than half of it
    ends = small.final_states(setups, [1.8 * per_contact * setup.time_step for setup in setups], precision)
    after = np.array([[end.velocity[0, 2], end.velocity[0, 0], -end.spin[0, 1]] for end in ends])
    cuts = np.cumsum([len(impact.normal) for impact in impacts])[:-1]
    return [Rebound(*part.T) for part in np.split(after, cuts)]


def patch_angle(impact: Impact, after: Rebound) -> Floats:
    """Direction of the contact point after the impact [deg]."""
    return np.degrees(np.arctan((after.tangential + impact.radius * after.spin) / after.normal))


def oblique_impacts() -> Iterator[Outcome]:
    """V05."""
    angles = np.concatenate([published.OBLIQUE_ANGLE, ONSET_ANGLES])
    impacts = [impact_at(solid, angles) for solid in SOLIDS.values()]
    references = [rebound(impact) for impact in impacts]
    for precision in PRECISIONS:
        found = simulated(impacts, precision)
        for name, impact, after, reference in zip(SOLIDS, impacts, found, references, strict=True):
            yield from own_law_outcomes(name, impact, after, reference, precision)
            yield from sliding_outcomes(name, impact, after, precision)
        yield from published_outcomes(impacts[0], found[0], precision)


def own_law_outcomes(
    name: str, impact: Impact, after: Rebound, reference: Rebound, precision: Precision
) -> Iterator[Outcome]:
    """Against the same law in fine steps: 0.5 % of each value, of at least 5 deg for the patch angle."""
    found, wanted = patch_angle(impact, after), patch_angle(impact, reference)
    for of, error in (
        ("tangential restitution", after.tangential / reference.tangential - 1.0),
        ("spin", after.spin / reference.spin - 1.0),
        ("patch angle", (found - wanted) / np.maximum(np.abs(wanted), published.OBLIQUE_ANGLE[0])),
    ):
        yield below(f"T4 {name} against its own law: {of}, relative", error, 5e-3, precision)


def sliding_outcomes(name: str, impact: Impact, after: Rebound, precision: Precision) -> Iterator[Outcome]:
    """Exact gross sliding from 35 deg, and the angle where the contact point comes to rest."""
    lost = impact.friction * (1.0 + impact.restitution) * impact.normal
    slides = impact.tangential > 3.5 * lost
    head = f"T4 {name}, exact sliding"
    error = after.tangential / (impact.tangential - lost) - 1.0
    yield below(f"{head}: tangential speed, relative", error[slides], 2e-3, precision)
    error = impact.radius * after.spin / (-2.5 * lost) - 1.0
    yield below(f"{head}: spin, relative", error[slides], 2e-3, precision)
    error = after.normal / impact.normal - RESTITUTION
    yield below(f"{head}: e_n minus 0.98", error, 2e-3 * RESTITUTION, precision)
    angle = np.degrees(np.arctan2(impact.tangential, impact.normal))
    order = np.argsort(angle)[np.sort(angle) > 25.0]
    onset = np.interp(0.0, patch_angle(impact, after)[order], angle[order])
    exact = degrees(atan(3.5 * FRICTION * (1.0 + RESTITUTION)))
    yield Outcome(f"T4 {name}: onset of gross sliding [deg]", float(onset), exact, 0.5, precision)


def published_outcomes(impact: Impact, after: Rebound, precision: Precision) -> Iterator[Outcome]:
    """Aluminium oxide against Chung & Ooi from 15 deg (3 %)."""
    steep = published.OBLIQUE_ANGLE >= 15.0
    ratio = after.tangential / impact.tangential
    for of, got, want in (
        ("tangential restitution", ratio, published.OBLIQUE_LITERATURE_RESTITUTION),
        ("spin", after.spin, published.OBLIQUE_LITERATURE_SPIN),
    ):
        error = (got[: len(want)] / want - 1.0)[steep]
        yield below(f"T4 Chung & Ooi from 15 deg: {of}, relative", error, 0.03, precision)


SPHERE_RADIUS, APPROACH = 0.1, 0.2  # tests 6-8: m, m s-1
SPHERE_RESTITUTION, SPHERE_FRICTION = 0.5, 0.4


def spinning_impacts() -> Iterator[Outcome]:
    """V06, test 6: a spinning sphere meets the plane; the sliding branch X < 1, 0.5 % of beta."""
    ratios = published.SPINNING_X[published.SPINNING_X < 1.0]
    normal = np.full(len(ratios), APPROACH)
    spin = 3.5 * SPHERE_FRICTION * 1.5 * normal / ratios / SPHERE_RADIUS
    touches = [(small.touch_of(s, None, SPHERE_RESTITUTION, SPHERE_FRICTION), s) for s in SPINNING.values()]
    impacts = [impact_on_plane(*each, SPHERE_RADIUS, normal, 0.0 * normal, spin) for each in touches]
    for precision in PRECISIONS:
        for name, impact, after in zip(SPINNING, impacts, simulated(impacts, precision, FINE), strict=True):
            betas = -(after.tangential + impact.radius * after.spin) / (impact.radius * impact.spin)
            for ratio, beta in zip(ratios, betas, strict=True):
                yield relative(f"T6 {name}: beta at X = {ratio:g}", beta, ratio - 1.0, 5e-3, precision)


SPINS = np.array([0.175, 1.0, 5.0, 22.86])  # rad s-1, the range of the published line
PARTNER_RADIUS = 0.5  # m, test 8
# directions of the line of centres: along an axis, and one along none
DIRECTIONS = (np.array([1.0, 0.0, 0.0]), np.array([0.48, -0.6, 0.64]))
# rounding of 1e-16 or 6e-8 per step, at random over the thousands of steps of a contact
LIMIT_SPIN: dict[Precision, float] = {"f64": 1e-10, "f32": 1e-4}
LIMIT_LINEAR: dict[Precision, float] = {"f64": 1e-12, "f32": 1e-5}


def across(direction: Floats) -> Floats:
    """A unit vector at right angles to `direction`."""
    side = np.cross(direction, [0.0, 0.0, 1.0])
    return side / np.linalg.norm(side)


def equal_pair(solid: Solid, direction: Floats, spin: float) -> Setup:
    """Test 7: equal spheres, equal and opposite spins about a line at right angles to their centres."""
    touch = small.touch_of(solid, solid, SPHERE_RESTITUTION, SPHERE_FRICTION)
    impact = small.head_on(touch, solid.density, 2.0 * APPROACH, SPHERE_RADIUS, SPHERE_RADIUS)
    step = impact.duration / 200.0
    half = (SPHERE_RADIUS + 3.5 * APPROACH * step) * direction
    ahead, turn = APPROACH * direction, spin * across(direction)
    grains = small.spheres([-half, half], [ahead, -ahead], [turn, -turn], SPHERE_RADIUS, 2.0 * impact.mass)
    return small.sphere_setup(grains, touch, step)


def equal_spins() -> Iterator[Outcome]:
    """V07."""
    choices = [(s, d, w) for s in (ALLOY, COPPER) for d in DIRECTIONS for w in SPINS]
    setups = [equal_pair(*choice) for choice in choices]
    for precision, limit in LIMIT_SPIN.items():
        ends = small.final_states(setups, [400.0 * setup.time_step for setup in setups], precision)
        spin = [end.spin - setup.grains.spin for setup, end in zip(setups, ends, strict=True)]
        yield below("T7: change of spin [rad/s]", np.ravel(spin), limit, precision)
        pairs = zip((direction for _, direction, _ in choices), ends, strict=True)
        drift = [end.velocity - np.outer(end.velocity @ direction, direction) for direction, end in pairs]
        yield below("T7: tangential speed after [m/s]", np.ravel(drift), limit, precision)


def unequal_pair(solid: Solid, partner: Solid, direction: Floats, slip: float) -> Setup:
    """Test 8: a small sphere whose surface turns with `slip` [m s-1] meets a large one at rest."""
    touch = small.touch_of(solid, partner, SPHERE_RESTITUTION, SPHERE_FRICTION)
    radii, densities = (SPHERE_RADIUS, PARTNER_RADIUS), (solid.density, partner.density)
    masses = [sphere_mass(*body) for body in zip(radii, densities, strict=True)]
    step = hertz_impact(touch.young_effective, series(*radii), series(*masses), APPROACH)[2] / 4000.0
    start = [-(sum(radii) + 3.5 * APPROACH * step) * direction, 0.0 * direction]
    velocity = [APPROACH * direction, 0.0 * direction]
    spin = [slip / SPHERE_RADIUS * across(direction), 0.0 * direction]
    return small.sphere_setup(small.spheres(start, velocity, spin, radii, masses), touch, step)


def linear(grains: GrainTable | Snapshot) -> Floats:
    return grains.mass @ grains.velocity


def angular(grains: GrainTable | Snapshot) -> Floats:
    """Angular momentum about the origin [kg m2 s-1]."""
    moving = grains.mass[:, None] * grains.velocity
    inertia = 0.4 * grains.mass * grains.radius**2
    return np.cross(grains.position, moving).sum(axis=0) + inertia @ grains.spin


def momentum() -> Iterator[Outcome]:
    """V08."""
    ratios = np.array([0.3, 0.6, 0.9, 2.0])  # X of test 6; the last one sticks
    slips = 3.5 * SPHERE_FRICTION * (1.0 + SPHERE_RESTITUTION) * APPROACH / ratios
    partners = ((ALLOY, NYLON), (NYLON, ALLOY), (ALLOY, ALLOY))
    setups = [unequal_pair(a, b, d, slip) for a, b in partners for d in DIRECTIONS for slip in slips]
    for precision in PRECISIONS:
        ends = small.final_states(setups, [8000.0 * setup.time_step for setup in setups], precision)
        pairs = [(setup.grains, end) for setup, end in zip(setups, ends, strict=True)]
        for kind, sums, limits in (("linear", linear, LIMIT_LINEAR), ("angular", angular, LIMIT_SPIN)):
            lost = [np.linalg.norm(sums(b) - sums(a)) / np.linalg.norm(sums(a)) for a, b in pairs]
            yield below(f"T8: change of {kind} momentum, relative", lost, limits[precision], precision)
        for ratio, slip, (_, after) in zip(ratios[:3], slips, pairs[:3], strict=False):
            name = f"T8 alloy on nylon: beta at X = {ratio:g}"
            # they met along x, and the first turned about -y
            left = after.velocity[0, 2] - after.velocity[1, 2] - after.radius @ after.spin[:, 1]
            yield relative(name, -left / slip, ratio - 1.0, 5e-3, precision)
