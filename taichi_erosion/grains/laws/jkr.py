"""JKR: elastic spheres that stick, with a neck that holds until it tears.

    F = (4/3) E* a^3 / R* - 4 sqrt(pi gamma E*) a^(3/2)
    d = a^2 / R* - 2 sqrt(pi gamma a / E*)

with gamma the surface energy of each surface [J m-2] (work of adhesion 2 gamma), a the contact radius [m], d
the overlap [m]. With L = (pi gamma R*^2 / E*)^(1/3) and a = L s^2 both become polynomials of one variable,

    d R* / L^2 = s^4 - 2 s,    F = (4/3) pi gamma R* s^3 (s^3 - 3),

solved for s by Newton's method. The pull-off force is 3 pi gamma R* at d = -0.57236 L^2/R*; the neck tears at
d = -1.190551 L^2/R*, where s^3 = 1/2. A contact starts at d = 0 (branch `touch`), or wherever the neck can
exist (branch `edem`).

Friction is capped by |F + 6 pi gamma R*| (`thornton`) or by (4/3) E* a^3 / R* (`edem`).

Reference: Johnson, Kendall & Roberts (1971), Proc. R. Soc. A 324, 301; Thornton (1991), J. Phys. D 24, 1942
(friction).
"""

from typing import Any

import numpy as np

from taichi_erosion.core.setup import Floats
from taichi_erosion.core.ti import ti

TEAR_GAP = 1.190550789  # of L^2/R*: (s^4 - 2 s) at s^3 = 1/2, negative [1]
TEAR_ROOT = 0.7937005259840998  # s where the neck tears, (1/2)^(1/3) [1]
HERTZ_LIMIT = 1e6  # d R*/L^2 beyond which adhesion is below rounding and Hertz is used [1]
CURVATURE_AT_TEAR = 3.7797631496846193  # (d^2/ds^2)(s^4 - 2 s)/2 at the tear, 6 s^2 [1]
START_SHIFT = 2.5198420997897464  # makes the first guess of s exact at d = 0 [1], 2^(4/3)
SLOPE_LEAST = 1e-6  # of d(s^4 - 2 s)/ds, which vanishes at the tear [1]
CUBE_LEAST = 1e-37  # keeps a cube root within the range of single precision [m3]
GUESS_BITS = 709958130.0  # two thirds of the bits of 1, less what keeps the worst guess nearest [1]


@ti.func
def largest_quartic_root(reduced):
    """Largest s with s^4 - 2 s = reduced [1]; three Newton steps give single precision, four double."""
    inner = ti.max(reduced + START_SHIFT, 0.0)
    far = ti.sqrt(ti.sqrt(ti.max(reduced, 0.0) + 2.0 * ti.sqrt(ti.sqrt(inner))))
    near = TEAR_ROOT + ti.sqrt(ti.max(reduced + TEAR_GAP, 0.0) / CURVATURE_AT_TEAR)
    s = ti.select(reduced > 0.0, far, near)
    for _ in ti.static(range(4)):
        cubed = s * s * s
        s = ti.max(s - (cubed * s - 2.0 * s - reduced) / ti.max(4.0 * cubed - 2.0, SLOPE_LEAST), TEAR_ROOT)
    return s


@ti.func
def cube_root(x):
    """Real cube root of a positive number: a third of its exponent as a guess, then Halley's method.

    The guess, read off the bits of the number in single precision, is right within 3.3 %; a step makes a
    relative error e one of (2/3) e^3, so two leave 1e-14. Logarithms do not run for many contacts at once.

    Reference: Kahan (1991), Computing a real cube root.
    """
    number = ti.max(x, CUBE_LEAST)
    bits = ti.cast(ti.bit_cast(ti.cast(number, ti.f32), ti.i32), ti.f32)
    root = ti.cast(ti.bit_cast(ti.cast(bits / 3.0 + GUESS_BITS, ti.i32), ti.f32), float)
    for _ in ti.static(range(2)):
        cubed = root * root * root
        root *= (cubed + 2.0 * number) / (2.0 * cubed + number)
    return root


def compile_jkr(branch: str, cap: str) -> Any:
    """Normal law with the choice of adhesion branch and friction cap."""
    acts_on_approach = branch == "edem"
    cap_repulsive = cap == "edem"

    @ti.func
    def normal_force(materials: ti.template(), row, overlap, root_radius, engaged):
        """Elastic force [N], contact radius [m], force that caps friction [N], whether the contact acts."""
        young = materials.young[row]
        adhesion = materials.adhesion[row]
        depth = ti.max(overlap, 0.0)
        contact_radius = root_radius * ti.sqrt(depth)
        force = (4.0 / 3.0) * young * contact_radius * depth
        cap_force = force
        acts = ti.cast(overlap > 0.0, ti.i32)
        if adhesion > 0.0:
            radius = root_radius * root_radius
            length = cube_root(adhesion * radius * radius / young)
            reduced = overlap * radius / (length * length)
            if ti.static(acts_on_approach):
                acts = ti.cast(reduced > -TEAR_GAP, ti.i32)
            else:
                acts = ti.cast(overlap >= 0.0 or (engaged == 1 and reduced > -TEAR_GAP), ti.i32)
            if acts == 1 and reduced < HERTZ_LIMIT:
                s = largest_quartic_root(reduced)
                cubed = s * s * s
                scale = (4.0 / 3.0) * adhesion * radius * cubed
                force = scale * (cubed - 3.0)
                contact_radius = length * s * s
                if ti.static(cap_repulsive):
                    cap_force = scale * cubed
                else:
                    cap_force = ti.abs(force + 6.0 * adhesion * radius)
        return force, contact_radius, cap_force, acts

    return normal_force


def zero_force_gap(adhesion: Floats, young: Floats, radius: float) -> float:
    """Gap beyond which the force vanishes [m], 1.190551 L^2/R* for the largest effective radius."""
    length = np.cbrt(adhesion * radius**2 / young)
    return float(np.max(TEAR_GAP * length**2 / radius))
