"""V30, V32, V38: drag on falling grains, and the momentum that grains and air exchange.

V30. The step is a fifth to a ten-thousandth of the drag's response, and drag is taken implicitly: what is
left is rounding and the lag of the rate by one exchange.

V32. Grains of two sizes fly through sheared air, along and across it, each level with a velocity of its own,
through many layers each; some reach below the floor and above the lid. Floor and lid exert no stress, so the
momentum of air, grains and residual is that of the start. Its change is taken over all that was exchanged. In
single precision the drag on a grain is the change of its rounded velocity, so that the balance is as exact as
the sum over one interval.

V38. The same on a grid of stirred air that advects nothing, so that its momentum changes by grains and by
their share of the pressure alone,

    sum over exchanges of  rho eps V (u' - u)  + m v + residual + due = const  along x and y,

with u and u' before and after a step of the air, eps the void fraction that it found, V the volume of a cell,
`residual` the drag not yet applied to the grains, `due` the rest of the frozen pressure force. Along z, where
floor and lid take part, the impulse recorded by the air is compared with the drag on the grains. Over a
regular bed all columns are alike: the wind is that of a single column.
"""

from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from taichi_erosion.air.readback import face_velocities
from taichi_erosion.core.air_setup import AirModel, AirSide, InitialTurbulence, bed_faces
from taichi_erosion.core.setup import Coupling, Floats, Laws, Setup
from taichi_erosion.core.transfer import download_field
from taichi_erosion.simulation import Simulation, advance, air_profile, spin_up_wind
from taichi_erosion.verification import closed_forms
from taichi_erosion.verification.claims import Outcome, Precision, below
from taichi_erosion.verification.closed_forms import sphere_mass
from tests.verification import small_scenes as small
from tests.verification.reference.flow import Stream, terminal_velocity

DENSITY, VISCOSITY = 1.225, 1.789e-5  # kg m-3, Pa s
QUARTZ = 2650.0  # kg m-3
LIMIT: dict[Precision, float] = {"f64": 1e-12, "f32": 1e-6}
LAWS = Laws(drag="two_limits")


def terminal_velocities() -> Iterator[Outcome]:
    """V30: the published table, and the balance of weight, buoyancy and drag, solved in NumPy."""
    yield from closed_forms.settling_outcomes()
    air = Stream(0.0, 1.0, DENSITY, VISCOSITY)
    balance = [terminal_velocity(1e-6 * microns, QUARTZ, air) for microns in closed_forms.TERMINAL]
    error = closed_forms.simulated_settling_speeds() / balance - 1.0
    yield below("terminal velocities against the balance of forces: error", error, 1e-4, "f64")


SIDE, HEIGHT = 5e-3, 4e-3  # m
LAYERS = 37  # thinner than the grains, and no face where a grain begins
STEP, STEPS, INTERVAL = 2e-6, 2000, 7  # s, 1, steps from exchange to exchange


class GrainMomentum(NamedTuple):
    """Momentum of all grains of a simulation [3] in kg m s-1."""

    moving: Floats  # sum of m v
    residual: Floats  # taken from the air and not yet applied
    frozen_pressure: Floats  # per time, by the pressure force frozen between exchanges [N]
    size: float  # sum of |m v|


def grain_momentum(sim: Simulation, replica: int = 0) -> GrainMomentum:
    first = (2 * replica + int(sim.world.replicas.side[replica])) * sim.capacities.grains
    rows = slice(first, first + len(sim.setups[replica].grains.mass))
    mass = 1.0 / download_field(sim.world.grains.mass_inverse)[rows].astype(np.float64)[:, None]
    frozen = sim.world.frozen_drag
    fields = sim.world.grains.velocity, frozen.drag_kick, frozen.steady_acceleration
    momenta, applied, pressure = (mass * download_field(field)[rows] for field in fields)
    # drag applied since the last exchange is not yet subtracted from the residual
    kept = download_field(sim.coupling.exchange.residual_momentum)[replica].sum(axis=0) - applied.sum(axis=0)
    size = float(np.linalg.norm(momenta, axis=1).sum())
    return GrainMomentum(momenta.sum(axis=0), kept, pressure.sum(axis=0), size)


def crossing_grains() -> Setup:
    """Grains on levels of equal height, so that they stay in their layers, against a sheared wind."""
    rng = np.random.default_rng(3)
    levels = np.array([0.0, 0.61, 1.37, 2.3, 3.1, 4.0]) * 1e-3
    across = np.linspace(0.1, 0.9, 6)
    x, y = (grid.ravel() for grid in np.meshgrid(across, across, indexing="ij"))
    place = np.concatenate([np.column_stack([SIDE * x, SIDE * y, np.full(36, z)]) for z in levels])
    radius = np.where(np.arange(len(place)) % 72 < 36, 1.5e-4, 2.2e-4)
    velocity = np.repeat(np.column_stack([rng.normal(0.0, 1.0, (6, 2)), np.zeros(6)]), 36, axis=0)
    grains = small.spheres(place, velocity, 0.0, radius, sphere_mass(1.0, QUARTZ) * radius**3)
    faces = np.linspace(0.0, HEIGHT, LAYERS + 1)
    air = small.still_air(faces, (SIDE, SIDE), DENSITY, VISCOSITY)
    sheared = replace(air, start=3.0 * small.centres(faces) / HEIGHT)
    setup = small.sphere_setup(grains, small.Touch(1e7, 1e7, restitution=0.7), STEP)
    return small.in_air(setup, sheared, Coupling(look_steps=INTERVAL), HEIGHT)


def column_momentum() -> Iterator[Outcome]:
    """V32."""
    setup = crossing_grains()
    solid = float((4.0 / 3.0 * np.pi * setup.grains.radius**3).sum())
    for precision, limit in LIMIT.items():
        sim = small.simulation_of([setup], precision, LAWS)
        grains, together = [], []  # horizontal momenta of grains, and of air, grains and residual [kg m s-1]
        # the first exchange counts the grains; air that they displace before it has no momentum
        for steps in (1, STEPS):
            advance(sim, [STEP * steps])
            profile, now = air_profile(sim, 0), grain_momentum(sim)
            layers = np.diff(profile.face) * SIDE * SIDE
            air = DENSITY * ((profile.void_fraction * layers)[:, None] * profile.velocity).sum(axis=0)
            grains.append(now.moving[:2])
            together.append(air + now.moving[:2] + now.residual[:2])
        change = (together[1] - together[0]) / np.abs(grains[1] - grains[0]).max()
        yield below("momentum of air and grains: change over what was exchanged", change, limit, precision)
        share = ((1.0 - profile.void_fraction) * layers).sum() / solid - 1.0
        yield below("volume of grains found in the layers: error", share, limit, precision)


PATCH_SIDE, PATCH_HEIGHT, CELLS = 4e-3, 3e-3, (6, 4, 16)  # m, m, 1
CELL = PATCH_SIDE * PATCH_SIDE * PATCH_HEIGHT / (CELLS[0] * CELLS[1] * CELLS[2])  # m3
GRAINS, RADIUS = 60, 1.2e-4  # 1, m
PATCH_INTERVAL, EXCHANGES = 5, 60  # steps from exchange to exchange, 1
HEAVY = 1e9  # kg m-3: grains that no wind moves
DIAMETER, OPEN, BED_CELLS = 2.5e-4, 0.5, (8, 8, 2)  # m, void fraction of the bed, lattice cells
BED_COLUMNS = (4, 4)  # two lattice cells wide: all alike
LID, FRICTION, TURNOVERS = 5e-3, 0.3, 30.0  # m, m s-1, 1
WIND_STEP = 1e-4  # s, of grains and air: Courant number 0.7 at the lid
SOFT = small.Touch(1e3, 1e3)


class PatchMomentum(NamedTuple):
    """Momentum of the grains of a patch one step after an exchange, and the last step of its air."""

    grains: Floats  # with residual and the rest of the frozen pressure force [3], kg m s-1
    drag: Floats  # of the grains by drag alone, with the residual; up to a constant [3], kg m s-1
    air: Floats  # velocities of the air, [3, nx, ny, nz] m s-1
    recorded: Floats  # impulse of drag on the air in its last step, as the air has recorded it [3], kg m s-1
    size: float  # kg m s-1, sum of the sizes of the grains' momenta


def stirred_setup() -> Setup:
    """Grains at random places and velocities, some of them beside floor and lid, in air stirred at random."""
    rng = np.random.default_rng(5)
    place = rng.uniform(0.0, 1.0, (GRAINS, 3)) * [PATCH_SIDE, PATCH_SIDE, PATCH_HEIGHT]
    grains = small.spheres(place, rng.normal(0.0, 1.0, (GRAINS, 3)), 0.0, RADIUS, sphere_mass(RADIUS, QUARTZ))
    setup = replace(small.sphere_setup(grains, SOFT, STEP), overlap_limit=2.0)
    faces = np.linspace(0.0, PATCH_HEIGHT, CELLS[2] + 1)
    still = small.still_air(faces, (PATCH_SIDE, PATCH_SIDE), DENSITY, VISCOSITY)
    stirred = replace(still, model=AirModel(advection="none", exchange=True), time_step=STEP * PATCH_INTERVAL)
    turbulence, start = InitialTurbulence(0.0, 0.0, DIAMETER / 30.0, 1), rng.normal(0.0, 2.0, (3, *CELLS))
    stirred = replace(stirred, cells=CELLS, initial_turbulence=turbulence, start=start)
    return small.in_air(setup, stirred, Coupling(look_steps=PATCH_INTERVAL), PATCH_HEIGHT)


def patch_momentum(sim: Simulation) -> PatchMomentum:
    """Momenta one step of the grains after an exchange."""
    grains, air = grain_momentum(sim), sim.coupling.air
    assert air is not None
    recorded = CELL * download_field(air.impulse)[0, 1:-1, 1:-1, 1:-1].sum(axis=(0, 1, 2))
    u, v, w = face_velocities(air, 0)
    wind = np.stack([u[:-1], v[:, :-1], w[:, :, :-1]])
    drag = grains.moving + grains.residual
    due = (PATCH_INTERVAL - 1) * STEP * grains.frozen_pressure
    return PatchMomentum(drag + due, drag, wind, recorded, grains.size)


def patch_balance(precision: Precision) -> Iterator[Outcome]:
    """Momentum of air and grains, along all axes."""
    sim = small.simulation_of([stirred_setup()], precision, LAWS)
    advance(sim, [STEP])
    first, air = patch_momentum(sim), sim.coupling.air
    assert air is not None
    last = first
    gained, recorded, pressed = np.zeros(2), np.zeros(3), np.zeros(3)
    for exchange in range(1, EXCHANGES + 1):
        pressed += last.grains - last.drag  # the rest of the frozen pressure force
        advance(sim, [STEP * (PATCH_INTERVAL * exchange + 1)])
        now = patch_momentum(sim)
        void = download_field(air.void_fraction)[0, 1:-1, 1:-1, 1:-1]
        on_faces = np.stack([0.5 * (void + np.roll(void, 1, axis)) for axis in range(2)])
        gained += DENSITY * CELL * (on_faces * (now.air - last.air)[:2]).sum(axis=(1, 2, 3))
        recorded += now.recorded
        pressed += (now.grains - now.drag) / (PATCH_INTERVAL - 1)  # one step of the force that is frozen now
        last = now
    scale, over = np.abs(gained).max(), "what was exchanged"
    if precision == "f32":  # the pressure force takes part in the rounding of these
        scale, over = first.size, "the grains' momenta"
    level = ((last.grains - first.grains)[:2] + gained) / scale
    name = f"grid: momentum of air and grains along x and y, over {over}"
    yield below(name, level, LIMIT[precision], precision)
    difference = (last.drag - first.drag - pressed + recorded) / scale
    name = f"grid: drag on grains less what the air booked, over {over}"
    yield below(name, difference, LIMIT[precision], precision)


def bed_setup(columns: tuple[int, int]) -> Setup:
    """A regular bed of grains that no wind moves, under one column or a grid that carries momentum along."""
    edge = small.lattice_edge(DIAMETER, OPEN)
    surface, patch = BED_CELLS[2] * edge, (BED_CELLS[0] * edge, BED_CELLS[1] * edge)
    setup = small.sphere_setup(small.regular_bed(DIAMETER, HEAVY, OPEN, BED_CELLS), SOFT, WIND_STEP)
    faces = bed_faces(0.0, surface + DIAMETER, LID, 0.25 * DIAMETER, 1.2)
    still = small.still_air(faces, patch, DENSITY, VISCOSITY)
    model = AirModel("mixing_length", "none", "euler", exchange=True)
    ends = still.sides | {"z_low": AirSide("wall")}
    air = replace(still, model=model, time_step=WIND_STEP, ground=surface, sides=ends)
    if columns != (1, 1):
        counts, start = (*columns, air.cells[2]), InitialTurbulence(0.0, TURNOVERS, DIAMETER / 30.0, 1)
        model = AirModel("mixing_length", exchange=True)
        air = replace(air, cells=counts, model=model, initial_turbulence=start)
    return small.in_air(replace(setup, overlap_limit=2.0), air, Coupling(look_steps=1, surface=surface), LID)


def grid_momentum() -> Iterator[Outcome]:
    """V38: momentum, and the wind over a regular bed on one column and on a grid."""
    for precision in LIMIT:
        yield from patch_balance(precision)
    winds = []
    for columns in ((1, 1), BED_COLUMNS):
        sim = small.simulation_of([bed_setup(columns)], "f64", LAWS)
        spin_up_wind(sim, 0, FRICTION)
        winds.append(air_profile(sim, 0).velocity[:, 0])
    off = (winds[1] - winds[0]) / winds[0].max()
    yield below("grid over a regular bed: wind off that of one column, over the fastest", off, 1e-4, "f64")
