"""Claims of `./erosion verify`: a sentence, what was got, what is wanted, and how far apart they may be.

A ladder holds checks by id; a check yields outcomes, and an outcome with its verdict is a claim.
"""

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from math import nan

import numpy as np
from numpy.typing import ArrayLike

from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.setup import Precision

PRECISIONS: tuple[Precision, Precision] = ("f64", "f32")
REASON_LENGTH = 200  # characters of an error that are printed


@dataclass(frozen=True)
class Outcome:
    """Result of a check; it passes where |got - want| <= tolerance."""

    claim: str
    got: float
    want: float
    tolerance: float  # in the unit of got and want
    precision: Precision


@dataclass(frozen=True)
class Claim(Outcome):
    """An outcome as it is printed, with its check, its verdict and the wall time that it took [s]."""

    id: str
    passed: bool
    wall_s: float


Check = Callable[[], Iterator[Outcome]]


@dataclass(frozen=True)
class Ladder:
    """Checks by id; a failure that is known is told in every run and is no news."""

    checks: Mapping[str, Check]
    is_known: Callable[[Claim], bool] = lambda claim: False


def relative(claim: str, got: float, want: float, share: float, precision: Precision) -> Outcome:
    """`got` may differ from `want` by `share` of it."""
    return Outcome(claim, float(got), float(want), share * abs(float(want)), precision)


def below(claim: str, deviations: ArrayLike, limit: float, precision: Precision) -> Outcome:
    """The largest of some deviations must vanish up to `limit`; a NaN among them fails."""
    return Outcome(claim, float(np.max(np.abs(np.asarray(deviations, dtype=float)))), 0.0, limit, precision)


def holds(claim: str, truth: bool, precision: Precision) -> Outcome:
    """A statement that is true (1) or not (0)."""
    return Outcome(claim, float(truth), 1.0, 0.0, precision)


def as_claim(ident: str, outcome: Outcome, wall_s: float) -> Claim:
    """The outcome with its verdict; got = NaN fails."""
    passed = bool(abs(outcome.got - outcome.want) <= outcome.tolerance)
    return Claim(**asdict(outcome), id=ident, passed=passed, wall_s=wall_s)


def verify_claims(
    ladder: Ladder, ids: Sequence[str] = (), on_claim: Callable[[Claim], object] = lambda claim: None
) -> list[Claim]:
    """Claims of the checks named by `ids` (all where empty), each handed to `on_claim` once known."""
    unknown = [ident for ident in ids if ident not in ladder.checks]
    if unknown:
        raise BadInput(f"verify: {unknown[0]} is unknown; choose from {', '.join(ladder.checks)}")
    claims = []
    for ident in ids or ladder.checks:
        for claim in run_check_claims(ident, ladder.checks[ident]):
            claims.append(claim)
            on_claim(claim)
    return claims


def run_check_claims(ident: str, check: Check) -> Iterator[Claim]:
    """Claims of one check; a claim's wall time counts from the one before it."""
    began = time.perf_counter()
    try:
        for outcome in check():
            now = time.perf_counter()
            yield as_claim(ident, outcome, now - began)
            began = now
    except Exception as fault:
        # one broken check must not hide the others: it becomes a claim that fails and says why
        reason = " ".join(str(fault).split())[:REASON_LENGTH]
        lost = Outcome(f"runs to its end ({type(fault).__name__}: {reason})", nan, nan, 0.0, "f64")
        yield as_claim(ident, lost, time.perf_counter() - began)
