"""Shifts of some effects on a small windy bed, with paired seeds; writes effect_library/measured/beds.csv.

python -m doe.effects.beds              all cases
python -m doe.effects.beds EFFECT...    the cases of some effects
python -m doe.effects.beds PLAN...      those of a plan: start ceasing flux laws tilt

Thresholds: the bed of scenes/wind_threshold.toml with 500 equal grains of 0.2 mm on a patch of 12 x 12
diameters and shorter holds. Flux: that of scenes/saltation.toml with 500 grains on a patch of 16 x 8
diameters in a strong wind, over half a second. Numbers of so small a bed are not those of a large one, and
only their shifts are used.
"""

import sys
from pathlib import Path

from doe.common.cases import DRAG_ALONE, MEASURED, ROOT
from doe.common.command import words
from doe.effect_signatures.shifts import Case, Orders, measure_shifts, tabulate
from taichi_erosion.core.setup import Numerics

TABLE = MEASURED / "beds.csv"
THRESHOLD, FLUX = (ROOT / "scenes" / f"{name}.toml" for name in ("wind_threshold", "saltation"))
SEEDS = range(1, 5)
LAW_SEEDS = range(1, 17)  # a law is judged by its size, for which beds that differ by a tenth need more pairs
DIAMETER = 2e-4  # m
STRONG = 0.6  # m s-1, friction velocity
ORDERS = (
    DRAG_ALONE,
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
)
CESSATION = ("measure.impact_threshold={}", "measure.threshold_ratio={}")  # takes four times as long
WIDER = ("grains.count=587", "wind.length_d=13.0", "wind.width_d=13.0")  # room for the coarsest grains
MOIST = "conditions.moisture=0.005"

CASES = [
    Case("liquid_bridge", circumstances=(MOIST,)),
    Case("turbulent_gusts"),
    Case("near_wall_drag"),
    Case("rotational_drag"),
    Case("dry_adhesion"),
    Case("sheltering", parameters=("ratio=1.6", "share=0.3")),  # a coarser lag does not fit on the patch
    Case("size_distribution", circumstances=WIDER),
]
CEASING = [
    Case("liquid_bridge", label="and cessation", circumstances=(MOIST, *CESSATION)),
    Case("dry_adhesion", label="and cessation", circumstances=CESSATION),
    Case("size_distribution", label="and cessation", circumstances=(*CESSATION, *WIDER)),
]
THIN_AIR = (  # ISO 2533 at 5000 m
    "conditions.altitude=5000",
    "conditions.pressure=54020",
    "conditions.temperature=255.65",
)
LAW_CASES = [
    *(
        Case("bed_slope", label=f"slope {t:g}", circumstances=(f"conditions.slope={t}",))
        for t in (-15.0, 15.0)
    ),
    *(
        Case("grain_density", label=f"density {rho:g}", parameters=(f"solid_density={rho}",))
        for rho in (2130.0, 4000.0)
    ),
    Case("air_density", label="altitude 5000", circumstances=THIN_AIR),
]
TILTED = (  # without wind, the bed is turned until it flows: 15 deg/s, against the wind
    *(order for order in ORDERS if not order.startswith(("threshold", "measure"))),
    "scene.kind=incline",
    "wind.friction_velocity=0.01",
    "measured={}",
    'measure={ sliding_angle = { stage = "tilt", plate = "ground", every = 0.01 } }',
    "stages.1.name=tilt",
    "stages.1.until=time",
    "stages.1.duration_max=2.4",
    "stages.1.tilt_rate=15",
    "stages.1.tilt_axis=[0.0, -1.0, 0.0]",
)
TILT_CASES = [Case("bed_slope", label="tilted on from 5", circumstances=("conditions.slope=5",))]
FLUX_ORDERS = (
    "grains.count=500",
    "wind.length_d=16.0",
    "wind.width_d=8.0",
    "run.overlap_limit=0.95",
    *(f"stages.{place}.friction_velocity={STRONG}" for place in (1, 2)),
    "stages.3.duration_max=0.5",
)
FLUX_CASES = [
    Case("midair_passing"),
    Case("supply_limit", label="cover 0.4", parameters=("cover=0.4",)),
    Case("supply_limit", label="cover 0.04", parameters=("cover=0.04",)),
]


def main(asked: list[str]) -> None:
    """Simulate what was asked for, telling every effect as it is done."""
    plans: dict[str, tuple[Path, Orders, list[Case], range]] = {
        "start": (THRESHOLD, ORDERS, CASES, SEEDS),
        "ceasing": (THRESHOLD, ORDERS, CEASING, SEEDS),
        "flux": (FLUX, FLUX_ORDERS, FLUX_CASES, SEEDS),
        "laws": (THRESHOLD, ORDERS, LAW_CASES, LAW_SEEDS),
        "tilt": (THRESHOLD, TILTED, TILT_CASES, LAW_SEEDS[:8]),
    }
    for plan, (scene, orders, cases, seeds) in plans.items():
        chosen = [case for case in cases if not asked or plan in asked or case.effect in asked]
        tabulate(TABLE, measure_shifts(scene, orders, chosen, list(seeds), Numerics(threads=1)), sys.stderr)


if __name__ == "__main__":
    main(words(__doc__))
