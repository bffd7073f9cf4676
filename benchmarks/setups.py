"""Setups of timed grains: beds and funnels, from the arrays of a case file or generated here."""

from dataclasses import asdict
from typing import Any

import numpy as np

from benchmarks.peers import cases
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
SKIN = 0.1  # Verlet skin of a resting grain over its radius [1], as the other codes' 0.1 d for a pair
LAWS = Laws(rolling="elastic_plastic")
SOIL = asdict(cases.SOIL)  # of the generated cases, SI units: the soil of the published study, softened
BED_SIDE, BED_LAYERS = 12, 14  # grains along each period of the generated bed, and upwards
# of a funnel of about 4,000 grains, in diameters; flanks of 45 deg
FUNNEL = {"funnel_bottom": 10.0, "funnel_height": 14.0, "orifice_radius": 5.0}
FUNNEL_GRAINS = 4016
PITCH, JITTER = 1.08, 0.03  # of the lattices that they settle from, over the diameter [1]
FLOOR = (0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0)  # row of an upward plane


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
    return GrainTable(
        position=np.asarray(position, np.float64),
        velocity=np.zeros((count, 3)),
        spin=np.zeros((count, 3)),
        radius=np.full(count, radius),
        mass=np.full(count, mass),
        material=np.zeros(count, np.int32),
        release_time=np.zeros(count),
    )


def case_setup(case: Any, primitives: PrimitiveTable, surfaces: tuple[str, ...], **box: Any) -> Setup:
    """Grains of a case over rigid walls."""
    return Setup(
        grains=grain_table(case["position"], case),
        materials=("grain", "wall"),
        contacts=contact_table(case),
        primitives=primitives,
        surfaces=tuple(Surface(name, 1) for name in surfaces),
        time_step=float(case["time_step"]),
        gravity=(0.0, 0.0, -float(case["gravity"])),
        skin=SKIN,
        **box,
    )


def bed_setup(case: Any) -> Setup:
    """Bed on a floor, periodic in x and y."""
    x, y = (float(length) for length in case["period"])
    floor = PrimitiveTable(np.zeros(1, np.int32), np.zeros(1, np.int32), np.array([FLOOR]))
    return case_setup(case, floor, ("floor",), domain=((0.0, 0.0, -1.0), (x, y, 1.0)), period=(x, y, 0.0))


def funnel_setup(case: Any) -> Setup:
    """Grains in a cone above a floor."""
    bottom, height, orifice = (float(case[k]) for k in ("funnel_bottom", "funnel_height", "orifice_radius"))
    cone = (0.0, 0.0, 0.0, 0.0, 0.0, 1.0, orifice, bottom, orifice + height, bottom + height)
    kinds = np.array([PrimitiveKind.PLANE, PrimitiveKind.REVOLVED], np.int32)
    walls = PrimitiveTable(kinds, np.array([0, 1], np.int32), np.array([FLOOR, cone]))
    return case_setup(case, walls, ("floor", "funnel"))


def lattice(sides: tuple[int, int, int], seed: int) -> Floats:
    """Jittered cubic lattice from the origin upwards, in diameters."""
    grid = np.stack(np.meshgrid(*(np.arange(sites) for sites in sides), indexing="ij"), axis=-1)
    sites = grid.reshape(-1, 3) * PITCH
    return sites + np.random.Generator(np.random.Philox(seed)).uniform(-JITTER, JITTER, sites.shape)


def lattice_bed(seed: int, side: int = BED_SIDE) -> Setup:
    """Jittered lattice over a periodic floor, which settles to a bed; `side` grains along each period."""
    diameter = SOIL["diameter"]
    position = diameter * (lattice((side, side, BED_LAYERS), seed) + 0.6)
    return bed_setup(SOIL | {"position": position, "period": (diameter * PITCH * side,) * 2})


def filled_funnel(seed: int, grains: int) -> Setup:
    """Jittered lattice of about so many grains that fills a cone above a floor, and runs out of it."""
    diameter, size = SOIL["diameter"], (grains / FUNNEL_GRAINS) ** (1.0 / 3.0)
    bottom, height, orifice = (size * length for length in FUNNEL.values())
    rim = orifice + height
    across, up = int(2.0 * rim / PITCH), int(height / PITCH)
    sites = np.array([-rim, -rim, bottom + 0.6]) + lattice((across, across, up), seed)
    inside = np.hypot(sites[:, 0], sites[:, 1]) < sites[:, 2] - bottom + orifice - 1.0  # off the flank
    lengths = {name: diameter * size * length for name, length in FUNNEL.items()}
    return funnel_setup(SOIL | lengths | {"position": diameter * sites[inside]})
