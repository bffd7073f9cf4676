"""Claims V36 and V39 of `./erosion verify` by the law of drag; writes claims.csv beside this file.

python -m doe.drag_law.claims V36    that check under both laws
python -m doe.drag_law.claims V39
python -m doe.drag_law.claims V36/two_limits_hindered ...    under one law
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from doe.common.command import words
from doe.common.method import method_commit
from doe.common.tables import read_table, write_table
from taichi_erosion.core.setup import DragLaw
from taichi_erosion.verification.claims import Outcome, as_claim
from tests.verification.wind.saltation import saltation, start_of_motion

TABLE = Path(__file__).with_name("claims.csv")
CHECKS: dict[str, Callable[[DragLaw], Iterator[Outcome]]] = {"V36": saltation, "V39": start_of_motion}
ALONE, HINDERED = LAWS = ("two_limits", "two_limits_hindered")


@dataclass(frozen=True)
class Line:
    """One claim under one law of drag."""

    law: str
    id: str
    claim: str
    got: float
    want: float
    tolerance: float
    passed: str
    commit: str


def lines(ident: str, law: DragLaw) -> Iterator[Line]:
    """Claims of one check under one law."""
    commit = method_commit()
    for outcome in CHECKS[ident](law):
        claim = as_claim(ident, outcome, 0.0)
        passed = "yes" if claim.passed else "no"
        yield Line(law, ident, claim.claim, claim.got, claim.want, claim.tolerance, passed, commit)


def read_lines() -> list[Line]:
    """Claims of the table; none where it has not been made yet."""
    return read_table(TABLE, Line) if TABLE.exists() else []


def write_lines(found: Sequence[Line]) -> None:
    """Replace the claims of these checks and laws in the table."""
    done = {(line.id, line.law) for line in found}
    kept = [line for line in read_lines() if (line.id, line.law) not in done]
    write_table(TABLE, Line, sorted([*kept, *found], key=lambda line: (line.id, line.law)))


def main(asked: Sequence[str]) -> None:
    """Simulate what was asked for."""
    for word in asked:
        ident, _, named = word.partition("/")
        for law in LAWS:
            if named in ("", law):
                write_lines(list(lines(ident, law)))


if __name__ == "__main__":
    main(words(__doc__))
