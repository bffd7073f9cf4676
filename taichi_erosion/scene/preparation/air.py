"""Air of one replica: over a periodic patch of grains, or in a box of air alone."""

from dataclasses import replace
from math import ceil, pi

import numpy as np

from taichi_erosion.core import air_setup
from taichi_erosion.core.air_setup import AirModel, AirSetup, AirSide
from taichi_erosion.core.setup import Coupling, Floats
from taichi_erosion.scene.preparation.limits import time_step
from taichi_erosion.scene.preparation.sizes import nominal_diameter, scene_mean_cubed_diameter
from taichi_erosion.scene.schema import air as schema
from taichi_erosion.scene.schema.scene import Scene
from taichi_erosion.scene.schema.wind import Wind

SOLID_SHARE = 0.6  # of a settled bed [1]
CELL_SHARE = 0.25  # finest layer of air over the nominal diameter [1]
ABOVE_BED = 2.0  # diameters above the bed up to which layers stay fine [1]
CENTRED = 0.5  # implicitness that is of second order: eddies are followed in time [1]
GRAIN_ROUGHNESS = 1.0 / 30.0  # roughness length of a bed at rest over its diameter (Nikuradse) [1]
HEADROOM = 10.0  # heights of the patch that grains may fly before they count as lost [1]
DIFFUSION = 0.5  # explicit diffusion along x and y: largest step over width^2 / nu in all directions [1]
TURBULENT = 30.0  # largest speed of a driven turbulent flow over its friction velocity [1]
GUST = 3.0  # standard deviations that a gust may exceed the mean wind by [1]
COLUMN_SHARE = 1e-3  # time step of air that nothing limits over the run [1]


def bed_surface_height(scene: Scene, wind: Wind) -> float:
    """Height of the undisturbed bed of a patch [m]."""
    if wind.surface is not None:
        return wind.surface
    volume = scene.grains.count * pi / 6.0 * scene_mean_cubed_diameter(scene)
    return volume / (SOLID_SHARE * wind.length * wind.width)


def air_over_patch(scene: Scene, wind: Wind, time_step: float, seed: int) -> AirSetup:
    """Air over a periodic patch of grains: one column of cells, or a grid."""
    diameter = nominal_diameter(scene.grains)
    fine_until = min(bed_surface_height(scene, wind) + ABOVE_BED * diameter, 0.5 * wind.height)
    faces = air_setup.bed_faces(0.0, fine_until, wind.height, wind.cell or CELL_SHARE * diameter, wind.growth)
    ends = {"z_low": AirSide("wall"), "z_high": AirSide("stress" if wind.drive == "lid" else "symmetry")}
    column = AirSetup(
        cells=(*wind.columns, len(faces) - 1),
        low=(0.0, 0.0, 0.0),
        high=(wind.length, wind.width, wind.height),
        faces_z=faces,
        sides={name: ends.get(name, AirSide("periodic")) for name in air_setup.SIDES},
        density=wind.density,
        viscosity=wind.viscosity,
        time_step=time_step * wind.look_steps,
        model=AirModel(closure=wind.closure, advection="none", scheme="euler", exchange=True),
        friction_velocity=wind.partition * wind.friction_velocity,
        ground=bed_surface_height(scene, wind),
    )
    return column if wind.columns == (1, 1) else air_on_several_columns(column, wind, diameter, seed)


def air_on_several_columns(column: AirSetup, wind: Wind, diameter: float, seed: int) -> AirSetup:
    """The same air on several columns: with advection, and random fluctuations when the wind sets in."""
    eddies = wind.closure != "mixing_length"
    grid = replace(
        column,
        model=AirModel(closure=wind.closure, exchange=True),
        implicitness=CENTRED if eddies else column.implicitness,
        driving_gradient=(air_setup.stress_gradient(column, column.friction_velocity), 0.0, 0.0),
        initial_turbulence=air_setup.InitialTurbulence(
            wind.stir if eddies else 0.0, wind.turnovers, GRAIN_ROUGHNESS * diameter, seed
        ),
    )
    blows = grid.friction_velocity > 0.0
    return replace(grid, start=air_setup.initial_wind(grid, grid.friction_velocity)) if blows else grid


def coupling_of_patch(scene: Scene, wind: Wind, seed: int) -> Coupling:
    """Intervals and constants of the exchange between grains and air."""
    interval = wind.look_steps * time_step(scene)
    return Coupling(
        look_steps=wind.look_steps,
        surface=bed_surface_height(scene, wind),
        through_flow=wind.through_flow,
        rising=any(stage.through_flow is not None for stage in scene.stages),
        seed=seed % 2**31,
        partition=wind.partition,
        # at rest, the first included, that last no less than the stated time
        sleep_exchanges=1 + ceil(wind.sleep_after / interval) if wind.sleep_after else 0,
        sleep_share=wind.sleep_share,
    )


def cell_face_heights(air: schema.AirBox) -> Floats:
    """Faces of the cells of a box along z [m]."""
    high, count = air.extents[2], air.cells[2]
    if air.lowest is None:
        return air_setup.equal_cell_faces(0.0, high, count)
    faces = air_setup.faces_fine_at_both_ends if air.both_ends else air_setup.stretched_faces
    return faces(0.0, high, count, air.lowest)


def inlet_wind(profile: schema.Profile, height: Floats, karman: float) -> Floats:
    """Wind at the inlet at some heights [m s-1]."""
    if isinstance(profile, schema.UniformProfile):
        return np.full(len(height), profile.speed)
    if isinstance(profile, schema.LogProfile):
        return air_setup.log_profile(height, profile.friction_velocity, profile.roughness_length, karman)
    return np.interp(height, profile.heights, profile.speeds)


def inlet_profile(air: schema.AirBox) -> Floats | None:
    """Wind at the inlet over 1 m s-1 by layer, None where none is stated."""
    height = cell_face_heights(air)
    return None if air.inlet is None else inlet_wind(air.inlet, 0.5 * (height[1:] + height[:-1]), air.karman)


def upper_bound_of_air_speed(air: schema.AirBox) -> float:
    """Speed that no air is expected to exceed by much [m s-1]."""
    shape, moving = inlet_profile(air), max(max(map(abs, side.velocity)) for side in air.sides.values())
    gust = GUST * max(air.turbulence.deviation) if air.turbulence else 0.0
    blowing = 0.0 if shape is None else float(shape.max())
    # a pressure gradient drives a laminar flow, or one of 30 u* with a closure
    gradient, height = max(map(abs, air.driving_gradient)), air.extents[2]
    laminar = gradient * height**2 / (8.0 * air.density * air.viscosity)
    turbulent = TURBULENT * max((gradient * height / air.density) ** 0.5, air.friction_velocity)
    driven = laminar if air.closure == "none" else min(laminar, turbulent) if gradient else turbulent
    return max(blowing + gust, moving, driven)


def stable_step(scene: schema.AirScene) -> float:
    """Longest stable time step [s]."""
    return min(air_time_step_limits(scene.air, schema.COURANT_MOST))


def air_time_step_limits(air: schema.AirBox, courant: float) -> tuple[float, float]:
    """Time steps [s] that advection and explicit diffusion allow; one cell along an axis allows any."""
    widths = [size / n for size, n in zip(air.extents[:2], air.cells[:2], strict=True) if n > 1]
    speed = upper_bound_of_air_speed(air)
    advective = courant * min(widths) / speed if widths and speed and air.advection != "none" else np.inf
    diffusive = DIFFUSION / (air.viscosity * sum(2.0 / w**2 for w in widths)) if widths else np.inf
    return advective, diffusive


def run_time_step(scene: schema.AirScene) -> float:
    """Time step of a run [s]; what nothing limits takes COLUMN_SHARE of the run."""
    if scene.run.time_step is not None:
        return scene.run.time_step
    limit = min(air_time_step_limits(scene.air, scene.run.courant))
    return float(limit) if np.isfinite(limit) else COLUMN_SHARE * scene.run.duration


def build_air(scene: schema.AirScene, seed: int) -> AirSetup:
    """Air of one replica of a scene of air alone."""
    air, shape = scene.air, inlet_profile(scene.air)
    sides = {name: AirSide(s.kind, s.velocity, s.roughness_length) for name, s in air.sides.items()}
    if sides["x_low"].kind == "inlet":  # wind along x comes as a profile of 1 m/s times `inlet_profile`
        sides["x_low"] = replace(sides["x_low"], velocity=(1.0, 0.0, 0.0))
    model = AirModel(air.closure, air.advection)
    if air.cells[:2] == (1, 1) and air.closure != "smagorinsky":
        # a column has no advection, so that one implicit stage does
        model = AirModel(air.closure, advection="none", scheme="euler")
    return AirSetup(
        cells=air.cells,
        low=(0.0, 0.0, 0.0),
        high=air.extents,
        faces_z=cell_face_heights(air),
        sides={name: sides[name] for name in air_setup.SIDES},
        density=air.density,
        viscosity=air.viscosity,
        time_step=run_time_step(scene),
        model=model,
        constants=air_setup.ClosureConstants(
            karman=air.karman, smagorinsky=air.smagorinsky, length_share=air.length_share
        ),
        friction_velocity=air.friction_velocity,
        driving_gradient=air.driving_gradient,
        implicitness=air.implicitness,
        inlet_shape=shape,
        turbulence=air.turbulence
        and air_setup.InletTurbulence(
            air.turbulence.deviation, air.turbulence.integral_length, seed, air.turbulence.waves
        ),
        start=shape if shape is not None else initial_wind_guess(air),
    )


def initial_wind_guess(air: schema.AirBox) -> Floats | None:
    """Initial wind of a driven flow with a closure [m s-1]; from rest it would take long to develop."""
    if air.closure == "none":
        return None
    gradient = max(-air.driving_gradient[0], 0.0) * air.extents[2] / air.density
    friction = max(gradient**0.5, air.friction_velocity)
    height = cell_face_heights(air)
    smooth = 0.11 * air.viscosity / max(friction, 1e-12)  # roughness length of a smooth wall
    roughness = max(air.sides["z_low"].roughness_length, smooth)
    return air_setup.log_profile(0.5 * (height[1:] + height[:-1]), friction, roughness, air.karman)
