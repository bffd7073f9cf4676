"""Random numbers that depend on nothing but their keys: seed, grain and step.

Reference: Jarzynski & Olano (2020), J. Comput. Graph. Tech. 9, 21 (pcg3d); Box & Muller (1958), Ann. Math.
Stat. 29, 610.
"""

from math import pi

from taichi_erosion.core.ti import ti

MULTIPLIER = 1664525
INCREMENT = 1013904223
UNIT = 2.0**-32  # of a 32-bit number
HALF = 2.0**-33  # keeps the logarithm away from zero


@ti.func
def mixed(key):
    """Three scrambled 32-bit numbers of three."""
    v = key * ti.u32(MULTIPLIER) + ti.u32(INCREMENT)
    for _ in ti.static(range(2)):
        v[0] = v[0] + v[1] * v[2]
        v[1] = v[1] + v[2] * v[0]
        v[2] = v[2] + v[0] * v[1]
        v = v ^ (v >> ti.u32(16))
    return v


@ti.func
def uniform(seed, ident, step):
    """Three numbers between 0 and 1."""
    key = ti.Vector([ti.cast(seed, ti.u32), ti.cast(ident, ti.u32), ti.cast(step, ti.u32)])
    return ti.cast(mixed(key), ti.f64) * UNIT + HALF


@ti.func
def normal(seed, ident, step):
    """Three standard normal numbers."""
    u = uniform(seed, ident, step)
    w = uniform(seed, -1 - ident, step)
    length = ti.sqrt(-2.0 * ti.log(u[0]))
    other = ti.sqrt(-2.0 * ti.log(w[0]))
    turn, more = 2.0 * pi * u[1], 2.0 * pi * w[1]
    return ti.cast(ti.Vector([length * ti.cos(turn), length * ti.sin(turn), other * ti.cos(more)]), float)
