"""First sentences of the page of a study: where the model fails, what is missing, how far the error falls."""

from collections.abc import Iterator, Mapping

import numpy as np

from taichi_erosion.evidence.inference.levels import HELD_OUT_MISFIT, HELD_OUT_SHARE, fails
from taichi_erosion.report.evidence_results import Document, Results, layers
from taichi_erosion.report.figures import numbers
from taichi_erosion.report.measured_table import Condition
from taichi_erosion.report.plain_words import (
    EVERYWHERE,
    Stretch,
    condition_words,
    effect_words,
    failing_stretch,
    listed,
    short,
    with_unit,
    words_of,
)

LEVEL = "level"  # axis of a misfit of an observable as a whole
AGREES = "The calibrated model agrees with the measurements."


def lead(found: Results) -> list[str]:
    """Sentences above the first figure."""
    return [failure_sentence(found), *answer_sentences(found)]


def failure_sentence(found: Results) -> str:
    """Which samples differ from the calibrated bare model, of the worst place alone."""
    place = worst_place(found)
    if place is None:
        whole = found.comparison["p"] if found.comparison else (found.discovery or {}).get("p_misfit")
        return (
            "The calibrated model does not agree with the measurements as a whole."
            if fails(whole)
            else AGREES
        )
    stretch, subject = stretch_of(found, place), EVERYWHERE
    words = words_of(place["observable"])
    if stretch is None:
        return f"{place['sentence'].rstrip('.')}."
    if place["axis"] != LEVEL:
        subject = stretch_words(found.table.condition(place["axis"]), stretch)
    return f"{subject} {words.above if stretch.sign > 0 else words.below}."


def worst_place(found: Results) -> Document | None:
    """Place of the worst misfit of the bare model; a stretch of a condition before a whole observable."""
    failing = [place for place in found.where if fails(place["p"])]
    along = [place for place in failing if place["axis"] != LEVEL]
    return next(iter(along or failing), None)


def stretch_of(found: Results, place: Document) -> Stretch | None:
    """Part of a condition where the model fails, in the unit of the table."""
    rows = layers(found)[0].fitted
    chosen = [k for k, name in enumerate(rows["observable"]) if name == place["observable"]]
    residual = numbers([rows["residual"][k] for k in chosen])
    if place["axis"] == LEVEL:
        return Stretch(1 if np.nansum(residual) > 0.0 else -1, None, None)
    condition = found.table.condition(place["axis"])
    column = rows["conditions"].get(place["axis"])
    return (
        None
        if column is None
        else failing_stretch([condition.shown(column[k]) for k in chosen], list(residual))
    )


def stretch_words(condition: Condition, stretch: Stretch) -> str:
    """`Grains finer than 0.23 mm`."""
    words = condition_words(condition.name, condition.path)
    ends = {
        key: with_unit(f"{end:.3g}", condition.unit)
        for key, end in (("low", stretch.low), ("high", stretch.high))
        if end is not None
    }
    form = words.middle if len(ends) == 2 else words.high if "low" in ends else words.low
    return form.format(**ends)


def answer_sentences(found: Results) -> Iterator[str]:
    """What is missing, and whether the error falls with it on measurements that no fit has seen."""
    if found.adoption:
        yield error_sentence(found.adoption)
    elif found.discovery:
        discovery = found.discovery
        if discovery["verdict"] != "present":
            yield discovery["sentences"][0]
            return
        names = [effect_words(name) for name in discovery["named"]]
        share = 100.0 * max((discovery["probabilities"].get(label) or 0.0) for label in labels_of(discovery))
        words = f"{listed(names)} (probability {share:.0f} %)"
        yield f"The measurements are consistent with a missing effect: {words}."


def labels_of(discovery: Document) -> list[str]:
    """Keys of what is named among the probabilities."""
    named = list(discovery["named"])
    return ["+".join(named), "+".join(reversed(named)), *named[:1]]


def error_sentence(adoption: Document) -> str:
    """Error on the held-out measurements before and after, by observable, in its unit."""
    base, added = adoption["base"], adoption["added"]
    names = listed([effect_words(name) for name in added["effects"]])
    if not base["vault_rmse"] or added["vault_chi2"] is None:
        change = f"from {short(base['chi2'])} to {short(added['chi2'])}"
        return (
            f"With {names} the misfit per fitted row goes {change}; "
            "no measurement was held out, so nothing is proved."
        )
    count = len((base["vault_rows"] or {"observable": ()})["observable"])
    seen = f"{count} measurement{'s' if count != 1 else ''} that no fit has seen"
    judged = adoption.get("with_all") or added
    end = ": they do not confirm it." if is_refuted(base, judged) else "."
    return f"With {names} the error on {seen} {change_words(base, added, adoption['units'])}{end}"


def is_refuted(base: Document, added: Document) -> bool:
    """Whether the held-out measurements contradict the effect, as `adopt` judges it."""
    before, after = base["vault_chi2"], added["vault_chi2"]
    return before > HELD_OUT_MISFIT and after > HELD_OUT_SHARE * before


def change_words(base: Document, added: Document, units: Mapping[str, str]) -> str:
    """`falls from 0.093 to 0.030 m/s`; of several observables each by its name."""
    before, after = base["vault_rmse"], added["vault_rmse"]
    sides = {
        name: f"from {short(before[name])} to {value_words(after[name], name, units)}" for name in before
    }
    falling = [after[name] < before[name] for name in before]
    verb = "falls" if all(falling) else "changes" if any(falling) else "rises"
    if len(sides) == 1:
        return f"{verb} {next(iter(sides.values()))}"
    return f"{verb}: {listed([f'{words_of(name).noun} {words}' for name, words in sides.items()])}"


def value_words(value: float, name: str, units: Mapping[str, str]) -> str:
    """`0.030 m/s`."""
    return with_unit(short(value), units.get(name, "1"))
