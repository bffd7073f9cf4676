"""Forms of laws of a dose: few numbers, one or two conditions.

    constant                a
    power                   a (c / c0)^p
    power of two            a (c / c0)^p (e / e0)^q
    onset                   a (max(c - k, 0) / c0)^p
    saturating              a (1 - exp(-c / k))
    exponential             a exp(b (c - c0))
    dimensionless groups    a (d / d0)^-2 (Bond number of a pull ~ d), a (d / d0)^-3 (of a constant pull),
                            a (u d) (Reynolds), a (u^2 / d) (Shields)

with c0 the typical size of a condition, so that a is the dose there. A form of a group has one number, so
that it is preferred where it does as well as a free power. A calibrated number can take over the level of a
dose, so the dose counts from the state without a condition: along one that reaches 0 only forms that are 0
there are tried.
"""

import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from itertools import combinations

import numpy as np

from taichi_erosion.core.setup import Floats

Conditions = Mapping[str, Floats]  # columns by name

SIZES = (("diameter", "d"), ("u_star", "friction_velocity"))  # names of columns
GROUPS = {  # name -> powers of diameter and wind
    "Bond number of a pull that grows with the diameter": (-2.0, 0.0),
    "Bond number of a constant pull": (-3.0, 0.0),
    "Reynolds number": (1.0, 1.0),
    "Shields number": (-1.0, 2.0),
}
POWERS = ("constant", "power", *GROUPS)  # forms that are taken where others are hardly better
FLATTEST, STEEPEST = 0.05, 4.0  # exponents that are tried: no term of a known force is steeper [1]


@dataclass(frozen=True)
class Form:
    """A law a s(conditions, numbers) with free numbers; a is the first of them."""

    name: str
    conditions: tuple[str, ...]
    shape: Callable[[Conditions, Floats], Floats]  # s, of the numbers after a
    python: str  # expression with the names of its numbers in braces, conditions as at["name"]
    names: tuple[str, ...] = ()  # of the numbers after a
    starts: tuple[tuple[float, ...], ...] = ((),)
    low: tuple[float, ...] = ()
    high: tuple[float, ...] = ()
    exponents: Mapping[str, str] = field(default_factory=dict)  # condition -> name of its exponent

    def dose(self, conditions: Conditions, numbers: Floats) -> Floats:
        return numbers[0] * np.nan_to_num(self.shape(conditions, numbers[1:]))

    @property
    def text(self) -> str:
        """The expression as it is written in a text."""
        plain = re.sub(r'at\["(\w+)"\]', r"\1", self.python)
        return plain.replace("np.maximum", "max").replace("np.", "").replace(" ** ", "^").replace(" * ", " ")


def median_nonzero_size(column: Floats) -> float:
    """Median of the sizes that are not zero, to three digits."""
    return float(f"{np.median(np.abs(column[column != 0.0])):.3g}")


def allowed_forms(conditions: Conditions) -> Iterator[Form]:
    yield Form("constant", (), lambda at, _: np.ones(next(iter(at.values())).size), "{a}")
    finite = {name: column for name, column in conditions.items() if np.all(np.isfinite(column))}
    varied = {name: c for name, c in finite.items() if np.ptp(c) > 1e-9 * np.abs(c).max()}
    positive = {name: column for name, column in varied.items() if column.min() >= 0.0}
    sizes = [next((c for c in names if c in positive and positive[c].min() > 0.0), "") for names in SIZES]
    for title, powers in GROUPS.items():
        fixed = {name: power for name, power in zip(sizes, powers, strict=True) if power}
        if "" not in fixed:
            yield power_form(title, {name: positive[name] for name in fixed}, tuple(fixed.values()))
    for name, column in varied.items():
        if column.min() != 0.0:
            yield exponential_form(name, column)
    for name, column in positive.items():
        yield power_form("power", {name: column})
        yield saturating_form(name, column)
        yield onset_form(name, column)
    for pair in combinations(positive, 2):
        yield power_form("power of two conditions", {name: positive[name] for name in pair})


def power_form(title: str, columns: Conditions, fixed: tuple[float, ...] = ()) -> Form:
    """Product of powers, free or fixed; of a condition that reaches zero the power is positive."""
    scales = {name: median_nonzero_size(column) for name, column in columns.items()}
    letters = () if fixed else ("p", "q")[: len(columns)]
    low = () if fixed else tuple(-STEEPEST if c.min() > 0.0 else FLATTEST for c in columns.values())
    terms = [f"{power:g}" for power in fixed] or [f"{{{letter}}}" for letter in letters]
    factors = [f'(at["{c}"] / {scales[c]:g}) ** {power}' for c, power in zip(columns, terms, strict=True)]

    def shape(at: Conditions, powers: Floats) -> Floats:
        bases = np.array([at[name] / scale for name, scale in scales.items()])
        return np.prod(bases ** np.array(fixed or powers)[:, np.newaxis], axis=0)

    starts = [tuple(sign if end < 0.0 else 1.0 for end in low) for sign in (1.0, -1.0)]
    python, conditions = " * ".join(["{a}", *factors]), tuple(columns)
    high, exponents = (STEEPEST,) * len(low), dict(zip(columns, letters, strict=False))
    return Form(title, conditions, shape, python, letters, tuple(dict.fromkeys(starts)), low, high, exponents)


def onset_form(name: str, column: Floats) -> Form:
    """A power of what a condition has above an onset."""
    scale, least, most = median_nonzero_size(column), float(column.min()), float(column.max())

    def shape(at: Conditions, n: Floats) -> Floats:
        return (np.maximum(at[name] - n[1], 0.0) / scale) ** n[0]

    python = f'{{a}} * (np.maximum(at["{name}"] - {{k}}, 0) / {scale:g}) ** {{p}}'
    starts = tuple((1.0, float(k)) for k in np.quantile(np.unique(column), (0.1, 0.35, 0.6)))
    low, high = (FLATTEST, least), (STEEPEST, least + 0.9 * (most - least))
    return Form("onset", (name,), shape, python, ("p", "k"), starts, low, high, {name: "p"})


def saturating_form(name: str, column: Floats) -> Form:
    scale, most = median_nonzero_size(column), float(column.max())

    def shape(at: Conditions, n: Floats) -> Floats:
        return -np.expm1(-at[name] / n[0])

    python = f'{{a}} * (1 - np.exp(-at["{name}"] / {{k}}))'
    starts, low, high = ((0.3 * scale,), (scale,)), (0.02 * scale,), (2.0 * most,)
    return Form("saturating", (name,), shape, python, ("k",), starts, low, high)


def exponential_form(name: str, column: Floats) -> Form:
    """Growth or decay by a factor of e in each step of the condition."""
    centre, width = float(f"{np.mean(column):.3g}"), float(np.std(column))

    def shape(at: Conditions, n: Floats) -> Floats:
        return np.exp(n[0] * (at[name] - centre))

    python = f'{{a}} * np.exp({{b}} * (at["{name}"] - {centre:g}))'
    starts, low, high = ((0.5 / width,), (-0.5 / width,)), (-STEEPEST / width,), (STEEPEST / width,)
    return Form("exponential", (name,), shape, python, ("b",), starts, low, high)
