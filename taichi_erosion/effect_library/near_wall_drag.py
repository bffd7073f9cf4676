"""Near-wall drag: a grain that lies on the bed or flies close above it has more drag than a free one.

    F = f F_free,    f = [1 + 0.138 exp(-2 s) + 9 / (16 (1 + 2 s))] (1 + a Re^b) / (1 + 0.15 Re^0.687)
    a = 0.15 - 0.046 (1 - 0.16 s^2) exp(-0.7 s),    b = 0.687 + 0.066 (1 - 0.76 s^2) exp(-s^0.9)

with F_free the drag of the run's law [N], s the gap between grain and bed over the diameter [1], 0 where
the centre is lower than a radius above the bed, Re = rho |u - v| d / mu, u the air at the centre and v the
velocity of the grain [m s-1], d the diameter [m], rho and mu density [kg m-3] and viscosity [Pa s] of the
air. At s = 0 and small Re f is 1.7005; O'Neill's exact solution of a sphere that touches a plane in linear
shear has 1.7009. The law is that of a resting sphere and a smooth plane in shear along it; here the bed is
rough, grains move too, and all components of the drag have the factor. Some diameters up at Re > 100 f
falls to 0.97, as the fit does. Below the surface of the bed f - 1 fades over a diameter: laws of drag in
beds have the neighbours already. The air loses the momentum that the grain gains, but for what gusts add:
the stress of the wind on the bed stays, and its upper grains take a larger share of it. Its counterparts
are `shear_lift`, the lift on the bed, and `rotational_drag`, whose torque on a grain that does not spin,
pi mu d^3 G / 2 with the shear G, is within 6 % that of a sphere at rest on a plane. Strength multiplies f
- 1. Holds for Re < 250.

Reference: Zeng, Najjar, Balachandar & Fischer (2009), Phys. Fluids 21, 033302; O'Neill (1968), Chem. Eng.
Sci. 23, 1293; Goldman, Cox & Brenner (1967), Chem. Eng. Sci. 22, 653.
"""

from dataclasses import asdict, dataclass
from math import exp, pi

from taichi_erosion.core.effect import Check, Checks, Conditions, Constants, Probe, effect_of, quantity
from taichi_erosion.core.ti import ti


@dataclass(frozen=True)
class Params:
    near: float = quantity(0.138, "1", "of the term that fades exponentially", low=0.0, high=1.0)
    far: float = quantity(0.5625, "1", "of the term that fades like 1 / s, Faxen's 9/16", low=0.0, high=2.0)
    inertia: float = quantity(0.046, "1", "by which a falls at the bed", low=0.0, high=0.15)
    steepening: float = quantity(0.066, "1", "by which b rises at the bed", low=0.0, high=0.3)


def constants(params: Params, strength: float, conditions: Conditions) -> Constants:
    return {"strength": strength, **asdict(params)}


@ti.func
def factor(constants, grain):
    """Factor of the drag [1]."""
    more = 0.0 * grain.radius
    buried = ti.min(ti.max(-grain.height / (2.0 * grain.radius) - 0.5, 0.0), 1.0)
    slip = (grain.air_velocity - grain.velocity).norm()
    if grain.air_viscosity > 0.0 and slip > 0.0:
        diameter = 2.0 * grain.radius
        gap = ti.max((grain.height - grain.radius) / diameter, 0.0)
        reynolds = grain.air_density * slip * diameter / grain.air_viscosity
        creeping = 1.0 + constants.near * ti.exp(-2.0 * gap) + constants.far / (1.0 + 2.0 * gap)
        share = 0.15 - constants.inertia * (1.0 - 0.16 * gap * gap) * ti.exp(-0.7 * gap)
        power = 0.687 + constants.steepening * (1.0 - 0.76 * gap * gap) * ti.exp(-(gap**0.9))
        inertial = (1.0 + share * reynolds**power) / (1.0 + 0.15 * reynolds**0.687)
        more = creeping * inertial - 1.0
    return 1.0 + (1.0 - buried) * constants.strength * more


@ti.func
def push(constants, grain):
    """No force besides the drag [N], and no torque [N m]."""
    return 0.0 * grain.velocity, 0.0 * grain.velocity


def checks(probe: Probe) -> Checks:
    # probes have creeping flow, drag 3 pi mu d u
    air = {"air_density": 1.2, "air_viscosity": 1.8e-5, "radius": 1e-4}

    def added_drag(height: float, speed: float, strength: float = 1.0) -> float:
        """Added drag over that of the probe's law."""
        members = air | {"air_velocity": (speed, 0.0, 0.0), "height": height}
        return probe(Params(), {}, strength=strength, **members)[0][0] / (3.0 * pi * 1.8e-5 * 2e-4 * speed)

    def law(gap: float, reynolds: float) -> float:
        a = 0.15 - 0.046 * (1.0 - 0.16 * gap**2) * exp(-0.7 * gap)
        b = 0.687 + 0.066 * (1.0 - 0.76 * gap**2) * exp(-(gap**0.9))
        wall = 1.0 + 0.138 * exp(-2.0 * gap) + 9.0 / (16.0 + 32.0 * gap)
        return wall * (1.0 + a * reynolds**b) / (1.0 + 0.15 * reynolds**0.687) - 1.0

    creeping = added_drag(1e-4, 1e-6)
    yield Check("in creeping flow O'Neill's factor of a touching sphere", creeping, 0.7009, rtol=2e-3)
    yield Check("on the bed at Re = 20", added_drag(1e-4, 1.5), law(0.0, 20.0))
    yield Check("half a diameter above it", added_drag(2e-4, 1.5), law(0.5, 20.0))
    yield Check("at Re = 200", added_drag(1e-4, 15.0), law(0.0, 200.0))
    yield Check("far away it is that of a free grain", added_drag(0.1, 1.5), law(499.5, 20.0), rtol=1e-3)
    yield Check("strength multiplies what is added", added_drag(1e-4, 1.5, 0.5), 0.5 * law(0.0, 20.0))
    at_surface = added_drag(-1e-4, 1.5)
    yield Check("a grain at the surface of the bed has that of one on it", at_surface, law(0.0, 20.0))
    yield Check("a diameter deeper it has none", added_drag(-3e-4, 1.5), 0.0)


EFFECT = effect_of(
    __name__,
    "more drag on grains on the bed and close above it",
    "grain",
    push,
    through_air=True,
    drag=factor,
    most=1.5,
    expected={"threshold_u_star": -1},
)
