"""Reading and conversion of units as laboratories print them: `m s-1`, `kg/(m s)`, `%`, `kg m⁻¹ s⁻¹`.

A unit is a factor to SI and five exponents: kilogram, metre, second, kelvin, radian. An angle counts as a
quantity of its own, so that degrees are not mistaken for a pure number.
"""

import re
import unicodedata
from collections.abc import Sequence
from dataclasses import dataclass
from math import isclose, pi

Exponents = tuple[int, int, int, int, int]

DIMENSIONLESS: Exponents = (0, 0, 0, 0, 0)
SYMBOLS: dict[str, tuple[float, Exponents]] = {
    "1": (1.0, DIMENSIONLESS),
    "-": (1.0, DIMENSIONLESS),
    "": (1.0, DIMENSIONLESS),
    "%": (1e-2, DIMENSIONLESS),
    "percent": (1e-2, DIMENSIONLESS),
    "‰": (1e-3, DIMENSIONLESS),
    "ppm": (1e-6, DIMENSIONLESS),
    "g": (1e-3, (1, 0, 0, 0, 0)),
    "t": (1e3, (1, 0, 0, 0, 0)),
    "m": (1.0, (0, 1, 0, 0, 0)),
    "L": (1e-3, (0, 3, 0, 0, 0)),
    "s": (1.0, (0, 0, 1, 0, 0)),
    "min": (60.0, (0, 0, 1, 0, 0)),
    "h": (3600.0, (0, 0, 1, 0, 0)),
    "d": (86400.0, (0, 0, 1, 0, 0)),
    "Hz": (1.0, (0, 0, -1, 0, 0)),
    "K": (1.0, (0, 0, 0, 1, 0)),
    "rad": (1.0, (0, 0, 0, 0, 1)),
    "deg": (pi / 180.0, (0, 0, 0, 0, 1)),
    "°": (pi / 180.0, (0, 0, 0, 0, 1)),
    "N": (1.0, (1, 1, -2, 0, 0)),
    "Pa": (1.0, (1, -1, -2, 0, 0)),
    "bar": (1e5, (1, -1, -2, 0, 0)),
    "J": (1.0, (1, 2, -2, 0, 0)),
    "W": (1.0, (1, 2, -3, 0, 0)),
}
PREFIXES = {"G": 1e9, "M": 1e6, "k": 1e3, "h": 1e2, "d": 1e-1, "c": 1e-2, "m": 1e-3, "u": 1e-6, "n": 1e-9}
PREFIXED = ("g", "m", "L", "s", "Hz", "N", "Pa", "bar", "J", "W", "rad")
EXAMPLES = "1, %, deg, m, mm, um, m/s, Pa, kg/m3, kg/(m s), g m-1 s-1, kg/kg, K; a condition also degC"
TOKEN = re.compile(
    r"\s*(?:(?P<mark>[/()])|(?P<symbol>[A-Za-z%‰°]+|1)(?:(?:\^|\*\*)?(?P<power>[+-]?\d+))?|[*·.])"
)
LONGEST = 60  # characters of a unit
LARGEST_POWER = 9


class UnknownUnit(ValueError):
    """A unit that cannot be read."""


@dataclass(frozen=True)
class Unit:
    """Size in SI units and the exponents of kg, m, s, K, rad."""

    factor: float
    exponents: Exponents

    def times(self, other: "Unit", power: int) -> "Unit":
        """Product of one unit and a power of another."""
        summed = [a + power * b for a, b in zip(self.exponents, other.exponents, strict=True)]
        return Unit(
            self.factor * other.factor**power, (summed[0], summed[1], summed[2], summed[3], summed[4])
        )


PURE = Unit(1.0, DIMENSIONLESS)


def parse_unit(text: str) -> Unit:
    """Unit that a text names; raises UnknownUnit.

    Factors stand side by side or are joined by `*` or `·`; a power follows its symbol; `/` divides by the one
    factor or parenthesis that follows, and nothing but another `/` may come after it.
    """
    plain = unicodedata.normalize("NFKC", text).strip().replace("\N{MINUS SIGN}", "-")
    plain = plain.replace("\N{GREEK SMALL LETTER MU}", "u")
    if plain in SYMBOLS:
        return Unit(*SYMBOLS[plain])
    if len(plain) > LONGEST:
        raise UnknownUnit(text)
    unit, rest = product(tokens(plain, text), text)
    if rest:
        raise UnknownUnit(text)
    return unit


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
            raise UnknownUnit(text)
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
        return PURE.times(symbol_unit(symbol, text), power), factors[1:]
    unit, rest = product(factors[1:], text)
    if not rest:
        raise UnknownUnit(text)
    return unit, rest[1:]


def symbol_unit(symbol: str, text: str) -> Unit:
    """Unit of one symbol, with or without a prefix."""
    if symbol in SYMBOLS:
        return Unit(*SYMBOLS[symbol])
    if symbol[0] in PREFIXES and symbol[1:] in PREFIXED:
        size, exponents = SYMBOLS[symbol[1:]]
        return Unit(PREFIXES[symbol[0]] * size, exponents)
    raise UnknownUnit(text)


def conversion(source: Unit, target: Unit) -> float | None:
    """Factor that turns numbers in `source` into numbers in `target`; None where the two differ in kind."""
    if source.exponents != target.exponents:
        return None
    ratio = source.factor / target.factor
    return 1.0 if isclose(ratio, 1.0, rel_tol=1e-12) else ratio
