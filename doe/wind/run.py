"""Sand under wind against measurements: simulates the cases and writes the tables beside this file.

python -m doe.wind.run             all cases
python -m doe.wind.run GROUP...    the cases of some groups; `hopping` is the grain that hops alone
"""

from collections.abc import Sequence
from math import pi
from pathlib import Path

from doe.common.cases import DRAG_ALONE, ROOT, Case, perform, read_rows, settings, size_order, write_rows
from doe.common.command import words
from doe.common.tables import lines_of
from doe.wind.saturated_sand import IN_EVERY_CONTACT
from taichi_erosion.core.files import write_atomic
from taichi_erosion.effect_library.dry_adhesion import Params
from tests.verification.reference.hopping import GRAVITY, Sand, hopping_threshold
from tests.verification.wind.saltation import SMALLEST, at_rest, roughness, winds_over_beds

FOLDER = Path(__file__).parent
TABLES = {
    "scenes/saltation.toml": FOLDER / "flux.csv",
    "scenes/impact_threshold.toml": FOLDER / "impact.csv",
    "scenes/wind_threshold.toml": FOLDER / "fluid.csv",
}
SALTATION, IMPACT, FLUID = TABLES
HOPPING = FOLDER / "hopping.csv"
CREYSSELS = ROOT / "doe" / "measured" / "flux_creyssels2009.csv"
STARTING = 0.6  # m s-1, that starts transport in scenes/saltation.toml
BLOWING = (2,)  # its stages that state the measured wind blows

REFERENCE = 0.24e-3  # m, diameter of scenes/impact_threshold.toml
DIAMETERS = (0.24e-3, 1.0e-3, 0.1e-3, 0.5e-3, 0.15e-3, 0.7e-3, 0.075e-3)  # m
FINE = (0.075e-3, 0.1e-3, 0.15e-3, 0.24e-3, 0.5e-3)  # m, those that are also simulated with adhesion
ADHESION = "effects.dry_adhesion.strength=1"
EACH = "effects.dry_adhesion.contacts=1"  # the pull of a whole grain in every contact
BETA = Params().beta  # N m-1, the pull over d at strength 1
MODULUS = 1e5  # Pa, at the reference: stiffness goes with d
TIMES = {  # s, at the reference: they go with d, as about does the time in which drag gives a grain its speed
    "stages.0.duration_max": 0.15,
    "stages.1.duration_max": 0.1,
    "threshold.spin_up": 0.4,
}
HOPS = {"threshold.fall_hold": 0.4}  # s, at the reference, a dozen hops: with the root of d, as a hop
# m s-1, with the root of d and of what holds a grain over its weight
WINDS = {"stages.1.friction_velocity": 0.55, "threshold.transport": 0.33}

FAR = 100.0  # diameters over a bed, from where its roughness is seen

BEDS = 5  # of a threshold
MANY = 32  # of the one that is compared with the tunnel
FALLING = 4  # of an impact threshold
BLOWN = 3  # of a flux, each of which is averaged over a second
FEW = 3  # of one that only has to show the way a choice acts
GUSTS, LIFT = "effects.turbulent_gusts.strength=1", "effects.shear_lift.strength=1"
DEEPER = ("grains.count=1200", "run.time_step_fraction=0.2", "run.overlap_limit=0.6")
STATED = "materials.soil.density=2130"  # kg m-3, of the grains as the study states it
COUNT, SIDE = 900, 14.0  # grains, and diameters, of the patch of scenes/wind_threshold.toml
SIDES = (20.0,)  # of other patches; much smaller ones hold too few of the largest grains


def flux_cases() -> list[Case]:
    """The winds of the measured flux, the middle ones first."""
    winds = [float(line["u_star [m/s]"]) for line in lines_of(CREYSSELS)]
    first = sorted(winds, key=lambda wind: abs(wind - winds[2]))
    return [Case("flux", f"{wind:g}", settings(*flux_orders(wind)), BLOWN) for wind in first]


def flux_orders(wind: float) -> tuple[str, ...]:
    """Settings of one wind [m s-1]."""
    stages = {1: max(STARTING, wind)} | dict.fromkeys(BLOWING, wind)
    return tuple(f"stages.{place}.friction_velocity={value}" for place, value in stages.items())


def impact_cases() -> list[Case]:
    """The same experiment with grains of other diameters [m]."""
    plain = [Case("impact", f"{1e3 * d:g}", settings(*impact_orders(d)), FALLING) for d in DIAMETERS]
    sticky = [(f"{1e3 * d:g}", settings(*impact_orders(d, bond_number(d)), ADHESION, EACH)) for d in FINE]
    return plain + [Case(IN_EVERY_CONTACT, label, orders, FALLING) for label, orders in sticky]


def bond_number(diameter: float) -> float:
    """Pull of dry grains over their weight [1]."""
    return BETA * diameter / (pi / 6.0 * diameter**3 * Sand(diameter).density * GRAVITY)


def impact_orders(diameter: float, pull: float = 0.0) -> tuple[str, ...]:
    """Settings of one diameter [m]: all ratios of lengths and forces but those of the air stay.

    Grains that stick with `pull` times their weight are set in motion by winds stronger by its root.
    """
    size = diameter / REFERENCE
    winds = {path: (1.0 + pull) ** 0.5 * value for path, value in WINDS.items()}
    return (
        size_order(diameter),
        f"materials.sand.shear_modulus={MODULUS * size:.6g}",
        *(f"{path}={size * value:.6g}" for path, value in TIMES.items()),
        *(f"{path}={size**0.5 * value:.6g}" for path, value in (HOPS | winds).items()),
    )


def fluid_cases() -> list[Case]:
    """The fluid threshold of the published soil: what moves the grains, and what else it depends on."""
    forces = {"drag alone": (), "drag and gusts": (GUSTS,), "drag and lift": (LIFT,)}
    return [
        *[Case("forces", label, settings(DRAG_ALONE, *orders), BEDS) for label, orders in forces.items()],
        Case("forces", "all forces", (), MANY),
        Case(
            "time step",
            "0.25 of the Rayleigh time, all forces",
            settings("run.time_step_fraction=0.25"),
            MANY,
        ),
        Case("as stated", "2130 kg/m3, all forces", settings(STATED), BEDS),
        changed("grain density", "2130 kg/m3", STATED),
        changed("criterion", "first grain of a layer", "threshold.share=0.005"),
        changed("criterion", "5 times the grains", "threshold.share=0.05"),
        changed("criterion", "a tenth of the time", "threshold.hold=0.03"),
        Case("deeper bed", "drag alone", settings(DRAG_ALONE, *DEEPER), BEDS),
        Case("deeper bed", "drag and gusts", settings(DRAG_ALONE, *DEEPER, GUSTS), BEDS),
        *[changed("patch", f"{side:g} diameters", *patch_orders(side)) for side in SIDES],
    ]


def changed(group: str, label: str, *orders: str) -> Case:
    """The scene under drag alone with some settings changed, on fewer beds."""
    return Case(group, label, settings(DRAG_ALONE, *orders), FEW)


def patch_orders(side: float) -> tuple[str, ...]:
    """Settings of a square patch of a side in diameters, the bed as deep as in the scene."""
    count = round(COUNT * (side / SIDE) ** 2)
    return (f"grains.count={count}", f"wind.length_d={side}", f"wind.width_d={side}")


def write_hopping() -> None:
    """The threshold of one grain that hops by the measured law of bounces, over a plane and over beds."""
    sands = [Sand(d) for d in sorted(DIAMETERS)]
    lines = [["diameter [mm]", "u_star [m/s]", "u_star over a bed [m/s]", "roughness of that bed [mm]"]]
    winds = winds_over_beds([at_rest(sand.diameter / SMALLEST) for sand in sands], sands)
    for sand, over in zip(sands, winds, strict=True):
        threshold = hopping_threshold(sand, over)
        rough = roughness(over(threshold), threshold, FAR * sand.diameter)
        cells = (1e3 * sand.diameter, hopping_threshold(sand), threshold, 1e3 * rough)
        lines.append([f"{cell:.4g}" for cell in cells])
    write_atomic(HOPPING, "".join(",".join(line) + "\n" for line in lines).encode())


def put_in_order(table: Path, cases: Sequence[Case]) -> None:
    """Rows in the order of the cases; those of cases that nobody asks for any more go."""
    rows = read_rows(table)
    names = [(case.group, case.label) for case in cases]
    write_rows(table, [row for name in names for row in rows if (row.group, row.label) == name])


def main(asked: Sequence[str]) -> None:
    """Simulate what was asked for."""
    plans = {SALTATION: flux_cases(), IMPACT: impact_cases(), FLUID: fluid_cases()}
    for scene, cases in plans.items():
        perform(scene, [c for c in cases if not asked or c.group in asked], TABLES[scene])
        put_in_order(TABLES[scene], cases)
    if not asked or "hopping" in asked:
        write_hopping()


if __name__ == "__main__":
    main(words(__doc__))
