"""What the page of an evidence study holds, from the records of its answers, and its HTML.

The first screen holds what was found, in a sentence and in one figure. Then follow what is missing, does it
hold, and what next, each with its lines, tables and figures; the method stands at the end.
"""

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from taichi_erosion import __version__
from taichi_erosion.evidence.race.record import Record
from taichi_erosion.evidence.words import page_words
from taichi_erosion.evidence.words.answer_lines import Table
from taichi_erosion.evidence.words.part_words import acting
from taichi_erosion.evidence.words.vocabulary import Vocabulary
from taichi_erosion.report import answer_figures as figures
from taichi_erosion.report.figure_style import Picture
from taichi_erosion.report.html import made, render

TEMPLATE = "answer.html"
FILES = ("study", "results", "written")  # of a vocabulary
TABLES = (("discover",), ("compare", "adopt"), ("next",))  # of the sections, by command


@dataclass(frozen=True)
class Section:
    """A part of the page."""

    title: str
    lines: Sequence[str]
    tables: Sequence[Table]
    pictures: Sequence[Picture]


@dataclass(frozen=True)
class AnswerPage:
    """Content of the page, in the order of reading."""

    title: str
    about: str
    made: str
    warnings: Sequence[str]  # before everything else
    lead: Sequence[str]
    first: Picture
    key: tuple[str, str, str]  # of the first picture: measured, both models
    sections: Sequence[Section]
    method_title: str
    methods: Sequence[str]
    notes: Sequence[str]  # on table and runs
    acting: frozenset[str]


def answer_page(
    title: str,
    records: Mapping[str, Record],
    vocabulary: Vocabulary,
    warnings: Sequence[str] = (),
    notes: Sequence[str] = (),
    model: str = "",
) -> AnswerPage:
    """Content of the page of a study, from its records by command."""
    voc, told = portable(vocabulary), leading(records)
    found = page_words.answers(records, voc)
    parts = page_words.page_lines(found)
    shown = figures.places(told)  # the worst first
    first, *others = (figures.row_picture(told, voc, *place, number) for number, place in enumerate(shown))
    drawn = (missing_pictures(told, voc, found), [*holding_pictures(records, told), *others], [])
    lines = parts[0][1:], *parts[1:]
    tables = ([found[key].table for key in keys if key in found] for keys in TABLES)
    *titles, method_title = page_words.SECTIONS
    return AnswerPage(
        title=title,
        about=voc.study,
        made=made({"taichi_erosion": __version__}, f"seed {told.cost.seed}"),
        warnings=warnings,
        lead=parts[0][:1],
        first=first,
        key=figures.key(told),
        sections=[
            Section(name, own, [each for each in stated if each], pictures)
            for name, own, stated, pictures in zip(titles, lines, tables, drawn, strict=True)
        ],
        method_title=method_title,
        methods=page_words.methods(told, model),
        notes=notes,
        acting=frozenset(name for names in acting(told.decided) for name in names),
    )


def html_page(page: AnswerPage) -> str:
    """The page as one self-contained HTML file."""
    return render(TEMPLATE, vars(page))


def leading(records: Mapping[str, Record]) -> Record:
    """The record that says most of what is missing."""
    return next(records[name] for name in page_words.LEADING if name in records)


def portable(voc: Vocabulary) -> Vocabulary:
    """Files as seen from the folder of the study: a page is read on other machines."""
    home = Path(voc.study).parent
    files = {key: getattr(voc, key) for key in FILES}
    return replace(
        voc, **{key: os.path.relpath(file, home) for key, file in files.items() if os.path.isabs(file)}
    )


def missing_pictures(record: Record, voc: Vocabulary, found: Mapping[str, object]) -> list[Picture]:
    """What explains the measurements, where that was asked."""
    if "discover" not in found:
        return []
    drawn = [figures.posterior_picture(record), figures.strength_picture(record)]
    acts = {name for names in acting(record.decided) for name in names}
    law = record.law if record.law and record.law.mechanism in acts else None
    return [*(figures.dose_pictures(law, voc) if law else ()), *drawn]


def holding_pictures(records: Mapping[str, Record], told: Record) -> list[Picture]:
    """Misfit before and after, and calibrated numbers."""
    last = records.get("adopt", told)
    drawn = [figures.ladder_picture(last)] if page_words.added_words(last) else []
    return [*drawn, *([figures.number_picture(last)] if last.numbers else [])]
