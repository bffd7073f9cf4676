"""V38: what a grid of air over a patch gives to grains it loses, and its wind is that of one column.

Grains without weight fly through stirred air between a floor and a lid without stress. Nothing is carried by
the air itself, so that its momentum changes by grains and by their share of the pressure alone,

    sum over looks of  rho eps V (u' - u)  + m v + owed + due = const  along x and y,

with u and u' before and after a step of the air, eps the void fraction that it found, V the volume of a cell,
`owed` what drag has not yet given to the grains, `due` what the held pull of the pressure still will. Along z
floor and lid take part; there what the air has booked is compared with what drag gave to the grains.

Over a regular bed whose grains hardly move, all columns are alike: the wind is that of a single column.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from taichi_erosion.air.readback import face_velocities
from taichi_erosion.core.air_setup import AirModel, AirSetup, AirSide, Stir, bed_faces
from taichi_erosion.core.setup import Coupling, Floats, Laws, Setup
from taichi_erosion.core.transfer import read
from taichi_erosion.simulation import Simulation, advance, air_profile, spin_up_wind
from taichi_erosion.verification.claim import Outcome, Precision, below
from taichi_erosion.verification.small_scenes import Touch, bench, contact_table, sphere_setup, spheres
from taichi_erosion.verification.wind.exchange import in_air, lattice_edge, regular_bed, still_air

SIDE, HEIGHT, LAYERS = 4e-3, 3e-3, 16  # m, m, 1
COLUMNS = (6, 4)
DENSITY, VISCOSITY = 1.225, 1.789e-5  # kg m-3, Pa s
SOLID = 2650.0  # kg m-3
GRAINS, RADIUS = 60, 1.2e-4  # 1, m
STEP, LOOK, LOOKS = 2e-6, 5, 60  # s, 1, 1
LIMIT: dict[Precision, float] = {"f64": 1e-12, "f32": 1e-6}
HEAVY = 1e9  # kg m-3: grains that no wind moves
DIAMETER, OPEN, BED_CELLS = 2.5e-4, 0.5, (8, 8, 2)  # m, void fraction of the bed, lattice cells
BED_COLUMNS = (4, 4)  # two lattice cells wide: all alike
LID, FRICTION, TURNOVERS = 5e-3, 0.3, 30.0  # m, m s-1, 1
WIND_STEP = 1e-4  # s, of grains and air: Courant number 0.7 at the lid


@dataclass(frozen=True)
class Books:
    """Momentum of grains and what is on the way to them [kg m s-1], and what the last step of the air did."""

    grains: Floats  # with what drag owes and what the pressure is due to give
    drag: Floats  # of the grains by drag alone, with what it owes; up to a constant
    air: Floats  # velocities of the air, [3, nx, ny, nz] m s-1
    felt: Floats  # [3] kg m s-1, by the air of drag in its last step, as it has booked
    size: float  # kg m s-1, sum of the sizes of the grains' momenta


def stirred_setup() -> Setup:
    """Grains at random places and velocities, some of them beside floor and lid, in air stirred at random."""
    rng = np.random.default_rng(5)
    place = rng.uniform(0.0, 1.0, (GRAINS, 3)) * [SIDE, SIDE, HEIGHT]
    mass = SOLID * 4.0 / 3.0 * np.pi * RADIUS**3
    grains = spheres(place, rng.normal(0.0, 1.0, (GRAINS, 3)), 0.0, RADIUS, mass)
    setup = sphere_setup(grains, contact_table(Touch(1e3, 1e3), Touch(1e3, 1e3)), STEP)
    setup = replace(setup, overlap_limit=2.0)
    air = still_air(np.linspace(0.0, HEIGHT, LAYERS + 1), (SIDE, SIDE), DENSITY, VISCOSITY)
    stirred = replace(
        air,
        cells=(*COLUMNS, LAYERS),
        time_step=STEP * LOOK,
        model=AirModel(advection="none", exchange=True),
        stir=Stir(0.0, 0.0, DIAMETER / 30.0, 1),
        start=rng.normal(0.0, 2.0, (3, *COLUMNS, LAYERS)),
    )
    return in_air(setup, stirred, Coupling(look_steps=LOOK), HEIGHT)


def books(sim: Simulation) -> Books:
    """What the momenta are one step of the grains after a look."""
    side, count = int(sim.world.replicas.side[0]), len(sim.setups[0].grains.mass)
    rows = slice(side * sim.capacities.grains, side * sim.capacities.grains + count)
    mass = 1.0 / read(sim.world.grains.mass_inverse)[rows].astype(np.float64)[:, None]

    def held(name: str) -> Floats:
        return (mass * read(getattr(sim.world.frozen_drag, name))[rows]).sum(axis=0)

    moving = (mass * read(sim.world.grains.velocity)[rows]).sum(axis=0)
    residual_momentum = read(sim.coupling.exchange.residual_momentum)[0].sum(axis=0) - held("drag_kick")
    air = sim.coupling.air
    assert air is not None
    width = (SIDE / COLUMNS[0]) * (SIDE / COLUMNS[1]) * HEIGHT / LAYERS
    felt = width * read(air.impulse)[0, 1:-1, 1:-1, 1:-1].sum(axis=(0, 1, 2))
    u, v, w = face_velocities(air, 0)
    wind = np.stack([u[:-1], v[:, :-1], w[:, :, :-1]])
    size = float(np.linalg.norm(mass * read(sim.world.grains.velocity)[rows], axis=1).sum())
    return Books(
        moving + residual_momentum + (LOOK - 1) * STEP * held("steady_acceleration"),
        moving + residual_momentum,
        wind,
        felt,
        size,
    )


def face_shares(sim: Simulation) -> Floats:
    """Void fraction on the faces that velocities along x and y live on [2, nx, ny, nz]."""
    assert sim.coupling.air is not None
    void = read(sim.coupling.air.void_fraction)[0, 1:-1, 1:-1, 1:-1]
    return np.stack([0.5 * (void + np.roll(void, 1, axis)) for axis in range(2)])


def action_and_reaction(precision: Precision) -> Iterator[Outcome]:
    """Momentum of air and grains, along all axes."""
    sim = bench([stirred_setup()], precision, Laws(drag="two_limits"))
    advance(sim, [STEP])
    first = last = books(sim)
    gained, felt, pulled = np.zeros(2), np.zeros(3), np.zeros(3)
    volume = DENSITY * SIDE * SIDE * HEIGHT / (COLUMNS[0] * COLUMNS[1] * LAYERS)
    for look in range(1, LOOKS + 1):
        pulled += last.grains - last.drag  # the rest of the pull that was held
        advance(sim, [STEP * (LOOK * look + 1)])
        now = books(sim)
        gained += volume * (face_shares(sim) * (now.air - last.air)[:2]).sum(axis=(1, 2, 3))
        felt += now.felt
        pulled += (now.grains - now.drag) / (LOOK - 1)  # one step of the pull that is held now
        last = now
    scale, over = np.abs(gained).max(), "what was exchanged"
    if precision == "f32":  # the pull of the pressure takes part in the rounding of these
        scale, over = first.size, "the grains' momenta"
    limit, level = LIMIT[precision], (last.grains - first.grains)[:2] + gained
    yield below(
        f"grid: momentum of air and grains along x and y, over {over}", level / scale, limit, precision
    )
    got = last.drag - first.drag - pulled + felt
    yield below(f"grid: drag on grains less what the air booked, over {over}", got / scale, limit, precision)


def bed_setup(columns: tuple[int, int]) -> Setup:
    """A regular bed of grains that no wind moves, under one column or a grid."""
    grains = regular_bed(DIAMETER, HEAVY, OPEN, BED_CELLS)
    edge = lattice_edge(DIAMETER, OPEN)
    surface, patch = BED_CELLS[2] * edge, (BED_CELLS[0] * edge, BED_CELLS[1] * edge)
    setup = sphere_setup(grains, contact_table(Touch(1e3, 1e3), Touch(1e3, 1e3)), WIND_STEP)
    setup = replace(setup, overlap_limit=2.0)
    faces = bed_faces(0.0, surface + DIAMETER, LID, 0.25 * DIAMETER, 1.2)
    single = replace(
        still_air(faces, patch, DENSITY, VISCOSITY),
        model=AirModel("mixing_length", "none", "euler", exchange=True),
        time_step=WIND_STEP,
        ground=surface,
    )
    single = replace(single, sides=single.sides | {"z_low": AirSide("wall")})
    air = single if columns == (1, 1) else on_columns(single, columns)
    return in_air(setup, air, Coupling(look_steps=1, surface=surface), LID)


def on_columns(single: AirSetup, columns: tuple[int, int]) -> AirSetup:
    """The same air on a grid that carries momentum along."""
    return replace(
        single,
        cells=(*columns, single.cells[2]),
        model=AirModel("mixing_length", exchange=True),
        stir=Stir(0.0, TURNOVERS, DIAMETER / 30.0, 1),
    )


def same_wind() -> Iterator[Outcome]:
    """The wind over a regular bed, on one column and on a grid."""
    winds = []
    for columns in ((1, 1), BED_COLUMNS):
        sim = bench([bed_setup(columns)], "f64", Laws(drag="two_limits"))
        spin_up_wind(sim, 0, FRICTION)
        winds.append(air_profile(sim, 0).velocity[:, 0])
    off = (winds[1] - winds[0]) / winds[0].max()
    yield below("grid over a regular bed: wind off that of one column, over the fastest", off, 1e-4, "f64")


def grid_patch() -> Iterator[Outcome]:
    """V38."""
    for precision in LIMIT:
        yield from action_and_reaction(precision)
    yield from same_wind()
