"""Scenes of air alone: a box of cells, its sides, the wind at its inlet, and measures."""

from collections.abc import Iterator
from math import prod
from typing import Annotated, Literal

from pydantic import Field

from taichi_erosion.core import air_setup
from taichi_erosion.core.air_setup import SIDES, AirModel, AirSetup, ClosureConstants, InletTurbulence
from taichi_erosion.scene.schema import fields
from taichi_erosion.scene.schema.conditions import Conditions
from taichi_erosion.scene.schema.fields import Name, SceneFile, Section, Vector
from taichi_erosion.scene.schema.scene import LONGEST, Measured

MOST_CELLS = 20_000_000  # about 8 GB of state
COURANT_MOST = 1.7  # limit of three-stage Runge-Kutta with central advection [1]


class AirSection(Section):
    """A section of a scene without grains, which has no diameter."""

    in_metres_only = True


class AirHead(AirSection):
    """What the scene is."""

    kind: Literal["cavity", "channel", "tunnel"] = Field(description="kind of flow, which the viewer follows")
    title: str = Field(default="", max_length=200, description="one line for people")
    notes: str = Field(default="", max_length=20_000, description="assumptions and sources")


class AirRun(AirSection):
    """How long and how finely the air is followed."""

    seed: int = fields.number(1, "1", "seed of the turbulence at the inlet", 0, 2**62)
    duration: float = fields.number(..., "s", "simulated time", 1e-9, LONGEST)
    averaging: float = fields.number(0.2, "1", "last share of a run over which measures take means", 0.0, 1.0)
    courant: float = fields.number(1.0, "1", "fastest wind times step over cell length", 1e-3, COURANT_MOST)
    time_step: float | None = fields.number(None, "s", "time step; left out: courant", 1e-12, LONGEST)
    frames: int = fields.number(40, "1", "frames of the recording", 1, 10_000)


class Side(AirSection):
    """One side of the box."""

    kind: air_setup.SideKind = Field(description="what the side does to the air")
    velocity: Vector = fields.number((0.0, 0.0, 0.0), "m s-1", "of the wall", -fields.FASTEST, fields.FASTEST)
    roughness_length: float = fields.extent(0.0, "roughness length z0 of a rough wall; 0: smooth", 0.0)


class UniformProfile(AirSection):
    """The same speed at every height."""

    law: Literal["uniform"]
    speed: float = fields.number(..., "m s-1", "wind speed", 0.0, fields.FASTEST)


class LogProfile(AirSection):
    """Speed that grows with the logarithm of height."""

    law: Literal["log"]
    friction_velocity: float = fields.number(..., "m s-1", "friction velocity u*", 0.0, 10.0)
    roughness_length: float = fields.extent(..., "roughness length z0", 1e-9)


class TableProfile(AirSection):
    """Measured speeds, joined by straight lines."""

    law: Literal["table"]
    heights: tuple[float, ...] = fields.number(..., "m", "heights, rising", 0.0, 1e4)
    speeds: tuple[float, ...] = fields.number(..., "m s-1", "wind speed at each height", 0.0, fields.FASTEST)

    def contradictions(self) -> Iterator[str]:
        if len(self.heights) != len(self.speeds) or len(self.heights) < 2:
            yield "heights and speeds must be lists of the same length, at least 2"
        if any(b <= a for a, b in zip(self.heights, self.heights[1:], strict=False)):
            yield "heights must rise"


Profile = Annotated[UniformProfile | LogProfile | TableProfile, Field(discriminator="law")]


class Turbulence(AirSection):
    """Fluctuations at the inlet."""

    deviation: Vector = fields.number(..., "m s-1", "standard deviations of u, v and w", 0.0, fields.FASTEST)
    integral_length: float = fields.extent(..., "integral length scale", high=fields.FARTHEST)
    waves: int = fields.number(InletTurbulence.waves, "1", "random waves that are summed", 8, 10_000)


class AirBox(AirSection):
    """The box, the fluid, the closure."""

    extents: Vector = fields.number(..., "m", "extents along x, y and z", 1e-7, 1e4)
    cells: tuple[int, int, int] = fields.number(..., "1", "cells along x, y and z", 1, 100_000)
    lowest: float | None = fields.number(None, "m", "height of the lowest cells; left out: equal", 1e-7, 1e4)
    both_ends: bool = fields.entry(False, "whether cells are fine at the lid too")
    density: float = fields.number(1.2, "kg m-3", "density of the air", 1e-3, 1e3)
    viscosity: float = fields.number(1.5e-5, "m2 s-1", "kinematic viscosity", 1e-9, 10.0)
    closure: air_setup.Closure = fields.entry(AirModel.closure, "turbulence closure")
    advection: air_setup.Advection = fields.entry(
        AirModel.advection, "central: keeps energy; limited: makes no new extremes"
    )
    implicitness: float = fields.number(
        AirSetup.implicitness, "1", "of diffusion along z: 0.5 second order in time, 1 robust", 0.5, 1.0
    )
    karman: float = fields.number(ClosureConstants.karman, "1", "von Karman's constant", 0.3, 0.5)
    smagorinsky: float = fields.number(ClosureConstants.smagorinsky, "1", "Smagorinsky's constant", 0.0, 0.5)
    length_share: float = fields.number(
        ClosureConstants.length_share,
        "1",
        "largest mixing length over the layer thickness; 0: no limit",
        0.0,
        0.5,
    )
    friction_velocity: float = fields.number(0.0, "m s-1", "u* of a side under stress", 0.0, 10.0)
    driving_gradient: Vector = fields.number(
        (0.0, 0.0, 0.0), "Pa m-1", "mean pressure gradient; negative drives forwards", -1e6, 1e6
    )
    sides: dict[Name, Side] = Field(description="x_low, x_high, y_low, y_high, z_low, z_high")
    inlet: Profile | None = fields.entry(None, "wind at the inlet, and everywhere at the start")
    turbulence: Turbulence | None = fields.entry(None, "fluctuations at the inlet")


class AirMeasure(AirSection):
    """Where one observable of the air is read."""

    place: float | None = fields.extent(None, "place on x; left out: mean along x", 0.0, fields.FARTHEST)


class AirScene(SceneFile):
    """One flow of air without grains."""

    scene: AirHead
    conditions: Conditions = Conditions()
    run: AirRun
    air: AirBox
    measure: dict[Name, AirMeasure] = Field({})
    measured: dict[Name, Measured] = Field({})


def air_box_contradictions(air: AirBox) -> Iterator[str]:
    """Contradictions between entries of a box, one line each, beginning with a dotted path."""
    yield from (f"air.sides.{name} is missing" for name in SIDES if name not in air.sides)
    unknown = [name for name in air.sides if name not in SIDES]
    yield from (f"air.sides.{name} is unknown; allowed: {', '.join(SIDES)}" for name in unknown)
    if set(air.sides) == set(SIDES):
        yield from list(misplaced_side_problems(air)) or (*air_inlet_problems(air), *cell_count_problems(air))


def misplaced_side_problems(air: AirBox) -> Iterator[str]:
    """Sides of a kind that cannot stand where they do."""
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


def air_inlet_problems(air: AirBox) -> Iterator[str]:
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


def cell_count_problems(air: AirBox) -> Iterator[str]:
    """Numbers of cells that fit into memory and suit the pressure solve."""
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
