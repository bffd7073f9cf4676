"""Grain diameters: range, nominal value and samples of each size law."""

import tomllib
from functools import cache
from importlib.resources import files
from math import exp, log

import numpy as np
import scipy

from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.setup import Floats
from taichi_erosion.scene.schema.grains import Lognormal, Monodisperse, Sieve, SieveRow, Size


def shipped_tables() -> list[str]:
    """Names of the sieve tables that come with the program."""
    folder = files("taichi_erosion.scene") / "tables"
    return sorted(
        entry.name.removesuffix(".toml") for entry in folder.iterdir() if entry.name.endswith(".toml")
    )


@cache
def table_rows(name: str) -> tuple[SieveRow, ...]:
    """Rows of a shipped sieve table: low [m], high [m], mass."""
    if name not in shipped_tables():
        raise BadInput(
            f"grains.size.table = '{name}' is not among the shipped tables: {', '.join(shipped_tables())}"
        )
    content = (files("taichi_erosion.scene") / "tables" / f"{name}.toml").read_text(encoding="utf-8")
    return tuple((float(low), float(high), float(mass)) for low, high, mass in tomllib.loads(content)["rows"])


def sieve_classes(size: Sieve) -> Floats:
    """Size classes after cutting and scaling, [classes, 3]: low [m], high [m], share of the mass [1].

    Mass is uniform over ln d inside a class, so a cut keeps ln(b'/a') / ln(b/a) of its mass.
    """
    rows = size.rows or table_rows(size.table or "")
    low, high = size.low or 0.0, size.high or np.inf
    kept = []
    for a, b, mass in rows:
        cut_a, cut_b = max(a, low), min(b, high)
        if cut_a < cut_b and mass > 0.0:
            kept.append((cut_a * size.scale, cut_b * size.scale, mass * log(cut_b / cut_a) / log(b / a)))
    if not kept:
        raise BadInput("grains.size: no mass is left between low and high")
    classes = np.array(kept)
    classes[:, 2] /= classes[:, 2].sum()
    return classes


def size_range(size: Size) -> tuple[float, float]:
    """Smallest and largest diameter that a size law can give [m]."""
    if isinstance(size, Monodisperse):
        return size.diameter, size.diameter
    if isinstance(size, Lognormal):
        return size.low, size.high
    classes = sieve_classes(size)
    return float(classes[0, 0]), float(classes[-1, 1])


def nominal_diameter(size: Size) -> float:
    """The diameter d that names the scene [m]: the diameter, the median, or the sieve curve's mass median."""
    if isinstance(size, Monodisperse):
        return size.diameter
    if isinstance(size, Lognormal):
        return size.median
    classes = sieve_classes(size)
    below = np.concatenate([[0.0], np.cumsum(classes[:, 2])])
    row = min(int(np.searchsorted(below, 0.5)) - 1, len(classes) - 1)
    low, high, share = classes[row]
    return float(low * (high / low) ** ((0.5 - below[row]) / share))


def sample_diameters(size: Size, count: int, generator: np.random.Generator) -> Floats:
    """Diameters of `count` grains in random order [m]."""
    if isinstance(size, Monodisperse):
        return np.full(count, size.diameter)
    if isinstance(size, Lognormal):
        return sample_lognormal(size, generator.random(count))
    return sample_sieve(sieve_classes(size), generator.random(count), generator.random(count))


def sample_lognormal(size: Lognormal, quantile: Floats) -> Floats:
    """Inverse of the truncated lognormal distribution of numbers [m]."""
    if size.sigma_log == 0.0:
        return np.full(len(quantile), size.median)
    below = scipy.special.ndtr(log(size.low / size.median) / size.sigma_log)
    above = scipy.special.ndtr(log(size.high / size.median) / size.sigma_log)
    deviate = scipy.special.ndtri(below + quantile * (above - below))
    return np.clip(size.median * np.exp(size.sigma_log * deviate), size.low, size.high)


def sample_sieve(classes: Floats, quantile_class: Floats, quantile: Floats) -> Floats:
    """Diameters whose masses follow a sieve curve [m].

    Mass uniform over ln d means numbers proportional to d^-3 per ln d: class [a, b] with share w of the mass
    holds numbers in proportion to  w (a^-3 - b^-3) / (3 ln(b/a));  inside it  d^-3 = a^-3 - q (a^-3 - b^-3).
    """
    low, high, share = classes.T
    span = low**-3 - high**-3
    numbers = share * span / np.log(high / low)
    edges = np.cumsum(numbers) / numbers.sum()
    row = np.minimum(np.searchsorted(edges, quantile_class, side="right"), len(classes) - 1)
    return np.clip((low[row] ** -3 - quantile * span[row]) ** (-1.0 / 3.0), low[row], high[row])


def mean_cube(size: Size) -> float:
    """Mean of d^3 over the grains [m3]; times pi/6 it is the mean volume of a sphere."""
    if isinstance(size, Monodisperse):
        return size.diameter**3
    if isinstance(size, Lognormal):
        return lognormal_cube(size)
    low, high, share = sieve_classes(size).T
    return 1.0 / float(np.sum(share * (low**-3 - high**-3) / (3.0 * np.log(high / low))))


def lognormal_cube(size: Lognormal) -> float:
    """Mean of d^3 of a truncated lognormal distribution [m3].

    E[d^3] = D^3 exp(9 s^2 / 2) [Phi(b - 3 s) - Phi(a - 3 s)] / [Phi(b) - Phi(a)]
    D median [m], s sigma_log [1], a = ln(low / D) / s, b = ln(high / D) / s, Phi the normal distribution
    """
    s = size.sigma_log
    if s == 0.0:
        return size.median**3
    a, b = log(size.low / size.median) / s, log(size.high / size.median) / s
    normal = scipy.special.ndtr
    kept = normal(b) - normal(a)
    if kept <= 0.0:
        return size.median**3
    return size.median**3 * exp(4.5 * s * s) * float(normal(b - 3.0 * s) - normal(a - 3.0 * s)) / float(kept)
