"""Reading and conversion of units as laboratories print them: `m s-1`, `kg/(m s)`, `%`, `kg m⁻¹ s⁻¹`, `°F`.

The dictionary of units is that of pint. The grammar is stricter than pint's: no text has two readings. A unit
is a factor to SI, its base units with their powers, and for temperatures the SI value of its zero. An angle
counts as a quantity of its own, so that degrees are not mistaken for a pure number.
"""

import re
import unicodedata
from dataclasses import dataclass
from functools import cache
from math import isclose, isfinite, pi
from typing import Any

Kind = tuple[tuple[str, int], ...]  # base units in the order of their names, with their powers

SIGNS = {"%": "percent", "‰": "permille", "°": "deg"}
PURE_NUMBERS = ("", "1", "-")
ICE_POINT = 273.15  # K
TEMPERATURES: dict[str, float] = dict.fromkeys(("degC", "°C", "Celsius", "celsius"), 1.0)  # degrees [K]
TEMPERATURES |= dict.fromkeys(("degF", "°F", "Fahrenheit", "fahrenheit"), 5.0 / 9.0)
AMBIGUOUS = {
    "C": "degrees Celsius are written degC, coulombs coulomb",
    "F": "degrees Fahrenheit are written degF, farads farad",
    **dict.fromkeys(("grad", "Grad", "grade"), "degrees are written deg, hundredths of a right angle gon"),
    **dict.fromkeys(("gr", "grain", "grains"), "grams are written g, grains of weight are no unit here"),
}
SINGLE_LETTERS = frozenset("gmshdtlLNKJWVAC")  # others are constants of nature, or units that no table has
BASES = frozenset(("kilogram", "meter", "second", "kelvin", "radian", "ampere"))
EXAMPLES = "1, %, deg, m, mm, um, m/s, Pa, kg/m3, kg/(m s), g m-1 s-1, kg/kg, K; a condition also degC, degF"
FACTOR = r"(?:[A-Za-z%‰°]+(?![A-Za-z%‰°])|(?<!\w)1)(?:(?:\^|\*\*)?[+-]?0*[1-9](?!\d))?"  # with its power
PRODUCT = rf"[\s*·.]*{FACTOR}(?:[\s*·.]*{FACTOR})*[\s*·.]*"
DIVISOR = rf"\s*/[\s*·.]*(?:{FACTOR}|\({PRODUCT}\))\s*"  # what is divided by: one factor, or parentheses
GRAMMAR = re.compile(rf"(?:{PRODUCT}|\({PRODUCT}\))?(?:{DIVISOR})*")
POWERS = re.compile(r"([A-Za-z%‰°]+|(?<!\w)1)(?:\^|\*\*)?([+-]?\d+)?")
SLASH = re.compile(r"/(?![^(]*\))")  # outside parentheses
LONGEST = 60  # characters of a unit


class UnknownUnit(ValueError):
    """A unit that cannot be read; `hint` says what may have been meant."""

    def __init__(self, text: str, hint: str = "") -> None:
        super().__init__(text)
        self.hint = hint


@dataclass(frozen=True)
class Unit:
    """Size in SI units, base units with their powers, and the SI value of 0."""

    factor: float
    kind: Kind = ()
    origin: float = 0.0

    def times(self, other: "Unit", power: int) -> "Unit":
        """Product of one unit and a power of another."""
        powers = dict(self.kind)
        for name, exponent in other.kind:
            powers[name] = powers.get(name, 0) + power * exponent
        kind = tuple(sorted((name, exponent) for name, exponent in powers.items() if exponent))
        return Unit(self.factor * other.factor**power, kind)


PURE = Unit(1.0)
SIZES: dict[Kind, dict[str, float]] = {
    (): {"1": 1.0, "percent": 0.01},
    (("meter", 1),): {"m": 1.0, "cm": 0.01, "mm": 1e-3, "um": 1e-6},
    (("kilogram", 1),): {"kg": 1.0, "g": 1e-3},
    (("second", 1),): {"s": 1.0, "min": 60.0, "h": 3600.0, "d": 86400.0},
    (("radian", 1),): {"rad": 1.0, "deg": pi / 180.0},
    (("kelvin", 1),): {"K": 1.0},
    (("kilogram", 1), ("meter", -1), ("second", -2)): {"Pa": 1.0, "hPa": 100.0, "kPa": 1000.0},
}
# the units of most tables: they need no dictionary, which takes long to load
USUAL = {name: Unit(size, kind) for kind, sizes in SIZES.items() for name, size in sizes.items()}


@cache
def unit_registry() -> Any:
    """The dictionary of units; loaded at first need, which takes half a second."""
    import pint

    return pint.UnitRegistry()


def plain_unit_text(text: str) -> str:
    """A unit in plain signs: `m⁻¹` is `m-1`, `µm` is `um`, `℃` is `°C`."""
    plain = unicodedata.normalize("NFKC", text).strip().replace("\N{MINUS SIGN}", "-")
    return plain.replace("\N{GREEK SMALL LETTER MU}", "u").replace("\N{MASCULINE ORDINAL INDICATOR}", "°")


@cache
def parse_unit(text: str) -> Unit:
    """Unit that a text names; raises UnknownUnit.

    Factors stand side by side or are joined by `*` or `·`; a power follows its symbol; `/` divides by the one
    factor or parenthesis that follows, and nothing but another `/` may come after it.
    """
    plain = plain_unit_text(text)
    if plain in PURE_NUMBERS:
        return PURE
    if len(plain) > LONGEST or not GRAMMAR.fullmatch(plain):
        remedy = "put what is divided by into parentheses: kg/(m s)"
        raise UnknownUnit(text, remedy if "/" in plain and "(" not in plain else "")
    unit = PURE
    for place, part in enumerate(SLASH.split(plain)):
        for symbol, power in POWERS.findall(part):
            unit = unit.times(unit_of_symbol(symbol, text), int(power or 1) * (-1 if place else 1))
    if not isfinite(unit.factor) or unit.factor <= 0.0:
        raise UnknownUnit(text)
    return unit


def parse_scale(text: str) -> Unit:
    """Unit of a condition: as `parse_unit`, or a temperature that does not count from absolute zero."""
    degree = TEMPERATURES.get(plain_unit_text(text).replace("deg ", "deg").replace("° ", "°"))
    if degree is None:
        return parse_unit(text)
    # water freezes at 0 of Celsius and 32 of Fahrenheit
    return Unit(degree, (("kelvin", 1),), ICE_POINT if degree == 1.0 else ICE_POINT - 32.0 * degree)


def unit_of_symbol(symbol: str, text: str) -> Unit:
    """Unit of one symbol, with or without a prefix."""
    if symbol in AMBIGUOUS and (len(symbol) > 1 or symbol == text.strip()):
        raise UnknownUnit(text, AMBIGUOUS[symbol])
    unit = unit_from_registry(SIGNS.get(symbol, symbol))
    if unit is None:
        lower = symbol.lower()
        raise UnknownUnit(text, f"did you mean '{lower}'?" if unit_from_registry(lower) is not None else "")
    return unit


@cache
def unit_from_registry(name: str) -> Unit | None:
    """Unit of the dictionary, None where it has none; a temperature with a zero of its own is none."""
    if name in USUAL:
        return USUAL[name]
    if name in TEMPERATURES or (len(name) == 1 and name not in SINGLE_LETTERS):
        return None
    try:
        size = unit_registry().Quantity(1.0, name).to_base_units()
    except (AttributeError, TypeError, ValueError):  # pint's errors for what it does not know
        return None
    powers = {str(unit): float(power) for unit, power in size.unit_items()}
    if not all(power.is_integer() for power in powers.values()) or not powers.keys() <= BASES:
        return None
    return Unit(float(size.magnitude), tuple(sorted((unit, int(power)) for unit, power in powers.items())))


def conversion_factor(source: Unit, target: Unit) -> float | None:
    """Factor that turns numbers in `source` into numbers in `target`; None where the two differ in kind."""
    if source.kind != target.kind:
        return None
    ratio = source.factor / target.factor
    return 1.0 if isclose(ratio, 1.0, rel_tol=1e-12) else ratio


@dataclass(frozen=True)
class Scale:
    """Numbers of a column as they are used: used = origin + factor * written."""

    unit: str = ""  # as written; empty: none was
    factor: float = 1.0
    origin: float = 0.0

    def to_use(self, number: float) -> float:
        """Number in the unit of use."""
        return self.origin + self.factor * number

    def to_unit_of_table(self, used: float) -> float:
        return (used - self.origin) / self.factor


def scale_between(text: str, target: Unit) -> Scale | None:
    """Scale from a unit as written to the unit of use; None where the two differ in kind."""
    source = parse_scale(text)
    factor = conversion_factor(source, target)
    if factor is None:
        return None
    return Scale(text.strip(), factor, (source.origin - target.origin) / target.factor)
