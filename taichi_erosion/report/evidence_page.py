"""Page of an evidence study: one self-contained HTML file, or a recording, from the stored results.

The first screen holds what was found, in words and in one figure; the page ends with the limits of the
conclusion and with what makes it repeatable.
"""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from taichi_erosion.campaign.study_file import read_evidence_study
from taichi_erosion.core.files import marked_html, refuse_foreign, write_atomic
from taichi_erosion.evidence.answers.agreement_words import (
    FITTED_ERRORS,
    HELD_OUT_ERRORS,
    NO_MISFIT,
    is_untested,
    row_sentences,
    untested_sentence,
)
from taichi_erosion.evidence.data.number_words import heading
from taichi_erosion.evidence.inference.verdict_levels import ABSORBED, PLAUSIBLE, STABLE, fails
from taichi_erosion.evidence.models.load_study import results_folder
from taichi_erosion.recording.study_recording import StudyPage, record_study
from taichi_erosion.report import figure_style, study_figures
from taichi_erosion.report.figure_style import Picture
from taichi_erosion.report.html import made, number, render
from taichi_erosion.report.markdown import markdown_table
from taichi_erosion.report.pictures.answers import draw_adoptions, draw_doses, draw_posterior, draw_vault
from taichi_erosion.report.results import CONTROLS, Document, Results, layers, stored_results
from taichi_erosion.report.sentences import LEVEL, lead, strength_words, worst_place
from taichi_erosion.report.study_figures import Panel
from taichi_erosion.report.words import effect_words, listed, words_of

TEMPLATE = "evidence.html"
RECORDING = "study.rrd"
MOST_SHOWN = 4  # observables in the first figure before a reader asks for others
ANSWERS = ("comparison", "discovery", "adoption", "prediction")  # that the template reads
TIMES = {0: "has not been opened", 1: "was opened once"}
UNDECLARED_NUMERICS = (
    "Numerics: the study declares no tolerance for box, time step and grain number. A smooth numerical error "
    "of the model would look like a missing effect."
)


def write_report(study: Path, to: Path | None = None, force: bool = False) -> Path:
    """Write the HTML page of a study. Raises BadInput without a stored result."""
    found = stored_results(study)
    to = to or results_folder(study, read_evidence_study(study)) / f"{study.stem}.report.html"
    refuse_foreign(to, study, force)
    return write_atomic(to, marked_html(to, study, render(TEMPLATE, page_fields(found))))


def write_recording(study: Path) -> Path:
    """Write the recording of a study. Raises BadInput without a stored result."""
    found = stored_results(study)
    folder, first = results_folder(study, read_evidence_study(study)), found.first
    title = title_of(first)
    drawn = {"agreement": first_panels(panels(found))[0]["picture"], **pictures(found)}
    page = StudyPage(
        title=title,
        summary="\n\n".join([f"# {title}", *lead(found)]),
        table=row_table(found),
        figures={name: figure_style.raster(one.figure) for name, one in drawn.items() if one},
        properties={"rows": first["rows_visible"], "held_out": first["rows_hidden"], "seed": first["seed"]},
    )
    return record_study(folder / f"{study.stem}.{RECORDING}", page)


def title_of(document: Document) -> str:
    """Title of a study, its file name where it has none."""
    return document["title"] or Path(document["study"]).stem


def row_table(found: Results) -> str:
    """Measured and predicted values of every fitted row."""
    rows = layers(found)[0].fitted
    axes = list(rows["conditions"])
    units = found.units
    header = [
        "observable",
        *(heading(axis, units.condition_unit(axis)) for axis in axes),
        "measured",
        "model",
        "residual, sd",
    ]
    cells = []
    for place, name in enumerate(rows["observable"]):
        at = [rows["conditions"][axis][place] for axis in axes]
        stated = [
            number(None if value is None else units.condition(axis, value))
            for axis, value in zip(axes, at, strict=True)
        ]
        label = heading(name, units.value_unit(name))
        predicted = number(units.value(name, rows["predicted"][place]))
        measured = measured_text(found, rows, place)
        cells.append([label, *stated, measured, predicted, number(rows["residual"][place])])
    return markdown_table(header, cells)


def measured_text(found: Results, rows: Document, place: int) -> str:
    """Measured value of a row in the unit of the table: `25.3`, `< 20`, `20 to 25`."""
    side = study_figures.limit_of(rows, place)
    keys = ("low", "high") if side == "between" else ("measured",)
    values = [number(found.units.value(rows["observable"][place], rows[key][place])) for key in keys]
    return {"below": "< ", "above": "> "}.get(side, "") + " to ".join(values)


def page_fields(found: Results) -> dict[str, Any]:
    """Fields of the template."""
    first, shown, every = found.first, layers(found), panels(found)
    measured = [rows for rows in (shown[0].fitted, shown[0].held) if rows]
    return {
        "title": title_of(first),
        "about": f"{first['measurements']}, answered by {first['model']}",
        "made": made(first["versions"], f"seed {first['seed']}"),
        "sections": sections(found),
        "set_up": first.get("set_up", []),
        "lead": lead(found),
        "layers": shown,
        "observables": {name: words_of(name).noun for name in dict.fromkeys(shown[0].fitted["observable"])},
        "marks": {
            study_figures.limit_of(rows, k) for rows in measured for k in range(len(rows["observable"]))
        },
        "shown": list(dict.fromkeys(panel.observable for panel in every))[:MOST_SHOWN],
        "conditions": {panel.condition.name: panel.condition.label for panel in every if panel.condition},
        "first_panels": first_panels(every),
        "units": found.units,
        **{name: getattr(found, name) for name in ANSWERS},
        "where": places_of_misfit(found),
        "residuals": study_figures.residual_pictures(every),
        "effects": ranked_effects(found.discovery),
        "levels": [
            each["sentence"] for each in (found.discovery or found.comparison or {}).get("levels", ())
        ],
        "strengths": list(strength_words(found, read_evidence_study(found.study)).items()),
        "groups": groups(found.discovery),
        "answers": answers(found),
        "vault": list(vault_sentences(found)),
        "fits_of_adoption": list(fits(found.adoption)),
        "errors": {"fitted": FITTED_ERRORS, "held_out": HELD_OUT_ERRORS},
        "limits": list(limits(found)),
        "experiments": (found.by_command.get("next") or found.discovery or {}).get("next_experiments", ()),
        "beyond": beyond_sentences(found),
        "doses": draw_doses(found.discovery, found.adoption, found.table),
        "notes": list(dict.fromkeys([*first["notes"], *first.get("warnings", [])])),
        "facts": list(facts(found)),
        "figures": pictures(found),
    }


def sections(found: Results) -> list[tuple[str, str]]:
    """Names and titles of the sections that there are."""
    there = [("beyond", "What acts like the missing effect")] if beyond_sentences(found) else []
    there += [("where", "Where the model fails")]
    there += [("missing", "Which effect is missing")] if found.discovery else []
    there += [("vault", "Vault")] if found.first["rows_hidden"] or found.adoption else []
    there += [("ladder", "Error ladder")] if len(found.adoptions) > 1 else []
    there += [("predictions", "Predictions at new conditions")] if found.prediction else []
    return [*there, ("limits", "What would change the answer"), ("methods", "Methods"), ("terms", "Terms")]


def panels(found: Results) -> list[Panel]:
    """Panels of the first figure: the place of the worst misfit first."""
    shown = layers(found)
    names = list(dict.fromkeys(shown[0].fitted["observable"]))
    every = list(study_figures.panels_of(names, shown, found.table, found.units))
    place = worst_place(found)
    failing = {
        (one["observable"], one["axis"]): rank for rank, one in enumerate(found.where) if fails(one["p"])
    }

    def rank(panel: Panel) -> tuple[bool, int]:
        axis = panel.condition.name if panel.condition else LEVEL
        worst = place is not None and (panel.observable, axis) == (place["observable"], place["axis"])
        return not worst, failing.get((panel.observable, axis), len(failing))

    return sorted(every, key=rank)


def first_figure(study: Path) -> figure_style.Figure:
    """First figure of the page of a study. Raises BadInput where it has no answer yet."""
    return figure_style.detached(
        lambda: study_figures.draw_with_key(panels(stored_results(study)), figure_style.WIDE)
    )


def first_panels(every: Sequence[Panel]) -> list[dict[str, Any]]:
    """Pictures of the first figure with the conditions at which each is shown.

    One condition is shown at a time; an observable that does not vary with it is shown along its first one.
    """
    conditions = list(dict.fromkeys(panel.condition.name for panel in every if panel.condition))
    shown = []
    for panel, drawn in study_figures.first_pictures(every):
        own = {one.condition.name for one in every if one.condition and one.observable == panel.observable}
        at = [panel.condition.name] if panel.condition else conditions
        is_first = panel is next(one for one in every if one.observable == panel.observable)
        at += [name for name in conditions if name not in own] if is_first else []
        shown.append({"picture": drawn, "observable": panel.observable, "at": "|".join(dict.fromkeys(at))})
    return shown


def pictures(found: Results) -> dict[str, Picture | None]:
    """Figures of the later sections by name; None without data."""
    discovery, adoption = found.discovery, found.adoption
    tested = adoption if adoption and adoption["base"]["vault_chi2_per_row"] is not None else None
    return {
        "posterior": draw_posterior(discovery["probabilities"]) if discovery else None,
        "vault": draw_vault(tested) if tested else None,
        "adoptions": draw_adoptions(found.adoptions) if len(found.adoptions) > 1 else None,
    }


def beyond_sentences(found: Results) -> list[str]:
    """What acts like the missing effect, where mechanisms were weighed."""
    beyond = (found.discovery or {}).get("beyond")
    return list(beyond["sentences"]) if beyond else []


def failures(document: Document | None) -> list[str]:
    """Sentences on the places of significant misfit of the bare model."""
    return [place["sentence"] for place in (document or {"where": ()})["where"] if fails(place["p"])]


def places_of_misfit(found: Results) -> list[str]:
    """Where the bare model fails; where nothing tests it, that."""
    told = failures({"where": found.where})
    if found.comparison is None:
        return told or [NO_MISFIT]
    untested = is_untested(found.comparison)
    return [*(told or ([] if untested else [NO_MISFIT])), *row_sentences(found.comparison["worst_row"])] or [
        untested_sentence(found.comparison)
    ]


def ranked_effects(discovery: Document | None) -> list[tuple[str, Document]]:
    """Candidates in order of probability."""
    effects = discovery["effects"] if discovery else {}
    return sorted(effects.items(), key=lambda item: -(item[1]["probability"] or 0.0))


def groups(discovery: Document | None) -> list[str]:
    """Plausible effects that the measurements do not separate; none beside an effect that is named alone."""
    if discovery is None or discovery["verdict"] == "present":
        return []
    effects = discovery["effects"]
    plausible = {name for name, effect in effects.items() if (effect["probability"] or 0.0) >= PLAUSIBLE}
    found = set()
    for name, others in discovery["ambiguity"].items():
        members = sorted(plausible & {name, *others})
        if name in plausible and len(members) > 1:
            found.add(", ".join(effect_words(member) for member in members))
    return sorted(found)


def answers(found: Results) -> list[str]:
    """Sentences of discover, after a verdict of the vault that contradicts them."""
    discovery, adoption = found.discovery, found.adoption
    if discovery is None:
        return []
    told = [*failures({"where": found.where}), *beyond_sentences(found)]
    sentences = [sentence for sentence in discovery["sentences"] if sentence not in told]
    if adoption and adoption["base"]["vault_chi2_per_row"] is not None and adoption["contradicted"]:
        names = " and ".join(effect_words(name) for name in adoption["added"]["effects"])
        verdict = (
            f"The vault, opened afterwards, does not confirm {names}: read the rest as it was before that."
        )
        return [verdict, *sentences]
    return sentences


def vault_sentences(found: Results) -> Iterator[str]:
    """Held-out rows, and how often the vault was opened."""
    yield from (note for note in found.first["notes"] if "held out" in note)
    if not found.first["rows_hidden"]:
        return
    opened = max(document.get("vault", {}).get("opened", 0) for document in found.by_command.values())
    yield f"The vault {TIMES.get(opened, f'was opened {opened} times')}."


def limits(found: Results) -> Iterator[str]:
    """What could change the conclusion."""
    discovery, adoption = found.discovery, found.adoption
    noise = (discovery or found.comparison or {}).get("noise", {}).get("observables", {})
    if unrepeated := ", ".join(name for name, budget in noise.items() if budget["repeats"] < 1):
        yield f"Repeats: the scatter of {unrepeated} is stated, not checked. A larger one lowers misfits."
    if noise and not any(budget["numerical"] for budget in noise.values()):
        yield UNDECLARED_NUMERICS
    if discovery:
        yield from limits_of_names(discovery)
        yield from limits_of_runs(discovery)
    if adoption and adoption["vault"]["opened"] > 1:
        yield "Vault: it was opened more than once. Its rows are no longer unseen data."
    for command in found.outdated:
        yield f"Table: the answer of `{command}` rests on another version of the table and is left out."


def limits_of_names(discovery: Document) -> Iterator[str]:
    """Limits of the named effects."""
    effects = discovery["effects"]
    hidden = [effect_words(name) for name, effect in effects.items() if effect["status"] == "not_testable"]
    unnamed = [name for name in hidden if name not in map(effect_words, discovery["group"])]
    if unnamed:
        yield f"Not testable: these measurements cannot show {listed(unnamed)}, even if present."
    for name in dict.fromkeys((*discovery["named"], *discovery["group"])):
        if (effects.get(name, {}).get("absorption") or 0.0) > ABSORBED:
            parameter = discovery["absorbed_by"].get(name, "a calibrated parameter")
            yield f"Absorption: {parameter} can imitate most of {effect_words(name)}. Measure it separately."
    if len(discovery["group"]) > 1:
        group = listed([effect_words(name) for name in discovery["group"]])
        yield f"Group: these measurements cannot separate {group}."


def limits_of_runs(discovery: Document) -> Iterator[str]:
    """Limits of the runs behind the named effects."""
    if discovery["decoy_rank"] == 1:
        yield "Decoy: an artificial effect fits best. The shortlist of effects is not reliable."
    stability = discovery["stability"]
    if stability is not None and stability < STABLE:
        yield f"Seeds: {100.0 * stability:.0f} % of the repeats with other seeds name the same effect first."
    if discovery["failures"]:
        yield f"Failures: {discovery['failures']} model values could not be computed and are left out."


def fits(adoption: Document | None) -> Iterator[tuple[str, Document]]:
    """Fits of an adoption with their labels."""
    if adoption is None:
        return
    yield "before", adoption["base"]
    yield (
        f"with {' and '.join(effect_words(name) for name in adoption['added']['effects'])}",
        adoption["added"],
    )
    for key, label in CONTROLS.items():
        if adoption.get(key) is not None:
            yield f"{label} ({', '.join(adoption[key]['effects'])})", adoption[key]


def facts(found: Results) -> Iterator[tuple[str, str]]:
    """Inputs and versions, for a repeat."""
    first = found.first
    yield "study", first["study"]
    yield "model", first["model"]
    yield "measurements", f"{first['measurements']}, digest {first['digest']}"
    yield "rows", f"{first['rows_visible']} fitted, {first['rows_hidden']} held out"
    yield "candidates", ", ".join(first["candidates"]) or "none"
    yield "seed", str(first["seed"])
    for command, document in found.by_command.items():
        if "runs" in document:
            yield f"cost of {command}", f"{document['runs']} runs, {document['wall_s']:.1f} s"
    yield "versions", ", ".join(f"{name} {number}" for name, number in first["versions"].items())
