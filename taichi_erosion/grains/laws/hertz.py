"""Hertz: elastic repulsion of two smooth spheres without adhesion.

    F = (4/3) E* sqrt(R*) d^(3/2) = (4/3) E* a d,    a = sqrt(R* d)

with d the overlap [m], R* the effective radius [m], E* the effective Young's modulus [Pa], a the contact
radius [m].

Reference: Johnson (1985), Contact Mechanics, eqs (4.22)-(4.23).
"""

from taichi_erosion.core.setup import Floats
from taichi_erosion.core.ti import ti


@ti.func
def normal_force(materials: ti.template(), row, overlap, root_radius, engaged):
    """Elastic force [N], contact radius [m], force that caps friction [N], and whether the contact acts."""
    depth = ti.max(overlap, 0.0)
    contact_radius = root_radius * ti.sqrt(depth)
    elastic = (4.0 / 3.0) * materials.young[row] * contact_radius * depth
    return elastic, contact_radius, elastic, ti.cast(overlap > 0.0, ti.i32)


@ti.func
def normal_energy(materials: ti.template(), row, overlap, root_radius):
    """Energy stored in the normal spring [J], (2/5) F d."""
    depth = ti.max(overlap, 0.0)
    return (8.0 / 15.0) * materials.young[row] * root_radius * ti.sqrt(depth) * depth * depth


def zero_force_gap(adhesion: Floats, young: Floats, radius: float) -> float:
    """Gap beyond which the force vanishes [m]."""
    return 0.0
