"""Page of an evidence study from the records of its answers: one self-contained HTML file.

The first screen holds what was found, in a sentence and in one figure. Then follow what is missing, does it
hold, and what next, each with its lines, tables and figures; the method stands at the end.
"""

import os
import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from markupsafe import Markup, escape

from taichi_erosion import __version__
from taichi_erosion.core.files import write_atomic
from taichi_erosion.evidence.race.record import Record
from taichi_erosion.evidence.words import page_words
from taichi_erosion.evidence.words.effect_words import acting
from taichi_erosion.evidence.words.vocabulary import Vocabulary
from taichi_erosion.report import answer_figures as figures
from taichi_erosion.report.figure_style import Picture
from taichi_erosion.report.html import made, render

TEMPLATE = "answer.html"
FILES = ("study", "results", "written")  # of a vocabulary


def answer_page(title: str, records: Mapping[str, Record], vocabulary: Vocabulary, out: Path) -> Path:
    """Write the page of a study from its records by command."""
    voc = portable(vocabulary)
    found = page_words.answers(records, voc)
    told = next(records[name] for name in ("discover", "adopt", "compare") if name in records)
    parts = page_words.page_lines(found)
    first, *others = row_pictures(told, voc)
    tables = [["discover"], ["compare", "adopt"], ["next"]]
    drawn = (missing_pictures(told, voc, found), [*holding_pictures(records, told), *others], [])
    lead = 1 + bool(told.repeats)  # repeats that disagree stand before what was found
    sections = [
        {
            "title": name,
            "lines": [commands(line) for line in lines],
            "tables": [found[key].table for key in keys if key in found and found[key].table],
            "pictures": pictures,
        }
        for name, lines, keys, pictures in zip(
            page_words.SECTIONS, (parts[0][lead:], *parts[1:]), tables, drawn, strict=False
        )
    ]
    fields = {
        "title": title,
        "about": voc.study,
        "made": made({"taichi_erosion": __version__}, f"seed {told.cost.seed}"),
        "lead": [commands(line) for line in parts[0][:lead]],
        "first": first,
        "key": (page_words.MEASURED, page_words.BARE, page_words.added_words(told)),
        "sections": sections,
        "methods": page_words.methods(told),
        "method_title": page_words.SECTIONS[-1],
        "acting": {name for names in acting(told.decided) for name in names},
    }
    return write_atomic(out, render(TEMPLATE, fields).encode())


def portable(voc: Vocabulary) -> Vocabulary:
    """Files as seen from the folder of the study: a page is read on other machines."""
    home = Path(voc.study).parent
    files = {key: getattr(voc, key) for key in FILES}
    return replace(
        voc, **{key: os.path.relpath(file, home) for key, file in files.items() if os.path.isabs(file)}
    )


def commands(line: str) -> Markup:
    """A line with its commands marked."""
    return Markup(re.sub("`(.+?)`", r"<code>\1</code>", str(escape(line))))


def row_pictures(record: Record, voc: Vocabulary) -> list[Picture]:
    """Measured beside predicted, the worst place first."""
    shown = figures.places(record)
    return [figures.row_picture(record, voc, *place, number) for number, place in enumerate(shown)]


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
