"""Sand under wind against measurements: simulates the cases and writes the tables beside this file.

python -m doe.wind.run             all cases
python -m doe.wind.run GROUP...    the cases of some groups; `hopping` is the grain that hops alone
"""

from collections.abc import Sequence
from pathlib import Path

from doe.common.cases import DRAG_ALONE, Case, perform, settings
from doe.common.command import words
from taichi_erosion.core.files import write_atomic
from tests.verification.reference.hopping import Sand, hopping_threshold
from tests.verification.wind.saltation import roughness, winds_over_beds

SCENE, TABLE = "scenes/wind_threshold.toml", Path(__file__).with_name("fluid.csv")
HOPPING = Path(__file__).with_name("hopping.csv")
DIAMETERS = (0.24e-3, 1.0e-3, 0.1e-3, 0.5e-3, 0.15e-3, 0.7e-3, 0.075e-3)  # m
FINE = (0.075e-3, 0.1e-3, 0.15e-3, 0.24e-3, 0.5e-3)  # m, those that are also simulated with adhesion
ADHESION = "effects.dry_adhesion.strength=1"
FAR = 100.0  # diameters over a bed, from where its roughness is seen

BEDS, MANY, FEW = 5, 32, 3  # of a threshold, of that of the tunnel, of one that shows how a choice acts
GUSTS, LIFT = "effects.turbulent_gusts.strength=1", "effects.shear_lift.strength=1"
DEEPER = ("grains.count=1200", "run.time_step_fraction=0.2", "run.overlap_limit=0.6")
STATED, STEP = "materials.soil.density=2130", "run.time_step_fraction=0.25"  # kg m-3, as the study states it


def fluid_cases() -> list[Case]:
    """The fluid threshold of the published soil: what moves the grains, and what else it depends on."""
    forces = {"drag alone": (), "drag and gusts": (GUSTS,), "drag and lift": (LIFT,)}
    return [
        *[Case("forces", label, settings(DRAG_ALONE, *orders), BEDS) for label, orders in forces.items()],
        Case("forces", "all forces", (), MANY),
        Case("time step", "0.25 of the Rayleigh time, all forces", settings(STEP), MANY),
        Case("as stated", "2130 kg/m3, all forces", settings(STATED), BEDS),
        changed("grain density", "2130 kg/m3", STATED),
        changed("criterion", "first grain of a layer", "threshold.share=0.005"),
        changed("criterion", "5 times the grains", "threshold.share=0.05"),
        changed("criterion", "a tenth of the time", "threshold.hold=0.03"),
        Case("deeper bed", "drag alone", settings(DRAG_ALONE, *DEEPER), BEDS),
        Case("deeper bed", "drag and gusts", settings(DRAG_ALONE, *DEEPER, GUSTS), BEDS),
    ]


def changed(group: str, label: str, *orders: str) -> Case:
    """The scene under drag alone with some settings changed, on fewer beds."""
    return Case(group, label, settings(DRAG_ALONE, *orders), FEW)


def write_hopping() -> None:
    """The threshold of one grain that hops by the measured law of bounces, over a plane and over beds."""
    sands = [Sand(d) for d in sorted(DIAMETERS)]
    lines = [["diameter [mm]", "u_star [m/s]", "u_star over a bed [m/s]", "roughness of that bed [mm]"]]
    for sand, over in zip(sands, winds_over_beds(sands), strict=True):
        threshold = hopping_threshold(sand, over)
        rough = roughness(over(threshold), threshold, FAR * sand.diameter)
        cells = (1e3 * sand.diameter, hopping_threshold(sand), threshold, 1e3 * rough)
        lines.append([f"{cell:.4g}" for cell in cells])
    write_atomic(HOPPING, "".join(",".join(line) + "\n" for line in lines).encode())


def main(asked: Sequence[str]) -> None:
    """Simulate what was asked for."""
    perform(SCENE, [case for case in fluid_cases() if not asked or case.group in asked], TABLE)
    if not asked or "hopping" in asked:
        write_hopping()


if __name__ == "__main__":
    main(words(__doc__))
