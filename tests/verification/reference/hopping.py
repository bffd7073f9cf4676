"""One grain that hops over a bed: the lowest wind in which it goes on, in SciPy alone.

Between landings the grain flies in the steady wind over a flat bed,

    nu u' + l^2 u'^2 = u*^2,    dl/dz = kappa (1 - exp(-sqrt(u l / (7 nu)))),
    dv/dt = (3 rho C_D / (4 rho_s d)) |u - v| (u - v) - g,    C_D = (sqrt(1/2) + sqrt(24 / Re))^2

with u and l from nought at the bed, and at every landing it bounces as measured on beds of equal spheres,

    |v'| = (A - B sin a) |v|,    v'_z = -(A / sqrt(sin a) - B) v_z,    A = 0.87, B = 0.72,

a the angle of impact. It has come to rest where it rises by less than a diameter. Nothing is ejected, nothing
is chance, and the grain takes nothing from the wind: the threshold of a grain that is kept going by the wind
alone. Holds for grains far from one another.

Reference: Duran, Andreotti & Claudin (2012), Phys. Fluids 24, 103306 (wind); Beladjine et al. (2007), Phys.
Rev. E 75, 061305 (bounces); Pahtz, Liu, Xia, Hu, He & Tholen (2021), J. Geophys. Res. 126, e2020JF005859
(the threshold as that of periodic hops).
"""

from collections.abc import Callable
from functools import partial
from math import cos, exp, hypot, pi, sin, sqrt

import numpy as np
from scipy.integrate import solve_ivp

from taichi_erosion.core.setup import Floats
from taichi_erosion.measures.wind_formulas import GRAVITY, Sand

KARMAN, SUBLAYER = 0.4, 7.0  # of the mixing length [1]
LOSS, STEER = 0.87, 0.72  # A and B of the bounce [1]
CENTRE = 0.7  # height of the centre of a grain on the bed over where the wind begins, over the diameter [1]
LANDINGS = 60  # that a grain must go on for
STEADY = 1e-3  # change of the speed between landings below which it goes on for ever [1]
LAUNCH = (60.0, 40.0)  # first speed over sqrt(g d) [1], and its angle [deg]
HIGHEST, ROWS = 0.3, 4000  # m, and heights of the profile
LOWEST_HEIGHT = 1e-6  # m
LONGEST = 4.0  # of a throw in vacuum: longer than any hop, over v_z / g [1]
SLOWEST = 1e-9  # keeps the drag of no slip finite [m s-1]
SPAN = (0.02, 0.3)  # of sqrt((s - 1) g d), between which the threshold is looked for [1]

WindProfile = Callable[[float], float]  # speed of a wind [m s-1] by the height over where it begins [m]


def scale(sand: Sand) -> float:
    """sqrt((s - 1) g d) [m s-1]."""
    return sqrt((sand.density_ratio - 1.0) * GRAVITY * sand.diameter)


def wind(friction: float, viscosity: float) -> WindProfile:
    """Wind over a flat bed [m s-1] as a function of the height [m].

    Near the bed u = u*^2 z / nu; there a length that grows from nought is (kappa u* / (3 nu))^2 z^3 / 7.
    """
    height = np.geomspace(LOWEST_HEIGHT, HIGHEST, ROWS)
    speed = friction**2 / viscosity * height
    length = (KARMAN * friction / (3.0 * viscosity)) ** 2 * height[0] ** 3 / SUBLAYER
    for k in range(1, ROWS):
        step = height[k] - height[k - 1]
        shear = 2.0 * friction**2 / (viscosity + sqrt(viscosity**2 + 4.0 * (length * friction) ** 2))
        speed[k] = speed[k - 1] + shear * step
        length += KARMAN * (1.0 - exp(-sqrt(speed[k] * length / (SUBLAYER * viscosity)))) * step
    return lambda z: float(np.interp(z, height, speed))


def hop(sand: Sand, blow: WindProfile, forward: float, upward: float) -> tuple[float, float]:
    """Forward and downward speed [m s-1] at the end of a hop."""
    bed = CENTRE * sand.diameter
    rate = 0.75 * sand.air_density / (sand.density * sand.diameter)

    def motion(_: float, state: Floats) -> list[float]:
        height, ahead, rise = state
        slip = (blow(height) - ahead, -rise)
        speed = max(hypot(*slip), SLOWEST)
        drag = (sqrt(0.5) + sqrt(24.0 * sand.viscosity / (speed * sand.diameter))) ** 2
        return [rise, rate * drag * speed * slip[0], rate * drag * speed * slip[1] - GRAVITY]

    def over_the_bed(_: float, state: Floats) -> float:
        return float(state[0]) - bed

    # the flight ends where the bed is reached from above
    vars(over_the_bed).update(terminal=True, direction=-1.0)
    span = (0.0, LONGEST * upward / GRAVITY)
    flown = solve_ivp(motion, span, (bed, forward, upward), events=over_the_bed, rtol=1e-4, atol=1e-9)
    _, ahead, rise = flown.y[:, -1]
    return float(ahead), -float(rise)


def bounce(forward: float, downward: float) -> tuple[float, float]:
    """Forward and upward speed [m s-1] after a landing."""
    speed = hypot(forward, downward)
    sine = downward / speed
    upward = (LOSS / sqrt(sine) - STEER) * downward
    after = (LOSS - STEER * sine) * speed
    return (sqrt(max(after**2 - upward**2, 0.0)), min(upward, after))


def goes_on(sand: Sand, blow: WindProfile) -> bool:
    """Whether a grain that was thrown hard still hops after many landings."""
    speed, angle = LAUNCH[0] * sqrt(GRAVITY * sand.diameter), LAUNCH[1] * pi / 180.0
    forward, upward = speed * cos(angle), speed * sin(angle)
    for _ in range(LANDINGS):
        before = upward
        forward, upward = bounce(*hop(sand, blow, forward, upward))
        if upward < sqrt(2.0 * GRAVITY * sand.diameter):  # it rises by less than its diameter
            return False
        if abs(upward / before - 1.0) < STEADY:
            return True
    return True


def hopping_threshold(sand: Sand, over: Callable[[float], WindProfile] | None = None) -> float:
    """Lowest friction velocity in which a grain goes on [m s-1], to 0.3 %.

    `over` gives the wind of a friction velocity [m s-1]; that over a flat bed where there is none.
    """
    over = over or partial(wind, viscosity=sand.viscosity)
    low, high = (share * scale(sand) for share in SPAN)
    for _ in range(9):
        middle = sqrt(low * high)
        low, high = (low, middle) if goes_on(sand, over(middle)) else (middle, high)
    return high
