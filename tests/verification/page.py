"""Table of all claims in the README beside this file, and the figure of the page of trust.

`python -m tests.verification.page [ID]...`: all checks if none is named, up to an hour. Claims that differ in
a number or in precision alone share a row, which shows the one nearest to its tolerance.
"""

import re
import sys
from collections.abc import Sequence
from math import isfinite
from pathlib import Path

import matplotlib as mpl

mpl.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

from doe.common.pages import MARKED, fill_tables
from taichi_erosion.core.files import write_atomic
from taichi_erosion.verification.claims import Claim, verify_claims
from tests.verification.contact.oblique_impact import OXIDE, impact_at, patch_angle, simulated
from tests.verification.ladder import LADDER
from tests.verification.reference import published
from tests.verification.reference.contact import rebound

PAGE = Path(__file__).with_name("README.md")
FIGURE = Path(__file__).parents[2] / "docs" / "pictures" / "oblique_impact.png"
POINT, LINE, FINE = "#c0392b", "#1f4e79", "#7f8c8d"
HEAD = ("| id | claim | of | got | want | tolerance | holds |", "| --- | --- | --- | --- | --- | --- | --- |")
NUMBER = re.compile(r"\d+(?:\.\d+)?(?:e[+-]?\d+)?")


def claim_rows(claims: Sequence[Claim]) -> list[str]:
    """Markdown rows; a claim that fails has a row of its own."""
    alike: dict[tuple[str, str], list[Claim]] = {}
    for claim in claims:
        words = NUMBER.sub("#", claim.claim) if claim.passed else claim.claim
        alike.setdefault((claim.id, words), []).append(claim)
    return ["| " + " | ".join(cells(each)) + " |" for each in alike.values()]


def cells(alike: Sequence[Claim]) -> tuple[str, ...]:
    """One row of the table, the claim whose distance over its tolerance is the largest."""
    claim = max(alike, key=lambda one: abs(one.got - one.want) / (one.tolerance or 1.0))
    words, verdict = claim.claim.replace("|", "\\|"), "yes" if claim.passed else "**NO**"
    got = f"{claim.got:.7g}" if isfinite(claim.got) else "none"
    return (claim.id, words, str(len(alike)), got, f"{claim.want:.7g}", f"{claim.tolerance:.2g}", verdict)


def renewed(table: str, claims: Sequence[Claim]) -> str:
    """Table in which the rows of some checks are replaced, in the order of the checks."""
    checked = {claim.id for claim in claims}
    kept = [row for row in table.splitlines() if row.startswith("| V") and row.split()[1] not in checked]
    rows = sorted([*kept, *claim_rows(claims)], key=lambda row: row.split()[1])
    return "".join(f"{row}\n" for row in [*HEAD, *rows])


def draw_oblique_impact(file: Path) -> None:
    """Tangential restitution, spin and patch angle against the angle of incidence."""
    angle = np.arange(2.5, 88.0, 2.5)
    impact = impact_at(OXIDE, angle)
    after, fine = simulated([impact], "f64")[0], rebound(impact)
    panels = {
        "tangential restitution [1]": published.OBLIQUE_LITERATURE_RESTITUTION,
        "spin after impact [rad/s]": published.OBLIQUE_LITERATURE_SPIN,
        "rebound angle of the contact [deg]": published.OBLIQUE_LITERATURE_PATCH,
    }
    peak = impact.tangential
    shown = [(f.tangential / peak, f.spin, patch_angle(impact, f)) for f in (fine, after)]
    figure, frames = plt.subplots(1, 3, figsize=(11.0, 3.6), layout="constrained")
    for frame, same_law, simulator, (label, literature) in zip(frames, *shown, panels.items(), strict=True):
        frame.plot(angle, same_law, color=FINE, lw=3.0, label="same law, fine step")
        frame.plot(angle, simulator, color=LINE, lw=1.0, label="simulator")
        frame.plot(published.OBLIQUE_ANGLE, literature, "o", color=POINT, ms=4, label="Chung & Ooi (2011)")
        frame.set(xlabel="angle of incidence [deg]", ylabel=label)
    frames[0].legend(frameon=False, fontsize=8)
    figure.suptitle("Aluminium oxide sphere on a rigid plane, 3.9 m/s, e = 0.98, friction 0.092", fontsize=10)
    figure.savefig(file, dpi=150)
    plt.close(figure)


def main(ids: Sequence[str]) -> None:
    """Run the checks and fill the table; with ids, only the rows of these checks are replaced."""
    claims = verify_claims(LADDER, tuple(ids))
    text = PAGE.read_text(encoding="utf-8")
    (mark,) = MARKED.finditer(text)
    write_atomic(PAGE, fill_tables(text, {"claims": renewed(mark["table"], claims)}).encode())
    draw_oblique_impact(FIGURE)


if __name__ == "__main__":
    main(sys.argv[1:])
