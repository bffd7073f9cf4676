"""Page of a run: one self-contained HTML file, from the JSON document beside its recording."""

import json
from collections.abc import Iterator, Mapping
from math import nan
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.files import read_text_file
from taichi_erosion.evidence.words import run_words
from taichi_erosion.evidence.words.vocabulary import in_words
from taichi_erosion.report.figure_style import AFTER, BEFORE, WIDE, Picture, panels, responsive_picture
from taichi_erosion.report.html import origin_line, picture_address, write_page
from taichi_erosion.tables.number_words import count_noun, heading

Document = Mapping[str, Any]

TEMPLATE = "run.html"
NEEDED = ("scene", "hash", "seed", "replicas", "measures", "measured", "versions")
COLUMNS = 3  # panels side by side
MOST_WIDE = 4.0  # of a panel [in]
LARGEST_FILM = 8_000_000  # bytes; a larger film is not embedded


def write_report(run: Path, to: Path | None = None, force: bool = False) -> Path:
    """Write the page of a run from its document or recording. Raises BadInput without a document."""
    source = run.with_suffix(".json")
    fields = page_fields(read_document(source), source)
    return write_page(to or run.with_suffix(".report.html"), source, force, TEMPLATE, fields)


def read_document(path: Path) -> Document:
    """JSON document of a run. Raises BadInput where it is missing or incomplete."""
    try:
        document = json.loads(read_text_file(path))
    except FileNotFoundError:
        raise BadInput(f"{path}: no such document; a run writes it beside its recording") from None
    except (OSError, ValueError) as error:
        raise BadInput(f"{path}: not the document of a run ({error})") from None
    missing = [name for name in NEEDED if not isinstance(document, dict) or name not in document]
    if missing:
        raise BadInput(f"{path}: not the document of a run; {missing[0]} is missing")
    return document


def page_fields(document: Document, source: Path) -> dict[str, Any]:
    seeds = [str(replica["seed"]) for replica in document["replicas"]]
    return {
        "title": document.get("title") or Path(document["scene"]).stem,
        "about": f"{document['scene']}, {count_noun(len(seeds), 'repeat')}",
        "made": origin_line(
            f"seed{'s' * (len(seeds) > 1)} {', '.join(seeds)}", document["versions"]["taichi_erosion"]
        ),
        "summary": list(run_words.measured_value_texts(document)),
        "warnings": run_words.run_warnings(document),
        "table": run_words.run_table(document),
        "notes": list(run_words.run_notes(document)),
        "titles": {name: in_words(name) for name in document["measures"]},
        "replicas": document["replicas"],
        "figure_of_measures": measure_picture(document),
        "pictures": list(run_pictures(document, source)),
        "facts": list(reproduction_facts(document)),
        "resolved": json.dumps(document.get("resolved", {}), indent=1),
    }


def measure_picture(document: Document) -> Picture | None:
    """Measures by seed with mean and standard deviation, and the measured value.

    A single seed is drawn only beside a measured value.
    """
    finite = (name for name, pooled in document["measures"].items() if pooled["value"] is not None)
    several = len(document["replicas"]) > 1
    names = [name for name in finite if several or name in document["measured"]]
    if not names:
        return None

    def draw(width: float) -> Figure:
        columns = min(len(names), COLUMNS) if width == WIDE else 1
        figure, frames = panels(len(names), columns, (min(width / columns, MOST_WIDE), 2.6))
        for frame, name in zip(frames, names, strict=True):
            pooled, datum = document["measures"][name], document["measured"].get(name)
            seeds = [one["measures"].get(name, {}).get("value") for one in document["replicas"]]
            values = [nan if value is None else value for value in seeds]
            if datum:
                sd = datum.get("sd") or 0.0
                frame.axhspan(datum["value"] - sd, datum["value"] + sd, color=BEFORE, alpha=0.2, lw=0.0)
                frame.axhline(datum["value"], color=BEFORE, lw=1.0)
            frame.plot([0.0] * len(values), values, "o", ms=3.5, color=AFTER, alpha=0.6)
            frame.errorbar([1.0], [pooled["value"]], [pooled["sd"] or 0.0], fmt="s", color=AFTER, capsize=3)
            frame.set(title=heading(in_words(name), pooled["unit"]), xlim=(-0.6, 1.6))
            frame.set_xticks([0.0, 1.0], ["seeds", "mean, sd"])
        return figure

    return responsive_picture(
        draw, "Measures by seed, their means with one standard deviation; red: measured.", "measures"
    )


def run_pictures(document: Document, source: Path) -> Iterator[Picture]:
    for kind, description in (
        ("silhouettes", "Silhouettes from all azimuths with the fitted slopes."),
        ("film", "The run, seen from the side."),
    ):
        name = document.get(kind)
        file = source.with_name(Path(name).name) if name else None
        if file and file.is_file() and file.stat().st_size < LARGEST_FILM:
            yield Picture(description, picture_address(file))


def reproduction_facts(document: Document) -> Iterator[tuple[str, str]]:
    """Time step, inputs and versions, for a repeat."""
    limits = document.get("limits", {})
    if limits:
        share = limits["time_step_over_rayleigh"]
        yield "time step", f"{limits['time_step']:.3g} s, {share:.2g} Rayleigh times"
    yield "scene", f"{document['scene']}, hash {document['hash']}"
    yield "seeds", ", ".join(str(replica["seed"]) for replica in document["replicas"])
    if "grain_steps" in document:
        yield "cost", f"{document['grain_steps']:.3g} grain-steps, {document['wall_s']:.1f} s"
    yield "computed on", ", ".join(f"{key} {value}" for key, value in document.get("numerics", {}).items())
    yield "versions", ", ".join(f"{name} {number}" for name, number in document["versions"].items())
