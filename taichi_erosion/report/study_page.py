"""Page and recording of an evidence study, from the answers in its results folder.

Answers with the table of the newest one belong together; the others are left out and named.
"""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from taichi_erosion.campaign.study_file import read_evidence_study
from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.files import marked_html, refuse_foreign, write_atomic
from taichi_erosion.evidence.answers.files import Command, Reply, document_file, read_reply
from taichi_erosion.evidence.answers.predictions import read_prediction
from taichi_erosion.evidence.models.load_study import results_folder
from taichi_erosion.evidence.words import page_words, shell_command
from taichi_erosion.recording.study_recording import StudyPage, record_study
from taichi_erosion.report.answer_figures import places, row_picture
from taichi_erosion.report.answer_page import AnswerPage, Section, answer_page, html_page
from taichi_erosion.report.figure_style import Figure, raster, with_key
from taichi_erosion.report.markdown import markdown_table

COMMANDS: tuple[Command, ...] = ("adopt", "discover", "compare", "next")  # the first knows the written study
RECORDING = "study.rrd"

Replies = dict[Command, Reply]


def write_report(study: Path, to: Path | None = None, force: bool = False) -> Path:
    """Write the HTML page of a study. Raises BadInput before its first answer."""
    page, _ = told(study)
    to = to or folder_of(study) / f"{study.stem}.report.html"
    refuse_foreign(to, study, force)
    return write_atomic(to, marked_html(to, study, html_page(page)))


def write_recording(study: Path) -> Path:
    """Write the recording of a study. Raises BadInput before its first answer."""
    page, first = told(study)
    about, seed = first.about, first.record.cost.seed
    pictures = [page.first, *(picture for section in page.sections for picture in section.pictures)]
    tables = [table for section in page.sections for table in section.tables]
    recorded = StudyPage(
        title=page.title,
        summary=summary(page),
        table="\n".join(f"## {each.title}\n\n{markdown_table(each.columns, each.rows)}" for each in tables),
        figures={each.name: raster(with_key(each)) for each in pictures},
        properties={"rows": about["rows_visible"], "held_out": about["rows_hidden"], "seed": seed},
    )
    return record_study(folder_of(study) / f"{study.stem}.{RECORDING}", recorded)


def told(study: Path) -> tuple[AnswerPage, Reply]:
    """Content of the page of a study, and one of its answers. Raises BadInput before the first one."""
    replies, others = stored_replies(study)
    first = next(iter(replies.values()))
    found = replies.values()
    warnings = [*(line for each in found for line in each.about["set_up"]), page_words.left_out(others)]
    notes = [line for each in found for key in ("notes", "warnings") for line in each.about[key]]
    records = {name: reply.record for name, reply in replies.items()}
    title = first.about["title"] or study.stem
    warnings, notes = (list(filter(None, dict.fromkeys(lines))) for lines in (warnings, notes))
    page = answer_page(title, records, first.vocabulary(), warnings, notes, first.about["model"])
    return replace(page, sections=[*page.sections, *prediction_sections(study, first)]), first


def prediction_sections(study: Path, first: Reply) -> Iterator[Section]:
    """The last predictions, of the adopted model where there is one, that rest on the table of the page."""
    stems = dict.fromkeys((Path(first.about.get("written", study)).stem, study.stem))
    stored = (read_prediction(folder_of(study), stem) for stem in stems)
    for found in [each for each in stored if each and each.about["digest"] == first.about["digest"]][:1]:
        answer = found.answer()
        yield Section(page_words.PREDICTIONS, answer.lines, [answer.table] if answer.table else [], [])


def stored_replies(study: Path) -> tuple[Replies, list[Command]]:
    """Answers that belong together, and commands with an answer to another table.

    Raises BadInput where none says what is missing.
    """
    folder, found, age = folder_of(study), {}, {}
    for command in COMMANDS:
        if reply := read_reply(folder, study.stem, command):
            found[command] = reply
            age[document_file(folder, study.stem, command).stat().st_mtime_ns] = reply.about["digest"]
    digest = age[max(age)] if age else ""
    kept = {command: reply for command, reply in found.items() if reply.about["digest"] == digest}
    if not set(kept) & set(page_words.LEADING):
        raise BadInput(f"{study}: has no answer yet; {shell_command('compare', study)} gives the first")
    return kept, [command for command in found if command not in kept]


def first_figure(reply: Reply) -> Figure:
    """Measured values, the model before and after, where it fails most."""
    place = places(reply.record)[0]
    return with_key(row_picture(reply.record, reply.vocabulary(), *place, 0))


def folder_of(study: Path) -> Path:
    """Results folder."""
    return results_folder(study, read_evidence_study(study))


def summary(page: AnswerPage) -> str:
    """Lines of the page as Markdown."""
    parts = [f"# {page.title}", *page.warnings, *page.lead]
    for section in page.sections:
        parts += [f"## {section.title}", *(f"- {line}" for line in section.lines)] if section.lines else []
    return "\n\n".join(parts)
