"""Reading and conversion of units as laboratories print them: `m s-1`, `kg/(m s)`, `%`, `kg m⁻¹ s⁻¹`, `°F`.

The dictionary of units is that of pint; the usual ones stand here too, because loading it takes most of a
second (a test compares the two). The grammar is stricter than pint's: no text has two readings. A unit is a
factor to SI, its base units with their powers, and for temperatures the SI value of its zero. An angle
counts as a quantity of its own, so that degrees are not mistaken for a pure number.
"""

import re
import unicodedata
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from math import isclose, isfinite, pi
from typing import Any

Kind = tuple[tuple[str, int], ...]  # base units in the order of their names, with their powers

KILOGRAM, METRE, SECOND, KELVIN, RADIAN = "kilogram", "meter", "second", "kelvin", "radian"
USUAL: dict[str, tuple[float, dict[str, int]]] = {
    "percent": (1e-2, {}),
    "permille": (1e-3, {}),
    "ppm": (1e-6, {}),
    "g": (1e-3, {KILOGRAM: 1}),
    "t": (1e3, {KILOGRAM: 1}),
    "m": (1.0, {METRE: 1}),
    "L": (1e-3, {METRE: 3}),
    "s": (1.0, {SECOND: 1}),
    "min": (60.0, {SECOND: 1}),
    "h": (3600.0, {SECOND: 1}),
    "d": (86400.0, {SECOND: 1}),
    "Hz": (1.0, {SECOND: -1}),
    "K": (1.0, {KELVIN: 1}),
    "rad": (1.0, {RADIAN: 1}),
    "deg": (pi / 180.0, {RADIAN: 1}),
    "N": (1.0, {KILOGRAM: 1, METRE: 1, SECOND: -2}),
    "Pa": (1.0, {KILOGRAM: 1, METRE: -1, SECOND: -2}),
    "bar": (1e5, {KILOGRAM: 1, METRE: -1, SECOND: -2}),
    "J": (1.0, {KILOGRAM: 1, METRE: 2, SECOND: -2}),
    "W": (1.0, {KILOGRAM: 1, METRE: 2, SECOND: -3}),
}
PREFIXES = {"G": 1e9, "M": 1e6, "k": 1e3, "h": 1e2, "d": 1e-1, "c": 1e-2, "m": 1e-3, "u": 1e-6, "n": 1e-9}
PREFIXED = ("g", "m", "L", "s", "Hz", "N", "Pa", "bar", "J", "W", "rad")
SIGNS = {"": "", "1": "", "-": "", "%": "percent", "‰": "permille", "°": "deg"}
ICE_POINT = 273.15  # K
TEMPERATURES: dict[str, float] = dict.fromkeys(("degC", "°C", "Celsius", "celsius"), 1.0)  # degrees [K]
TEMPERATURES |= dict.fromkeys(("degF", "°F", "Fahrenheit", "fahrenheit"), 5.0 / 9.0)
AMBIGUOUS = {
    "C": "degrees Celsius are written degC, coulombs coulomb",
    "F": "degrees Fahrenheit are written degF, farads farad",
    "grad": "degrees are written deg, hundredths of a right angle gon",
    "Grad": "degrees are written deg, hundredths of a right angle gon",
    "grade": "degrees are written deg, hundredths of a right angle gon",
    "gr": "grams are written g, grains of weight are no unit here",
}
SINGLE_LETTERS = frozenset("gmshdtlLNKJWVAC")  # others are constants of nature, or units that no table has
BASES = frozenset((KILOGRAM, METRE, SECOND, KELVIN, RADIAN, "ampere"))
EXAMPLES = "1, %, deg, m, mm, um, m/s, Pa, kg/m3, kg/(m s), g m-1 s-1, kg/kg, K; a condition also degC, degF"
TOKEN = re.compile(
    r"\s*(?:(?P<mark>[/()])|(?P<symbol>[A-Za-z%‰°]+|1)(?:(?:\^|\*\*)?(?P<power>[+-]?\d+))?|[*·.])"
)
LONGEST = 60  # characters of a unit
LARGEST_POWER = 9


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


@cache
def registry() -> Any:
    """The dictionary of units; loaded at first need, which takes a moment."""
    import pint

    return pint.UnitRegistry()


def plain_text(text: str) -> str:
    """A unit in plain signs: `m⁻¹` is `m-1`, `µm` is `um`, `℃` is `°C`."""
    plain = unicodedata.normalize("NFKC", text).strip().replace("\N{MINUS SIGN}", "-")
    return plain.replace("\N{GREEK SMALL LETTER MU}", "u").replace("\N{MASCULINE ORDINAL INDICATOR}", "°")


@cache
def parse_unit(text: str) -> Unit:
    """Unit that a text names; raises UnknownUnit.

    Factors stand side by side or are joined by `*` or `·`; a power follows its symbol; `/` divides by the one
    factor or parenthesis that follows, and nothing but another `/` may come after it.
    """
    plain = plain_text(text)
    if plain in SIGNS:
        return named_unit(SIGNS[plain], text)
    if plain in AMBIGUOUS:
        raise UnknownUnit(text, AMBIGUOUS[plain])
    if len(plain) > LONGEST:
        raise UnknownUnit(text)
    unit, rest = product(tokens(plain, text), text)
    if rest or not isfinite(unit.factor) or unit.factor <= 0.0:
        raise UnknownUnit(text)
    return unit


def parse_scale(text: str) -> Unit:
    """Unit of a condition: as `parse_unit`, or a temperature that does not count from absolute zero."""
    degree = TEMPERATURES.get(plain_text(text).replace("deg ", "deg").replace("° ", "°"))
    return parse_unit(text) if degree is None else Unit(degree, ((KELVIN, 1),), zero_of(degree))


def zero_of(degree: float) -> float:
    """Where a scale of such degrees begins: water freezes at 0 of Celsius and 32 of Fahrenheit [K]."""
    return ICE_POINT if degree == 1.0 else ICE_POINT - 32.0 * degree


def tokens(plain: str, text: str) -> list[tuple[str, int]]:
    """Symbols with their powers, and the marks `/ ( )` with power 0."""
    found: list[tuple[str, int]] = []
    place = 0
    while place < len(plain):
        match = TOKEN.match(plain, place)
        if match is None:
            raise UnknownUnit(text)
        place = match.end()
        if match["mark"]:
            found.append((match["mark"], 0))
        elif match["symbol"]:
            power = int(match["power"] or 1)
            if not 0 < abs(power) <= LARGEST_POWER:
                raise UnknownUnit(text)
            found.append((match["symbol"], power))
    return found


def product(factors: Sequence[tuple[str, int]], text: str) -> tuple[Unit, Sequence[tuple[str, int]]]:
    """Unit of a product up to its end or to a closing parenthesis, and what is left."""
    unit, divided, empty = PURE, False, True
    while factors and factors[0][0] != ")":
        dividing = factors[0][0] == "/"
        if divided and not dividing:
            raise UnknownUnit(text, "put what is divided by into parentheses: kg/(m s)")
        divided = divided or dividing
        part, factors = factor(factors[1:] if dividing else factors, text)
        unit, empty = unit.times(part, -1 if dividing else 1), False
    if empty:
        raise UnknownUnit(text)
    return unit, factors


def factor(factors: Sequence[tuple[str, int]], text: str) -> tuple[Unit, Sequence[tuple[str, int]]]:
    """Unit of one symbol or one parenthesis, and what is left."""
    if not factors or factors[0][0] in "/)":
        raise UnknownUnit(text)
    symbol, power = factors[0]
    if symbol != "(":
        return PURE.times(named_unit(SIGNS.get(symbol, symbol), text), power), factors[1:]
    unit, rest = product(factors[1:], text)
    if not rest:
        raise UnknownUnit(text)
    return unit, rest[1:]


def named_unit(name: str, text: str) -> Unit:
    """Unit of one name or symbol of the dictionary, with or without a prefix."""
    if not name:
        return PURE
    found = usual_unit(name) or dictionary_entry(name)
    if found is None:
        lower = name.lower()
        raise UnknownUnit(text, f"did you mean '{lower}'?" if dictionary_entry(lower) is not None else "")
    return found


def usual_unit(name: str) -> Unit | None:
    """One of the usual units, with or without a prefix; None for any other."""
    size, prefixed = 1.0, name
    if name not in USUAL and name[0] in PREFIXES and name[1:] in PREFIXED:
        size, prefixed = PREFIXES[name[0]], name[1:]
    if prefixed not in USUAL:
        return None
    factor, powers = USUAL[prefixed]
    return Unit(size * factor, tuple(sorted(powers.items())))


@cache
def dictionary_entry(name: str) -> Unit | None:
    """Unit of the dictionary, None where it has none; a temperature with a zero of its own is none."""
    known = registry()
    if name in TEMPERATURES or (len(name) == 1 and name not in SINGLE_LETTERS) or name not in known:
        return None
    size = known.Quantity(1.0, name).to_base_units()
    powers = {str(unit): float(power) for unit, power in size.unit_items()}
    if not all(power.is_integer() for power in powers.values()) or not powers.keys() <= BASES:
        return None
    return Unit(float(size.magnitude), tuple(sorted((unit, int(power)) for unit, power in powers.items())))


def conversion(source: Unit, target: Unit) -> float | None:
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

    def used(self, written: float) -> float:
        """Number in the unit of use."""
        return self.origin + self.factor * written

    def written(self, used: float) -> float:
        """Number as the table has it."""
        return (used - self.origin) / self.factor


def scale_between(text: str, target: Unit) -> Scale | None:
    """Scale from a unit as written to the unit of use; None where the two differ in kind."""
    source = parse_scale(text)
    factor = conversion(source, target)
    if factor is None:
        return None
    return Scale(text.strip(), factor, (source.origin - target.origin) / target.factor)
