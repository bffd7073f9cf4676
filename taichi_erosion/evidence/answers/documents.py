"""Renderings of findings: sentences for people, JSON documents for machines, and the folder that holds them.

Sentences and documents are made from the records alone. "Consistent with" and "not distinguished from" are
said; "caused by" never.
"""

import json
import platform
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from importlib.metadata import version
from math import isnan, nan
from pathlib import Path
from typing import Any, Literal

import numpy as np

from taichi_erosion import __version__
from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.files import read_text_file, write_atomic
from taichi_erosion.evidence.answers.agreement_words import refuted, row_sentences, uneven
from taichi_erosion.evidence.answers.finding_sentences import set_sentences, trend_sentences, unstable_words
from taichi_erosion.evidence.data import number_words
from taichi_erosion.evidence.data.findings import (
    NONE,
    OUTSIDE,
    SILENT,
    Adoption,
    Discovery,
    HypothesisFit,
    NearestHypothesis,
    Variants,
    VaultErrors,
)
from taichi_erosion.evidence.data.number_words import counted
from taichi_erosion.evidence.data.table_units import KEY
from taichi_erosion.evidence.inference import verdict_levels as levels
from taichi_erosion.evidence.models.load_study import Study
from taichi_erosion.measures.result import without_nan

Command = Literal["compare", "discover", "adopt", "next", "predict", "rounds"]
Document = dict[str, Any]
FORMAT = 2  # of documents: their keys are those of docs/json.md
LADDER = "ladder.json"  # errors after each adoption, shared by the studies that follow one another
ROUNDS: Command = "rounds"  # no command: what the rounds of simulations were about
FIGURE_ROWS = ("rows", "rows_before", "rows_after", "vault_rows")  # of a document, drawn but not printed
LIBRARIES = ("numpy", "scipy")
MOST_VARIANTS = 3  # told
NO_CANDIDATE = "No candidate is listed, so nothing can be named; `compare` says where the model fails."
RED_FLAG = "Red flag: a made-up effect explains the misfit better than any named one in the screen."


def discovery_sentences(found: Discovery) -> tuple[str, ...]:
    """Verdict first, then where the model fails, then what would change the conclusion."""
    if not found.effects:
        return NO_CANDIDATE, *found.noise.sentences
    if not found.noise.known:
        return found.noise.sentences
    sentences = [*level_sentences(found), *error_sentences(found), verdict_sentence(found)]
    sentences += [found.fresh_runs.sentence] if found.fresh_runs else []
    if found.calibrated_with and levels.fails(found.p_misfit_after):
        names, chance = " and ".join(found.calibrated_with), levels.p_text(found.p_misfit_after)
        sentences.append(
            f"Even with {names} the model fails ({chance}): its law may be another than ours, or something "
            "else acts too that these candidates do not describe."
        )
    if found.calibrated_with and found.stuck_after:
        names, numbers = " and ".join(found.calibrated_with), " and ".join(found.stuck_after)
        sentences.append(
            f"With {names} the calibration still drives {numbers} to the end of its range: check that range, "
            "and units, before you trust the name."
        )
    told_names = (*found.named, *found.group)
    sentences += [each.sentence for each in found.opposed if each.effect in told_names]
    sentences += trend_sentences(found.trend)
    sentences += nearest_sentences(found.nearest)
    if found.verdict == "outside_library":
        sentences += row_sentences(None if found.worst_row is None else asdict(found.worst_row))
    sentences += [
        place.sentence for place in found.where if levels.fails(place.p) and not found.range_suffices
    ]
    sentences += [] if found.beyond is None else found.beyond.sentences
    sentences += [trend.sentence for trend in found.clues]
    sentences += [found.varying.sentence] if found.varying else []
    sentences += found.noise.sentences
    if found.decoy_rank == 1 and found.named:
        sentences.append(RED_FLAG)
    return *sentences, *set_sentences(found), *variant_sentences(found.variants), rival_sentence(found)


def variant_sentences(told: Variants) -> list[str]:
    """In how many variants the answer holds, and what it becomes in a few of the others."""
    if told.count == 0:
        return []
    if told.holds == told.count:
        return [f"The answer holds in all {told.count} variants of tolerances, priors and rows."]
    more = len(told.changes) - MOST_VARIANTS
    rest = f"; and so on, {more} more" if more > 0 else ""
    return [
        f"The answer holds in {told.holds} of {told.count} variants of tolerances, priors and rows. "
        f"In the others the likeliest is: {'; '.join(told.changes[:MOST_VARIANTS])}{rest}."
    ]


def error_sentences(found: Discovery) -> list[str]:
    """Errors that nobody stated and on which the answer rests, and what it were without them."""
    told = [each.sentence for each in found.errors]
    if told and found.errors_stated:
        sure = (
            "" if found.errors_probability > levels.SURE_LEVEL else f" ({found.errors_probability:.0%} sure)"
        )
        told.append(
            f"The answer rests on this{sure}; with errors as stated the likeliest is {found.errors_stated}."
        )
    return told


def nearest_sentences(nearest: NearestHypothesis | None) -> list[str]:
    """The explanation of the list that comes closest where none suffices; whether it ends at a maximum."""
    if nearest is None:
        return []
    names, chance = " and ".join(nearest.names), levels.p_text(nearest.p)
    told = [
        f"Of the list, {names} comes closest: it takes away {nearest.explained:.0%} of the misfit "
        f"beyond chance ({chance} of what it leaves)."
    ]
    if nearest.at_maximum:
        ends = " and ".join(nearest.at_maximum)
        told.append(f"There {ends} ends at the largest strength that the list allows.")
    return told


def verdict_sentence(found: Discovery) -> str:
    """One sentence for the verdict."""
    if levels.too_few_rows(found.n, found.calibrated):
        return (
            f"{counted(found.n, 'measured mean')} of known scatter cannot decide where "
            f"{counted(found.calibrated, 'number')} {'is' if found.calibrated == 1 else 'are'} calibrated; "
            f"nothing is named. Could be hiding: {', '.join(found.effects)}."
        )
    if found.verdict in SILENT:
        return silence_sentence(found)
    if found.verdict == "outside_library":
        return (
            f"Something is missing that {no_set(len(found.effects))} of the list describes "
            f"(probability {found.probabilities[OUTSIDE]:.2g}; {decisive_chance(found)})."
        )
    if found.verdict == "unstable":
        return unstable_words(found.fresh_runs)
    if found.verdict == "group":
        return group_sentence(found)
    details = "; ".join(found.effects[name].sentence for name in found.named)
    return f"The misfit is consistent with a missing effect (family-wise p = {found.p:.2g}): {details}."


def level_sentences(found: Discovery) -> list[str]:
    """Levels that are off, and whether a misfit is seen along the conditions of these observables."""
    if found.level_probability <= levels.LEVEL_ODDS or found.range_suffices:
        return []
    if not found.levels:
        if found.level_probability <= levels.SURE_LEVEL:
            return []
        return [
            "The levels of the observables do not fit together, at no calibration: an instrument, a method, "
            "the contact law or a range is off at all conditions alike; which one is open."
        ]
    told = [shift.sentence for shift in found.levels]
    for shift in found.levels:
        own = [place for place in found.where if place.observable == shift.observable]
        axes = [place for place in own if place.axis != "level"]
        if axes and not any(levels.fails(place.p) for place in axes):
            told.append(
                f"{shift.observable}: along {', '.join(sorted(p.axis for p in axes))} no misfit is seen."
            )
    return told


def group_sentence(found: Discovery) -> str:
    """What is sure, and among which effects these measurements do not decide."""
    open_ones = ", ".join(name for name in found.group if name not in found.named)
    count = effects_of_group(found) - len(found.named)
    number = ("one", "two", "three", "four")[min(max(count, 1), 4) - 1]
    if len(found.group) == 1 and not found.named:
        return single_sentence(found)
    if found.named:
        sure = " and ".join(found.named)
        return (
            f"{sure} {'is' if len(found.named) == 1 else 'are'} missing, and {number} of {open_ones} with "
            f"{'it' if len(found.named) == 1 else 'them'}; these measurements do not distinguish them."
        )
    return (
        f"{number.capitalize()} of {open_ones} {'are' if count > 1 else 'is'} missing; these measurements do "
        "not distinguish them."
    )


def single_sentence(found: Discovery) -> str:
    """The only effect of a group, which is likelier than nothing but not sure."""
    name, likely = found.group[0], found.probabilities
    others = f"nothing is (probability {likely.get(NONE, 0.0):.2g}) or something outside the list is"
    chance = f"{likely.get(name, 0.0):.2g}"
    return (
        f"{name} may be missing (probability {chance}); these measurements do not exclude that {others} "
        f"({likely.get(OUTSIDE, 0.0):.2g})."
    )


def effects_of_group(found: Discovery) -> int:
    """How many effects of a group act: the size of set that holds most of its probability."""
    share: dict[int, float] = {}
    for key, probability in found.probabilities.items():
        if set(key.split("+")) <= set(found.group):
            size = len(key.split("+"))
            share[size] = share.get(size, 0.0) + probability
    return max(share, key=lambda size: share[size], default=1)


def no_set(candidates: int) -> str:
    """No set of effects among so many candidates, up to the largest that is searched."""
    most = min(candidates, levels.MOST_EFFECTS)
    return f"no set of up to {('one', 'two', 'three', 'four')[most - 1]} effects" if most > 1 else "no effect"


def decisive_chance(found: Discovery) -> str:
    """The chance that showed that something is missing."""
    if levels.fails(found.p_misfit):
        return f"{levels.p_text(found.p_misfit)} of the misfit"
    place = min(found.where, key=lambda each: each.p, default=None)
    if place is not None and levels.fails(place.p):
        return f"{levels.p_text(place.p)} of the misfit of {place.observable} along {place.axis}"
    return f"{levels.p_text(found.p)} of the best candidate"


def rejection_sentences(found: Discovery) -> list[str]:
    """A misfit without a name: how large it is, and the likeliest plain reasons."""
    places = [place for place in found.where if levels.fails(place.p)]
    if not levels.fails(found.p_misfit) and not places:
        return []
    told = [f"The calibrated model does not agree with the measurements ({decisive_chance(found)})."]
    if found.range_suffices:
        numbers = " and ".join(found.stuck) or "a calibrated number"
        told.append(
            f"The misfit is gone if {numbers} may leave its range: widen the range, or check a unit. Until "
            "then nothing can be concluded on effects."
        )
        return told
    told += row_sentences(None if found.worst_row is None else asdict(found.worst_row))
    factor = f"{found.scatter_factor:.2g}"
    if found.worst_row is None and found.scatter_factor > 1.0 and factor != "1":
        told.append(f"A scatter {factor} times as large as stated would explain it.")
        if not places:
            told.append("The misfit is spread over the rows, along no condition.")
    return told


def silence_sentence(found: Discovery) -> str:
    """What is excluded and what could be hiding; never a bare "nothing is missing"."""
    excluded = [
        f"{n} above {e.strength_high:.2g}" for n, e in found.effects.items() if e.status == "excluded"
    ]
    left = {name: effect for name, effect in found.effects.items() if effect.status == "not_testable"}
    hiding = [name for name, effect in left.items() if effect.power < levels.TESTABLE_POWER]
    possible = [f"{n} up to {e.strength_high:.2g}" for n, e in left.items() if n not in hiding]
    rejected = rejection_sentences(found)
    words = "No effect is named." if rejected or likelier_than_nothing(found) else "No detectable effect."
    words = " ".join([*rejected, words])
    if excluded and not found.range_suffices:
        words += f" Excluded: {', '.join(excluded)}."
    if possible:
        words += f" Not excluded: {', '.join(possible)}."
    if hiding:
        words += f" Could be hiding, because these measurements cannot test them: {', '.join(hiding)}."
    return words


def rival_sentence(found: Discovery) -> str:
    """What would change the conclusion."""
    if found.range_suffices:
        return (
            "Probabilities of effects mean nothing while a calibrated number is held at the end of its range."
        )
    others = {key: p for key, p in found.probabilities.items() if not told(found, key)}
    rival = max(others, key=lambda key: others[key], default=NONE)
    if others.get(rival, 0.0) < levels.REPORTED_RIVAL:
        return "No other explanation is left with a probability worth naming."
    called = {NONE: "that nothing is missing", OUTSIDE: "an effect outside the library"}
    called = called.get(rival, " with ".join(rival.split("+")))
    if likelier_than_nothing(found):
        return (
            f"The likeliest explanation is {called} (probability {others[rival]:.2g}, against "
            f"{found.probabilities[NONE]:.2g} that nothing is missing), which is not enough to name it."
        )
    weak = sum(effect.status == "not_testable" for effect in found.effects.values())
    best = f"The next best explanation is {called} (probability {others[rival]:.2g})"
    if not weak:
        return f"{best}."
    return (
        f"{best}; {weak} of {len(found.effects)} candidates are left open by these measurements, and data "
        "that test them could change the conclusion."
    )


def likelier_than_nothing(found: Discovery) -> bool:
    """Whether an answer without a name has an explanation that is likelier than that nothing is missing."""
    return found.verdict in SILENT and max(found.probabilities.values()) > found.probabilities[NONE]


def told(found: Discovery, key: str) -> bool:
    """Whether the verdict contains an explanation; a group contains every combination of its members."""
    if found.verdict in SILENT:
        return key == NONE
    if found.verdict == "outside_library":
        return key == OUTSIDE
    if found.verdict in ("group", "unstable"):
        return set(key.split("+")) <= {*found.named, *found.group}
    return set(key.split("+")) == set(found.named)


def adoption_sentence(found: Adoption) -> str:
    """Errors of the held-out rows before and after, with the controls."""
    effect, base, added = " and ".join(found.effect.split("+")), found.base, found.added
    if isnan(added.vault_chi2_per_row):
        change = f"from {number_words.plain(base.chi2_per_row)} to {number_words.plain(added.chi2_per_row)}"
        return (
            f"With {effect} the misfit per fitted row goes {change}; no row was held out, so nothing is "
            f"proved.{missing_sentence(found)}"
        )
    before, after = (number_words.plain(fit.vault_chi2_per_row) for fit in (base, added))
    change = f"from {before} to {after}"
    words = f"With {effect} the misfit per held-out row goes {change}"
    controls = ((found.best_wrong, "the best other candidate"), (found.random_wrong, "a random one"))
    told = [
        f"{number_words.plain(fit.vault_chi2_per_row)} with {what} ({fit.effects[0]})"
        for fit, what in controls
        if fit is not None
    ]
    words += f"; for comparison {', '.join(told)}{uneven(base, added)}" if told else uneven(base, added)
    if found.with_all is not None:
        names = " and ".join(found.with_all.effects)
        after = number_words.plain(found.with_all.vault_chi2_per_row)
        words += f" With all that was named ({names}) it goes to {after}: adopt these together."
    judged = found.with_all or added
    if found.contradicted:
        words += f" What was held out does not bear {' and '.join(judged.effects)} out{wider(base, judged)}."
    adequate = (
        "" if found.unstated_scatter and not levels.fails(judged.vault_p) else adequacy_sentence(judged)
    )
    silent = "".join(f" {each}" for each in found.unstated_scatter)
    return words + adequate + control_sentence(found) + missing_sentence(found) + silent


def wider(base: HypothesisFit, judged: HypothesisFit) -> str:
    """Why held-out rows contradict although their misfit falls; empty where it does not fall clearly."""
    if not judged.vault_chi2_per_row < base.vault_chi2_per_row or refuted(
        base.vault_chi2_per_row, judged.vault_chi2_per_row
    ):
        return ""
    return ": it predicts them with wider errors, not better"


def adequacy_sentence(judged: HypothesisFit) -> str:
    """Whether the model with what was named is adequate on the held-out rows."""
    if isnan(judged.vault_p):
        return ""
    chance = levels.p_text(judged.vault_p)
    if levels.fails(judged.vault_p):
        return f" It is not adequate there ({chance}): something else acts too, or its law is another."
    return f" Beyond that the held-out rows show no misfit ({chance})."


def control_sentence(found: Adoption) -> str:
    """A control that predicts the held-out rows as well as what was adopted; nothing where none does."""
    rows = found.added.vault_rows
    count = len(rows.observable) if rows is not None else 0
    limit = found.added.vault_log_score - 0.5 * levels.RIVAL_MISFIT / max(count, 1)
    controls = (found.best_wrong, found.random_wrong)
    good = (fit.effects[0] for fit in controls if fit is not None and fit.vault_log_score > limit)
    equal = tuple(dict.fromkeys(good))
    if not equal:
        return ""
    verb = "does" if len(equal) == 1 else "do"
    return f" {' and '.join(equal)} {verb} as well there: these rows do not tell them apart."


def missing_sentence(found: Adoption) -> str:
    """How many held-out rows do not count for want of a value; nothing where all do."""
    if found.base.vault_rows is None:
        return ""
    missing = found.held_out - len(found.base.vault_rows.observable)
    return f" For {missing} of {found.held_out} held-out rows there is no value." if missing else ""


def plain(value: Any) -> Any:
    """A nested value with lists for arrays and tuples, plain numbers for NumPy's, None for NaN."""
    if isinstance(value, np.ndarray | np.generic):
        return plain(value.tolist())
    if isinstance(value, Mapping):
        return {str(key): plain(entry) for key, entry in value.items()}
    if isinstance(value, Sequence) and not isinstance(value, str):
        return [plain(entry) for entry in value]
    return without_nan(value)


def record(found: Any) -> Any:
    """A record of findings as plain tables."""
    return plain(asdict(found))


def study_document(study: Study) -> Document:
    """The part of every document that describes its study."""
    table = study.problem.measurements
    versions = {"taichi_erosion": __version__, "python": platform.python_version()}
    return {
        "format": FORMAT,
        "study": str(study.path),
        "title": study.file.study.title,
        "model": study.model,
        "measurements": study.file.study.measurements,
        "digest": study.digest[:12],
        "seed": study.file.study.seed,
        "adopted": list(study.file.adopted),
        "candidates": study.problem.candidate_names,
        "units": dict(zip(table.observable, table.unit, strict=True)),
        KEY: table.table_units.record(),
        "notes": list(study.notes),
        "rows_visible": table.size - len(study.problem.vault.rows),
        "rows_hidden": len(study.problem.vault.rows),
        "versions": versions | {name: version(name) for name in LIBRARIES},
    }


def adopt_document(found: Adoption, opened: int, files: Sequence[str]) -> Document:
    """The document of `adopt --json`: errors on fitted and held-out rows, and the files, the study first."""
    control, rows = found.random_wrong or found.best_wrong, found.added.vault_rows
    base, added = found.base.vault_chi2_per_row, found.added.vault_chi2_per_row
    wrong = control.vault_chi2_per_row if control else nan
    count = len(rows.observable) if rows is not None else 0
    vault = VaultErrors(
        opened, count * base, count * added, count * wrong, base, added, wrong, found.added.effects
    )
    document = record(found) | {"vault": record(vault), "written": files[0], "files": list(files)}
    n, before, after = len(found.base.rows.observable), found.base.chi2_per_row, found.added.chi2_per_row
    totals = {"n": n, "chi2_before": n * before, "chi2_after": n * after}
    return document | plain(totals | {"chi2_per_row_before": before, "chi2_per_row_after": after})


def without_rows(document: Document) -> Document:
    """A document as printed: what figures are drawn from stays in the results folder."""
    return {
        key: without_rows(entry) if isinstance(entry, dict) else entry
        for key, entry in document.items()
        if key not in FIGURE_ROWS
    }


def document_file(folder: Path, stem: str, command: Command) -> Path:
    """File of the last answer of a command; studies that follow one another share a folder."""
    return folder / f"{stem}.{command}.json"


def write_document(file: Path, document: Document) -> Path:
    """Write a document in place of an earlier one."""
    return write_atomic(file, (json.dumps(document, indent=1, allow_nan=False) + "\n").encode())


def read_answer(folder: Path, stem: str, command: Command) -> Document | None:
    """The last answer of a command, None if it has not been given in this format."""
    document = read_document(document_file(folder, stem, command))
    if document is None or command == ROUNDS:
        return document
    return document if document.get("format") == FORMAT else None


def read_document(file: Path) -> Document | None:
    """A stored document, None if there is none; raises BadInput for a damaged one."""
    if not file.exists():
        return None
    try:
        document = json.loads(read_text_file(file))
    except (ValueError, OSError) as error:
        raise BadInput(f"{file}: cannot be read ({error}); remove it and ask again") from None
    if not isinstance(document, dict):
        raise BadInput(f"{file}: holds no result; remove it and ask again")
    return document


def extend_ladder(folder: Path, rung: Document) -> None:
    """Add a rung to the error ladder; adopting the same effects again replaces it and all above it."""
    kept = [r for r in ladder(folder, rung["of"]) if len(r["effects"]) < len(rung["effects"])]
    write_document(folder / LADDER, {"rungs": [*kept, rung]})


def ladder(folder: Path, digest: str) -> list[Document]:
    """Rungs of the error ladder on a table, from the model as it came to the last adoption."""
    document = read_document(folder / LADDER)
    rungs = [] if document is None else document["rungs"]
    return [each for each in rungs if each.get("of") == digest and "chi2_per_row_fitted" in each]
