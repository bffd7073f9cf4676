"""Entries of the scene of a live session: values, differences, meanings, and those that may change."""

from dataclasses import MISSING, fields
from typing import Any

from taichi_erosion.core.effect import STRENGTH, STRENGTH_MOST, Effect, first_reference, parameter_names
from taichi_erosion.core.errors import BadInput, did_you_mean
from taichi_erosion.execution.checks import read_scene, scene_effect_files
from taichi_erosion.execution.session import LIVE_WIND, Session, saved_state
from taichi_erosion.scene import resolve
from taichi_erosion.scene.paths import describe_entry_at_path, leaf_entries, number_entry_at_path

NOT_SET = "not set"  # an entry that a scene lacks
STEERED = ("wind", "contact", "conditions", "gravity")  # sections of a page, in its order


def entry_value(session: Session, path: str) -> Any:
    """Value of an entry of the present scene, or the entries below it. Raises BadInput."""
    value: Any = resolve(session.scene)
    for key in path.split("."):
        if not isinstance(value, dict) or key not in value:
            entries = list(value) if isinstance(value, dict) else []
            words = f"{did_you_mean(key, entries)}; entries there: {', '.join(entries) or 'none'}"
            raise BadInput(f"no entry '{path}'{words}")
        value = value[key]
    return value


def changed_entries(session: Session, before: str | None = None, after: str | None = None) -> dict[str, Any]:
    """Entries that differ, as (before, after) by path: from the scene file, or a saved state, to another.

    Raises BadInput for an unknown state.
    """
    file = read_scene(session.path, (), session.effect_files)
    old = file if before is None else saved_state(session, before)[0].scene
    new = session.scene if after is None else saved_state(session, after)[0].scene
    first, second = (dict(leaf_entries(resolve(scene))) for scene in (old, new))
    pairs = {path: (first.get(path, NOT_SET), second.get(path, NOT_SET)) for path in sorted(first | second)}
    return {path: pair for path, pair in pairs.items() if pair[0] != pair[1]}


def entry_meaning(session: Session, path: str) -> str:
    """Meaning, unit, default and range of an entry of scenes, of effects too. Raises BadInput."""
    section, _, rest = path.partition(".")
    if section != "effects":
        return describe_entry_at_path(path)
    library = session_library(session)
    if not rest:
        return f"{path}: optional physics, effects.NAME.strength = 1 switches one on: {', '.join(library)}"
    name, _, parameter = rest.partition(".")
    if name not in library:
        raise BadInput(f"no effect '{name}'{did_you_mean(name, library)}; `help effects` lists them")
    effect = library[name]
    entries = ", ".join(parameter_names(effect))
    words = parameter_meaning(effect, parameter) if parameter else f"{effect.title}; entries: {entries}"
    source = first_reference(effect)
    return f"{path}: {words}" + (f"; source: {source}" if source else "")


def parameter_meaning(effect: Effect, name: str) -> str:
    """Meaning, unit, default and range of the strength or a parameter of an effect. Raises BadInput."""
    if name == STRENGTH:
        physical = f"to {effect.most:g} where its literature supports it, to {STRENGTH_MOST:g} at most"
        return f"strength of '{effect.title}', 0: absent, 1: textbook [1] from 0 {physical}"
    parameters = {f.name: f for f in fields(effect.params)}
    if name not in parameters:
        names = parameter_names(effect)
        near = did_you_mean(name, names)
        raise BadInput(f"effects.{effect.name} has no entry '{name}'{near}; there are {', '.join(names)}")
    field_of, about = parameters[name], parameters[name].metadata
    default = "" if field_of.default is MISSING else f", default {field_of.default:g}"
    return f"{about['meaning']} [{about['unit']}] from {about['low']:g} to {about['high']:g}{default}"


def session_library(session: Session) -> dict[str, Effect]:
    """All effects by name, those of files too."""
    from taichi_erosion.effect_library import load_library

    return load_library((*scene_effect_files(session.scene), *session.effect_files))


def changeable_numbers(session: Session) -> list[dict[str, Any]]:
    """Numbers that may change during a run: path, value, unit, range, meaning; those that are stated first.

    Effects that change a scene before it is built are left out.
    """
    scene, rows = session.scene, []
    unstated = dict.fromkeys(f"conditions.{name}" for name in type(scene.conditions).model_fields)
    for path, value in (unstated | dict(leaf_entries(resolve(scene)))).items():
        section, _, name = path.partition(".")
        if section in STEERED and (section != "wind" or name in LIVE_WIND) and not isinstance(value, list):
            if number := number_entry_at_path(path):
                rows.append((path, value, number.unit, number.low, number.high))
    for name, effect in session_library(session).items():
        entries = scene.effects.get(name, {})
        if effect.place != "scene":
            strength = entries.get(STRENGTH, 1.0) if name in scene.effects else None
            rows.append((f"effects.{name}.{STRENGTH}", strength, "1", 0.0, effect.most))
        for param in fields(effect.params) if name in scene.effects else ():
            value, about = entries.get(param.name, param.default), param.metadata
            rows.append((f"effects.{name}.{param.name}", value, about["unit"], about["low"], about["high"]))
    rows.sort(key=lambda row: (row[1] is None, (*STEERED, "effects").index(row[0].partition(".")[0])))
    names = ("path", "value", "unit", "low", "high", "meaning")
    return [dict(zip(names, (*row, entry_meaning(session, row[0])), strict=True)) for row in rows]
