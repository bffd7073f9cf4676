"""Curves behind the ladder, as arrays: test 4, test 6 and JKR, each beside what it is held against."""

from typing import Any

import numpy as np

from taichi_erosion.core.errors import BadInput
from taichi_erosion.verification import adhesion
from taichi_erosion.verification.oblique_impact import (
    SOLIDS,
    SPINNING,
    impact_at,
    patch_angle,
    simulated,
    spinning_impact,
    tangential_restitution,
)
from taichi_erosion.verification.reference import jkr, published
from taichi_erosion.verification.reference.mindlin import rebound


def curves(name: str) -> dict[str, Any]:
    """Arrays of the curve `T4`, `T6` or `JKR`; the keys say what they hold and in which unit."""
    makers = {"T4": test4_curves, "T6": test6_curves, "JKR": jkr_curves}
    if name not in makers:
        raise BadInput(f"curves: {name} is not one of {', '.join(makers)}")
    return makers[name]()


def test4_curves() -> dict[str, Any]:
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
        "literature_angle_deg": published.TEST4_ANGLE,
        "literature_restitution": published.TEST4_LITERATURE_RESTITUTION,
        "literature_spin_rad_s": published.TEST4_LITERATURE_SPIN,
        "literature_patch_deg": published.TEST4_LITERATURE_PATCH,
    }


def test6_curves() -> dict[str, Any]:
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
        "literature_ratio": published.TEST6_X,
        "literature_beta": published.TEST6_BETA,
    }


def jkr_curves() -> dict[str, Any]:
    """Force of a bounce [pi gamma R*] against overlap [L^2/R*], the law, and its landmarks."""
    run, grid, law = adhesion.curve_of_bounce()
    cubes = (jkr.CUBE_TEAR, jkr.CUBE_PULL_OFF, jkr.CUBE_TOUCH, jkr.CUBE_BALANCE)
    return {
        "overlap": run.overlap,
        "force": run.force,
        "law_overlap": grid,
        "law_force": law,
        "landmark_overlap": np.array([jkr.overlap_at(cube) for cube in cubes]),
        "landmark_force": np.array([jkr.force_at(cube) for cube in cubes]),
    }
