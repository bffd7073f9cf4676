"""Figures and table of the verification page: the simulator against reference curves and published points.

Curves are arrays: oblique impact (T4), spinning impact (T6) and the JKR law, each with its reference.
"""

import re
from collections.abc import Callable, Sequence
from math import isfinite
from pathlib import Path
from typing import Any

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from taichi_erosion.core.errors import BadInput
from taichi_erosion.verification.claims import Claim
from tests.verification.contact import adhesion
from tests.verification.contact.oblique_impact import (
    SOLIDS,
    SPINNING,
    impact_at,
    patch_angle,
    simulated,
    spinning_impact,
    tangential_restitution,
)
from tests.verification.reference import contact, published
from tests.verification.reference.contact import rebound


def curves(name: str) -> dict[str, Any]:
    """Arrays of the curve `T4`, `T6` or `JKR`; the keys say what they hold and in which unit."""
    makers = {"T4": oblique_curves, "T6": spinning_curves, "JKR": jkr_curves}
    if name not in makers:
        raise BadInput(f"curves: {name} is not one of {', '.join(makers)}")
    return makers[name]()


def oblique_curves() -> dict[str, Any]:
    """Tangential restitution, spin and patch angle against the angle of incidence."""
    angle = np.arange(2.5, 88.0, 2.5)
    impact = impact_at(SOLIDS["aluminium oxide"], angle)
    after, fine = simulated([impact], "f64")[0], rebound(impact)
    return {
        "angle_deg": angle,
        "restitution": after.tangential / impact.tangential,
        "restitution_fine_step": fine.tangential / impact.tangential,
        "spin_rad_s": after.spin,
        "spin_fine_step_rad_s": fine.spin,
        "patch_deg": patch_angle(impact, after),
        "patch_fine_step_deg": patch_angle(impact, fine),
        "literature_angle_deg": published.OBLIQUE_ANGLE,
        "literature_restitution": published.OBLIQUE_LITERATURE_RESTITUTION,
        "literature_spin_rad_s": published.OBLIQUE_LITERATURE_SPIN,
        "literature_patch_deg": published.OBLIQUE_LITERATURE_PATCH,
    }


def spinning_curves() -> dict[str, Any]:
    """Tangential restitution of a spinning impact against X = 3.5 mu (1 + e) v_n / v_s."""
    ratio = np.geomspace(0.15, 25.0, 40)
    impacts = [spinning_impact(solid, ratio) for solid in SPINNING.values()]
    found = simulated(impacts, "f64")
    betas = [tangential_restitution(impact, after) for impact, after in zip(impacts, found, strict=True)]
    return {
        "ratio": ratio,
        "beta_aluminium_alloy": betas[0],
        "beta_nylon": betas[1],
        "beta_fine_step": tangential_restitution(impacts[0], rebound(impacts[0])),
        "sliding_ratio": ratio[ratio < 1.0],
        "sliding_beta": ratio[ratio < 1.0] - 1.0,
        "literature_ratio": published.SPINNING_X,
        "literature_beta": published.SPINNING_BETA,
    }


def jkr_curves() -> dict[str, Any]:
    """Force of a bounce [pi gamma R*] against overlap [L^2/R*], the law, and its landmarks."""
    run, grid = adhesion.bounce(), np.linspace(adhesion.TEAR_AT, 4.0, 400)
    cubes = (contact.CUBE_TEAR, contact.CUBE_PULL_OFF, contact.CUBE_TOUCH, contact.CUBE_BALANCE)
    return {
        "overlap": run.overlap,
        "force": run.force,
        "law_overlap": grid,
        "law_force": np.array([contact.branch_force(d) for d in grid]),
        "landmark_overlap": np.array([contact.overlap_at(cube) for cube in cubes]),
        "landmark_force": np.array([contact.force_at(cube) for cube in cubes]),
    }


mpl.use("Agg")

POINT, LINE, FINE = "#c0392b", "#1f4e79", "#7f8c8d"
NAMES = {"T4": "oblique_impact", "T6": "spinning_impact", "JKR": "jkr_law"}


def draw_curves(folder: Path) -> list[Path]:
    """Draw tests 4 and 6 and the JKR law into `folder`; returns the files."""
    folder.mkdir(parents=True, exist_ok=True)
    drawings: dict[str, Callable[[dict[str, Any]], Figure]] = {
        "T4": draw_oblique_impact,
        "T6": draw_spinning_impact,
        "JKR": draw_jkr,
    }
    files = []
    for name, draw in drawings.items():
        figure = draw(curves(name))
        files.append(folder / f"{NAMES[name]}.png")
        figure.savefig(files[-1], dpi=150)
        plt.close(figure)
    return files


def draw_oblique_impact(curve: dict[str, Any]) -> Figure:
    """Test 4: tangential restitution, spin and patch angle against the angle of incidence."""
    figure, frames = plt.subplots(1, 3, figsize=(11.0, 3.6), layout="constrained")
    panels = (
        ("restitution", "restitution_fine_step", "literature_restitution", "tangential restitution [1]"),
        ("spin_rad_s", "spin_fine_step_rad_s", "literature_spin_rad_s", "spin after impact [rad/s]"),
        ("patch_deg", "patch_fine_step_deg", "literature_patch_deg", "rebound angle of the contact [deg]"),
    )
    for frame, (found, fine, literature, label) in zip(frames, panels, strict=True):
        frame.plot(curve["angle_deg"], curve[fine], color=FINE, lw=3.0, label="same law, fine step")
        frame.plot(curve["angle_deg"], curve[found], color=LINE, lw=1.0, label="simulator")
        frame.plot(
            curve["literature_angle_deg"],
            curve[literature],
            "o",
            color=POINT,
            ms=4,
            label="Chung & Ooi (2011)",
        )
        frame.set(xlabel="angle of incidence [deg]", ylabel=label)
    finish(
        figure,
        frames[0],
        "Test 4: aluminium oxide sphere on a rigid plane, 3.9 m/s, e = 0.98, friction 0.092",
    )
    return figure


def draw_spinning_impact(curve: dict[str, Any]) -> Figure:
    """Test 6: tangential restitution against X."""
    figure, frame = plt.subplots(figsize=(6.0, 4.2), layout="constrained")
    frame.plot(
        curve["sliding_ratio"], curve["sliding_beta"], color=FINE, lw=5.0, alpha=0.5, label="exact, sliding"
    )
    frame.plot(
        curve["ratio"], curve["beta_fine_step"], color=FINE, lw=2.5, label="same law, fine step (alloy)"
    )
    frame.plot(
        curve["ratio"], curve["beta_aluminium_alloy"], color=LINE, lw=1.0, label="simulator, aluminium alloy"
    )
    frame.plot(curve["ratio"], curve["beta_nylon"], "--", color=LINE, lw=1.0, label="simulator, nylon")
    frame.plot(
        curve["literature_ratio"],
        curve["literature_beta"],
        "o",
        color=POINT,
        ms=4,
        label="Chung & Ooi (2011)",
    )
    frame.set(
        xlabel="X = 3.5 mu (1 + e) v_n / v_s [1]", ylabel="tangential restitution beta [1]", xscale="log"
    )
    finish(figure, frame, "Test 6: spinning sphere on a rigid plane, 0.2 m/s, e = 0.5, friction 0.4")
    return figure


def draw_jkr(curve: dict[str, Any]) -> Figure:
    """Force against overlap along one bounce of two sticky spheres, on the law."""
    figure, frame = plt.subplots(figsize=(6.0, 4.2), layout="constrained")
    frame.plot(curve["law_overlap"], curve["law_force"], color=FINE, lw=3.0, label="JKR (1971)")
    frame.plot(curve["overlap"], curve["force"], ".", color=LINE, ms=3.0, label="simulator, one bounce")
    frame.plot(
        curve["landmark_overlap"], curve["landmark_force"], "o", color=POINT, ms=5, label="closed form"
    )
    frame.axhline(0.0, color="black", lw=0.5)
    frame.set(xlabel="overlap [L^2/R*]", ylabel="force [pi gamma R*]", xlim=(-1.6, 3.2), ylim=(-3.4, 6.0))
    finish(figure, frame, "Adhesive contact: touch, pull-off and tear")
    return figure


def finish(figure: Figure, frame: Axes, title: str) -> None:
    """Legend and title."""
    frame.legend(frameon=False, fontsize=8)
    figure.suptitle(title, fontsize=10)


HEADER = ("id", "claim", "of", "got", "want", "tolerance", "holds")
NUMBER = re.compile(r"\d+(?:\.\d+)?(?:e[+-]?\d+)?")


def markdown_table(claims: Sequence[Claim]) -> str:
    """Markdown table of claims; those that differ in a number or in precision alone share a row.

    The row shows the one nearest to its tolerance; a claim that fails has a row of its own.
    """
    alike: dict[tuple[str, str], list[Claim]] = {}
    for claim in claims:
        words = NUMBER.sub("#", claim.claim) if claim.passed else claim.claim
        alike.setdefault((claim.id, words), []).append(claim)
    rows = [HEADER, tuple("---" for _ in HEADER), *(cells(each) for each in alike.values())]
    return "".join("| " + " | ".join(row) + " |\n" for row in rows)


def strain(claim: Claim) -> float:
    """Distance from what is wanted over the tolerance [1]."""
    distance = abs(claim.got - claim.want)
    return distance / claim.tolerance if claim.tolerance > 0.0 else distance


def cells(alike: Sequence[Claim]) -> tuple[str, ...]:
    """One row of the table."""
    claim = max(alike, key=strain)
    return (
        claim.id,
        claim.claim.replace("|", "\\|"),
        str(len(alike)),
        number(claim.got),
        number(claim.want),
        number(claim.tolerance, digits=2),
        "yes" if claim.passed else "**NO**",
    )


def number(value: float, digits: int = 7) -> str:
    """A number with as many digits as carry meaning."""
    return f"{value:.{digits}g}" if isfinite(value) else "none"
