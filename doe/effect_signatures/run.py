"""Shift of every effect, measured with paired seeds; writes effect_library/measured/signatures.csv.

python -m doe.effect_signatures.run              all cases of all scenes
python -m doe.effect_signatures.run EFFECT...    the cases of some effects
"""

import sys

from doe.common.cases import MEASURED, ROOT
from doe.common.command import words
from doe.effect_signatures.shifts import Case, measure_shifts, tabulate
from taichi_erosion.core.setup import Numerics

TABLE = MEASURED / "signatures.csv"
SEEDS = range(1, 7)

# The collapsing column of laboratory C with grains of 0.15 mm, where adhesion and water count, a fifth of its
# grains and of its stiffness. Stiffness goes with d and times with its root, so the bare heap is to scale.
FINE = 0.1  # diameter over that of the scene [1]
DIAMETER = 1.5e-3 * FINE  # m
COLUMN = ROOT / "scenes" / "column_collapse.toml"
COLUMN_ORDERS = (
    "grains.count=400",
    f"grains.size.diameter={DIAMETER:g}",
    f"geometry.tube.radius={5.5 * DIAMETER:g}",
    f"fill.radius={4.9 * DIAMETER:g}",
    *(f"materials.{name}.young_modulus={1e6 * FINE:g}" for name in ("grain", "plate", "tube")),
    f"run.time_step={3e-5 * FINE**0.5:.4g}",
    f"stages.0.duration_min={0.075 * FINE**0.5:.4g}",
    f"stages.0.duration_max={0.525 * FINE**0.5:.4g}",
    f"stages.1.duration_max={0.645 * FINE**0.5:.4g}",
    "conditions.angularity=0.5",
    "conditions.slope=5.0",
)


def rolling(angularity: float) -> Case:
    """Rolling resistance of grains of another shape."""
    orders = (f"conditions.angularity={angularity:g}",)
    return Case("rolling_resistance", label=f"angularity {angularity:g}", circumstances=orders)


def wet(moisture: float, *parameters: str) -> Case:
    """Bridges at a moisture, with numbers of their own; without any at 1.65 % the case of the effect."""
    orders = (f"conditions.moisture={moisture:g}",)
    words = [f"moisture {moisture:g}"] if moisture != MEASURED else []
    words += ["share 0.01"] if parameters else []
    return Case("liquid_bridge", label=", ".join(words), circumstances=orders, parameters=parameters)


MEASURED = 0.0165  # moisture of the published soil [kg kg-1]
FIXED_SHARE = ("wet_fraction=0.01", "exponent=0")  # a pull that does not know how much water there is
IN_THE_TUBE = ("stages.1.remove=[]", "measure.column_height.stage=collapse")  # height before and after taps

COLUMN_CASES = [
    Case("rolling_resistance"),
    wet(MEASURED),
    wet(MEASURED, *FIXED_SHARE),
    Case("dry_adhesion"),
    Case("grain_shape"),
    Case("size_distribution", circumstances=("run.overlap_limit=0.45",)),  # its finest grains fall from high
    Case("packing_preparation"),
    Case("packing_preparation", label="in the tube", circumstances=IN_THE_TUBE, parameters=("taps=20",)),
    Case("side_walls", parameters=("width=11",)),  # the bare heap reaches 15 diameters across
    wet(0.002, *FIXED_SHARE),
    wet(0.1, *FIXED_SHARE),
    rolling(1.0),
    Case("dry_adhesion", 10.0, label="strength 10"),
    Case("grain_shape", 2.0, label="strength 2"),
    Case("restitution_speed"),
    Case("surface_crust"),
    Case("image_charge"),
    Case("bed_slope"),
    Case("grain_density"),
    Case("sieve_diameter"),
    Case("repose_method"),
]  # the most telling first: a study may be cut short


def main(asked: list[str]) -> None:
    """Simulate what was asked for, telling every effect as it is done."""
    cases = [case for case in COLUMN_CASES if not asked or case.effect in asked]
    shifts = measure_shifts(COLUMN, COLUMN_ORDERS, cases, list(SEEDS), Numerics(threads=1))
    tabulate(TABLE, shifts, sys.stderr)


if __name__ == "__main__":
    main(words(__doc__))
