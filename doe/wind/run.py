"""Sand under wind against measurements: simulates the cases, fills the tables, the page and its figures.

python doe/wind/run.py             all cases
python doe/wind/run.py GROUP...    the cases of some groups
python doe/wind/run.py --page      only the page and its figures, from the tables
"""

import csv
import sys
from collections.abc import Sequence
from pathlib import Path

from taichi_erosion.campaign.cases import ROOT, Case, perform, settings
from taichi_erosion.report.threshold import publish

FOLDER = Path(__file__).parent
TABLES = {
    "scenes/saltation.toml": FOLDER / "flux.csv",
    "scenes/impact_threshold.toml": FOLDER / "impact.csv",
    "scenes/wind_threshold.toml": FOLDER / "fluid.csv",
}
SALTATION, IMPACT, FLUID = TABLES
CREYSSELS = ROOT / "doe" / "measured" / "flux_creyssels2009.csv"
STARTING = 0.6  # m s-1, that starts transport in scenes/saltation.toml

REFERENCE = 0.24e-3  # m, diameter of scenes/impact_threshold.toml
DIAMETERS = (0.24e-3, 0.5e-3, 0.15e-3, 1.0e-3, 0.1e-3, 0.7e-3)  # m
SIZES = {"median": 1.0, "low": 0.8, "high": 1.25}  # of the diameter
MODULUS = 1e5  # Pa, at the reference: stiffness goes with d
TIMES = {  # s, at the reference: they go with the root of d
    "stages.0.duration_max": 0.15,
    "stages.1.duration_max": 0.1,
    "threshold.spin_up": 0.2,
    "threshold.fall_hold": 0.2,
}
WINDS = {"stages.1.friction_velocity": 0.55, "threshold.transport": 0.33}  # m s-1, likewise

BEDS = 2  # of a threshold that is compared with the reference
COUNT, SIDE = 1200, 14.0  # grains, and diameters, of the patch of scenes/wind_threshold.toml
SIDES = (20.0,)  # of other patches; much smaller ones hold too few of the largest grains


def flux_cases() -> list[Case]:
    """The winds of the measured flux, the middle ones first."""
    with CREYSSELS.open(encoding="utf-8", newline="") as file:
        winds = [float(row["u_star [m/s]"]) for row in csv.DictReader(file)]
    first = sorted(winds, key=lambda wind: abs(wind - winds[2]))
    return [Case("flux", f"{wind:g}", settings(*flux_orders(wind))) for wind in first]


def flux_orders(wind: float) -> tuple[str, ...]:
    """Settings of one wind [m s-1]."""
    stages = {1: max(STARTING, wind), 2: wind, 3: wind}
    return tuple(f"stages.{place}.friction_velocity={value}" for place, value in stages.items())


def impact_cases() -> list[Case]:
    """The same experiment with grains of other diameters [m]."""
    return [Case("impact", f"{1e3 * d:g}", settings(*impact_orders(d))) for d in DIAMETERS]


def impact_orders(diameter: float) -> tuple[str, ...]:
    """Settings of one diameter [m]: all ratios of lengths, forces and times but those of the air stay."""
    size = diameter / REFERENCE
    sizes = ", ".join(f"{name} = {share * diameter:.6g}" for name, share in SIZES.items())
    root = size**0.5
    return (
        f'grains.size={{ law = "lognormal", sigma_log = 0.1, {sizes} }}',
        f"materials.sand.shear_modulus={MODULUS * size:.6g}",
        *(f"{path}={root * value:.6g}" for path, value in (TIMES | WINDS).items()),
    )


def fluid_cases() -> list[Case]:
    """The fluid threshold of the published soil, and what it depends on."""
    return [
        Case("reference", "scene as it is", (), 5),
        changed("grain density", "2130 kg/m3", "materials.soil.density=2130"),
        changed("gusts", "turbulent_gusts = 1", "effects.turbulent_gusts.strength=1"),
        changed("lift", "shear_lift = 1", "effects.shear_lift.strength=1"),
        changed("criterion", "a tenth of the time", "threshold.hold=0.03"),
        changed("criterion", "5 times the grains", "threshold.share=0.05"),
        *[changed("patch", f"{side:g} diameters", *patch_orders(side)) for side in SIDES],
    ]


def changed(group: str, label: str, *orders: str) -> Case:
    """The reference with some settings changed, on fewer beds."""
    return Case(group, label, settings(*orders), BEDS)


def patch_orders(side: float) -> tuple[str, ...]:
    """Settings of a square patch of a side in diameters, the bed as deep as in the scene."""
    count = round(COUNT * (side / SIDE) ** 2)
    return (f"grains.count={count}", f"wind.length_d={side}", f"wind.width_d={side}")


def main(words: Sequence[str]) -> None:
    """Simulate what was asked for, then publish the tables."""
    if list(words) != ["--page"]:
        plans = {SALTATION: flux_cases(), IMPACT: impact_cases(), FLUID: fluid_cases()}
        for scene, cases in plans.items():
            perform(scene, [c for c in cases if not words or c.group in words], TABLES[scene])
    publish(ROOT / "doe", ROOT / "docs")


if __name__ == "__main__":
    main(sys.argv[1:])
