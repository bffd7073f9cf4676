"""Makes the table of a soil whose grains roll less freely when wet, which no listed effect describes.

    python -m doe.beyond.laboratory [TABLE]

The laboratory has formulas of its own, another angle of repose and another threshold than the start values of
the study. TABLE is rolling_wet.csv beside this file where left out.
"""

import math
import random
import sys
from pathlib import Path

HERE = Path(__file__).parent
MOISTURES = (0.0, 0.01, 0.02, 0.03, 0.04)  # kg water per kg of dry soil
DIAMETERS = (1.5, 2.5, 4.0, 6.0)  # 0.1 mm
WIND = 0.6  # friction velocity at which the flux is measured [m s-1]
SEED = 11
HEADING = "observable,value,sd,unit,group,moisture,diameter [m],u_star [m/s],source"
FRICTION, ROLLING = 0.55, 0.12  # of dry grains [1]
SCATTER = {"threshold_u_star": 0.02, "flux": 0.08}  # over the value [1]
OWN_SCATTER = {"repose_angle": 0.5, "flux": 1e-4}  # deg, kg m-1 s-1


def readings(moisture: float, diameter: float) -> dict[str, float]:
    """What the soil does: threshold [m s-1], flux [kg m-1 s-1], angle [deg]."""
    factor = 1.0 + 5.0 * (moisture / 0.02) ** 0.7  # of rolling friction over that of dry grains
    threshold = 0.11 * math.sqrt((2650.0 / 1.2 - 1.0) * 9.81 * diameter) * factor**0.125
    flux = 1.3 * 1.2 / 9.81 * threshold * max(WIND**2 - threshold**2, 0.0)
    angle = math.degrees(math.atan(FRICTION)) + 15.0 * ROLLING * factor
    return {"threshold_u_star": threshold, "flux": flux, "repose_angle": angle}


def table() -> str:
    """One reading of every observable at every moisture and diameter."""
    drawn, lines = random.Random(SEED), [HEADING]
    units = {"threshold_u_star": "m/s", "flux": "kg/m/s", "repose_angle": "deg"}
    for moisture in MOISTURES:
        for tenths in DIAMETERS:
            for name, value in readings(moisture, 1e-4 * tenths).items():
                sd = SCATTER.get(name, 0.0) * value + OWN_SCATTER.get(name, 0.0)
                read = value + drawn.gauss(0.0, sd)
                place = f"{moisture:g},{1e-4 * tenths:g},{WIND:g}"
                group = f"soil {moisture:g} {tenths:g}"
                lines.append(f"{name},{read:.5g},{sd:.3g},{units[name]},{group},{place},laboratory.py")
    return "\n".join(lines) + "\n"


def main() -> None:
    """Write the table."""
    path = Path(sys.argv[1]) if len(sys.argv) > 1 else HERE / "rolling_wet.csv"
    path.write_text(table(), encoding="utf-8")


if __name__ == "__main__":
    main()
