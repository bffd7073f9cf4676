"""Writes the verification page and its figures.

`python docs/build.py [ID]...`; all checks if none is named. `--page` runs none: the table stays.
"""

import sys
from pathlib import Path

from docs.verification_curves import draw_curves, markdown_table
from taichi_erosion.verification.claims import Claim, verify
from tests.verification.ladder import LADDER

DOCS = Path(__file__).resolve().parent
PAGE_ALONE = "--page"
HEAD = """# Verification: do we solve the equations right?

The claims of `./erosion verify` in a source tree, which prints every one of them; all take about half an
hour, `./erosion verify ID` those of one check. An installed program checks a short list of closed forms. A
row stands for all claims of a check that differ in a number or in precision alone (`of`), and shows the one
nearest to its tolerance; a claim that fails has a row of its own. `got`, `want` and `tolerance` have the
unit of the claim. `python docs/build.py` writes this page. The [glossary](../GLOSSARY.md) explains the
terms.

"""
DOUBTS = """
## What does not hold, and why

- **V33, round holes**: 2.64 where 2.5 is wanted. It is Beverloo's k that differs, not the law: with the
  exponents given, both kinds of opening ask for the same k, 1.74 +- 0.07 and 1.80 +- 0.04, where 1.2 to 1.6
  is the range of spheres. Friction of 0.5 with rolling friction, more than glass has, and the softness of
  the grains are not excluded as the reason.
- **V36**: in strong winds the air over 0.5 mm keeps up to 1.39 times the stress of the wind in which one
  grain goes on, and over 0.25 mm, in the strongest wind, 0.71 times that; Owen has it constant, and a fifth
  is allowed. Other beds under other winds show the same (`docs/threshold.md`); another law of drag does not
  mend it (`doe/drag_law/`). The thresholds are known to a twentieth or a tenth.
- **V39**: one grain goes on over a bed down to 0.53 of the wind that starts it, where 0.75 to 0.9 is
  measured. The fluid threshold is at the upper end of what is asked for; the impact threshold, 0.171 m/s,
  is 0.89 of Bagnold's 0.192 m/s for 0.24 mm (`docs/threshold.md`, impact over fluid threshold).
- **V35**, silo, drum and penetration by Dosta et al. (2024), is missing: it needs walls and places of
  grains that were published beside that paper and could not be had.
"""
FIGURES = """
## Curves

![Oblique impact of aluminium oxide (T4)](pictures/oblique_impact.png)

Below 10 degrees the contact mostly sticks, and codes differ in what becomes of the tangential dashpot
there.

![Normal impact with spin (T6)](pictures/spinning_impact.png)

Up to X = 1 the contact slides throughout and the answer is exact; only this branch is judged (V06). Beyond
it the contact sticks, and what comes back depends on the tangential dashpot, for which the published curve
follows another rule.

![JKR force against overlap](pictures/jkr_law.png)

The neck snaps in at zero overlap on the way in and tears beyond the pull-off on the way out.
"""


def print_verdict(claim: Claim) -> None:
    """Print the verdict of one claim as soon as it is known; all checks take half an hour."""
    sys.stderr.write(f"{claim.id} {'ok' if claim.passed else 'FAILED'}: {claim.claim}\n")


def renewed(table: list[str], claims: list[Claim]) -> list[str]:
    """Lines of a table in which the rows of some checks are replaced."""
    rows = markdown_table(claims).splitlines()
    for ident in dict.fromkeys(claim.id for claim in claims):
        mark = f"| {ident} |"
        place = next((k for k, row in enumerate(table) if row.startswith(mark)), len(table))
        table = [row for row in table if not row.startswith(mark)]
        table[place:place] = [row for row in rows if row.startswith(mark)]
    return table


def count(table: list[str]) -> str:
    """How many outcomes of a table hold."""
    rows = [row for row in table if row.startswith("| V")]
    numbers = [int(row.replace(r"\|", "").split("|")[3]) for row in rows]
    held = sum(number for number, row in zip(numbers, rows, strict=True) if "| yes |" in row)
    return f"\n{held} of {sum(numbers)} outcomes hold.\n"


def main(ids: list[str]) -> None:
    """Run the checks and write the page; with ids, only the rows of these checks are replaced."""
    page = DOCS / "verification.md"
    claims = [] if ids == [PAGE_ALONE] else verify(LADDER, tuple(ids), print_verdict)
    if ids:
        old = [line for line in page.read_text(encoding="utf-8").splitlines() if line.startswith("| ")]
        table = renewed(old, claims)
    else:
        table = markdown_table(claims).splitlines()
        draw_curves(DOCS / "pictures")
    page.write_text(HEAD + "\n".join(table) + "\n" + count(table) + DOUBTS + FIGURES, encoding="utf-8")


if __name__ == "__main__":
    main(sys.argv[1:])
