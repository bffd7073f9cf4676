"""One claim: a sentence, the value found, the value expected, and the largest admissible difference."""

from dataclasses import asdict, dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

Precision = Literal["f32", "f64"]
PRECISIONS: tuple[Precision, Precision] = ("f64", "f32")


@dataclass(frozen=True)
class Outcome:
    """Result of a check; it passes where |got - want| <= tolerance."""

    claim: str
    got: float
    want: float
    tolerance: float  # in the unit of got and want
    precision: Precision


@dataclass(frozen=True)
class Claim:
    """One outcome as it is printed, with its verdict and the wall time that it took [s]."""

    id: str
    claim: str
    got: float
    want: float
    tolerance: float
    precision: str
    passed: bool
    wall_s: float


def relative(claim: str, got: float, want: float, share: float, precision: Precision) -> Outcome:
    """`got` may differ from `want` by `share` of it."""
    return Outcome(claim, float(got), float(want), share * abs(float(want)), precision)


def below(claim: str, deviations: ArrayLike, limit: float, precision: Precision) -> Outcome:
    """The largest of some deviations must vanish up to `limit`; a NaN among them fails."""
    largest = float(np.max(np.abs(np.asarray(deviations, dtype=float))))
    return Outcome(claim, largest, 0.0, limit, precision)


def holds(claim: str, truth: bool, precision: Precision) -> Outcome:
    """A statement that is true (1) or not (0)."""
    return Outcome(claim, float(truth), 1.0, 0.0, precision)


def as_claim(ident: str, outcome: Outcome, wall_s: float) -> Claim:
    """The outcome with its verdict; got = NaN fails."""
    passed = bool(abs(outcome.got - outcome.want) <= outcome.tolerance)
    return Claim(ident, **asdict(outcome), passed=passed, wall_s=wall_s)
