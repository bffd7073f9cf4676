"""First sentences of the page of a study: where the model fails, what is missing, how far the error falls."""

from collections.abc import Iterator, Mapping, Sequence

from taichi_erosion.evidence.inference.verdict_levels import HELD_OUT_MISFIT, HELD_OUT_SHARE, fails
from taichi_erosion.report.evidence_results import Document, Results, layers
from taichi_erosion.report.plain_words import (
    EVERYWHERE,
    between,
    condition_words,
    effect_words,
    listed,
    short,
    with_unit,
    words_of,
)

BESIDE = 1e-6  # of a level: closer numbers are one level
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
    words, axis = words_of(place["observable"]), place["axis"]
    told = [
        (stretch["sign"], subject_words(found, place["observable"], axis, stretch))
        for stretch in place.get("stretches", ())
    ]
    parts = [f"{subject} {words.above if sign > 0 else words.below}" for sign, subject in told]
    if not parts:
        return f"{place['sentence'].rstrip('.')}."
    return "; ".join([parts[0], *(part[0].lower() + part[1:] for part in parts[1:])]) + "."


def worst_place(found: Results) -> Document | None:
    """Place of the worst misfit of the bare model; a stretch of a condition before a whole observable."""
    failing = [place for place in found.where if fails(place["p"])]
    along = [place for place in failing if place["axis"] != LEVEL]
    return next(iter(along or failing), None)


def subject_words(found: Results, observable: str, axis: str, stretch: Document) -> str:
    """Samples of a stretch, such as `Grains finer than 0.23 mm`."""
    if stretch["low"] is None and stretch["high"] is None:
        return EVERYWHERE
    condition, rows = found.table.condition(axis), layers(found)[0].fitted
    column = rows["conditions"].get(axis, ())
    pairs = zip(rows["observable"], column, strict=False)
    levels = [condition.shown(value) for name, value in pairs if name == observable and value is not None]
    ends = {
        side: with_unit(f"{boundary(condition.shown(stretch[side]), levels, side):.3g}", condition.unit)
        for side in ("low", "high")
        if stretch[side] is not None
    }
    words = condition_words(condition.name, condition.path)
    form = words.middle if len(ends) == 2 else words.high if "low" in ends else words.low
    return form.format(**ends)


def boundary(end: float, levels: Sequence[float], side: str) -> float:
    """Short number between the end of a stretch and the next measured level beyond it."""
    slack = BESIDE * abs(end)
    beyond = [level for level in levels if (level < end - slack if side == "low" else level > end + slack)]
    if not beyond:
        return end
    return between(end, max(beyond) if side == "low" else min(beyond))


def answer_sentences(found: Results) -> Iterator[str]:
    """What is missing, and whether the error falls with it on measurements that no fit has seen."""
    if found.adoption:
        yield error_sentence(found.adoption)
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
