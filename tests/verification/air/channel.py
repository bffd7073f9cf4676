"""V27-V29: flow between plates, wind over a fetch and in a channel, and the mass balance of a gusty box.

V27. Flow between plates, driven by a pressure gradient (Poiseuille) or by the upper plate (Couette).

    Poiseuille:  u = G z (H - z) / (2 nu),      Couette:  u = U z / H

The grid holds linear flow exactly. With half a cell to the wall the discrete parabola lies above Poiseuille's
by G dz^2 / (8 nu) everywhere. Plates normal to y work through ghosts and explicit diffusion, plates normal to
z through the implicit scheme.

V28. A logarithmic wind u = (u*/kappa) ln((z + z0) / z0) over a rough floor, under a lid with the stress
rho u*^2, survives an empty tunnel: nothing may change over the fetch.

V29. Air is neither made nor lost: what remains of div u in a cell is the tolerance of the solve. Iterations
are counted for a random flow on grids from 8 x 8 to 64 x 64 columns, with cells stretched by 100.

Reference: Richards & Hoxey (1993), J. Wind Eng. Ind. Aerodyn. 46-47, 145-153.
"""

from collections.abc import Iterator

import numpy as np

from taichi_erosion.air.readback import air_snapshot, face_velocities
from taichi_erosion.air.single_column import advance_columns
from taichi_erosion.air.step import advance_air
from taichi_erosion.core import air_setup
from taichi_erosion.core.air_setup import AirModel, AirSetup, AirSide, InletTurbulence
from taichi_erosion.verification import closed_forms
from taichi_erosion.verification.claims import Outcome, below, holds
from tests.verification.small_scenes import LINEAR, air_of, box, centres, order, sides

WALL, LID = AirSide("wall"), AirSide("wall", (1.0, 0.0, 0.0))
PLATE_LAYERS, PLATE_GRIDS = 32, (16, 32)
LONG = 1e6  # s: a step so long that one gives the steady state
STEADY_STEPS = 3
ACROSS_CELLS, ACROSS_STEP, ACROSS_STEPS = 16, 0.4, 1000  # 1, dy^2 / nu, 1: 1.6 H^2 / nu, 16 decay times


def plates(layers: int, lid: AirSide, gradient: float, stretched: bool) -> AirSetup:
    """A column of air between plates one metre apart."""
    return box(
        (1, 1, layers),
        (1.0, 1.0, 1.0),
        faces_z=air_setup.faces_fine_at_both_ends(0.0, 1.0, layers, 0.3 / layers)
        if stretched
        else air_setup.equal_cell_faces(0.0, 1.0, layers),
        sides=sides(z_low=WALL, z_high=lid),
        driving_gradient=(gradient, 0.0, 0.0),
        implicitness=1.0,
        time_step=LONG,
        model=LINEAR,
    )


def steady_errors(layers: int, whole_grid: bool) -> list[float]:
    """Largest error of the steady u(z) [m s-1]: Couette on equal and stretched cells, Poiseuille likewise."""
    flows = ((LID, 0.0), (WALL, -8.0))
    setups = [plates(layers, *flow, stretched) for flow in flows for stretched in (False, True)]
    air = air_of(setups)
    if whole_grid:
        advance_air(air, STEADY_STEPS)
    else:
        advance_columns(STEADY_STEPS, air)
    z = [centres(setup.faces_z) for setup in setups]
    exact = [z[0], z[1], 4.0 * z[2] * (1.0 - z[2]), 4.0 * z[3] * (1.0 - z[3])]
    found = [face_velocities(air, replica)[0][0, 0, :] for replica in range(len(setups))]
    return [float(np.abs(u - want).max()) for u, want in zip(found, exact, strict=True)]


def between_side_walls() -> float:
    """Largest error of Poiseuille flow between walls normal to y, over its maximum."""
    n = ACROSS_CELLS
    walls, step = sides(y_low=WALL, y_high=WALL), ACROSS_STEP / n**2
    forced = {"driving_gradient": (-8.0, 0.0, 0.0), "time_step": step}
    setup = box((2, n, 2), (1.0, 1.0, 1.0), sides=walls, **forced)
    air = air_of([setup])
    advance_air(air, ACROSS_STEPS)
    y = centres(air_setup.equal_cell_faces(0.0, 1.0, n))
    return float(np.abs(face_velocities(air, 0)[0][0, :, 0] - (4.0 * y * (1.0 - y) + 1.0 / n**2)).max())


def plane_flows() -> Iterator[Outcome]:
    """V27."""
    for words, whole_grid in (("grid", True), ("column", False)):
        *couette, parabola, _ = steady_errors(PLATE_LAYERS, whole_grid)
        for kind, error in zip(("equal", "stretched"), couette, strict=True):
            yield below(f"Couette, {words}, {kind} cells: error over the lid's speed", error, 1e-9, "f64")
        name = f"Poiseuille, {words}, {PLATE_LAYERS} cells: error over the largest speed"
        yield below(name, parabola, 1.0 / PLATE_LAYERS**2 * (1.0 + 1e-6), "f64")
    found = order([steady_errors(layers, False)[3] for layers in PLATE_GRIDS])
    yield Outcome("Poiseuille, stretched cells: order in space", found, 2.0, 0.15, "f64")
    name = "Poiseuille between side walls: off the discrete parabola, over the largest speed"
    yield below(name, between_side_walls(), 1e-5, "f64")


KARMAN, DENSITY, VISCOSITY = 0.40, 1.2, 1.5e-5  # 1, kg m-3, m2 s-1
FRICTION, ROUGHNESS = 0.3, 1e-4  # m s-1, m
FETCH, FETCH_HEIGHT = 5.0, 0.5  # m
FETCH_CELLS, FETCH_LAYERS, FETCH_LOWEST = 64, 32, 5e-3  # 1, 1, m
FETCH_STEP, FETCH_STEPS = 5e-3, 200  # s, 1: Courant number 0.5 at the lid, one passage of the slowest cell
INFLOW = {"x_low": AirSide("inlet", (1.0, 0.0, 0.0)), "x_high": AirSide("outlet")}


def fetch() -> AirSetup:
    faces = air_setup.stretched_faces(0.0, FETCH_HEIGHT, FETCH_LAYERS, FETCH_LOWEST)
    profile = air_setup.log_profile(centres(faces), FRICTION, ROUGHNESS, KARMAN)
    slip = dict.fromkeys(("y_low", "y_high"), AirSide("symmetry"))
    ends = {"z_low": AirSide("rough", roughness=ROUGHNESS), "z_high": AirSide("stress")}
    return box(
        (FETCH_CELLS, 1, FETCH_LAYERS),
        (FETCH, 0.1, FETCH_HEIGHT),
        faces_z=faces,
        sides=sides(**INFLOW, **slip, **ends),
        density=DENSITY,
        viscosity=VISCOSITY,
        time_step=FETCH_STEP,
        model=AirModel(closure="mixing_length"),
        implicitness=1.0,
        friction_velocity=FRICTION,
        inlet_shape=profile,
        start=profile,
    )


def wind_profile() -> Iterator[Outcome]:
    """V28: the wind at the end of the fetch is that at its beginning; the channel of the short list."""
    setup = fetch()
    air = air_of([setup])
    advance_air(air, FETCH_STEPS)
    state = air_snapshot(air, 0)
    assert setup.inlet_shape is not None
    off = state.velocity[:, 0, :, 0] / setup.inlet_shape - 1.0
    yield below("log wind over the fetch: change of the speed, relative", off, 0.02, "f64")
    friction = state.friction_velocity[:, 0] / FRICTION - 1.0
    yield below("log wind over the fetch: change of u* at the floor, relative", friction, 0.02, "f64")
    yield from closed_forms.channel_outcomes()


SPEED = 5.0  # m s-1
CELLS, SIZE, LOWEST = (24, 8, 16), (1.2, 0.4, 0.4), 4e-3  # 1, m, m
STEPS, STEP = 20, 5e-3  # 1, s
TIGHT = 1e-13  # of a cell in a step: tolerance for the balance of the whole box [1]
PRESSURE_GRIDS, PRESSURE_LAYERS = (8, 16, 32, 64), 16  # columns along x and along y, layers
MORE = 2  # iterations that the finest grid may take more than the coarsest


def gusty_box() -> AirSetup:
    walls = {"y_low": WALL, "y_high": WALL, "z_low": AirSide("rough", roughness=1e-4)}
    ends = {"x_low": AirSide("inlet", (SPEED, 0.0, 0.0)), "x_high": AirSide("outlet")}
    return box(
        CELLS,
        SIZE,
        faces_z=air_setup.stretched_faces(0.0, SIZE[2], CELLS[2], LOWEST),
        sides=sides(**walls, **ends),
        density=1.2,
        viscosity=1.5e-5,
        time_step=STEP,
        model=AirModel(closure="smagorinsky"),
        turbulence=InletTurbulence((0.5, 0.3, 0.3), 0.1, seed=1),
        start=np.full(CELLS[2], SPEED),
    )


def random_flow(columns: int) -> AirSetup:
    """A periodic box whose first flow does not conserve air at all."""
    return box(
        (columns, columns, PRESSURE_LAYERS),
        (1.0, 1.0, 1.0),
        faces_z=air_setup.stretched_faces(0.0, 1.0, PRESSURE_LAYERS, 2e-3),
        time_step=0.1 / columns,
        viscosity=1e-3,
        model=LINEAR,
        start=np.random.default_rng(columns).normal(size=(3, columns, columns, PRESSURE_LAYERS)),
    )


def mass_balance() -> Iterator[Outcome]:
    """V29."""
    setup = gusty_box()
    air = air_of([setup])
    advance_air(air, STEPS)
    u, v, w = face_velocities(air, 0)
    dx, dy = setup.high[0] / setup.cells[0], setup.high[1] / setup.cells[1]
    level = np.diff(u, axis=0) / dx + np.diff(v, axis=1) / dy
    divergence = level + np.diff(w, axis=2) / np.diff(setup.faces_z)
    yield below("gusty box: |div u| dx / U", divergence * dx / SPEED, 1e-6, "f64")
    advance_air(air, 1, tolerance=TIGHT)
    through = (face_velocities(air, 0)[0] * np.diff(setup.faces_z)).sum(axis=(1, 2))
    lost = (through[0] - through[-1]) / through[0]
    yield below("gusty box, tight solve: air in less air out, relative", lost, 1e-10, "f64")
    again = []
    for threads in (1, 0):
        air = air_of([setup], threads)
        advance_air(air, STEPS)
        again.append(face_velocities(air, 0)[0])
    yield holds("gusty box: one thread and all give the same bits", np.array_equal(*again), "f64")
    counts = [advance_air(air_of([random_flow(columns)]), 1) for columns in PRESSURE_GRIDS]
    words = ", ".join(f"{count} on {n} x {n}" for count, n in zip(counts, PRESSURE_GRIDS, strict=True))
    more = float(max(counts[-1] - counts[0], 0))
    yield Outcome(f"pressure solve ({words}): iterations more on the finest grid", more, 0.0, MORE, "f64")
