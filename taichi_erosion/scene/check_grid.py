"""Whether a grid of air over a patch fits together; each problem is one line that begins with its path."""

from collections.abc import Iterator
from math import log

from taichi_erosion.core.air_setup import ClosureConstants
from taichi_erosion.scene.limits import time_step
from taichi_erosion.scene.schema import Scene
from taichi_erosion.scene.schema_wind import Wind
from taichi_erosion.scene.sizes import nominal_diameter
from taichi_erosion.scene.wind import GRAIN_ROUGHNESS, surface_height

COLUMNS_LEAST = 4  # in each direction: fewer carry no wave
COURANT_MOST = 1.2  # of the fastest gust expected; the scheme is stable up to 1.7 [1]
GUST = 3.0 * 2.5  # u' that hardly any gust exceeds, over u*: three deviations near a wall [1]
OF_ONE_COLUMN = ("bed_stress", "pressure_drop")  # measures that read its mixing length or its rising air


def grid_checks(scene: Scene, wind: Wind) -> Iterator[str]:
    """Columns, closure and what drives go together."""
    if wind.columns == (1, 1):
        if wind.closure == "smagorinsky":
            yield "wind.closure = 'smagorinsky': one column has no eddies; state wind.columns"
        if wind.drive == "gradient":
            yield "wind.drive = 'gradient': one column is driven by its lid; state wind.columns"
        return
    yield from column_checks(scene, wind)
    yield from rising_checks(scene, wind)
    for name in OF_ONE_COLUMN:
        if name in scene.measure:
            yield f"measure.{name} reads a single column of air; leave wind.columns out"
    if "turbulent_gusts" in scene.effects and wind.closure != "mixing_length":
        yield "effects.turbulent_gusts: the grid has gusts of its own; leave the effect or the eddies out"
    yield from courant_checks(scene, wind)


def column_checks(scene: Scene, wind: Wind) -> Iterator[str]:
    """Columns can be paired by the pressure solve, and are wider than grains."""
    diameter = nominal_diameter(scene.grains.size)
    for place, (count, name) in enumerate(zip(wind.columns, ("length", "width"), strict=True)):
        width = getattr(wind, name) / count
        if count < COLUMNS_LEAST or count % 2:
            yield f"wind.columns.{place} = {count}: an even number is needed, at least {COLUMNS_LEAST}"
        elif width < diameter:
            told = "narrower than a grain; averages over them mean nothing"
            yield f"wind.columns.{place} = {count}: columns of {width:.3g} m are {told}"


def rising_checks(scene: Scene, wind: Wind) -> Iterator[str]:
    """Nothing rises through the floor of a grid."""
    if wind.through_flow != 0.0:
        yield "wind.through_flow needs a single column of air; leave wind.columns out"
    for place, stage in enumerate(scene.stages):
        if stage.through_flow is not None:
            yield f"stages.{place}.through_flow needs a single column of air; leave wind.columns out"


def courant_checks(scene: Scene, wind: Wind) -> Iterator[str]:
    """No gust crosses more than a cell from one look to the next."""
    friction = max([wind.friction_velocity, *(stage.friction_velocity or 0.0 for stage in scene.stages)])
    friction = wind.partition * max(friction, scene.threshold.transport or 0.0, scene.threshold.first or 0.0)
    above = wind.height - surface_height(scene, wind)
    roughness = GRAIN_ROUGHNESS * nominal_diameter(scene.grains.size)
    fastest = friction * (log(1.0 + max(above, 0.0) / roughness) / ClosureConstants.karman + GUST)
    flown = fastest * wind.look_steps * time_step(scene)
    most = COURANT_MOST * wind.length / wind.columns[0]
    if flown > most:
        yield (
            f"wind.look_steps = {wind.look_steps}: a gust of {fastest:.3g} m/s crosses {flown:.2g} m of air "
            f"between two looks; at most {int(wind.look_steps * most / flown)}"
        )
