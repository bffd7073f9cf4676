"""Restitution that falls with impact speed: viscoelastic dissipation in the contact.

    F = A k v_n,    k = dF_el / dd = (3/2) K sqrt(d),    K = (4/3) E* sqrt(R*)
    A = q (m* / K)^(2/5) / (1.7302 v_r^(1/5))

with v_n the speed at which the overlap d [m] grows [m s-1], k the stiffness of the elastic contact [N m-1],
m* the effective mass m_i m_j / (m_i + m_j), of a wall m_i [kg], and A the dissipative time of the contact
[s]. A grain of restitution 1 would then bounce with

    e = 1 - q (v / v_r)^(1/5)

to lowest order: q is the loss [1] at the reference speed v_r [m s-1]. The material's own A would depend on
how far the scene softens it; q does not. The force is added to the damper of the bare model, whose
restitution is the same at every speed: the slowest impacts keep that restitution, fast ones lose more.
Strength multiplies A. Holds for impacts without yield and q (v / v_r)^(1/5) below about 0.3.

Reference: Kuwabara & Kono (1987), Jpn J. Appl. Phys. 26, 1230; Brilliantov, Spahn, Hertzsch & Poeschel
(1996), Phys. Rev. E 53, 5382; Ramirez, Poeschel, Brilliantov & Schwager (1999), Phys. Rev. E 60, 4465 (e of
v).
"""

from dataclasses import dataclass

from taichi_erosion.core.effect import Check, Checks, Conditions, Constants, Probe, effect_of, quantity
from taichi_erosion.core.ti import ti

LOSS_FACTOR = 1.5 * 1.15344  # (1 - e) / (A (K / m*)^(2/5) v^(1/5)) as A goes to 0; Ramirez et al. (1999) [1]


@dataclass(frozen=True)
class Params:
    loss: float = quantity(0.15, "1", "loss of restitution at the reference speed", low=0.0, high=0.5)
    speed: float = quantity(1.0, "m s-1", "reference speed of impact", low=1e-3, high=100.0)


def constants(params: Params, strength: float, conditions: Conditions) -> Constants:
    return {"time": strength * params.loss / (LOSS_FACTOR * params.speed**0.2)}  # A (K / m*)^(2/5)


@ti.func
def pull(constants, pair):
    """Attraction [N]; negative while the overlap grows."""
    attraction = 0.0
    if pair.gap < 0.0 and pair.stiffness > 0.0:
        mass = pair.mass_i
        if pair.mass_j > 0.0:
            mass = pair.mass_i * pair.mass_j / (pair.mass_i + pair.mass_j)
        spring = pair.stiffness / (1.5 * ti.sqrt(-pair.gap))
        attraction = -constants.time * (mass / spring) ** 0.4 * pair.stiffness * pair.closing_speed
    return attraction


def checks(probe: Probe) -> Checks:
    lossy = Params(loss=0.2, speed=32.0)  # 32^(1/5) = 2
    # d = 1 um and k = 3000 N/m: K = 2e6; m* = 6.4e-5 of two grains twice as heavy, so (m* / K)^(2/5) = 2^-14
    touch = {"gap": -1e-6, "stiffness": 3000.0, "mass_i": 2e6 * 2.0**-34, "mass_j": 2e6 * 2.0**-34}
    dissipative = 0.2 / (1.5 * 1.15344 * 2.0) * 2.0**-14

    def force(speed: float, **changed: float) -> float:
        return probe(lossy, {}, closing_speed=speed, **(touch | changed))

    yield Check("a growing overlap is resisted with A k v", force(0.5), -dissipative * 3000.0 * 0.5)
    yield Check("a shrinking overlap is held back alike", force(-0.5), dissipative * 3000.0 * 0.5)
    at_wall = force(0.5, mass_j=0.0)
    yield Check("a wall counts as a grain without end: m* doubles", at_wall, force(0.5) * 2.0**0.4)
    yield Check("grains that do not touch lose nothing", force(0.5, gap=1e-9, stiffness=0.0), 0.0)


EFFECT = effect_of(
    __name__, "restitution that falls with impact speed", "pair", pull, most=2.0, expected={"flux": -1}
)
