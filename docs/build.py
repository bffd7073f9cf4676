"""Writes the verification page and its figures.

`python docs/build.py [ID]...`; all rungs if none is named.
"""

import sys
from pathlib import Path

from taichi_erosion.report.curves import draw_curves
from taichi_erosion.report.ladder import markdown_table
from taichi_erosion.verification import Claim, verify

DOCS = Path(__file__).resolve().parent
HEAD = """# Verification: do we solve the equations right?

Made by `python docs/build.py`, which runs `./erosion verify` and draws the curves. A claim that fails stands
here as failing. `got`, `want` and `tolerance` are in the unit that the claim names; `precision` is that of
forces and velocities.

"""
FIGURES = """
## Curves

![Oblique impact of aluminium oxide (T4)](pictures/oblique_impact.png)

Below 10 degrees the contact mostly sticks, and codes differ in what becomes of the tangential dashpot there.

![Normal impact with spin (T6)](pictures/spinning_impact.png)

Up to X = 1 the contact slides throughout and the answer is exact; only this branch is judged (V06).
Beyond it the contact sticks, and what comes back depends on the tangential dashpot, for which the
published curve follows another rule: beyond X = 6 this law levels off, while the published points fall on.

![JKR force against overlap](pictures/jkr_law.png)

The neck snaps in at zero overlap on the way in and tears beyond the pull-off on the way out; forces are
those of the simulator, from second differences of its path.
"""


def announce(claim: Claim) -> None:
    """Say how one claim fared, for the ladder takes minutes."""
    sys.stderr.write(f"{claim.id} {'ok' if claim.passed else 'FAILED'}: {claim.claim}\n")


def main(ids: list[str]) -> None:
    """Run the ladder and write the page."""
    claims = verify(tuple(ids), announce)
    draw_curves(DOCS / "pictures")
    (DOCS / "verification.md").write_text(HEAD + markdown_table(claims) + FIGURES, encoding="utf-8")


if __name__ == "__main__":
    main(sys.argv[1:])
