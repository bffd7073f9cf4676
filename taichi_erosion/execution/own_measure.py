"""Measures of the user's own: a Python file with a unit and a function of grains, contacts and walls."""

from collections.abc import Callable
from functools import lru_cache
from math import nan
from typing import TYPE_CHECKING, Any

from taichi_erosion.core.effect_file import EffectFile, error_text, execute, line_of, read_effect_file
from taichi_erosion.core.errors import BadInput
from taichi_erosion.measures.result import Measurement, no_measurement
from taichi_erosion.scene import Scene

if TYPE_CHECKING:
    from taichi_erosion.execution.observables import MeasureInput

REMEDY = 'it needs UNIT = "..." and a function measure(grains, contacts, walls) that gives a number'


@lru_cache
def unit_and_function(file: EffectFile) -> tuple[str, Callable[..., Any]]:
    """Unit and function of a file, which is executed once. Raises BadInput where one is missing."""
    module = execute(file, REMEDY)
    unit, function = getattr(module, "UNIT", None), getattr(module, "measure", None)
    if not isinstance(unit, str) or not callable(function):
        raise BadInput(f"{file}: is no measure; {REMEDY}")
    return unit, function


def measure_files(scene: Scene) -> dict[str, EffectFile]:
    """Files of the measures of a scene that are the user's own, by name. Raises BadInput."""
    named = {name: order.file for name, order in scene.measure.items() if order.file is not None}
    files = {name: read_effect_file(scene.folder / file, scene.file) for name, file in named.items()}
    for file in files.values():
        unit_and_function(file)
    return files


def own_measure(name: str, state: "MeasureInput") -> Measurement:
    """What the function gives at the end of the stage: a number, or one with its standard deviation.

    It gets xarrays of the grains that are there, of the contacts and of the walls, in SI units.
    """
    from taichi_erosion.recording.export import contact_table, grain_frame, grain_table, wall_table

    assert state.network is not None
    unit, function = unit_and_function(measure_files(state.scene)[name])
    network = state.network()
    grains = grain_table([grain_frame(state.end)]).isel(time=0).sel(grain=state.end.ident)
    try:
        result = function(grains, contact_table([network]), wall_table(state.poses, network))
        value, sd = (float(number) for number in (result if isinstance(result, tuple) else (result, nan)))
    except Exception as error:  # whatever the user's code raises
        return no_measurement(name, unit, f"its function failed{line_of(error)}: {error_text(error)}")
    return Measurement(name, value, sd, unit)
