"""A bead in a pocket of a regular layer of equal beads: the wind in which it leaves; writes results.csv.

python -m doe.single_bead.run          all cases, in some minutes
python -m doe.single_bead.run --page   only the table of README.md, from results.csv

A layer of spheres in contact covers a plane, in a triangular or a quadratic arrangement; one sphere more
lies in a pocket of it, and the wind blows towards the lowest saddle between its neighbours. The bead rolls
over that saddle, about the line through both contacts, when

    F z + T = (W - L) x,    x = d / sqrt(48), z = d / sqrt(6) (triangular),    d / 4, d / sqrt(8) (quadratic)

with F, T, L drag, torque about the centre and lift of the air, W the weight less buoyancy, d the diameter.
`creeping`: laminar air, so viscous that Re < 0.2; `air`: 0.25 mm of quartz in air with its turbulence. The
Shields number is rho u*^2 / ((rho_s - rho) g d). The effective height is that over which the shear at the
lid, u*^2 / nu, would give the wind at the centre of the bead, as it is in the wind in which it leaves.
"""

from collections.abc import Iterator, Sequence
from dataclasses import astuple, dataclass
from math import pi, sqrt
from pathlib import Path
from typing import Any

import numpy as np

from doe.common.command import words
from doe.common.pages import write_pages
from doe.common.tables import cell, read_table, write_table
from doe.effects.pocket import Floats, leaving_winds
from taichi_erosion.core.device import stop_device
from taichi_erosion.core.setup import Laws, Numerics
from taichi_erosion.core.snapshot import AirProfile
from taichi_erosion.effects import load_library
from taichi_erosion.report.markdown import markdown_table
from taichi_erosion.scene import Scene, parse_scene
from taichi_erosion.simulation import assemble, prepare, snapshot, spin_up_wind
from taichi_erosion.simulation.wind_driver import air_profile
from tests.verification.reference.flow import Stream, two_limits

FOLDER = Path(__file__).parent
RESULTS, PAGE = FOLDER / "results.csv", FOLDER / "README.md"
DIAMETER, DENSITY, AIR, GRAVITY = 2.5e-4, 2650.0, 1.225, 9.81  # m, kg m-3, kg m-3, m s-2
DIGITS = 4  # of numbers in the table
SIDE = 14  # beads along a row: the bead takes less than a tenth of the stress of the wind
YOUNG = 3e6  # Pa: the bead sinks in by less than 1e-3 radii
HOLD = 0.05  # s from rest in which the bead must leave: ten times the time of a fall over its radius
ROLLING = Laws(drag="two_limits", rolling="elastic_plastic")
WINDS = {
    "creeping": ("none", 3e-4),
    "air": ("mixing_length", 1.46e-5),
}  # closure, kinematic viscosity [m2 s-1]
LEVERS = {"triangular": (1 / sqrt(48), 1 / sqrt(6)), "quadratic": (1 / 4, 1 / sqrt(8))}  # x and z over d
FORCES = (
    (),
    ("near_wall_drag",),
    ("near_wall_drag", "rotational_drag"),
    ("near_wall_drag", "rotational_drag", "shear_lift"),
)


@dataclass(frozen=True)
class Case:
    """One bead."""

    arrangement: str
    wind: str
    effects: tuple[str, ...] = ()
    side: int = SIDE


@dataclass(frozen=True)
class Row:
    """One line of the table."""

    arrangement: str
    wind: str
    effects: str
    u_star: float  # m s-1
    shields: float  # 1
    reynolds: float  # of the bead in the mean wind at its centre [1]
    effective_height: float  # over d [1]
    balance: float  # F z + T over (W - L) x in that wind, from the closed forms [1]


def places(arrangement: str, side: int) -> tuple[list[tuple[float, float, float]], float]:
    """Centres of the bead, then of the layer, and length of a patch `side` wide, all over the diameter."""
    if arrangement == "quadratic":
        layer = [(float(i), float(j), 0.5) for i in range(side) for j in range(side)]
        middle = side // 2 + 0.5
        return [(middle, middle, 0.5 + sqrt(0.5)), *layer], float(side)
    row = sqrt(0.75)
    layer = [(i * row, j + 0.5 * (i % 2), 0.5) for i in range(side) for j in range(side)]
    first = side // 4 * 2  # an even row: the bead lies between one of its beads and two of the next row
    return [((first + 2.0 / 3.0) * row, side // 2, 0.5 + sqrt(2.0 / 3.0)), *layer], side * row


def bead_scene(case: Case) -> Scene:
    """Scene of a case; the layer cannot roll on its plane, the bead on the layer can."""
    points, length = places(case.arrangement, case.side)
    closure, viscosity = WINDS[case.wind]
    solid = {"density": DENSITY, "young_modulus": YOUNG, "poisson_ratio": 0.25}
    touch = {"restitution": 0.05, "friction_sliding": 1.0}
    d = DIAMETER
    table: dict[str, Any] = {
        "scene": {"kind": "threshold", "title": "a bead on a regular layer"},
        "run": {"overlap_limit": 0.9},
        "grains": {"count": len(points), "material": "bead", "size": {"law": "monodisperse", "diameter": d}},
        "materials": {"bead": solid, "plane": solid},
        "laws": {"rolling": "elastic_plastic"},
        "contact": {
            "bead-bead": touch | {"friction_rolling": 0.0},
            "bead-plane": touch | {"friction_rolling": 1.0},
        },
        "geometry": {"ground": {"shape": "plane", "material": "plane"}},
        "fill": {
            "law": "positions",
            "grains": [{"position": tuple(d * c for c in point)} for point in points],
        },
        "wind": {
            "length": length * d,
            "width": case.side * d,
            "height": 60.0 * d,
            "surface": d,
            "closure": closure,
            "viscosity": viscosity,
            "density": AIR,
            "drag": "two_limits",
        },
        "stages": [{"name": "blow", "until": "time", "duration_max": HOLD}],
        "effects": {effect: {"strength": 1.0} for effect in case.effects},
    }
    return parse_scene(table, "bead")


def sphere_mean(profile: AirProfile, height: float) -> float:
    """Mean of the streamwise wind over the volume of a bead at a height [m s-1]."""
    share = np.linspace(-1.0, 1.0, 201)
    middles = 0.5 * (profile.face[1:] + profile.face[:-1])
    wind = np.interp(height + 0.5 * DIAMETER * share, middles, profile.velocity[:, 0])
    return float(np.average(wind, weights=1.0 - share**2))


def moment_balance(case: Case, mean: float, shear: float) -> float:
    """F z + T over (W - L) x [1] in a mean wind over the bead [m s-1] and a shear [s-1], from the papers."""
    stream = Stream(mean, DIAMETER, AIR, AIR * WINDS[case.wind][1])
    drag, torque, lift = two_limits(stream), 0.0, 0.0
    reynolds = stream.reynolds
    if "near_wall_drag" in case.effects:  # Zeng et al. (2009), gap 0
        wall = 1.0 + 0.138 + 9.0 / 16.0
        drag *= wall * (1.0 + 0.104 * reynolds**0.753) / (1.0 + 0.15 * reynolds**0.687)
    if "rotational_drag" in case.effects:  # Dennis et al. (1980)
        spin = 0.5 * shear
        turning = AIR * DIAMETER**2 * spin / stream.viscosity
        size = 64.0 * pi if turning < 32.0 else 12.9 * sqrt(turning) + 128.4
        torque = stream.viscosity * DIAMETER**3 * spin * size / 64.0
    if "shear_lift" in case.effects:
        coefficient = 3.663 / (reynolds**2 + 0.1173) ** 0.22
        lift = pi / 8.0 * AIR * (DIAMETER * mean) ** 2 * coefficient
    weight = pi / 6.0 * DIAMETER**3 * (DENSITY - AIR) * GRAVITY
    x, z = (lever * DIAMETER for lever in LEVERS[case.arrangement])
    return (drag * z + torque) / ((weight - lift) * x)


def winds_at(cases: Sequence[Case], winds: Floats) -> Iterator[tuple[float, float, float]]:
    """Wind at the centre, its mean over the bead [m s-1], and shear [s-1], for each case in its wind."""
    library = load_library()
    sim = assemble([prepare(bead_scene(c), 1, library) for c in cases], ROLLING, Numerics(threads=1))
    for replica, wind in enumerate(winds):
        spin_up_wind(sim, replica, float(wind), anew=True)
        profile, height = air_profile(sim, replica), float(snapshot(sim, replica).position[0, 2])
        middles = 0.5 * (profile.face[1:] + profile.face[:-1])
        around = np.interp(height + DIAMETER * np.array([-0.5, 0.0, 0.5]), middles, profile.velocity[:, 0])
        yield float(around[1]), sphere_mean(profile, height), float(around[2] - around[0]) / DIAMETER
    stop_device()


def rows_of(cases: Sequence[Case]) -> Iterator[Row]:
    """Simulate cases of one kind of wind."""
    found = leaving_winds([(bead_scene(case), 1) for case in cases], ROLLING, HOLD)
    for case, wind, (centre, mean, shear) in zip(cases, found, winds_at(cases, found), strict=True):
        viscosity = WINDS[case.wind][1]
        yield Row(
            case.arrangement,
            case.wind,
            " + ".join(case.effects),
            float(wind),
            float(AIR * wind**2 / ((DENSITY - AIR) * GRAVITY * DIAMETER)),
            centre * DIAMETER / viscosity,
            float(centre * viscosity / wind**2 / DIAMETER),
            moment_balance(case, mean, shear),
        )


def bead_table(winds: Sequence[str] = tuple(WINDS)) -> str:
    """Table of the cases in some kinds of wind, from results.csv."""
    rows = [row for row in read_table(RESULTS, Row) if row.wind in winds]
    header = ("layer", "wind", "forces beside drag", "u* [m/s]", "Shields", "Re", "height / d", "moments")
    return markdown_table(header, [tuple(cell(value, DIGITS) for value in astuple(row)) for row in rows])


def main(asked: Sequence[str]) -> None:
    """Simulate, then publish."""
    if list(asked) != ["--page"]:
        kinds = [[Case(a, wind, f) for a in LEVERS for f in FORCES] for wind in WINDS]
        write_table(RESULTS, Row, [row for cases in kinds for row in rows_of(cases)], DIGITS)
    write_pages([PAGE], {"beads": bead_table()})


if __name__ == "__main__":
    main(words(__doc__))
