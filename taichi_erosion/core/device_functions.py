"""Functions of device code: the nearest image in a periodic box, and elementary functions of 64-bit floats.

These are those of the engine, but on devices whose shaders have them in 32 bits only (Vulkan). There the
argument is reduced exactly and a series summed, so that the error is a few units of the last place:

    exp x = 2^n exp r,  |r| <= (ln 2) / 2        sin, cos x: r = x - n pi / 2,  |r| <= pi / 4
    ln x = n ln 2 + 2 artanh((m - 1) / (m + 1)),  x = 2^n m,  1 / sqrt 2 < m <= sqrt 2

Logarithms of numbers beyond the range of 32-bit floats, 1e-38 to 3e38, are not needed here and not right.

Reference: Muller (2016), Elementary Functions, 3rd ed., chapters 3 and 11 (series, reduction in two parts).
"""

from math import factorial, log, pi, sqrt

from taichi_erosion.core.ti import impl, ti

HALF_PI_HIGH = float.fromhex("0x1.921fb54400000p+0")  # its first 33 bits: products with n are exact
HALF_PI_LOW = 6.077100506506192e-11  # the rest of pi / 2
LN_2_HIGH = float.fromhex("0x1.62e42fee00000p-1")  # likewise
LN_2_LOW = 1.9082149292705877e-10
LN_2, ROOT_2, HALF_PI = log(2.0), sqrt(2.0), 0.5 * pi
EXPONENT_BITS = 11  # of a 64-bit float
SINGLE_MANTISSA, SINGLE_BIAS = 23, 127  # of a 32-bit float
ODD = tuple(1.0 / (2 * k + 1) for k in range(13))  # coefficients of artanh
EXP = tuple(1.0 / factorial(k) for k in range(15))
SINE = tuple((-1.0) ** k / factorial(2 * k + 1) for k in range(10))
COSINE = tuple((-1.0) ** k / factorial(2 * k) for k in range(10))

real = ti.f64


@ti.func
def nearest_image(difference, period):
    """Shortest vector between two positions of a periodic box [m]."""
    nearest = difference
    for k in ti.static(range(3)):
        if period[k] > 0.0:
            nearest[k] -= period[k] * ti.round(difference[k] / period[k])
    return nearest


def has_wide_functions() -> bool:
    """Whether the engine compiles elementary functions of 64-bit floats for the device."""
    return impl.current_cfg().arch != ti.vulkan


@ti.func
def power_of_two(n):
    """2^n for a whole number |n| < 2^10."""
    size, value = ti.abs(n), real(1.0)
    for bit in ti.static(range(EXPONENT_BITS - 1)):
        if (size >> bit) & 1:
            value *= ti.select(n > 0, real(2.0 ** (1 << bit)), real(0.5 ** (1 << bit)))
    return value


@ti.func
def exponential(x):
    """e^x."""
    if ti.static(has_wide_functions()):
        return ti.exp(x)
    else:
        n = ti.round(x * real(1.0 / LN_2))
        r = (x - n * real(LN_2_HIGH)) - n * real(LN_2_LOW)
        total = real(0.0)
        for term in ti.static(EXP[::-1]):
            total = total * r + real(term)
        return total * power_of_two(ti.cast(n, ti.i32))


@ti.func
def logarithm(x):
    """Natural logarithm of x > 0."""
    if ti.static(has_wide_functions()):
        return ti.log(x)
    else:
        n = (ti.bit_cast(ti.cast(x, ti.f32), ti.i32) >> SINGLE_MANTISSA) - SINGLE_BIAS
        m = x * power_of_two(-n)
        if m > real(ROOT_2):
            m *= real(0.5)
            n += 1
        s = (m - real(1.0)) / (m + real(1.0))
        total = real(0.0)
        for term in ti.static(ODD[::-1]):
            total = total * s * s + real(term)
        return ti.cast(n, real) * real(LN_2_HIGH) + (ti.cast(n, real) * real(LN_2_LOW) + 2.0 * s * total)


@ti.func
def sine_and_cosine(x):
    """Sine and cosine by the series, for |x| < 1e5."""
    n = ti.round(x * real(1.0 / HALF_PI))
    r = (x - n * real(HALF_PI_HIGH)) - n * real(HALF_PI_LOW)
    sine, cosine = real(0.0), real(0.0)
    for k in ti.static(range(len(SINE) - 1, -1, -1)):
        sine = real(SINE[k]) + sine * r * r
        cosine = real(COSINE[k]) + cosine * r * r
    sine *= r
    quarter = ti.cast(n, ti.i32) & 3
    across = ti.select(quarter % 2 == 1, cosine, sine)
    along = ti.select(quarter % 2 == 1, sine, cosine)
    return ti.select(quarter >= 2, -across, across), ti.select(quarter % 3 == 0, along, -along)


@ti.func
def sine(x):
    """Sin x, x in radians."""
    if ti.static(has_wide_functions()):
        return ti.sin(x)
    else:
        return sine_and_cosine(x)[0]


@ti.func
def cosine(x):
    """Cos x, x in radians."""
    if ti.static(has_wide_functions()):
        return ti.cos(x)
    else:
        return sine_and_cosine(x)[1]
