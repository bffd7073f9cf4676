"""Numbers as they stand in print: their last digit says how far they can be trusted."""

import re
from dataclasses import dataclass
from math import isfinite

NUMBER = re.compile(
    r"(?P<bound>[<>]?)\s*(?P<number>[+-]?(?:\d+\.?(?P<decimals>\d*)|\.(?P<bare>\d+))(?:[eE](?P<power>[+-]?\d+))?)"
)
HALF = 0.5 * (1.0 + 1e-6)  # of the last digit; a number that ends in 5 may be rounded either way [1]


@dataclass(frozen=True)
class Printed:
    """A printed number; `bound` is '<' or '>' where only a limit is printed."""

    text: str
    value: float
    last_digit: float  # size of one unit of the last printed digit
    bound: str = ""

    def agrees(self, found: float) -> bool:
        """Whether the found number could have been printed like this."""
        if not isfinite(found):
            return False
        if self.bound:
            return found < self.value if self.bound == "<" else found > self.value
        return abs(found - self.value) <= HALF * self.last_digit + 1e-12 * abs(self.value)

    def cut_off(self, found: float) -> bool:
        """Whether the found number would be printed like this if its further digits were cut off."""
        return 0.0 <= abs(found) - abs(self.value) < self.last_digit and found * self.value >= 0.0

    def opposite(self, found: float) -> bool:
        """Whether it would agree with the opposite sign, and only then."""
        flipped = Printed(self.text, -self.value, self.last_digit, self.bound)
        return not self.agrees(found) and flipped.agrees(found)


def parse_printed(text: str) -> Printed | None:
    """The number of a cell, stars of significance apart; None for anything else."""
    match = NUMBER.fullmatch(text.strip().rstrip("*").strip())
    if match is None:
        return None
    decimals = len(match["decimals"] or match["bare"] or "")
    power = int(match["power"] or 0)
    return Printed(text.strip(), float(match["number"]), 10.0 ** (power - decimals), match["bound"])
