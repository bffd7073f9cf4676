"""Cells, inlet and time step of an air scene.

Whether the sections of an air scene fit together; each problem is one line that begins with a path.

Air scenes: reading, checking, and the setup that follows.
"""

import json
import tomllib
from collections.abc import Collection, Iterator, Mapping, Sequence
from copy import deepcopy
from hashlib import sha256
from math import prod
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import ValidationError

from taichi_erosion.core.air_setup import (
    SIDES,
    AirModel,
    AirSetup,
    AirSide,
    ClosureConstants,
    InletTurbulence,
    both_faces,
    even_faces,
    log_profile,
    stretched_faces,
)
from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.setup import Floats, Triple
from taichi_erosion.scene.entries import apply_override
from taichi_erosion.scene.load import HASH_LENGTH, file_text, first_line, summary, with_tuples
from taichi_erosion.scene.schema.air import (
    COURANT_MOST,
    MOST_CELLS,
    AirBox,
    AirScene,
    LogProfile,
    PowerProfile,
    Profile,
    UniformProfile,
)
from taichi_erosion.scene.validation_messages import problem_lines

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


MOST_STEPS = 2_000_000  # a run longer than this would take weeks


def air_checks(scene: AirScene, observables: Collection[str] | None) -> Iterator[str]:
    """Problems of an air scene whose entries are right one by one."""
    sides = list(side_checks(scene.air))
    yield from sides
    for name in scene.measure if observables is not None else ():
        if name not in (observables or ()):
            yield f"measure.{name} is unknown; known observables: {', '.join(sorted(observables or ()))}"
    if not sides:
        yield from inlet_checks(scene.air)
        yield from grid_checks(scene.air)
        yield from step_checks(scene)


def side_checks(air: AirBox) -> Iterator[str]:
    """All sides are there, and each kind stands where it can."""
    yield from (f"air.sides.{name} is missing" for name in SIDES if name not in air.sides)
    unknown = [name for name in air.sides if name not in SIDES]
    yield from (f"air.sides.{name} is unknown; allowed: {', '.join(SIDES)}" for name in unknown)
    if set(air.sides) == set(SIDES):
        yield from place_checks(air)


def place_checks(air: AirBox) -> Iterator[str]:
    """Each kind of side stands where it can."""
    allowed = {"inlet": ("x_low", "z_low"), "outlet": ("x_high", "z_high"), "stress": ("z_high",)}
    for name, side in air.sides.items():
        if side.kind in allowed and name not in allowed[side.kind]:
            yield f"air.sides.{name}.kind = '{side.kind}' may stand at {' or '.join(allowed[side.kind])} only"
    for axis in "xyz":
        low, high = air.sides[f"{axis}_low"].kind, air.sides[f"{axis}_high"].kind
        if (low == "periodic") != (high == "periodic"):
            yield f"air.sides.{axis}_low and air.sides.{axis}_high: both are periodic or none"
        if axis == "z" and low == "periodic":
            yield "air.sides.z_low.kind = 'periodic': the air has a floor and a lid"


def inlet_checks(air: AirBox) -> Iterator[str]:
    """What enters can leave, and is stated."""
    kinds = [side.kind for side in air.sides.values()]
    if "inlet" in kinds and "outlet" not in kinds:
        yield "air.sides: an inlet needs an outlet, or the air has nowhere to go"
    if air.sides["x_low"].kind == "inlet" and air.inlet is None:
        yield "air.inlet is missing: air.sides.x_low is an inlet"
    if air.turbulence is not None and air.sides["x_low"].kind != "inlet":
        yield "air.turbulence: air.sides.x_low must be an inlet"
    if air.sides["z_high"].kind == "stress" and air.friction_velocity == 0.0:
        yield "air.friction_velocity = 0.0, but air.sides.z_high is under stress"


def grid_checks(air: AirBox) -> Iterator[str]:
    """The grid fits into memory and suits walls and the pressure solve."""
    if prod(air.cells) > MOST_CELLS:
        yield f"air.cells = {list(air.cells)}: {prod(air.cells)} cells; at most {MOST_CELLS} fit"
    if air.lowest is not None and air.lowest * air.cells[2] > air.extents[2]:
        yield f"air.lowest = {air.lowest:g} m: {air.cells[2]} cells of it are higher than the box"
    if air.both_ends and air.cells[2] % 2:
        yield f"air.cells.2 = {air.cells[2]}: an even number is needed for cells fine at both ends"
    for axis, name in enumerate("xy"):
        periodic = air.sides[f"{name}_low"].kind == "periodic"
        if periodic and air.cells[axis] > 1 and air.cells[axis] % 2:
            yield f"air.cells.{axis} = {air.cells[axis]}: 1 or an even number is needed along a period"
    for name in ("z_low", "z_high"):
        side, lowest = air.sides[name], faces(air)[1] if name == "z_low" else air.extents[2] - faces(air)[-2]
        if side.kind == "rough" and 0.5 * lowest < side.roughness_length:
            yield f"air.sides.{name}.roughness_length = {side.roughness_length:g} m exceeds half a cell there"


def step_checks(scene: AirScene) -> Iterator[str]:
    """The time step follows the fastest wind."""
    step, longest = time_step(scene), longest_step(scene)
    if step > longest * (1.0 + 1e-9):
        yield (
            f"run.time_step = {step:g} s lets wind or diffusion cross more than a cell (CFL); "
            f"at most {longest:.3g} s"
        )
    if scene.run.duration / step > MOST_STEPS:
        yield f"run.duration: {scene.run.duration / step:.2g} steps of {step:.2g} s; at most {MOST_STEPS:g}"


NOT_HASHED = {"scene": {"title", "notes"}, "run": {"seed", "frames"}, "measured": True}


def is_air_scene(path: Path) -> bool:
    """Whether a file describes air alone; a file that cannot be read does not, and says so when it is."""
    try:
        table = tomllib.loads(file_text(path, str(path)))
    except (BadInput, ValueError, RecursionError):
        return False
    return "air" in table and "grains" not in table


def load_air_scene(
    path: Path, overrides: Sequence[str] = (), observables: Collection[str] | None = None
) -> AirScene:
    """Validated air scene of a TOML file; raises BadInput with one line."""
    name = str(path).replace("\n", "?")
    try:
        table = tomllib.loads(file_text(path, name))
    except (ValueError, RecursionError) as error:
        raise BadInput(f"{name}: not a TOML file: {first_line(error)}") from None
    return parse_air_scene(table, name, overrides, observables)


def parse_air_scene(
    table: Mapping[str, Any],
    name: str = "scene",
    overrides: Sequence[str] = (),
    observables: Collection[str] | None = None,
) -> AirScene:
    """Validated air scene of a raw table."""
    try:
        frozen = deepcopy(dict(table))
        for order in overrides:
            apply_override(frozen, order)
        frozen = with_tuples(frozen)
        try:
            scene = AirScene.model_validate(frozen)
        except ValidationError as error:
            raise BadInput(summary(problem_lines(error, frozen, {}))) from None
        scene._file = name
        lines = list(air_checks(scene, observables))
    except BadInput as error:
        raise BadInput(f"{name}: {first_line(error)}") from None
    if lines:
        raise BadInput(f"{name}: {summary(lines)}")
    return scene


def build_air(scene: AirScene, seed: int) -> AirSetup:
    """The air of one replica."""
    air = scene.air
    shape = inlet_shape(air)
    start = shape if shape is not None else first_guess(air)
    return AirSetup(
        cells=air.cells,
        low=(0.0, 0.0, 0.0),
        high=air.extents,
        faces_z=faces(air),
        sides={name: air_side(air, name) for name in SIDES},
        density=air.density,
        viscosity=air.viscosity,
        time_step=time_step(scene),
        model=air_model(air),
        constants=ClosureConstants(
            karman=air.karman, smagorinsky=air.smagorinsky, length_share=air.length_share
        ),
        friction_velocity=air.friction_velocity,
        driving_gradient=air.driving_gradient,
        implicitness=air.implicitness,
        inlet_shape=shape,
        turbulence=inlet_turbulence(air, seed),
        start=start,
    )


def air_model(air: AirBox) -> AirModel:
    """Choices compiled in; in a column nothing is carried, so that one implicit stage does."""
    if air.cells[:2] == (1, 1) and air.closure != "smagorinsky":
        return AirModel(air.closure, advection="none", scheme="euler")
    return AirModel(air.closure, air.advection)


def air_side(air: AirBox, name: str) -> AirSide:
    """One side of the box; wind along x comes as a profile of 1 m/s times `inlet_shape`."""
    side = air.sides[name]
    velocity: Triple = (1.0, 0.0, 0.0) if (name, side.kind) == ("x_low", "inlet") else side.velocity
    return AirSide(side.kind, velocity, side.roughness_length)


def first_guess(air: AirBox) -> Floats | None:
    """Wind that a closure starts from [m s-1]: still air would take long to become turbulent."""
    if air.closure == "none":
        return None
    gradient = max(-air.driving_gradient[0], 0.0) * air.extents[2] / air.density
    friction = max(gradient**0.5, air.friction_velocity)
    height = faces(air)
    smooth = 0.11 * air.viscosity / max(friction, 1e-12)  # roughness length of a smooth wall
    roughness = max(air.sides["z_low"].roughness_length, smooth)
    return log_profile(0.5 * (height[1:] + height[:-1]), friction, roughness, air.karman)


def inlet_turbulence(air: AirBox, seed: int) -> InletTurbulence | None:
    """Fluctuations at the inlet."""
    if air.turbulence is None:
        return None
    told = air.turbulence
    return InletTurbulence(told.deviation, told.integral_length, seed, told.waves)


def resolved_air(scene: AirScene) -> dict[str, Any]:
    """The scene with all defaults filled, as plain lists, tables and numbers."""
    return scene.model_dump(mode="json", exclude_none=True)


def air_hash(scene: AirScene) -> str:
    """Name of the physical situation, independent of seed, titles and recording."""
    table = scene.model_dump(mode="json", exclude_none=True, exclude=NOT_HASHED)
    canonical = json.dumps(table, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return sha256(canonical.encode()).hexdigest()[:HASH_LENGTH]
