"""Strengths of effects in physical words: forces beside a grain's weight, changed numbers, moved values.

An effect of the library knows its own law: of a pair the attraction at touch is evaluated, of a change of the
scene what it sets. For every model the value that the effect moves most stands beside it.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields
from math import isfinite, pi
from types import SimpleNamespace
from typing import Any

from taichi_erosion.campaign.study_file import StudyFile
from taichi_erosion.core.effect import Effect
from taichi_erosion.core.errors import BadInput
from taichi_erosion.evidence.data.number_words import short, with_unit
from taichi_erosion.evidence.data.table_units import TableUnits
from taichi_erosion.report.evidence_results import Document, Results
from taichi_erosion.report.measured_table import MeasuredTable
from taichi_erosion.report.plain_words import words_of

GRAVITY = 9.81  # m s-2
PREFIXES = ((1.0, ""), (1e-3, "m"), (1e-6, "µ"), (1e-9, "n"), (1e-12, "p"))
MOST_CHANGES = 3  # changed entries of a scene that are told


@dataclass(frozen=True)
class Grains:
    """Typical grain of a study, and the conditions that its table has in the middle."""

    radius: float  # m
    mass: float  # kg
    conditions: Mapping[str, float]  # by the names that effects read
    words: Mapping[str, str]  # the same in the units of the table
    scene: Any


def strength_words(found: Results, file: StudyFile) -> dict[str, str]:
    """One sentence for every effect with a fitted strength."""
    strengths = dict(fitted_strengths(found))
    laws = force_words(found, file, strengths) if file.study.model is None and strengths else {}
    actions = found.adoption["added"].get("actions", {}) if found.adoption else {}
    actions = (found.discovery or {}).get("actions", {}) | actions
    sentences = {}
    for name, strength in strengths.items():
        parts = [laws.get(name), action_words(actions.get(name), found.table, found.units)]
        told = "; ".join(part for part in parts if part)
        if told:
            sentences[name] = f"Strength {short(strength)}: {told}."
    return sentences


def fitted_strengths(found: Results) -> Iterator[tuple[str, float]]:
    """Strengths of named and adopted effects; those of an adoption count last."""
    if found.discovery:
        effects = found.discovery["effects"]
        names = (*found.discovery["named"], *found.discovery["group"])
        yield from ((name, effects[name]["strength"]) for name in names if effects[name]["strength"])
    if found.adoption:
        strengths = found.adoption["added"]["strengths"].items()
        yield from ((name, estimate["value"]) for name, estimate in strengths)


def action_words(action: Document | None, table: MeasuredTable, units: TableUnits) -> str | None:
    """`it raises the threshold friction velocity from 0.099 to 0.15 m/s at diameter 0.075 mm`."""
    if action is None or action["without"] is None or action["acting"] is None:
        return None
    name = action["observable"]
    verb = "raises" if action["acting"] > action["without"] else "lowers"
    ends = (short(units.value(name, action[key]) or 0.0) for key in ("without", "acting"))
    change = with_unit(f"from {' to '.join(ends)}", units.value_unit(name))
    at = [
        table.condition(key).words(value) for key, value in action["conditions"].items() if value is not None
    ]
    where = f" at {', '.join(at)}" if at else ""
    return f"it {verb} the {words_of(name).noun} {change}{where}, where it does most"


def force_words(found: Results, file: StudyFile, strengths: Mapping[str, float]) -> dict[str, str]:
    """What the laws of library effects are at these strengths; nothing for a law that cannot be evaluated."""
    from taichi_erosion.effects import load_library

    grains, library = typical_grains(found, file), load_library()
    told = {}
    for name, strength in strengths.items():
        if name not in library or grains is None:
            continue
        try:
            words = law_words(library[name], calibrated_params(library[name], found), strength, grains)
        except Exception:
            words = None
        if words:
            told[name] = words
    return told


def typical_grains(found: Results, file: StudyFile) -> Grains | None:
    """Grains of the first scene with the middle of the measured conditions; None where it cannot be read."""
    from taichi_erosion.run.checks import read_scene
    from taichi_erosion.scene.preparation.sizes import nominal_diameter

    names = [entry.scene for entry in file.observables.values() if entry.scene]
    try:
        scene = read_scene(found.study.parent / str(names[0]), ())
    except (BadInput, IndexError):
        return None
    radius = 0.5 * nominal_diameter(scene.grains.size)
    conditions, words = {}, {}
    for condition in found.table.conditions.values():
        middle = median_of([value for value in found.table.values(condition.name) if isfinite(value)])
        for path in (part.strip() for part in condition.path.split(",")):
            section, _, name = path.rpartition(".")
            if section == "conditions" and middle is not None:
                conditions[name], words[name] = middle, condition.words(middle)
            elif section.startswith("grains.size") and middle is not None:
                radius = 0.5 * middle
    density = scene.grain_material.density
    given = scene.conditions.model_dump(exclude_none=True)
    stated = {name: value for name, value in given.items() if isinstance(value, float)}
    return Grains(radius, 4.0 / 3.0 * pi * radius**3 * density, stated | conditions, words, scene)


def median_of(values: list[float]) -> float | None:
    """Upper median of the values above 0 where there are any: dry rows do not hide what water does."""
    known = sorted(value for value in values if value > 0.0) or sorted(values)
    return known[len(known) // 2] if known else None


def calibrated_params(effect: Effect, found: Results) -> Any:
    """Numbers of an effect's law, those that were calibrated with its strength at their fitted values."""
    fit = found.adoption["added"] if found.adoption else found.discovery
    fitted = fit["parameters"] if fit else {}
    names = {f"effects.{effect.name}.{each.name}": each.name for each in fields(effect.params)}
    return effect.params(**{names[path]: fitted[path]["value"] for path in names if path in fitted})


def law_words(effect: Effect, params: Any, strength: float, grains: Grains) -> str | None:
    """The law of one effect at a strength, in words."""
    if effect.place == "pair" and not effect.vector and effect.grain_state is None:
        assert effect.constants is not None
        return attraction_words(effect, effect.constants(params, strength, grains.conditions), grains)
    if effect.place == "scene":
        return change_of_scene(effect.act(params, strength, grains.conditions, grains.scene), grains)
    return None


def attraction_words(effect: Effect, constants: Mapping[str, float], grains: Grains) -> str:
    """Attraction of two touching grains, and its ratio to the weight of one."""
    pair = {
        "gap": 0.0,
        "radius_i": grains.radius,
        "radius_j": grains.radius,
        "radius_effective": 0.5 * grains.radius,
        "mass_i": grains.mass,
        "mass_j": grains.mass,
        "closing_speed": 0.0,
        "stiffness": 0.0,
        "touched": 1.0,
    }
    law = getattr(effect.act, "__wrapped__", effect.act)
    pull = float(law(SimpleNamespace(**constants), SimpleNamespace(**pair)))
    weight = grains.mass * GRAVITY
    read = [grains.words[name] for name in effect.reads if name in grains.words]
    at = f" at {', '.join(read)}" if read else ""
    ratio = f"{short(abs(pull) / weight)} of a grain's weight"
    kind = "pull" if pull >= 0.0 else "push"
    size = engineering(2.0 * grains.radius, "m")
    return f"a {kind} of {engineering(abs(pull), 'N')} between grains of {size}{at}, {ratio}"


def change_of_scene(changed_scene: Any, grains: Grains) -> str | None:
    """Entries of the scene that an effect changes, old and new."""
    from taichi_erosion.scene import resolved

    before = dict(leaves(resolved(grains.scene), ""))
    after = dict(leaves(resolved(changed_scene), ""))
    changed = [
        f"{path} from {before[path]:.3g} to {value:.3g}"
        for path, value in after.items()
        if path in before and value != before[path]
    ]
    if not changed:
        return None
    rest = f" and {len(changed) - MOST_CHANGES} more" if len(changed) > MOST_CHANGES else ""
    return f"it changes {', '.join(changed[:MOST_CHANGES])}{rest}"


def leaves(table: Any, above: str) -> Iterator[tuple[str, float]]:
    """Numbers of nested tables and lists by their paths."""
    entries = (
        table.items() if isinstance(table, dict) else enumerate(table) if isinstance(table, list) else ()
    )
    for key, value in entries:
        path = f"{above}.{key}" if above else str(key)
        if isinstance(value, float):
            yield path, value
        else:
            yield from leaves(value, path)


def engineering(value: float, unit: str) -> str:
    """`36 µN`: number with the prefix that makes it readable."""
    for size, prefix in PREFIXES:
        if value >= size:
            return f"{short(value / size)} {prefix}{unit}"
    return f"{value:.2g} {unit}"
