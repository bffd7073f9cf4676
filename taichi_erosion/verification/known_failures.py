"""Claims that are known not to hold, how far off they may be, and where the reason stands.

A known failure is told in every run; it is no news, and a larger one is.
"""

from dataclasses import dataclass

from taichi_erosion.verification.claim import Claim


@dataclass(frozen=True)
class KnownFailure:
    """Claims of one check that fail, with the range in which they were found."""

    id: str
    words: str  # in the claim
    low: float  # of what was got
    high: float
    source: str  # of the range


KNOWN = (
    KnownFailure(
        "V33", "Beverloo, round holes", 2.58, 2.70, "2.64 +- 0.03 from nine fillings, and two standard errors"
    ),
    KnownFailure(
        "V39",
        "impact over fluid threshold",
        0.49,
        0.58,
        "0.53, and the 95 % interval of the fluid threshold of five beds, 0.298 to 0.343 m/s",
    ),
    KnownFailure(
        "V36",
        "stress of the air at the bed of 0.5 mm",
        1.0,
        1.5,
        "1.39 and 1.34 in the winds that fail, scatter of a tenth",
    ),
    KnownFailure(
        "V36",
        "stress of the air at the bed of 0.25 mm under u* = 0.6 m/s",
        0.6,
        0.8,
        "0.71, scatter of a tenth; other beds of 0.24 mm have 0.71 at 0.56 m/s and 0.79 at 0.51 m/s",
    ),
)


def is_known(claim: Claim) -> bool:
    """Whether a claim fails, and as far as is known."""
    return not claim.passed and any(
        claim.id == known.id and known.words in claim.claim and known.low <= claim.got <= known.high
        for known in KNOWN
    )


def news(claims: list[Claim], strict: bool = False) -> list[Claim]:
    """Claims that fail and are not known to; with `strict` all that fail."""
    return [claim for claim in claims if not claim.passed and (strict or not is_known(claim))]
