"""First sentences of the page of a study: where the model fails, what is missing, how far the error falls."""

from collections.abc import Iterator

from taichi_erosion.evidence.answers.words.agreement import is_untested, row_sentences, untested_sentence
from taichi_erosion.evidence.answers.words.held_out import open_words, unseen_words
from taichi_erosion.evidence.data.number_words import counted, short, with_unit
from taichi_erosion.evidence.data.table_units import TableUnits
from taichi_erosion.evidence.inference.verdict_levels import fails
from taichi_erosion.report.evidence_results import Document, Results
from taichi_erosion.report.plain_words import EVERYWHERE, condition_words, effect_words, listed, words_of

MOST_TOLD = 3  # observables whose errors a sentence lists
LEVEL = "level"  # axis of a misfit of an observable as a whole
AGREES = "The calibrated model agrees with the measurements."


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
    parts = [f"{subject} {words.above if sign > 0 else words.below}" for sign, subject in told]
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
    if stretch["low"] is None and stretch["high"] is None:
        return EVERYWHERE
    ends = {
        side: found.units.condition_text(axis, stretch[side])
        for side in ("low", "high")
        if stretch[side] is not None
    }
    condition = found.table.condition(axis)
    words = condition_words(condition.name, condition.path)
    if stretch.get("level") is not None:
        return words.single.format(found.units.condition_text(axis, stretch["level"]))
    form = words.middle if len(ends) == 2 else words.high if "low" in ends else words.low
    return form.format(**ends)


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
