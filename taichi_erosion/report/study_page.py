"""Page and recording of an evidence study, from the answers in its results folder.

Answers of the present table belong together; the others are left out and named. The first screen
holds what was found, in a sentence and in one figure. Then follow what is missing, does it hold, and what
next, each with its lines, tables and figures; the method stands at the end.
"""

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from taichi_erosion.campaign.study_file import read_evidence_study
from taichi_erosion.core.effect_file import read_effect_files
from taichi_erosion.core.errors import BadInput
from taichi_erosion.evidence.answers.files import Command, Reply, answer_file, read_reply, with_adoption
from taichi_erosion.evidence.answers.set_up import stale_faults
from taichi_erosion.evidence.data.held_out_rows import table_digest
from taichi_erosion.evidence.models.load_study import load_measurements, results_folder
from taichi_erosion.evidence.record import Record
from taichi_erosion.evidence.words import page_words, shell_command
from taichi_erosion.evidence.words.answer_lines import ANSWERS, Table, sensitivity_table
from taichi_erosion.evidence.words.part_words import sure_and_group
from taichi_erosion.evidence.words.vocabulary import Vocabulary
from taichi_erosion.recording.study_recording import StudyPage, record_study
from taichi_erosion.report import answer_figures as figures
from taichi_erosion.report.figure_style import Figure, Picture, as_png, figure_with_key
from taichi_erosion.report.html import origin_line, write_page
from taichi_erosion.tables.number_words import markdown_table

COMMANDS: tuple[Command, ...] = ("compare", "discover", "adopt", "next")
TEMPLATE, RECORDING = "answer.html", "study.rrd"
FILES = ("study", "results", "sequel")  # of a vocabulary
TABLES = (("discover",), ("compare", "adopt"), ("next",))  # of the sections, by command


@dataclass(frozen=True)
class Section:
    """A part of the page."""

    title: str
    lines: Sequence[str]
    tables: Sequence[Table]
    pictures: Sequence[Picture]


def write_report(study: Path, to: Path | None = None, force: bool = False) -> Path:
    """Write the HTML page of a study. Raises BadInput before its first answer."""
    page, _ = fields_and_answer(study)
    return write_page(to or folder_of(study) / f"{study.stem}.report.html", study, force, TEMPLATE, page)


def write_recording(study: Path) -> Path:
    """Write the recording of a study. Raises BadInput before its first answer."""
    page, first = fields_and_answer(study)
    about, seed, sections = first.about, first.record.seed, page["sections"]
    pictures = [page["first"], *(picture for section in sections for picture in section.pictures)]
    tables = [table for section in sections for table in section.tables]
    lines = [f"# {page['title']}", *page["warnings"], *page["lead"]]
    for section in sections:
        lines += [f"## {section.title}", *(f"- {line}" for line in section.lines)] if section.lines else []
    content = StudyPage(
        title=page["title"],
        summary="\n\n".join(lines),
        table="\n".join(f"## {each.title}\n\n{markdown_table(each.columns, each.rows)}" for each in tables),
        figures={each.name: as_png(figure_with_key(each)) for each in pictures},
        properties={"rows": about["rows_visible"], "held_out": about["rows_hidden"], "seed": seed},
    )
    return record_study(folder_of(study) / f"{study.stem}.{RECORDING}", content)


def fields_and_answer(study: Path) -> tuple[dict[str, Any], Reply]:
    """Fields of the page of a study, and one of its answers. Raises BadInput before the first one."""
    replies, others = current_and_stale_replies(study)
    answers = replies.values()
    first = replies.get("adopt") or next(iter(answers))  # which knows the written study
    stale = (f"warning: {each.sentence}" for each in stale_faults(study, read_evidence_study(study)))
    lines = (line for each in answers for line in each.about["set_up"])
    warnings = [*lines, *stale, page_words.omissions(others)]
    notes = [line for each in answers for key in ("notes", "warnings") for line in each.about[key]]
    records = {name: reply.record for name, reply in replies.items()}
    if {"discover", "adopt"} <= set(records):
        records["discover"] = with_adoption(records["discover"], records["adopt"])
    page = answer_page(first.about["title"] or study.stem, records, first.vocabulary(), first.about["model"])
    page["warnings"], page["notes"] = (list(filter(None, dict.fromkeys(each))) for each in (warnings, notes))
    stems = dict.fromkeys((Path(first.about.get("written", study)).stem, study.stem))  # the adopted one first
    stored = (read_reply(folder_of(study), stem, "predict") for stem in stems)
    for answers in [each for each in stored if each and each.about["digest"] == first.about["digest"]][:1]:
        answer = answers.answer()
        tables = [answer.table] if answer.table else []
        page["sections"].append(Section(page_words.PREDICTIONS, answer.lines, tables, []))
    return page, first


def current_and_stale_replies(study: Path) -> tuple[dict[Command, Reply], list[Command]]:
    """Answers that belong together, the last one at the end, and commands with an answer to another table.

    Raises BadInput where none says what is missing.
    """
    folder, replies, age = folder_of(study), {}, {}
    for command in COMMANDS:
        if reply := read_reply(folder, study.stem, command):
            replies[command] = reply
            age[command] = answer_file(folder, study.stem, command).stat().st_mtime_ns
    file = read_evidence_study(study)
    effect_files = read_effect_files(file.study.effect_files, study.parent, str(study))
    digest = table_digest(load_measurements(study, file, effect_files)[1])[:12]
    answers = {name: replies[name] for name in sorted(replies, key=age.__getitem__)}
    answers = {name: reply for name, reply in answers.items() if reply.about["digest"] == digest}
    if not set(answers) & set(page_words.LEADING):
        state = "no answer to its present table" if replies else "no answer yet"
        raise BadInput(f"{study}: has {state}; {shell_command('compare', study)} gives the first")
    return answers, [command for command in replies if command not in answers]


def folder_of(study: Path) -> Path:
    return results_folder(study, read_evidence_study(study))


def worst_place_figure(reply: Reply) -> Figure:
    """Measured values, the model before and after, where it fails most."""
    place = figures.rank_failing_places(reply.record)[0]
    return figure_with_key(figures.observable_picture(reply.record, reply.vocabulary(), *place, 0))


def answer_page(
    title: str, records: Mapping[str, Record], vocabulary: Vocabulary, model: str = ""
) -> dict[str, Any]:
    """Fields of the page of a study, from its records by command, the last one at the end: it leads."""
    home = Path(vocabulary.study).parent
    files = {key: getattr(vocabulary, key) for key in FILES}
    # files as seen from the folder of the study: a page is read on other machines
    nearby = {key: os.path.relpath(file, home) for key, file in files.items() if os.path.isabs(file)}
    voc = replace(vocabulary, **nearby)
    lead = [name for name in records if name in page_words.LEADING][-1]
    leading = records[lead]
    sentences = {name: answer(records[name], voc) for name, answer in ANSWERS.items() if name in records}
    parts = page_words.page_lines(sentences, lead)
    panels = figures.rank_failing_places(leading)  # the worst first
    first, *others = (figures.observable_picture(leading, voc, *place, k) for k, place in enumerate(panels))
    causes = list[Picture]()  # what explains the measurements
    if "discover" in sentences:
        record = records["discover"]
        acts = {name for names in sure_and_group(record) for name in names}
        if record.law and record.law.mechanism in acts:
            causes += figures.dose_pictures(record.mechanisms[record.law.mechanism], voc)
        causes += (figures.curve_picture(each, voc, number) for number, each in enumerate(record.curves))
        causes += [figures.posterior_picture(record)]
        causes += [figures.strength_picture(record)] if record.effects else []
    adoption = records.get("adopt", leading)
    effects = page_words.added_effects_text(adoption)
    misfits = [figures.misfit_before_after_picture(adoption)] if effects else []
    numbers = [figures.calibrated_number_picture(adoption)] if adoption.parameters else []
    columns = causes, [*misfits, *numbers, *others], []
    tables = [[sentences[key].table for key in keys if key in sentences] for keys in TABLES]
    tables[1].append(sensitivity_table(records["discover"]) if "discover" in sentences else None)
    *titles, method_title = page_words.SECTIONS
    return {
        "title": title,
        "about": voc.study,
        "made": origin_line(f"seed {leading.seed}"),
        "warnings": [],  # before everything else
        "lead": parts[0],
        "first": first,
        "key": figures.model_labels(leading),  # of the first picture: measured, both models
        "sections": [
            Section(name, commands, [each for each in named_tables if each], pictures)
            for name, commands, named_tables, pictures in zip(titles, parts[1:], tables, columns, strict=True)
        ],
        "method_title": method_title,
        "methods": page_words.methods_text(leading, model),
        "notes": [],  # on table and runs
        "acting": {name for names in sure_and_group(records.get("discover", leading)) for name in names},
    }
