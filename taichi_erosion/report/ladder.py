"""The verification ladder as a table."""

from collections.abc import Sequence
from math import isfinite

from taichi_erosion.verification import Claim

HEADER = ("id", "claim", "got", "want", "tolerance", "precision", "passed", "time")


def markdown_table(claims: Sequence[Claim]) -> str:
    """Markdown table of claims, with the count of those that hold below it."""
    rows = [HEADER, tuple("---" for _ in HEADER), *(cells(claim) for claim in claims)]
    lines = ["| " + " | ".join(row) + " |" for row in rows]
    held = sum(claim.passed for claim in claims)
    seconds = sum(claim.wall_s for claim in claims)
    return "\n".join([*lines, "", f"{held} of {len(claims)} claims hold; {seconds:.0f} s."]) + "\n"


def cells(claim: Claim) -> tuple[str, ...]:
    """One row of the table."""
    return (
        claim.id,
        claim.claim.replace("|", "\\|"),
        number(claim.got),
        number(claim.want),
        number(claim.tolerance, digits=2),
        claim.precision,
        "yes" if claim.passed else "**NO**",
        f"{claim.wall_s:.1f} s",
    )


def number(value: float, digits: int = 7) -> str:
    """A number with as many digits as carry meaning."""
    return f"{value:.{digits}g}" if isfinite(value) else "none"
