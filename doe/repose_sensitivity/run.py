"""Sensitivity of the funnel angle: simulates the cases, writes results.csv, draws the figure, fills the page.

python -m doe.repose_sensitivity.run             all cases
python -m doe.repose_sensitivity.run GROUP...    the cases of some groups
python -m doe.repose_sensitivity.run --page      only the figure and the tables of the page, from results.csv
"""

from pathlib import Path

from doe.common.cases import ROOT, Case, perform, settings
from doe.common.command import words
from doe.repose_sensitivity.page import publish

SCENE = "scenes/funnel_repose.toml"
TABLE = Path(__file__).with_name("results.csv")

COUNT = 3000  # grains in the scene, for which its outlet stands just above the heap
OUTLET_HEIGHT = 0.032  # m, in the scene
FUNNEL_HEIGHT = 0.065  # m, stem and cone
RATE = 20000.0  # s-1, in the scene: more than the outlet passes, so that the funnel fills
OUTLET_RATE = 5000.0  # s-1, about what the outlet passes
DURATION = 2.0  # s, limit in the scene
FUNNEL = {"outlet_radius": 0.0125, "stem_length": 0.010, "rim_radius": 0.060, "cone_height": 0.055}  # m
FILL_RADIUS = 0.040  # m
COARSE = 8.0  # grains over the sieve class in the scene
SURFACE_ENERGY = 3.302  # J m-2, published
SEEDS, REFERENCE_SEEDS = 3, 6  # where a heap is left; one where all grains hang, or a seed takes 5 minutes
EDEM = ("laws.adhesion_branch=edem", "laws.friction_cap=edem")
GENTLE = "fill.speed=1.414"  # m s-1: with half the height of the funnel, the same splash
SOFT = ("materials.soil.shear_modulus=1e6", "run.overlap_limit=0.3")  # impacts overlap by 0.23 radii


def heap(count: int = COUNT, size: float = 1.0, lift: float = 1.0, rate: float = RATE) -> tuple[str, ...]:
    """Settings of a similar test: lengths grow with `size`, times with its root, the outlet with the heap.

    `lift` multiplies the height of the outlet; `rate` [s-1] is that of grains of the scene's size.
    The speed of the pour stays.
    """
    outlet = OUTLET_HEIGHT * (count / COUNT) ** (1.0 / 3.0) * size * lift
    root = size**0.5
    orders = [
        f"grains.count={count}",
        f"grains.size.scale={COARSE * size:g}",
        f"geometry.funnel.outlet=[0.0, 0.0, {outlet:.5f}]",
        f"fill.centre=[0.0, 0.0, {outlet + FUNNEL_HEIGHT * size:.5f}]",
        f"fill.rate={rate / root:g}",
        f"stages.0.duration_min={root * max(0.4, 1.1 * count / rate):.4g}",
        f"stages.0.duration_max={root * (DURATION + count / min(rate, OUTLET_RATE)):.4g}",
    ]
    if size != 1.0:
        orders += [f"geometry.funnel.{name}={length * size:g}" for name, length in FUNNEL.items()]
        orders.append(f"fill.radius={FILL_RADIUS * size:g}")
    return tuple(orders)


def adhesive(energy: float) -> tuple[str, ...]:
    """Settings of a surface energy [J m-2] in both pairs of materials."""
    pairs = ("contact.soil-soil", "contact.soil-steel")
    return ("laws.normal=jkr", *(f"{pair}.surface_energy={energy:g}" for pair in pairs))


def step(fraction: float) -> tuple[str, ...]:
    """Settings of a time step, in Rayleigh times; beyond 0.3 the scene must insist."""
    forced = ("run.force_time_step=true",) if fraction > 0.3 else ()
    return (f"run.time_step_fraction={fraction}", *forced)


def case(group: str, label: str, *orders: str, replicas: int = SEEDS) -> Case:
    """A case from its settings."""
    return Case(group, label, settings(*orders), replicas)


JKR = adhesive(SURFACE_ENERGY)

SMALL = heap(1000)
STICKY = (*SMALL, *JKR, "stages.0.duration_max=0.6")  # what hangs in the funnel never comes to rest

ADHESIVE_CASES = [
    *[
        case(
            "adhesion and time step",
            f"1000 grains, 3.302 J/m2, {f:g} Rayleigh times",
            *STICKY,
            *step(f),
            replicas=1,
        )
        for f in (1.0, 0.6, 0.3, 0.2, 0.1)
    ],
    case(
        "adhesion and time step", "3000 grains, 3.302 J/m2, 0.6 Rayleigh times", *JKR, *step(0.6), replicas=1
    ),
    case("law of adhesion", "1000 grains, 3.302 J/m2, branch and cap of EDEM", *STICKY, *EDEM, replicas=1),
    *[
        case("surface energy", f"1000 grains, {energy:g} J/m2", *SMALL, *adhesive(energy))
        for energy in (0.302, 0.0302, 0.00302)
    ],
    case("adhesion and grain size", "14 mm, 0 J/m2", *heap(size=5.0)),
    case("adhesion and grain size", "14 mm, 3.302 J/m2", *heap(size=5.0), *JKR),
]

DRY_CASES = [
    *[case("time step", f"{f:g} Rayleigh times", *step(f)) for f in (0.6, 0.3)],
    case("stiffness", "G = 1e6 Pa", *SOFT),
    *[
        case(*names, *orders, replicas=1)
        for *names, orders in (
            ("grain size", "half, apparatus alike", heap(size=0.5)),
            ("grain size", "half, apparatus and splash alike", (*heap(size=0.5), GENTLE)),
            ("grain number", "10000 grains, G = 1e6 Pa", (*heap(10_000, rate=10_000.0), *SOFT)),
            ("time step", "0.1 Rayleigh times", step(0.1)),
            ("stiffness", "G = 1e8 Pa", ("materials.soil.shear_modulus=1e8",)),
            ("outlet height", "1.5 of the reference", heap(lift=1.5)),
            ("pouring rate", "2500 per second, the outlet stays open", heap(rate=2500.0)),
            ("grain number", "20000 grains, G = 1e6 Pa", (*heap(20_000, rate=7000.0), *SOFT)),
        )
    ],
]

CASES = [
    case("reference", "3000 grains", replicas=REFERENCE_SEEDS),
    case("reference", "1000 grains", *SMALL),
    *ADHESIVE_CASES,
    *DRY_CASES,
]  # the most telling first: a study may be cut short


def main(asked: list[str]) -> None:
    """Simulate what was asked for, then publish the table."""
    if asked != ["--page"]:
        perform(SCENE, [c for c in CASES if not asked or c.group in asked], TABLE)
    publish(TABLE, ROOT / "docs")


if __name__ == "__main__":
    main(words(__doc__))
