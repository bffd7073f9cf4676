"""Writes the verification page and its figures.

`python docs/build.py [ID]...`; all checks if none is named. `--page` runs none: the table stays.
"""

import sys
from pathlib import Path

from docs.verification_curves import draw_curves, markdown_table
from taichi_erosion.verification.claim import Claim
from taichi_erosion.verification.claims import verify

DOCS = Path(__file__).resolve().parent
PAGE_ALONE = "--page"
HEAD = """# Verification: do we solve the equations right?

Made by `python docs/build.py`, which runs `./erosion verify` and draws the curves. The table also shows
failed claims. `got`, `want` and `tolerance` have the unit of the claim; `precision` is that of forces and
velocities. The [glossary](../GLOSSARY.md) explains the terms.

"""
DOUBTS = """
## What does not pass, and why

V33: through round holes the law holds as well as three of them can tell: 2.48 with the k of the least
squares, 1.2, at the lower end of its range, 2.40 with Beverloo's 1.4. Through slots it does not: 1.64 with
the k of the least squares at the upper end, 1.6, where 1.5 is expected; with 3/2 given, the two edges of a
slot take 2.1 grains from its width instead of 1.4. Silos, heads and openings are those that the law is
stated for (`taichi_erosion/verification/contact/bulk.py`), and the flow through slots changes neither with
time nor as the head falls. It does scatter from filling to filling, by 3 % through the narrowest slot and
by 8 % through the narrowest hole: fillings read over half as many grains gave 2.55 for holes, and 1.64 and
1.59 for slots. Read over three thousand grains each, slots give 1.68. Why their edges count for more is not
known here; until then that row fails. This check used one silo for all holes before, 2.0 times the widest,
under a head of 1.3 of its diameters; that is outside of the range of the law, and gave 2.67.

V35, silo, drum and penetration by Dosta et al. (2024), needs walls and places of grains that were published
beside that paper. They could not be had, and the check is missing.

V36: in strong winds the air keeps more stress at the bed of 0.5 mm than that of the wind in which one grain
goes on, by more than the fifth that is allowed; over 0.25 mm it does not. It is not chance alone, for other
beds of 0.5 and 1 mm under other winds (`docs/threshold.md`, wind by wind) show the same growth with the wind.
Owen has it constant; why it grows over coarse grains is not known here, and until then those rows fail.

The thresholds of V36 are known to a twentieth or a tenth: four winds of two seconds leave as much scatter.
Two runs, alike but for the time after which deep grains sleep, read 0.250 and 0.278 m/s for 0.5 mm, 1.48 and
1.65 of that for 0.25 mm. One grain that hops in the wind over these very beds goes on down to 0.171 and
0.255 m/s, in a ratio of 1.49: more than the root of two, because grains of 0.5 mm stick out of the viscous
sublayer and slow the wind down (over a plane it goes on down to 0.167 and 0.233 m/s).

V36 read 0.128 m/s for 0.25 mm from the line of the flux of beds over which the wind fell by 7 percent
every 0.4 s. That flux was not saturated: in a wind a tenth too weak one grain hops on for 1.3 s, and in
one a fifth too weak for 0.9 s (`time_to_rest` in `taichi_erosion/verification/reference/hopping.py`). The
stress at the bed was divided by that of this threshold, and so was 1.5 to 2.5 in place of 1.

V26 failed until its pressure was found more closely. The errors of its time steps are 1e-8 to 1e-7 of the
velocity, and the ordinary tolerance of the pressure, 1e-9, leaves 1e-8: the orders from step to halved step
were 1.86, 1.15 and 0.21. With 1e-12 they are 1.97, 1.99 and 2.01. That the pressure is unknown at the start
makes no difference: with the exact one given, the errors agree to seven digits.
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


def print_verdict(claim: Claim) -> None:
    """Print the verdict of one claim as soon as it is known; all checks take half an hour."""
    sys.stderr.write(f"{claim.id} {'ok' if claim.passed else 'FAILED'}: {claim.claim}\n")


def renewed(table: list[str], claims: list[Claim]) -> list[str]:
    """Lines of a table in which the rows of some checks are replaced."""
    rows = markdown_table(claims).splitlines()
    for ident in dict.fromkeys(claim.id for claim in claims):
        mark = f"| {ident} |"
        place = next(k for k, row in enumerate(table) if row.startswith(mark))
        table = [row for row in table if not row.startswith(mark)]
        table[place:place] = [row for row in rows if row.startswith(mark)]
    judged = [row for row in table if row.startswith("| V")]
    held = sum("| yes |" in row for row in judged)
    seconds = sum(float(row.rsplit("|", 2)[1].removesuffix("s ")) for row in judged)
    return [*table, "", f"{held} of {len(judged)} claims hold; {seconds:.0f} s."]


def main(ids: list[str]) -> None:
    """Run the checks and write the page; with ids, only the rows of these checks are replaced."""
    page = DOCS / "verification.md"
    claims = [] if ids == [PAGE_ALONE] else verify(tuple(ids), print_verdict)
    if ids:
        old = [line for line in page.read_text(encoding="utf-8").splitlines() if line.startswith("| ")]
        table = "\n".join(renewed(old, claims)) + "\n"
    else:
        table = markdown_table(claims)
        draw_curves(DOCS / "pictures")
    page.write_text(HEAD + table + DOUBTS + FIGURES, encoding="utf-8")


if __name__ == "__main__":
    main(sys.argv[1:])
