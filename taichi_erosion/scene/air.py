"""Air scenes: reading, checking, and the setup that follows."""

import json
import tomllib
from collections.abc import Collection, Mapping, Sequence
from copy import deepcopy
from hashlib import sha256
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from taichi_erosion.core.air_setup import (
    SIDES,
    AirModel,
    AirSetup,
    AirSide,
    ClosureConstants,
    InletTurbulence,
    log_profile,
)
from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.setup import Floats, Triple
from taichi_erosion.scene.air_check import air_checks
from taichi_erosion.scene.air_grid import faces, inlet_shape, time_step
from taichi_erosion.scene.load import HASH_LENGTH, file_text, first_line, summary, with_tuples
from taichi_erosion.scene.override import apply_override
from taichi_erosion.scene.problem import problem_lines
from taichi_erosion.scene.schema_air import AirBox, AirScene

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
