"""Questions to a live session: entries of its scene, what was changed, numbers now and over time."""

from dataclasses import MISSING, fields
from typing import Any

from taichi_erosion.core.effect import STRENGTH, STRENGTH_MOST, Effect, parameter_names, reference
from taichi_erosion.core.errors import BadInput, did_you_mean
from taichi_erosion.run.checks import read_scene, scene_effect_files
from taichi_erosion.run.session import Session, measure_now, saved_state, session_status
from taichi_erosion.scene import Scene, resolved
from taichi_erosion.scene.paths import leaves, meaning_of

NOT_SET = "not set"  # an entry that a scene lacks
EFFECTS = "effects"  # section of a scene
STATUS_UNITS = {"time_s": "s", "kinetic_J": "J", "speed_largest_m_s": "m/s", "overlap_largest": "radii"}


def entry(session: Session, path: str) -> Any:
    """Value of an entry of the present scene, or the entries below it. Raises BadInput."""
    found: Any = resolved(session.scene)
    for key in path.split("."):
        if not isinstance(found, dict) or key not in found:
            entries = list(found) if isinstance(found, dict) else []
            told = f"{did_you_mean(key, entries)}; entries there: {', '.join(entries) or 'none'}"
            raise BadInput(f"no entry '{path}'{told}")
        found = found[key]
    return found


def scene_of(session: Session, name: str | None) -> Scene:
    """The scene when a state was saved; the present one without a name. Raises BadInput."""
    if name is None:
        return session.scene
    return read_scene(session.path, saved_state(session, name).overrides, session.effect_files)


def differences(session: Session, before: str | None = None, after: str | None = None) -> dict[str, Any]:
    """Entries that differ, as (before, after) by path: from the scene file, or a saved state, to another.

    Raises BadInput for an unknown state.
    """
    old = read_scene(session.path, (), session.effect_files) if before is None else scene_of(session, before)
    first, second = (dict(leaves(resolved(scene))) for scene in (old, scene_of(session, after)))
    pairs = {
        path: (first.get(path, NOT_SET), second.get(path, NOT_SET)) for path in sorted({*first, *second})
    }
    return {path: pair for path, pair in pairs.items() if pair[0] != pair[1]}


def status_numbers(session: Session) -> dict[str, float]:
    """Numbers of the status by name, in the units that the names end in."""
    found = session_status(session).items()
    return {name: float(value) for name, value in found if not isinstance(value, str)}


def number_names(session: Session) -> list[str]:
    """Names of the numbers that can be plotted and watched."""
    return [*status_numbers(session), *session.scene.measure]


def refuse_unknown_number(session: Session, name: str) -> None:
    """Raise BadInput for a name that is no number of the status and no measure."""
    known = number_names(session)
    if name not in known:
        raise BadInput(f"no number '{name}'{did_you_mean(name, known)}; there are {', '.join(known)}")


def watch(session: Session, *names: str) -> None:
    """Keep measures too at every check, beside the status. Raises BadInput for an unknown name."""
    for name in names:
        refuse_unknown_number(session, name)
    units = {name: found.unit for name, found in measure_now(session).items()}
    session.watched |= {name: units.get(name) or STATUS_UNITS.get(name, "") for name in names}


def keep_sample(session: Session) -> dict[str, float]:
    """Keep the numbers of this check; those of a later time, from before a return, go."""
    now = status_numbers(session)
    if not set(session.watched) <= set(now):
        now |= {name: found.value for name, found in measure_now(session).items() if name in session.watched}
    session.samples[:] = [each for each in session.samples if each["time_s"] < now["time_s"]]
    session.samples.append(now)
    return now


def curve(session: Session, name: str) -> tuple[list[float], list[float]]:
    """Times [s] and values of a number at the checks so far. Raises BadInput without any."""
    refuse_unknown_number(session, name)
    samples = [sample for sample in session.samples if name in sample]
    if not samples and name in session.scene.measure:
        raise BadInput(f"'{name}' has no samples: `watch {name}` before the run keeps them")
    if not samples:
        raise BadInput(f"'{name}' has no samples: nothing has run yet; `run 0.1s` makes some")
    return [sample["time_s"] for sample in samples], [sample[name] for sample in samples]


def meaning(session: Session, path: str) -> str:
    """Meaning, unit, default and range of an entry of scenes, of effects too. Raises BadInput."""
    section, _, rest = path.partition(".")
    if section != EFFECTS:
        return meaning_of(path)
    from taichi_erosion.effects import load_library

    library = load_library((*scene_effect_files(session.scene), *session.effect_files))
    if not rest:
        return f"{path}: optional physics, effects.NAME.strength = 1 switches one on: {', '.join(library)}"
    name, _, parameter = rest.partition(".")
    if name not in library:
        raise BadInput(f"no effect '{name}'{did_you_mean(name, library)}; `help effects` lists them")
    effect = library[name]
    if not parameter:
        return f"{path}: {effect.title}; entries: {', '.join(parameter_names(effect))}{source(effect)}"
    return f"{path}: {parameter_meaning(effect, parameter)}{source(effect)}"


def parameter_meaning(effect: Effect, name: str) -> str:
    """Meaning, unit, default and range of the strength or a parameter of an effect. Raises BadInput."""
    if name == STRENGTH:
        physical = f"to {effect.most:g} where its literature supports it, to {STRENGTH_MOST:g} at most"
        return f"strength of '{effect.title}', 0: absent, 1: textbook [1] from 0 {physical}"
    known = {f.name: f for f in fields(effect.params)}
    if name not in known:
        names = parameter_names(effect)
        near = did_you_mean(name, names)
        raise BadInput(f"effects.{effect.name} has no entry '{name}'{near}; there are {', '.join(names)}")
    stated, about = known[name], known[name].metadata
    default = "" if stated.default is MISSING else f", default {stated.default:g}"
    return f"{about['meaning']} [{about['unit']}] from {about['low']:g} to {about['high']:g}{default}"


def source(effect: Effect) -> str:
    """`; source: ...` with the first reference of an effect."""
    found = reference(effect)
    return f"; source: {found}" if found else ""
