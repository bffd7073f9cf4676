"""A sphere cut by the layers of the air: layers are thinner than grains, so each grain lies in many of them.

The share of a sphere's volume below a height s (in radii, from its centre) is

    c(s) = (2 + 3 s - s^3) / 4,    -1 <= s <= 1,

and the shares of all layers add up to one exactly, because each is the difference of two neighbouring c and
the outermost ones are set to 0 and 1. What reaches below the floor or above the lid counts in the outermost
layer. Grains receive means over the same shares with which they give, so that the drag on a grain is the sum
of what its layers lose.
"""

from taichi_erosion.air.place import layer_of
from taichi_erosion.core.ti import ti

real = ti.f64


@ti.func
def share_below(air: ti.template(), r, height, radius, face):
    """Share of the sphere below the face with this number [1]."""
    share = real(1.0)
    if face < air.cells[2]:
        s = ti.min(ti.max((air.face[r, face] - height) / radius, -1.0), 1.0)
        share = 0.25 * (2.0 + 3.0 * s - s * s * s)
    return share


@ti.func
def layer_range(air: ti.template(), r, height, radius):
    """First and last layer that a sphere reaches."""
    return layer_of(air, r, height - radius), layer_of(air, r, height + radius)
