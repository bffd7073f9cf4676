"""Whether the sections of an air scene fit together; each problem is one line that begins with a path."""

from collections.abc import Collection, Iterator
from math import prod

from taichi_erosion.core.air_setup import SIDES
from taichi_erosion.scene.air_grid import faces, longest_step, time_step
from taichi_erosion.scene.schema_air import MOST_CELLS, AirBox, AirScene

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
