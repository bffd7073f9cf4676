"""Checks of a scene that need no device: validation, and compatibility with others in one ensemble."""

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from taichi_erosion.core.effect import STRENGTH, parameter_names, read_effect_entries, strength_warning
from taichi_erosion.core.effect_file import EffectFile, effect_in, read_effect_files
from taichi_erosion.core.errors import BadInput
from taichi_erosion.execution.observables import OBSERVABLES, measure_files_of_scene
from taichi_erosion.measures.boundary_layer import AIR_OBSERVABLES
from taichi_erosion.scene import Scene, laws, load_scene, resolve, scene_hash, step_report
from taichi_erosion.scene.load import fault_lines, is_air_scene, load_air_scene, read_toml, validate
from taichi_erosion.scene.physical_ranges import range_at
from taichi_erosion.scene.preparation.air import run_time_step, stable_step
from taichi_erosion.scene.schema.air import AirScene
from taichi_erosion.scene.schema.scene import effect_problems

EffectFiles = tuple[EffectFile, ...]
Examine = Callable[[EffectFile], dict[str, Any]]  # check of the effect of a file, from above

OF_AIR = ("friction_velocity", "density", "viscosity", "through_flow")  # of [wind], no numbers of a grid
OF_BOX = "density viscosity friction_velocity driving_gradient sides inlet turbulence".split()  # of [air]
MIXABLE_PLACES = ("pair", "scene", "instrument")  # effects that replicas of one ensemble need not share


def read_scene(path: Path, overrides: tuple[str, ...], effect_files: EffectFiles = ()) -> Scene:
    """Load a scene whose measures and effects this program knows. Raises BadInput.

    `effect_files` are those beside the ones that the scene names itself.
    """
    scene = load_scene(path, overrides, observables=tuple(OBSERVABLES))
    measure_files_of_scene(scene)
    if not scene.effects:
        return scene
    try:
        return attach_effects_to_scene(scene, (*scene_effect_files(scene), *effect_files))
    except BadInput as error:
        raise BadInput(*fault_lines(scene.file, error.faults)) from None


def scene_effect_files(scene: Scene) -> EffectFiles:
    """Effect files that a scene names, relative to its folder. Raises BadInput."""
    return read_effect_files(scene.scene.effect_files, scene.folder, str(scene.file))


def attach_effects_to_scene(scene: Scene, files: EffectFiles) -> Scene:
    """The scene with the files of its own effects and what its effects are known by. Raises BadInput."""
    from taichi_erosion.effect_library import load_library, package_digests

    library = load_library(files)
    entries = {name: parameter_names(effect) for name, effect in library.items()}
    if lines := list(effect_problems(scene, entries)) or list(effect_range_problems(scene, library)):
        raise BadInput(*lines)
    by_name = {effect_in(file).name: file for file in files}
    used = {name: by_name[name] for name in sorted(scene.effects) if name in by_name}
    scene._effect_files = tuple(used.values())
    digests = {name: file.digest for name, file in used.items()}
    scene._effect_digests = digests | package_digests(scene.effects)
    return scene


def effect_range_problems(scene: Scene, library: Mapping[str, Any]) -> Iterator[str]:
    """Strengths and parameters of effects outside the ranges that the effects declare."""
    for name, entries in scene.effects.items():
        try:
            read_effect_entries(library[name], entries)
        except ValueError as error:
            yield str(error)


def setup_report(scene: Scene, files: EffectFiles = ()) -> dict[str, Any]:
    """Time step, limits and warnings of a scene and of effects, of files too, that do not act; SI units."""
    report, library = step_report(scene), library_of(scene)
    lines = [strength_warning(library[name], e.get(STRENGTH, 1.0)) for name, e in scene.effects.items()]
    lines = [*report["warnings"], *unusual_conditions(scene), *filter(None, lines)]
    return report | {"warnings": [*lines, *idle_warnings(scene, files)]}


def unusual_conditions(scene: Scene) -> Iterator[str]:
    """Sentences on conditions that are possible, but not usual for soil, sand and wind on Earth."""
    for name, value in scene.conditions.values_in_si().items():
        allowed = range_at(f"conditions.{name}")
        if allowed and allowed.usual and not allowed.is_usual(value):
            low, high = allowed.usual
            usual = f"usual are {low:g} to {high:g}; check number and unit"
            yield f"conditions.{name} = {value:g} {allowed.unit}: {usual}"


def read_effects(paths: Sequence[Path]) -> EffectFiles:
    """Effect files named on the command line, each of which holds an effect. Raises BadInput."""
    files = read_effect_files(paths)
    if files:
        from taichi_erosion.effect_library import load_library

        load_library(files)
    return files


def idle_warnings(scene: Scene, files: EffectFiles) -> list[str]:
    """Sentences on effects of a scene and of named files that do not act, and on conditions without one."""
    if not files and not scene.effects and not any(scene.conditions.values_in_si().values()):
        return []  # and the device is not imported
    names = [name for file in files if (name := effect_in(file).name) not in scene.effects]
    reasons = {name: f"the scene does not name it; --set effects.{name}.strength=1" for name in names}
    library = library_of(scene)
    reasons |= {name: why_effect_is_idle(scene, library[name]) for name in scene.effects}
    idle = [f"effect '{name}' does not act: {reason}" for name, reason in reasons.items() if reason]
    return [*idle, *sentences_on_unread_conditions(scene, files)]


def why_effect_is_idle(scene: Scene, effect: Any) -> str:
    """What keeps an effect from changing anything in a scene; empty where it acts, or is stated as 0."""
    from taichi_erosion.simulation.scene_setup import can_effect_act_in_scene, does_effect_change_scene

    if scene.effects[effect.name].get("strength") == 0.0:
        return ""
    conditions, possible = scene.conditions.values_in_si(), can_effect_act_in_scene(scene, effect)
    if possible and does_effect_change_scene(scene, effect):
        return ""
    if effect.place == "instrument":
        return f"it changes the reading of none of {', '.join(scene.measure)}"
    reasons = [f"conditions.{name} = {conditions[name]:g}" for name in effect.reads if name in conditions]
    reasons = reasons or [f"conditions.{name} is not stated" for name in effect.reads]
    if possible and scene.wind is None:
        reasons.append("there is no [wind] section")
    return ", ".join(reasons) or "with these numbers it changes nothing"


def sentences_on_unread_conditions(scene: Scene, files: EffectFiles) -> Iterator[str]:
    """Sentences on conditions that no effect of a scene reads; one of 0 is that of a scene without it."""
    from taichi_erosion.effect_library import load_library

    library = load_library(dict.fromkeys((*scene_effect_files(scene), *files)))
    read = {name for effect in scene.effects for name in library[effect].reads}
    unread = {n: value for n, value in scene.conditions.values_in_si().items() if value and n not in read}
    for name, value in unread.items():
        readers = [each for each in library.values() if name in each.reads]
        acting = [each for each in readers if effect_would_act(scene, each)]
        names = ", ".join(each.name for each in acting or readers)
        hint = f"; {names} can, but has nothing to act on here" if readers else ", and none of the list"
        if acting:
            hint = f"; {names} can: --set effects.{acting[0].name}.strength=1"
        yield f"conditions.{name} = {value:g} changes nothing: no effect of this scene reads it{hint}"


def effect_would_act(scene: Scene, effect: Any) -> bool:
    """Whether an effect that a scene does not name would change something in it."""
    try:
        return not why_effect_is_idle(scene.model_copy(update={"effects": {effect.name: {}}}), effect)
    except BadInput:
        return False


def comparable(path: Path, scene: Scene | AirScene) -> dict[str, Any]:
    """Measured values of what is simulated: those of the file, where the laboratory's situation is its own.

    A value that was stated anew stays. Contacts, effects and the number of grains are what is tried. A file
    that is no scene without the changes of a run has no situation.
    """
    kind: Any = type(scene)
    try:
        file = validate(kind, read_toml(path), str(scene.file), (), lambda _: iter(()))
    except BadInput:
        return {}
    same = situation_of_measurement(file) == situation_of_measurement(scene)
    values = {name: m for name, m in scene.measured.items() if same or m != file.measured.get(name)}
    return {name: measured.model_dump() for name, measured in values.items()}


def situation_of_measurement(scene: Scene | AirScene) -> list[Any]:
    """What a laboratory's value depends on."""
    if isinstance(scene, AirScene):
        return [scene.conditions, scene.air.model_dump(include=set(OF_BOX))]
    wind = scene.wind and scene.wind.model_dump(include=set(OF_AIR))
    winds = [(each.friction_velocity, each.through_flow) for each in scene.stages]
    grains, tunnel = scene.grains.model_copy(update={"count": 1}), scene.threshold.speed_ratio
    return [scene.conditions, scene.gravity, scene.geometry, scene.fill, wind, winds, grains, tunnel]


def library_of(*scenes: Scene) -> dict[str, Any]:
    """The effects that scenes can name; empty where they name none: most scenes need no library."""
    if not any(scene.effects for scene in scenes):
        return {}
    from taichi_erosion.effect_library import load_library

    return load_library(dict.fromkeys(file for scene in scenes for file in scene.effect_files_of_scene))


def check_scene(
    path: Path,
    overrides: tuple[str, ...] = (),
    effect_files: tuple[Path, ...] = (),
    examine: Examine | None = None,
) -> dict[str, Any]:
    """Hash, resolved scene, time-step limits and warnings. Raises BadInput.

    Starts no device, unless `examine` does, which is called with every effect file of the scene and of the
    arguments; what it finds stands under `effects`.
    """
    examined: list[dict[str, Any]] = []
    if is_air_scene(path):
        scene = load_air_scene(path, overrides, observables=tuple(AIR_OBSERVABLES))
        limits = {"time_step": run_time_step(scene), "time_step_longest": stable_step(scene), "warnings": []}
    else:
        named = read_effects(effect_files)
        scene = read_scene(path, overrides, named)
        if examine is not None:
            examined = [examine(file) for file in dict.fromkeys((*scene.effect_files_of_scene, *named))]
        if scene.effects:
            from taichi_erosion.scene.preparation.sizes import size_range
            from taichi_erosion.simulation.scene_setup import device_effects, effective_scene

            library = library_of(scene)
            after = effective_scene(scene, library)
            device_effects(after, library, 0.5 * size_range(after.grains)[1])  # none of them fails
        limits = setup_report(scene, named)
    document = {"scene": str(path), "hash": scene_hash(scene), "resolved": resolve(scene), "limits": limits}
    return document | {"effects": examined}


def compatibility_key(scene: Scene) -> str:
    """All that is compiled into the kernels, and the check interval; equal for scenes of one ensemble.

    Replicas with and without an attraction between grains, a change of the scene or an instrument run beside
    each other and come out bit for bit as alone.
    """
    effective, effects = apply_and_list_effects(scene)
    clumped = effective.grains.clump is not None
    air = None
    if effective.wind is not None:  # the layers of the air are fixed, and whether air may rise
        rising = any(stage.through_flow is not None for stage in effective.stages)
        names = {"closure", "columns", "drive", "surface", "length", "width", "height", "cell", "growth"}
        size = effective.grains.model_dump(include={"size", "kinds"})
        air = [effective.wind.model_dump(include=names), rising, effective.grains.count, size]
    choices = [scene.scene.kind, asdict(laws(effective)), scene.run.precision, clumped, effects]
    return json.dumps([*choices, scene.run.check_interval, air], sort_keys=True)


def apply_and_list_effects(scene: Scene) -> tuple[Scene, list[tuple[str, bool]]]:
    """The scene changed by its effects, and (name, strength > 0) of the effects that are compiled in.

    Where an effect is not in the library or refuses the scene, all count as compiled in: its replica then
    fails by itself.
    """
    named = sorted((name, entry.get("strength", 1.0) > 0.0) for name, entry in scene.effects.items())
    if not named:
        return scene, named
    from taichi_erosion.simulation.scene_setup import effective_scene

    library = library_of(scene)
    try:
        compiled = [(name, acts) for name, acts in named if library[name].place not in MIXABLE_PLACES]
        return effective_scene(scene, library), compiled
    except (BadInput, KeyError):
        return scene, named
