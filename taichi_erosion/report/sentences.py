"""Sentences of the page of a study: where the model fails, what is missing, how far the error falls.

Strengths are told in physical words: forces beside a grain's weight, changed numbers, moved values. An effect
of the library knows its own law: of a pair the attraction at touch is evaluated, of a change of the scene
what it sets. For every model the value that the effect moves most stands beside it.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields
from math import isfinite, pi
from types import SimpleNamespace
from typing import Any

from matplotlib.ticker import EngFormatter

from taichi_erosion.campaign.study_file import StudyFile
from taichi_erosion.core.effect import Effect
from taichi_erosion.core.errors import BadInput
from taichi_erosion.evidence.answers.agreement_words import (
    is_untested,
    open_words,
    row_sentences,
    unseen_words,
    untested_sentence,
)
from taichi_erosion.evidence.data.number_words import counted, short, with_unit
from taichi_erosion.evidence.data.table_units import TableUnits
from taichi_erosion.evidence.inference.verdict_levels import fails
from taichi_erosion.report.results import Document, MeasuredTable, Results
from taichi_erosion.report.words import EVERYWHERE, effect_words, listed, samples_words, words_of

MOST_TOLD = 3  # observables whose errors a sentence lists
LEVEL = "level"  # axis of a misfit of an observable as a whole
AGREES = "The calibrated model agrees with the measurements."
GRAVITY = 9.81  # m s-2
MOST_CHANGES = 3  # changed entries of a scene that are told


def lead(found: Results) -> list[str]:
    """Sentences above the first figure; an adoption that leaves something open comes first."""
    first, *others = failure_sentence(found), *answer_sentences(found)
    if found.adoption:
        return [others[0], first, *others[1:]] if open_words(found.adoption) else [first, *others]
    if others and found.comparison and is_untested(found.comparison):
        return others
    is_explained = found.discovery is not None and bool(found.discovery["named"] or found.discovery["group"])
    worst = None if is_explained else (found.comparison or found.discovery or {}).get("worst_row")
    return [first, *others, *row_sentences(worst)]


def failure_sentence(found: Results) -> str:
    """Which samples differ from the calibrated bare model, of the worst place alone."""
    place = worst_place(found)
    if place is None:
        whole = found.comparison["p"] if found.comparison else (found.discovery or {}).get("p_misfit")
        if found.comparison and is_untested(found.comparison):
            return untested_sentence(found.comparison)
        return (
            "The calibrated model does not agree with the measurements as a whole."
            if fails(whole)
            else AGREES
        )
    words, axis = words_of(place["observable"]), place["axis"]
    told = [(stretch["sign"], subject_words(found, axis, stretch)) for stretch in place.get("stretches", ())]
    parts = [
        f"{subject} {words.above if sign > 0 else words.below} than the model says" for sign, subject in told
    ]
    if not parts:
        return f"{place['sentence'].rstrip('.')}."
    return "; ".join([parts[0], *(part[0].lower() + part[1:] for part in parts[1:])]) + "."


def worst_place(found: Results) -> Document | None:
    """Place of the worst misfit of the bare model; a stretch of a condition before a whole observable."""
    failing = [place for place in found.where if fails(place["p"])]
    along = [place for place in failing if place["axis"] != LEVEL]
    return next(iter(along or failing), None)


def subject_words(found: Results, axis: str, stretch: Document) -> str:
    """Samples of a stretch, such as `Grains up to 0.23 mm`, with the ends that the place's sentence tells."""
    sides = ("low", "high", "level")
    ends = {
        side: found.units.condition_text(axis, stretch[side])
        for side in sides
        if stretch.get(side) is not None
    }
    if stretch["low"] is None and stretch["high"] is None:
        return EVERYWHERE
    condition = found.table.condition(axis)
    samples = samples_words(condition.name, condition.path)
    if "level" in ends:
        return f"{samples} of {ends['level']}"
    if len(ends) == 2:
        return f"{samples} of {ends['low']} to {ends['high']}"
    return f"{samples} from {ends['low']}" if "low" in ends else f"{samples} up to {ends['high']}"


def answer_sentences(found: Results) -> Iterator[str]:
    """What is missing, and whether the error falls with it on measurements that no fit has seen."""
    if found.adoption:
        yield error_sentence(found.adoption, found.units)
        if found.discovery and found.discovery["verdict"] == "outside_library":
            yield spoken(found.discovery)
    elif found.discovery:
        discovery = found.discovery
        if discovery["verdict"] != "present":
            yield spoken(discovery)
            return
        names = [effect_words(name) for name in discovery["named"]]
        share = 100.0 * max((discovery["probabilities"].get(label) or 0.0) for label in labels_of(discovery))
        words = f"{listed(names)} (probability {share:.0f} %)"
        yield f"The measurements are consistent with a missing effect: {words}."


def spoken(discovery: Document) -> str:
    """First sentence of a discovery that names no single effect, with the names of effects in words."""
    first = discovery["sentences"][0]
    if discovery["verdict"] == "none_detected":
        first = first.partition(". ")[0].rstrip(".") + "."
    for name in discovery["effects"]:
        first = first.replace(name, effect_words(name))
    return first


def labels_of(discovery: Document) -> list[str]:
    """Keys of what is named among the probabilities."""
    named = list(discovery["named"])
    return ["+".join(named), "+".join(reversed(named)), *named[:1]]


def error_sentence(adoption: Document, units: TableUnits) -> str:
    """Error on the held-out measurements before and after, by observable, in its unit."""
    base, added = adoption["base"], adoption["added"]
    names = listed([effect_words(name) for name in added["effects"]])
    if not base["vault_rmse"] or added["vault_chi2_per_row"] is None:
        change = f"from {short(base['chi2_per_row'])} to {short(added['chi2_per_row'])}"
        return (
            f"With {names} the misfit per fitted row goes {change}; "
            "no measurement was held out, so nothing is proved."
        )
    count = len((base["vault_rows"] or {"observable": ()})["observable"])
    unseen = unseen_words(adoption["vault"]["opened"])
    rows, words = adoption["rows_hidden"], counted(count, "measurement")
    if rows > count:
        words = f"{counted(count, 'measured mean')} of {rows} rows"
    seen = f"{words} {unseen}"
    left = open_words(adoption)
    end = f"; {left}." if left else "."
    return f"With {names} the error on {seen} {change_words(base, added, units)}{end}"


def change_words(base: Document, added: Document, units: TableUnits) -> str:
    """`falls from 0.093 to 0.030 m/s`; of several observables each by its name."""
    before, after = base["vault_rmse"], added["vault_rmse"]
    ends = {
        name: [short(units.value(name, side[name]) or 0.0) for side in (before, after)] for name in before
    }
    sides = {
        name: with_unit(f"from {first} to {last}", units.value_unit(name))
        for name, (first, last) in ends.items()
    }
    falling = [after[name] < before[name] for name in before]
    verb = "falls" if all(falling) else "changes" if any(falling) else "rises"
    if len(sides) == 1:
        return f"{verb} {next(iter(sides.values()))}"
    if verb == "changes" and len(sides) <= MOST_TOLD:
        verbs = ("rises" if not down else "falls" for down in falling)
        nouns = (words_of(name).noun for name in sides)
        told = zip(verbs, sides.values(), nouns, strict=True)
        return listed([f"{way} {words} for {noun}" for way, words, noun in told])
    if len(sides) > MOST_TOLD:
        most = max(before, key=lambda name: before[name] / max(after[name], 1e-300))
        told = f"most for {words_of(most).noun}, {sides[most]}"
        return f"{verb} for {sum(falling) or len(sides)} of {len(sides)} observables, {told}"
    return f"{verb}: {listed([f'{words_of(name).noun} {words}' for name, words in sides.items()])}"


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
    """`36 µN`: number in two digits with the prefix that makes it readable."""
    return str(EngFormatter(unit)(float(f"{value:.2g}")))
