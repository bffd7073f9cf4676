"""Recording of a whole study: its runs side by side, its table, its findings and its figures."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import ceil, sqrt
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from taichi_erosion.recording import blueprint, pictures
from taichi_erosion.recording.blueprint import Focus
from taichi_erosion.recording.readback import GrainFrame, read_grains
from taichi_erosion.recording.stream import close, open_stream, set_properties

if TYPE_CHECKING:
    import rerun.blueprint as rrb

APPLICATION = "taichi_erosion_study"  # apart from single runs, which have another layout
MOST_FRAMES = 40  # of each run, evenly spread
FIGURE_COLUMNS = 2  # figures side by side

Films = Mapping[str, list[GrainFrame]]  # frames by run


@dataclass(frozen=True)
class RecordedRun:
    """One run of a study."""

    name: str  # of its entity
    caption: str  # settings and results
    recording: Path
    properties: Mapping[str, Any]


@dataclass(frozen=True)
class StudyPage:
    """Content of a study's recording."""

    title: str
    summary: str  # markdown
    table: str  # markdown
    figures: Mapping[str, bytes]  # PNG by name
    runs: Sequence[RecordedRun] = ()
    properties: Mapping[str, Any] | None = None  # of the study as a whole


def record_study(path: Path, page: StudyPage) -> Path:
    """Write the recording of a study. Raises BadInput where it cannot be written."""
    import rerun as rr

    films = {run.name: thin_out(read_grains(run.recording)) for run in page.runs}
    recording = open_stream(path, page.title, study_blueprint(page, films), path.stem, APPLICATION)
    stream = recording.stream
    stream.log("/", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    stream.log("runs", rr.Transform3D(scale=blueprint.MAGNIFICATION), static=True)
    stream.set_time(blueprint.TIMELINE, duration=0.0)
    for entity, text in (("summary", page.summary), ("table", page.table)):
        stream.log(entity, rr.TextDocument(text, media_type=rr.MediaType.MARKDOWN))
    for name, content in page.figures.items():
        stream.log(figure_entity(name), rr.EncodedImage(contents=content, media_type="image/png"))
    set_properties(recording, "study", page.properties or {})
    for run in page.runs:
        set_properties(recording, run.name, run.properties)
        for frame in films[run.name]:
            stream.set_time(blueprint.TIMELINE, duration=frame.time)
            colours = pictures.resting_colours(frame.ident)
            stream.log(f"runs/{run.name}", rr.Points3D(frame.position, radii=frame.radius, colors=colours))
    return close(recording)


def thin_out(frames: list[GrainFrame]) -> list[GrainFrame]:
    """At most MOST_FRAMES frames, the first and the last among them."""
    kept = np.linspace(0, len(frames) - 1, min(MOST_FRAMES, len(frames))).round().astype(int)
    return [frames[k] for k in kept]


def study_blueprint(page: StudyPage, films: Films) -> "rrb.Blueprint":
    """Runs side by side above, figures and texts below; without runs the figures have the room."""
    import rerun.blueprint as rrb

    texts = rrb.Tabs(
        rrb.TextDocumentView(name="What was found", origin="/summary"),
        rrb.TextDocumentView(name="All runs", origin="/table"),
    )
    figures = [rrb.Spatial2DView(name=name, origin=f"/{figure_entity(name)}") for name in page.figures]
    if not films:
        grid = rrb.Grid(*figures, grid_columns=FIGURE_COLUMNS)
        return blueprint.with_time_panel(rrb.Horizontal(grid, texts, column_shares=[2, 1]))
    focus = common_focus(films)
    views = [blueprint.grain_view(focus, run.caption, f"/runs/{run.name}") for run in page.runs]
    grid = rrb.Grid(*views, grid_columns=ceil(sqrt(len(views))))
    below = rrb.Horizontal(rrb.Tabs(*figures), texts, column_shares=[1, 1])
    return blueprint.with_time_panel(rrb.Vertical(grid, below, row_shares=[3, 2]))


def common_focus(films: Films) -> Focus:
    """One camera for all runs, so that heaps can be compared by eye: the largest heap fits."""
    heaps = [blueprint.heap_focus(frames[-1].radius.astype(np.float64)) for frames in films.values()]
    return max(heaps, key=lambda focus: focus.radius)


def figure_entity(name: str) -> str:
    return f"figures/{name.replace(' ', '_').replace(',', '')}"
