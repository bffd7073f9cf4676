"""Recording of a whole study: its runs side by side, its table, its findings and its figures."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from taichi_erosion.recording import blueprint, pictures, rr, rrb
from taichi_erosion.recording.blueprint import Focus
from taichi_erosion.recording.readback import GrainFrame, read_grains
from taichi_erosion.recording.stream import close, log_scale_bar, open_stream, set_run_properties

APPLICATION = "taichi_erosion_study"  # apart from single runs, which have another layout
MOST_FRAMES = 40  # of each run, evenly spread
RUN_DISTANCE = 1.35  # of the eye, over the radius that it frames: heaps are low and views wide [1]

Films = Mapping[str, list[GrainFrame]]  # frames by run


@dataclass(frozen=True)
class RecordedRun:
    name: str  # of its entity
    caption: str  # settings and results
    recording: Path
    properties: Mapping[str, Any]


@dataclass(frozen=True)
class StudyPage:
    title: str
    summary: str  # markdown
    table: str  # markdown
    figures: Mapping[str, bytes]  # PNG by name
    runs: Sequence[RecordedRun] = ()
    properties: Mapping[str, Any] | None = None  # of the study as a whole
    columns: Mapping[str, Sequence[Any]] | None = None  # of all runs: design, settings, results


def record_study(path: Path, page: StudyPage) -> Path:
    """Write the recording of a study. Raises BadInput where it cannot be written."""
    films = {}
    for run in page.runs:
        frames = read_grains(run.recording)
        rows = np.linspace(0, len(frames) - 1, min(MOST_FRAMES, len(frames))).round().astype(int)
        films[run.name] = [frames[k] for k in rows]
    recording = open_stream(path, page.title, study_blueprint(page, films), APPLICATION)
    stream = recording.stream
    stream.log("/", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    stream.log("runs", rr.Transform3D(scale=blueprint.MAGNIFICATION), static=True)
    stream.set_time(blueprint.TIMELINE, duration=0.0)
    for entity, text in (("summary", page.summary), ("table", page.table)):
        stream.log(entity, rr.TextDocument(text, media_type=rr.MediaType.MARKDOWN))
    for name, content in page.figures.items():
        stream.log(figure_entity_path(name), rr.EncodedImage(contents=content, media_type="image/png"))
    set_run_properties(recording, "study", page.properties or {})
    if page.columns:
        stream.log("design", rr.AnyValues(False, **page.columns), static=True)
    for run in page.runs:
        log_scale_bar(recording, f"runs/{run.name}/scale", common_focus(films))
        set_run_properties(recording, run.name, run.properties)
        for frame in films[run.name]:
            stream.set_time(blueprint.TIMELINE, duration=frame.time)
            colours = pictures.resting_colours(frame.ident, frame.state.get("kind"))
            stream.log(f"runs/{run.name}", rr.Points3D(frame.position, radii=frame.radius, colors=colours))
    return close(recording)


def study_blueprint(page: StudyPage, films: Films) -> "rrb.Blueprint":
    """Runs side by side above, figures and texts below; without runs the figures have the room."""
    summary = rrb.TextDocumentView(name="Summary", origin="/summary")
    texts = rrb.Tabs(summary, rrb.TextDocumentView(name="All runs", origin="/table"))
    figures = [rrb.Spatial2DView(name=name, origin=f"/{figure_entity_path(name)}") for name in page.figures]
    if not films:
        return blueprint.add_time_panel(rrb.Horizontal(rrb.Tabs(*figures), texts, column_shares=[3, 2]))
    focus = common_focus(films)
    runs = ((run.caption, f"/runs/{run.name}") for run in page.runs)
    above = rrb.Grid(*(blueprint.grain_view(focus, *run, RUN_DISTANCE) for run in runs))
    below = rrb.Horizontal(rrb.Tabs(*figures), texts, column_shares=[1, 1])
    return blueprint.add_time_panel(rrb.Vertical(above, below, row_shares=[3, 2]))


def common_focus(films: Films) -> Focus:
    """One camera for all runs, so that heaps can be compared by eye: the largest heap fits.

    It looks at the foot of the heaps: they are low, no funnel stands above them, and the views are flat.
    """
    heaps = [blueprint.heap_focus(frames[-1].radius.astype(np.float64)) for frames in films.values()]
    return Focus((0.0, 0.0, 0.0), max(focus.radius for focus in heaps))


def figure_entity_path(name: str) -> str:
    return f"figures/{name.replace(' ', '_').replace(',', '')}"
