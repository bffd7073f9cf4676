"""What is timed: beds and funnels, from the arrays of a case file or generated here."""

from typing import Any

import numpy as np

from taichi_erosion.core.setup import (
    ContactTable,
    Floats,
    GrainTable,
    Laws,
    PrimitiveKind,
    PrimitiveTable,
    Setup,
    Surface,
)

DAMPING = 0.3  # of rolling, share of the critical value [1]
SKIN = 0.1  # list margin of a resting grain over its radius [1], as the other codes' 0.1 d for a pair
LAWS = Laws(rolling="elastic_plastic")
SOIL = {  # of the generated cases, SI units: the soil of the published study, softened
    "diameter": 1e-3,
    "density": 2130.0,
    "young": 1e7,
    "poisson": 0.29,
    "restitution": 0.6,
    "friction": 0.61,
    "friction_wall": 0.34,
    "friction_rolling": 0.1,
    "gravity": 9.81,
    "time_step": 5e-6,
}
BED_SIDE = 12  # grains along each period of the generated bed
BED_LAYERS = 14
FUNNEL = {
    "funnel_bottom": 10.0,
    "funnel_height": 14.0,
    "orifice_radius": 5.0,
}  # of about 4,000 grains, in diameters; flanks of 45 deg
FUNNEL_GRAINS = 4016
PITCH = 1.08  # of the lattices that they settle from, over the diameter [1]
JITTER = 0.03  # of those lattices, over the diameter [1]


def contact_table(case: Any) -> ContactTable:
    """Contact of grain and grain, grain and rigid wall, wall and wall, from the scalars of a case file."""
    young, poisson, one = float(case["young"]), float(case["poisson"]), np.ones(3)
    frictions = [case["friction"], case["friction_wall"], case["friction_wall"]]
    return ContactTable(
        young_effective=young / (2.0 * (1.0 - poisson**2)) * one,
        shear_effective=young / (4.0 * (2.0 - poisson) * (1.0 + poisson)) * one,
        restitution=float(case["restitution"]) * one,
        friction_sliding=np.array(frictions, dtype=np.float64),
        friction_rolling=float(case["friction_rolling"]) * one,
        rolling_damping=DAMPING * one,
        surface_energy=0.0 * one,
        effects=one,
    )


def grain_table(position: Floats, case: Any) -> GrainTable:
    """Equal spheres at rest."""
    count, radius = len(position), 0.5 * float(case["diameter"])
    mass = float(case["density"]) * 4.0 / 3.0 * np.pi * radius**3
    still = np.zeros((count, 3))
    return GrainTable(
        position=np.asarray(position, np.float64),
        velocity=still,
        spin=still,
        radius=np.full(count, radius),
        mass=np.full(count, mass),
        material=np.zeros(count, np.int32),
        release_time=np.zeros(count),
    )


def floor(height: float = 0.0) -> Floats:
    """Row of an upward plane."""
    return np.array([[0.0, 0.0, height, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0]])


def bed_setup(case: Any) -> Setup:
    """Bed on a floor, periodic in x and y."""
    period = np.asarray(case["period"], np.float64)
    return Setup(
        grains=grain_table(case["position"], case),
        materials=("grain", "wall"),
        contacts=contact_table(case),
        primitives=PrimitiveTable(np.zeros(1, np.int32), np.zeros(1, np.int32), floor()),
        surfaces=(Surface("floor", 1),),
        time_step=float(case["time_step"]),
        gravity=(0.0, 0.0, -float(case["gravity"])),
        domain=((0.0, 0.0, -1.0), (float(period[0]), float(period[1]), 1.0)),
        period=(float(period[0]), float(period[1]), 0.0),
        skin=SKIN,
    )


def funnel_setup(case: Any) -> Setup:
    """Grains in a cone above a floor."""
    bottom, height, orifice = (float(case[k]) for k in ("funnel_bottom", "funnel_height", "orifice_radius"))
    cone = np.array([[0.0, 0.0, 0.0, 0.0, 0.0, 1.0, orifice, bottom, orifice + height, bottom + height]])
    kinds = np.array([PrimitiveKind.PLANE, PrimitiveKind.REVOLVED], np.int32)
    return Setup(
        grains=grain_table(case["position"], case),
        materials=("grain", "wall"),
        contacts=contact_table(case),
        primitives=PrimitiveTable(kinds, np.array([0, 1], np.int32), np.concatenate([floor(), cone])),
        surfaces=(Surface("floor", 1), Surface("funnel", 1)),
        time_step=float(case["time_step"]),
        gravity=(0.0, 0.0, -float(case["gravity"])),
        skin=SKIN,
    )


def lattice(sides: tuple[int, int, int], seed: int) -> Floats:
    """Jittered cubic lattice from the origin upwards, in diameters."""
    grid = np.stack(np.meshgrid(*(np.arange(sites) for sites in sides), indexing="ij"), axis=-1)
    sites = grid.reshape(-1, 3) * PITCH
    return sites + np.random.Generator(np.random.Philox(seed)).uniform(-JITTER, JITTER, sites.shape)


def lattice_bed(seed: int) -> Setup:
    """Jittered lattice over a periodic floor, which settles to a bed."""
    diameter = SOIL["diameter"]
    position = diameter * (lattice((BED_SIDE, BED_SIDE, BED_LAYERS), seed) + 0.6)
    return bed_setup(SOIL | {"position": position, "period": (diameter * PITCH * BED_SIDE,) * 2})


def filled_funnel(seed: int, grains: int = FUNNEL_GRAINS) -> Setup:
    """Jittered lattice of about so many grains that fills a cone above a floor, and runs out of it."""
    diameter, size = SOIL["diameter"], (grains / FUNNEL_GRAINS) ** (1.0 / 3.0)
    funnel = {name: size * length for name, length in FUNNEL.items()}
    rim = funnel["orifice_radius"] + funnel["funnel_height"]
    across, up = (int(length / PITCH) for length in (2.0 * rim, funnel["funnel_height"]))
    corner = np.array([-rim, -rim, funnel["funnel_bottom"] + 0.6])
    place = corner + lattice((across, across, up), seed)
    radius = np.hypot(place[:, 0], place[:, 1])
    inside = radius < place[:, 2] - funnel["funnel_bottom"] + funnel["orifice_radius"] - 1.0  # off the flank
    lengths = {name: diameter * length for name, length in funnel.items()}
    return funnel_setup(SOIL | lengths | {"position": diameter * place[inside]})
