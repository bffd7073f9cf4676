"""Forms of laws of a dose: few numbers, one or two conditions.

    constant                a
    power                   a (c / c0)^p
    power of two            a (c / c0)^p (e / e0)^q
    onset                   a (max(c - k, 0) / c0)^p
    saturating              a (1 - exp(-c / k))
    exponential             a exp((c - c0) / k)
    dimensionless groups    a (d / d0)^-2 (Bond number of a pull ~ d), a (d / d0)^-3 (of a constant pull),
                            a (u d) (Reynolds), a (u^2 / d) (Shields)

with c0 the typical size of a condition, so that a is the dose there. A form of a group has one number, so
that it is preferred where it does as well as a free power. A calibrated number can take over the level of a
dose, so the dose counts from the state without a condition: along one that reaches 0 only forms that are 0
there are tried.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from taichi_erosion.evidence.data.problem import Conditions, Floats

DIAMETERS = ("diameter", "d")  # names of columns
WINDS = ("u_star", "friction_velocity")
GROUPS = {  # name -> powers of diameter and wind
    "Bond number of a pull that grows with the diameter": (-2.0, 0.0),
    "Bond number of a constant pull": (-3.0, 0.0),
    "Reynolds number": (1.0, 1.0),
    "Shields number": (-1.0, 2.0),
}
STEEPEST = 4.0  # exponent that is tried [1]
LARGEST_DOSE = 1e3


@dataclass(frozen=True)
class Form:
    """A law with free numbers; the first of them is the dose at typical conditions."""

    name: str
    conditions: tuple[str, ...]
    names: tuple[str, ...]  # of its numbers
    dose: Callable[[Conditions, Floats], Floats]  # (conditions, numbers) -> doses of the rows
    starts: tuple[tuple[float, ...], ...]  # of the numbers after the first
    low: tuple[float, ...]  # of all numbers
    high: tuple[float, ...]
    text: str  # expression with the names of its numbers in braces
    python: str  # the same in Python, conditions as at["name"]
    exponents: Mapping[str, str]  # condition -> name of its exponent

    @property
    def size(self) -> int:
        """How many numbers it has."""
        return len(self.names)


def typical(column: Floats) -> float:
    """Median of the sizes that are not zero, to three digits; 1 where there is none."""
    sizes = np.abs(column[np.isfinite(column) & (column != 0.0)])
    return float(f"{np.median(sizes):.3g}") if sizes.size else 1.0


def forms_of(conditions: Conditions) -> Iterator[Form]:
    """All forms that the conditions of some rows allow."""
    yield constant_form()
    varied = {
        name: column
        for name, column in conditions.items()
        if np.all(np.isfinite(column)) and np.ptp(column) > 1e-9 * np.abs(column).max()
    }
    yield from group_forms(varied)
    for name, column in varied.items():
        if column.min() != 0.0:
            yield exponential_form(name, column)
        if column.min() >= 0.0:
            yield power_form({name: column})
            yield saturating_form(name, column)
            yield onset_form(name, column)
    positive = {name: column for name, column in varied.items() if column.min() >= 0.0}
    for first, second in combinations(positive, 2):
        yield power_form({first: positive[first], second: positive[second]})


def constant_form() -> Form:
    """The same dose everywhere."""

    def dose(conditions: Conditions, numbers: Floats) -> Floats:
        size = next((column.size for column in conditions.values()), 1)
        return np.full(size, numbers[0])

    ends = ((-LARGEST_DOSE,), (LARGEST_DOSE,))
    return Form("constant", (), ("a",), dose, ((),), *ends, "{a}", "{a}", {})


def group_forms(varied: Conditions) -> Iterator[Form]:
    """Dimensionless groups of the scene, with fixed exponents."""
    diameter = next((name for name in DIAMETERS if name in varied), None)
    wind = next((name for name in WINDS if name in varied), None)
    for title, (of_diameter, of_wind) in GROUPS.items():
        if diameter is None or (of_wind and wind is None):
            continue
        powers = {diameter: of_diameter} | ({wind: of_wind} if wind is not None and of_wind else {})
        yield fixed_power_form(title, powers, {name: varied[name] for name in powers})


def fixed_power_form(title: str, powers: Mapping[str, float], columns: Conditions) -> Form:
    """Product of fixed powers."""
    scales = {name: typical(column) for name, column in columns.items()}

    def dose(conditions: Conditions, numbers: Floats) -> Floats:
        product = numbers[0] * np.ones(next(iter(conditions.values())).size)
        for name, power in powers.items():
            product = product * (conditions[name] / scales[name]) ** power
        return product

    text = " ".join(f"({name} / {scales[name]:g})^{power:g}" for name, power in powers.items())
    python = " * ".join(f'(at["{name}"] / {scales[name]:g}) ** {power:g}' for name, power in powers.items())
    ends = ((-LARGEST_DOSE,), (LARGEST_DOSE,))
    return Form(title, tuple(powers), ("a",), dose, ((),), *ends, f"{{a}} {text}", f"{{a}} * {python}", {})


def power_form(columns: Conditions) -> Form:
    """Product of free powers of one condition, or two; of one that reaches zero the power is positive."""
    scales = {name: typical(column) for name, column in columns.items()}
    letters = dict(zip(columns, ("p", "q"), strict=False))
    low = tuple(0.05 if column.min() <= 0.0 else -STEEPEST for column in columns.values())

    def dose(conditions: Conditions, numbers: Floats) -> Floats:
        product = numbers[0] * np.ones(next(iter(conditions.values())).size)
        for k, name in enumerate(columns):
            product = product * np.maximum(conditions[name] / scales[name], 0.0) ** numbers[k + 1]
        return product

    starts = [tuple(sign if end < 0.0 else 1.0 for end in low) for sign in (1.0, -1.0)]
    text = " ".join(f"({name} / {scales[name]:g})^{{{letters[name]}}}" for name in columns)
    python = " * ".join(f'(at["{name}"] / {scales[name]:g}) ** {{{letters[name]}}}' for name in columns)
    return Form(
        "power" if len(columns) == 1 else "power of two conditions",
        tuple(columns),
        ("a", *letters.values()),
        dose,
        tuple(dict.fromkeys(starts)),
        (-LARGEST_DOSE, *low),
        (LARGEST_DOSE, *(STEEPEST for _ in columns)),
        f"{{a}} {text}",
        f"{{a}} * {python}",
        letters,
    )


def onset_form(name: str, column: Floats) -> Form:
    """A power of what a condition has above an onset."""
    scale, least, most = typical(column), float(column.min()), float(column.max())

    def dose(conditions: Conditions, numbers: Floats) -> Floats:
        above = np.maximum(conditions[name] - numbers[2], 0.0) / scale
        return np.where(above > 0.0, numbers[0] * np.maximum(above, 1e-12) ** numbers[1], 0.0)

    levels = np.unique(column)
    onsets = [float(np.quantile(levels, share)) for share in (0.1, 0.35, 0.6)]
    return Form(
        "onset",
        (name,),
        ("a", "p", "k"),
        dose,
        tuple((1.0, onset) for onset in onsets),
        (-LARGEST_DOSE, 0.05, least),
        (LARGEST_DOSE, STEEPEST, least + 0.9 * (most - least)),
        f"{{a}} (max({name} - {{k}}, 0) / {scale:g})^{{p}}",
        f'{{a}} * (np.maximum(at["{name}"] - {{k}}, 0.0) / {scale:g}) ** {{p}}',
        {name: "p"},
    )


def saturating_form(name: str, column: Floats) -> Form:
    """Growth to a limit."""
    scale, most = typical(column), float(column.max())

    def dose(conditions: Conditions, numbers: Floats) -> Floats:
        return numbers[0] * -np.expm1(-conditions[name] / numbers[1])

    return Form(
        "saturating",
        (name,),
        ("a", "k"),
        dose,
        ((0.3 * scale,), (scale,)),
        (-LARGEST_DOSE, 0.02 * scale),
        (LARGEST_DOSE, 2.0 * most),
        f"{{a}} (1 - exp(-{name} / {{k}}))",
        f'{{a}} * (1.0 - np.exp(-at["{name}"] / {{k}}))',
        {},
    )


def exponential_form(name: str, column: Floats) -> Form:
    """Growth or decay by a factor of e in each step of the condition."""
    centre = float(f"{np.mean(column):.3g}")
    width = float(np.std(column))

    def dose(conditions: Conditions, numbers: Floats) -> Floats:
        return numbers[0] * np.exp(np.clip(numbers[1] * (conditions[name] - centre), -30.0, 30.0))

    return Form(
        "exponential",
        (name,),
        ("a", "b"),
        dose,
        ((0.5 / width,), (-0.5 / width,)),
        (-LARGEST_DOSE, -4.0 / width),
        (LARGEST_DOSE, 4.0 / width),
        f"{{a}} exp({{b}} ({name} - {centre:g}))",
        f'{{a}} * np.exp({{b}} * (at["{name}"] - {centre:g}))',
        {},
    )
