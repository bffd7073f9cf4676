"""Cells, inlet and time step of an air scene."""

import numpy as np

from taichi_erosion.core.air_setup import both_faces, even_faces, log_profile, stretched_faces
from taichi_erosion.core.setup import Floats
from taichi_erosion.scene.schema_air import (
    COURANT_MOST,
    AirBox,
    AirScene,
    LogProfile,
    PowerProfile,
    Profile,
    UniformProfile,
)

DIFFUSION = 0.5  # explicit diffusion along x and y: largest step over width^2 / nu in all directions [1]
TURBULENT = 30.0  # largest speed of a driven turbulent flow over its friction velocity [1]
GUST = 3.0  # standard deviations that a gust may exceed the mean wind by [1]
COLUMN_SHARE = 1e-3  # time step of air that nothing limits over the run [1]


def faces(air: AirBox) -> Floats:
    """Faces of cells along z [m]."""
    high, count = air.extents[2], air.cells[2]
    if air.lowest is None:
        return even_faces(0.0, high, count)
    return (both_faces if air.both_ends else stretched_faces)(0.0, high, count, air.lowest)


def inlet_speed(profile: Profile, height: Floats, karman: float) -> Floats:
    """Wind at the inlet at some heights [m s-1]."""
    if isinstance(profile, UniformProfile):
        return np.full(len(height), profile.speed)
    if isinstance(profile, LogProfile):
        return log_profile(height, profile.friction_velocity, profile.roughness_length, karman)
    if isinstance(profile, PowerProfile):
        return profile.speed * np.minimum(height / profile.thickness, 1.0) ** profile.exponent
    return np.interp(height, profile.heights, profile.speeds)


def inlet_shape(air: AirBox) -> Floats | None:
    """Wind at the inlet over 1 m/s by layer, None where none is stated."""
    height = faces(air)
    return None if air.inlet is None else inlet_speed(air.inlet, 0.5 * (height[1:] + height[:-1]), air.karman)


def fastest_wind(air: AirBox) -> float:
    """Speed that no air is expected to exceed by much [m s-1]."""
    shape, moving = inlet_shape(air), max(max(map(abs, side.velocity)) for side in air.sides.values())
    gust = GUST * max(air.turbulence.deviation) if air.turbulence else 0.0
    blowing = 0.0 if shape is None else float(shape.max())
    return max(blowing + gust, moving, driven_speed(air))


def driven_speed(air: AirBox) -> float:
    """Speed scale of air that a pressure gradient drives [m s-1]: laminar, or 30 u* with a closure."""
    gradient, height = max(map(abs, air.driving_gradient)), air.extents[2]
    laminar = gradient * height**2 / (8.0 * air.density * air.viscosity)
    turbulent = TURBULENT * max((gradient * height / air.density) ** 0.5, air.friction_velocity)
    return laminar if air.closure == "none" else min(laminar, turbulent) if gradient else turbulent


def longest_step(scene: AirScene) -> float:
    """Longest stable time step [s]."""
    return min(step_limits(scene.air, COURANT_MOST))


def step_limits(air: AirBox, courant: float) -> tuple[float, float]:
    """Time steps [s] that advection and explicit diffusion allow; one cell along an axis allows any."""
    widths = [size / n for size, n in zip(air.extents[:2], air.cells[:2], strict=True) if n > 1]
    speed = fastest_wind(air)
    advective = courant * min(widths) / speed if widths and speed and air.advection != "none" else np.inf
    diffusive = DIFFUSION / (air.viscosity * sum(2.0 / w**2 for w in widths)) if widths else np.inf
    return advective, diffusive


def time_step(scene: AirScene) -> float:
    """Time step of a run [s]; what nothing limits takes COLUMN_SHARE of the run."""
    if scene.run.time_step is not None:
        return scene.run.time_step
    limit = min(step_limits(scene.air, scene.run.courant))
    return float(limit) if np.isfinite(limit) else COLUMN_SHARE * scene.run.duration
