"""From the wind section of a scene to the air of one replica."""

from dataclasses import replace
from math import ceil, pi

from taichi_erosion.core.air_setup import SIDES, AirModel, AirSetup, AirSide, Stir, bed_faces, bed_gradient
from taichi_erosion.core.initial_turbulence import stirred_wind
from taichi_erosion.core.setup import Coupling, GrainTable, Triple
from taichi_erosion.scene.build.limits import time_step
from taichi_erosion.scene.build.sizes import mean_cube, nominal_diameter
from taichi_erosion.scene.schema.scene import Scene
from taichi_erosion.scene.schema.wind import Wind

SOLID_SHARE = 0.6  # of a settled bed [1]
CELL_SHARE = 0.25  # finest layer of air over the nominal diameter [1]
ABOVE_BED = 2.0  # diameters above the bed up to which layers stay fine [1]
CENTRED = 0.5  # implicitness that is of second order: eddies are followed in time [1]
GRAIN_ROUGHNESS = 1.0 / 30.0  # roughness length of a bed at rest over its diameter (Nikuradse) [1]
HEADROOM = 10.0  # heights of the patch that grains may fly before they count as lost [1]


def surface_height(scene: Scene, wind: Wind) -> float:
    """Height of the undisturbed bed [m]."""
    if wind.surface is not None:
        return wind.surface
    volume = scene.grains.count * pi / 6.0 * mean_cube(scene.grains.size)
    return volume / (SOLID_SHARE * wind.length * wind.width)


def air_setup(scene: Scene, wind: Wind, time_step: float, seed: int) -> AirSetup:
    """The air that a scene describes."""
    diameter = nominal_diameter(scene.grains.size)
    fine_until = min(surface_height(scene, wind) + ABOVE_BED * diameter, 0.5 * wind.height)
    faces = bed_faces(0.0, fine_until, wind.height, wind.cell or CELL_SHARE * diameter, wind.growth)
    ends = {"z_low": AirSide("wall"), "z_high": AirSide("stress" if wind.drive == "lid" else "symmetry")}
    made = AirSetup(
        cells=(*wind.columns, len(faces) - 1),
        low=(0.0, 0.0, 0.0),
        high=(wind.length, wind.width, wind.height),
        faces_z=faces,
        sides={name: ends.get(name, AirSide("periodic")) for name in SIDES},
        density=wind.density,
        viscosity=wind.viscosity,
        time_step=time_step * wind.look_steps,
        model=AirModel(closure=wind.closure, advection="none", scheme="euler", exchange=True),
        friction_velocity=wind.partition * wind.friction_velocity,
        ground=surface_height(scene, wind),
    )
    return made if wind.columns == (1, 1) else on_grid(made, wind, diameter, seed)


def on_grid(column: AirSetup, wind: Wind, diameter: float, seed: int) -> AirSetup:
    """The same air on several columns: carried along by itself, and stirred when the wind sets in."""
    eddies = wind.closure != "mixing_length"
    grid = replace(
        column,
        model=AirModel(closure=wind.closure, exchange=True),
        implicitness=CENTRED if eddies else column.implicitness,
        driving_gradient=(bed_gradient(column, column.friction_velocity), 0.0, 0.0),
        stir=Stir(wind.stir if eddies else 0.0, wind.turnovers, GRAIN_ROUGHNESS * diameter, seed),
    )
    blows = grid.friction_velocity > 0.0
    return replace(grid, start=stirred_wind(grid, grid.friction_velocity)) if blows else grid


def coupling(scene: Scene, wind: Wind, seed: int) -> Coupling:
    """How grains and air look at each other."""
    rising = any(stage.through_flow is not None for stage in scene.stages)
    return Coupling(
        look_steps=wind.look_steps,
        surface=surface_height(scene, wind),
        through_flow=wind.through_flow,
        rising=rising,
        seed=seed % 2**31,
        partition=wind.partition,
        sleep_exchanges=sleep_exchanges(scene, wind),
        sleep_share=wind.sleep_share,
    )


def sleep_exchanges(scene: Scene, wind: Wind) -> int:
    """Looks, the first of them included, that last no less than the time at rest; 0 where no grain sleeps."""
    if not wind.sleep_after:
        return 0
    return 1 + ceil(wind.sleep_after / (wind.look_steps * time_step(scene)))


def patch_box(wind: Wind, grains: GrainTable) -> tuple[Triple, Triple]:
    """Domain of a periodic patch [m]."""
    below = -10.0 * float(grains.radius.max())
    return (0.0, 0.0, below), (wind.length, wind.width, HEADROOM * wind.height)
