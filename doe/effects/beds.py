"""What some effects move on a small bed under wind, with paired seeds; writes beds.csv beside this file.

python doe/effects/beds.py              all cases
python doe/effects/beds.py EFFECT...    the cases of some effects

The bed is that of scenes/wind_threshold.toml with 500 equal grains of 0.2 mm on a patch of 12 x 12 diameters
and shorter holds: thresholds of so small a bed are not those of a large one, and only their shifts are used.
"""

import sys
from pathlib import Path

from taichi_erosion.campaign.cases import ROOT
from taichi_erosion.campaign.signatures import Case, measure_shifts, tabulate
from taichi_erosion.core.setup import Numerics

TABLE = Path(__file__).with_name("beds.csv")
SCENE = ROOT / "scenes" / "wind_threshold.toml"
SEEDS = range(1, 5)
DIAMETER = 2e-4  # m
ORDERS = (
    "grains.count=500",
    f'grains.size={{ law = "monodisperse", diameter = {DIAMETER} }}',
    *(f"materials.{name}.shear_modulus=1.2e5" for name in ("soil", "ground")),
    "run.overlap_limit=0.95",  # fast grains meet softened ones
    "wind.length_d=12.0",
    "wind.width_d=12.0",
    "wind.height=0.03",
    "fill.pitch_d=1.15",
    "threshold.first=0.16",
    "threshold.hold=0.1",
    "threshold.spin_up=0.12",
    "threshold.fall=0.1",
    "threshold.fall_hold=0.08",
    "measure.fluid_threshold={}",
    "measure.impact_threshold={}",
    "measure.threshold_ratio={}",
)

CASES = [
    Case("liquid_bridge", circumstances=("conditions.moisture=0.005",)),
    Case("dry_adhesion"),
    Case("turbulent_gusts"),
    Case("size_distribution"),
    Case("sheltering", parameters=("ratio=1.6", "share=0.3")),  # a coarser lag does not fit on the patch
]


def main(words: list[str]) -> None:
    """Simulate what was asked for, telling every effect as it is done."""
    cases = [case for case in CASES if not words or case.effect in words]
    tabulate(TABLE, measure_shifts(SCENE, ORDERS, cases, list(SEEDS), Numerics(threads=1)), sys.stderr)


if __name__ == "__main__":
    main(sys.argv[1:])
