"""Turbulent gusts: a wind that fluctuates about its mean, log-normal along itself, weak upwards at the bed.

    u' = u (exp(s g_1 - s^2 / 2) - 1, 0, 0) + sigma_w (0, 0, c g_1 + sqrt(1 - c^2) g_2)
    s^2 = ln(1 + I^2),    I = min(a u* / |u_x|, i),    c = -1 / (r a^2)
    sigma_w = min(r a u*, b u* z+^2),    z+ = z u* rho / mu
    g = sqrt(2/K) sum_k cos(w_k t + p_k),    w_k = tan(pi (k - 1/2) / (2 K)) / T,    k = 1 .. K
    T = min(T_o, T+ mu / (rho u*^2)),    T+ = t max(1, 0.7122 + 0.05731 y - 0.000129 y^2)
    y = min(d u* rho / (2 mu), 200)

with u the mean wind at the grain [m s-1] and u_x its streamwise component, u* the friction velocity [m
s-1], z the height of the centre over the bed [m], 0 below, rho and mu density [kg m-3] and viscosity [Pa s]
of the air. I is the relative deviation of the streamwise wind, whose mean stays u: a = 2.5 far from the
ground, and in the viscous sublayer the limit i = 0.4, that of the stress at the wall; velocities there are
log-normal. Upwards r a = 1.4 far from the ground; at a wall continuity leaves b z+^2 of it, b = 0.009, next
to nothing around a grain at rest. The correlation c carries the stress of the wind, -<u'w'> = u*^2, far
from the ground. g_1 and g_2 are stationary processes of variance 1 and correlation exp(-t / T), those of
the Langevin equation dg = -g dt/T + sqrt(2/T) dW, as a sum of waves: it needs no memory of every grain, and
the whole patch feels one gust, as it does where eddies are larger than it. T_o is 0.3 to 1 times depth over
speed of the layer: 0.02 s in a tunnel, seconds outdoors; with t = 0, the default, T is T_o in every wind.
Near a wall gusts are shorter: t = 10 is the Lagrangian time scale at the height of a grain that lies on the
bed, half the nominal diameter d, for y from 0 to 200: 3.7 ms at u* = 0.2 m s-1 and 0.25 mm, 0.9 ms at 0.54
and 1 mm. A grain at rest feels the Eulerian one, 1/3 to 3 times that. In flight T is that of the bed too,
short for grains high up. u* is that of the driving stress, which changes in steps; with each step another
gust begins. The phases p_k follow from the seed. Drag, lift and torque of other effects act with the wind of
the gust; the shear grows as the streamwise wind. The air does not lose what gusts give: their momentum comes
from above. Strength multiplies I and sigma_w. Holds for grains much smaller than eddies.

Reference: Kok & Renno (2009), J. Geophys. Res. 114, D17204 (a, r, the Langevin equation); Alfredsson,
Johansson, Haritonidis & Eckelmann (1988), Phys. Fluids 31, 1026 (i); Alfredsson, Orlu & Schlatter (2011),
Exp. Fluids 51, 271 (log-normal sublayer); Kallio & Reeks (1989), Int. J. Multiphase Flow 15, 433, as in
Dehbi (2008), Int. J. Multiphase Flow 34, 819 (T+); Anfossi et al. (2006), Boundary-Layer Meteorol. 118, 675
(Lagrangian over Eulerian times); Kim, Moin & Moser (1987), J. Fluid Mech. 177, 133 (b); Shinozuka &
Deodatis (1991), Appl. Mech. Rev. 44, 191 (processes as sums of waves).
"""

from dataclasses import dataclass, replace
from math import cos, exp, log, pi, sqrt, tan

from taichi_erosion.core.effect import Check, Checks, Conditions, Constants, Probe, effect_of, quantity
from taichi_erosion.core.ti import ti

WAVES = 24  # K; correlations are then right to 0.04 [1]
FREQUENCIES = tuple(tan(0.5 * pi * (k + 0.5) / WAVES) for k in range(WAVES))  # w_k T [1]
SQUARE = (7919.0, 5003.0)  # factors of the seed's number in the phases of both processes [1]
CUBE = (3571.0, 9973.0)
GROWTH = (0.7122, 0.05731, -0.000129)  # of T+ over that of the sublayer, by powers of y [1]
HIGHEST = 200.0  # y up to which it was fitted [1]


@dataclass(frozen=True)
class Params:
    deviation: float = quantity(2.5, "1", "of the wind along itself, over u*", low=0.0, high=5.0)
    upward: float = quantity(0.56, "1", "vertical over streamwise deviation", low=0.0, high=1.0)
    intensity: float = quantity(0.4, "1", "largest deviation over the mean wind", low=0.0, high=1.0)
    wall_upward: float = quantity(
        0.009, "1", "vertical deviation over u* z+^2 at the bed", low=0.0, high=0.02
    )
    timescale: float = quantity(0.02, "s", "longest correlation time of a gust", low=1e-4, high=100.0)
    wall_timescale: float = quantity(
        0.0, "1", "correlation time at a wall, nu / u*^2; 0: the longest always", low=0.0, high=100.0
    )


def constants(params: Params, strength: float, conditions: Conditions) -> Constants:
    """Numbers of one replica; at strength 0 the wind is steady."""
    carried = params.upward * params.deviation**2  # largest -<u'w'> over u*^2 [1]
    return {
        "deviation": strength * params.deviation,
        "intensity": strength * params.intensity,
        "upward": strength * params.upward * params.deviation,
        "wall_upward": strength * params.wall_upward,
        "correlation": -1.0 / max(carried, 1.0),
        "rate": 1.0 / params.timescale,
        "wall_rate": 1.0 / params.wall_timescale if params.wall_timescale > 0.0 else 0.0,
        "half": 0.5 * conditions.get("grain_diameter", 0.0),  # height of a grain that lies on the bed [m]
    }


@ti.func
def wave_sum(time, square, cube):
    """Process of variance 1 [1] at a time in units of T; phases are k^2 square + k^3 cube turns."""
    total = 0.0 * time
    for k in ti.static(range(1, WAVES + 1)):
        phase = (square * (k * k)) % 1.0 + (cube * (k * k * k)) % 1.0
        total += ti.cos(FREQUENCIES[k - 1] * time + 2.0 * pi * phase)
    return ti.sqrt(2.0 / WAVES) * total


@ti.func
def rate(constants, grain):
    """Inverse of the correlation time of gusts [s-1]."""
    units = grain.friction_velocity * grain.air_density / grain.air_viscosity  # u* over nu [m-1]
    y = ti.min(constants.half * units, HIGHEST)
    growth = ti.max(1.0, GROWTH[0] + (GROWTH[1] + GROWTH[2] * y) * y)
    return ti.max(constants.rate, constants.wall_rate * grain.friction_velocity * units / growth)


@ti.func
def gust(constants, grain):
    """Wind less its mean at the grain [m s-1]."""
    change = 0.0 * grain.velocity
    stream = grain.air_velocity[0]
    friction = grain.friction_velocity
    if grain.air_viscosity > 0.0 and friction > 0.0:
        time = grain.time * rate(constants, grain)
        along = wave_sum(time, grain.chance * SQUARE[0] % 1.0, grain.chance * CUBE[0] % 1.0)
        other = wave_sum(time, grain.chance * SQUARE[1] % 1.0, grain.chance * CUBE[1] % 1.0)
        if stream != 0.0:
            relative = ti.min(constants.deviation * friction / ti.abs(stream), constants.intensity)
            variance = ti.log(1.0 + relative * relative)
            change[0] = stream * (ti.exp(ti.sqrt(variance) * along - 0.5 * variance) - 1.0)
        layers = ti.max(grain.height, 0.0) * friction * grain.air_density / grain.air_viscosity
        upward = ti.min(constants.upward, constants.wall_upward * layers * layers)
        correlation = constants.correlation
        rest = ti.sqrt(1.0 - correlation * correlation)
        change[2] = upward * friction * (correlation * along + rest * other)
    return change


@ti.func
def push(constants, grain):
    """No force besides the drag of the gust [N], and no torque [N m]."""
    return 0.0 * grain.velocity, 0.0 * grain.velocity


# probes have creeping flow, drag 3 pi mu d s; the grain is carried by the air
PROBED = {"radius": 1e-4, "friction_velocity": 0.2, "chance": 0.375}
STOKES = 3.0 * pi * 2e-4
GUSTY = Params(deviation=2.0, upward=0.5, intensity=0.5, wall_upward=0.01, timescale=0.05)


def wave(axis: int, time: float) -> float:
    """Process 0 or 1 [1] of the probed grain at a time [s], where T is 0.05 s."""
    square, cube = (0.375 * (SQUARE, CUBE)[n][axis] for n in range(2))
    terms = (
        cos(tan(pi * (k - 0.5) / 48.0) * time / 0.05 + 2.0 * pi * (square * k**2 + cube * k**3))
        for k in range(1, 25)
    )
    return sum(terms) / sqrt(12.0)


def gust_over_mean(intensity: float, time: float) -> float:
    """Gust over the mean wind [1] at a time [s], where its relative deviation is `intensity` [1]."""
    variance = log(1.0 + intensity**2)
    return exp(sqrt(variance) * wave(0, time) - 0.5 * variance) - 1.0


def checks(probe: Probe) -> Checks:
    def blown(axis: int, time: float, wind: float = 4.0, layers: float = 1e3, strength: float = 1.0) -> float:
        """Gust felt in a mean wind [m s-1] at a height over mu / (rho u*) [1]."""
        carried = {"air_velocity": (wind, 0.0, 0.0), "velocity": (wind, 0.0, 0.0)}
        members = PROBED | carried | {"air_density": 1.0, "air_viscosity": 1.0, "height": layers / 0.2}
        return probe(GUSTY, {}, strength=strength, time=time, **members)[0][axis] / STOKES

    # r a^2 = 2: c = -1/2
    rise = -0.5 * wave(0, 0.03) + sqrt(0.75) * wave(1, 0.03)
    yield Check("a gust has the deviation a u*", blown(0, 0.03), 4.0 * gust_over_mean(0.1, 0.03), rtol=3e-3)
    yield Check("later it is another", blown(0, 0.09), 4.0 * gust_over_mean(0.1, 0.09), rtol=3e-3)
    weak = blown(0, 0.03, 0.1)
    yield Check("in a weak wind it has the share i", weak, 0.1 * gust_over_mean(0.5, 0.03), rtol=3e-3)
    strong = blown(0, 0.03, 0.1, strength=2.0)
    yield Check("strength multiplies the deviation", strong, 0.1 * gust_over_mean(1.0, 0.03), rtol=3e-3)
    yield Check("upwards it is weaker, against the stream", blown(2, 0.03), 0.2 * rise, rtol=3e-3)
    yield Check("near the bed weaker yet", blown(2, 0.03, layers=4.0), 0.2 * 0.16 * rise, rtol=3e-3)
    yield from checks_at_wall(probe)


def checks_at_wall(probe: Probe) -> Checks:
    """Gusts where mu / (rho u*^2) is 10 ms, after 0.03 s."""
    thin = {"air_density": 1e-2, "air_viscosity": 4e-6, "height": 1.0}
    carried = {"air_velocity": (4.0, 0.0, 0.0), "velocity": (4.0, 0.0, 0.0)}

    def gust_ratio(diameter: float, longest: float = 10.0, time: float = 0.03) -> float:
        """Gust over the mean wind, with T+ = 5 in the sublayer."""
        params = replace(GUSTY, timescale=longest, wall_timescale=5.0)
        ratio = probe(params, {"grain_diameter": diameter}, time=time, **PROBED | thin | carried)[0][0]
        return float(ratio) / (4.0 * 4e-6 * STOKES)

    short = gust_over_mean(0.1, 0.03)
    yield Check("at a wall it lasts t nu / u*^2", gust_ratio(1e-3), short, rtol=3e-3)
    grown = 0.7122 + 0.05731 * 50.0 - 0.000129 * 50.0**2
    longer = gust_over_mean(0.1, 0.03 / grown)
    yield Check("longer at the height of coarse grains", gust_ratio(0.2), longer, rtol=3e-3)
    yield Check("at most T_o", gust_ratio(0.2, longest=0.05), short, rtol=3e-3)


EFFECT = effect_of(
    __name__,
    "gusts of the wind (log-normal, Langevin statistics)",
    "grain",
    push,
    through_air=True,
    expected={"threshold_u_star": -1, "flux": 1},
)
