"""V02-V04: head-on impacts against Hertz's closed form, the order of the time step, and restitution.

V02 runs tests 1 and 2 of Chung & Ooi; the pairs of test 1 are in the short list of the program.
"""

from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from taichi_erosion.core.setup import Setup
from taichi_erosion.verification import closed_forms
from taichi_erosion.verification.claims import PRECISIONS, Outcome, below
from taichi_erosion.verification.closed_forms import AHEAD, PER_CONTACT, sphere_mass
from tests.verification import small_scenes as small
from tests.verification.reference.contact import Solid, hertz_motion

GLASS = Solid(4.8e10, 0.20, 2800.0)
LIMESTONE = Solid(2.0e10, 0.25, 2500.0)
ALUMINIUM_ALLOY = Solid(7.0e10, 0.30, 2699.0)
MAGNESIUM_ALLOY = Solid(4.0e10, 0.35, 1800.0)
ALUMINIUM_OXIDE = Solid(3.8e11, 0.23, 4000.0)
CAST_IRON = Solid(1.0e11, 0.25, 7000.0)


class Case(NamedTuple):
    setup: Setup
    impact: small.HeadOn


def impact_case(touch: small.Touch, density: float, speed: float, *radii: float) -> Case:
    """A sphere that falls on the rigid floor without gravity, or two spheres along x that share the speed."""
    impact = small.head_on(touch, density, speed, *radii)
    step = impact.duration / PER_CONTACT
    gap = AHEAD * speed * step
    masses = [sphere_mass(radius, density) for radius in radii]
    if len(radii) == 1:
        grain = small.spheres([[0, 0, radii[0] + gap]], [[0, 0, -speed]], 0.0, radii, masses)
        return Case(small.sphere_setup(grain, touch, step, small.FLAT), impact)
    half, velocity = 0.5 * (sum(radii) + gap), [[speed / 2, 0, 0], [-speed / 2, 0, 0]]
    grains = small.spheres([[-half, 0, 0], [half, 0, 0]], velocity, 0.0, radii, masses)
    return Case(small.sphere_setup(grains, touch, step), impact)


def hertz_cases() -> dict[str, Case]:
    """Tests 1 and 2 of Chung & Ooi (2011)."""
    glass, limestone = (small.touch_of(solid, solid) for solid in (GLASS, LIMESTONE))
    aluminium, magnesium = (small.touch_of(solid, None) for solid in (ALUMINIUM_ALLOY, MAGNESIUM_ALLOY))
    return {
        "T1 glass": impact_case(glass, 2800.0, 20.0, 0.01, 0.01),
        "T1 limestone": impact_case(limestone, 2500.0, 20.0, 0.01, 0.01),
        "T2 aluminium alloy": impact_case(aluminium, 2699.0, 0.2, 0.1),
        "T2 magnesium alloy": impact_case(magnesium, 1800.0, 0.2, 0.1),
    }


def hertz_peaks() -> Iterator[Outcome]:
    """V02."""
    yield from closed_forms.hertz_outcomes()
    cases = dict(list(hertz_cases().items())[2:])
    setups = [case.setup for case in cases.values()]
    times = np.outer(np.arange(1.0, PER_CONTACT + 13.0), [setup.time_step for setup in setups])
    for precision in PRECISIONS:
        paths = closed_forms.sample_states(setups, times, precision)
        for (name, case), path in zip(cases.items(), paths, strict=True):
            yield from closed_forms.peak_outcomes(name, case.impact.closed, path, precision)


def step_order() -> Iterator[Outcome]:
    """V03: error of the overlap 0.4 contact times after a touch at t = 0, for 20 to 320 steps on the way."""
    touch = small.touch_of(GLASS, None)
    impact = small.head_on(touch, 2800.0, 10.0, 0.01)
    duration = 0.4 * impact.duration
    exact = hertz_motion(impact.closed[0], impact.mass, impact.speed, duration)
    counts = np.array([20, 40, 80, 160, 320])
    grain = small.spheres([[0, 0, 0.01]], [[0, 0, -impact.speed]], 0.0, 0.01, impact.mass)
    setups = [small.sphere_setup(grain, touch, duration / count, small.FLAT) for count in counts]
    for precision in PRECISIONS:
        # single precision drowns the two finest steps in rounding
        finest = 5 if precision == "f64" else 3
        ends = small.final_states(setups, duration, precision)
        errors = np.array([abs(0.01 - state.position[0, 2] - exact) / exact for state in ends])
        slope = -np.polyfit(np.log(counts[:finest]), np.log(errors[:finest]), 1)[0]
        yield Outcome("order of the time step in an elastic contact", float(slope), 2.0, 0.2, precision)


def restitution() -> Iterator[Outcome]:
    """V04: e out of an impact is the e that was asked for."""
    wanted = np.round(np.arange(0.1, 1.01, 0.1), 1)
    groups = {  # restitution, speed [m s-1], radii [m]
        "T3 aluminium oxide on a wall": [(e, 3.9, 0.0025) for e in wanted],
        "equal spheres": [(e, 3.9, 0.0025, 0.0025) for e in wanted],
        "spheres of 1 and 4 mm": [(e, 3.9, 0.001, 0.004) for e in wanted],
        "e = 0.5 at 0.01 to 10 m/s": [(0.5, speed, 0.0025) for speed in np.geomspace(0.01, 10.0, 10)],
    }
    oxide, iron = small.touch_of(ALUMINIUM_OXIDE, None), small.touch_of(CAST_IRON, CAST_IRON)
    cases = []
    for e, *impact in (each for group in groups.values() for each in group):
        touch, density = (oxide, 4000.0) if len(impact) == 2 else (iron, 7000.0)
        cases.append(impact_case(replace(touch, restitution=e), density, *impact))
    setups = [case.setup for case in cases]
    asked = np.array([setup.contacts.restitution[0] for setup in setups])
    for precision in PRECISIONS:
        # a heavily damped contact lasts longer than the elastic one; five contact times outlast e = 0.1
        ends = small.final_states(setups, [5.0 * case.impact.duration for case in cases], precision)
        velocities = [end.velocity for end in ends]
        after = np.array([v[1, 0] - v[0, 0] if len(v) == 2 else v[0, 2] for v in velocities])
        found = after / np.array([case.impact.speed for case in cases])
        for name, error in zip(groups, np.split(found - asked, len(groups)), strict=True):
            yield below(f"restitution out minus in, {name}", error, 0.005, precision)
