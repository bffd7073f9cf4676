"""One recording for a whole study: its runs side by side, its table, its sentences and its figures."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import ceil, sqrt
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from taichi_erosion.core.files import make_parent, part_path
from taichi_erosion.recording import pictures as drawing
from taichi_erosion.recording.blueprint import (
    FRAMES_PER_SECOND,
    MAGNIFICATION,
    TIMELINE,
    Focus,
    grain_view,
    heap_focus,
)
from taichi_erosion.recording.readback import GrainFrame, read_grains

if TYPE_CHECKING:
    import rerun as rr
    import rerun.blueprint as rrb

APPLICATION = "taichi_erosion_study"  # apart from single runs, which have another layout
MOST_FRAMES = 40  # of each run, evenly spread
ACROSS = 3  # figures side by side
FOOT = (0.0, 0.0, 0.0)  # m, where heaps stand


@dataclass(frozen=True)
class Shown:
    """One run that is shown."""

    name: str  # of its entity
    caption: str  # what was set and what came out
    recording: Path
    properties: Mapping[str, Any]


@dataclass(frozen=True)
class StudyPage:
    """What a study's recording shows."""

    title: str
    summary: str  # markdown
    table: str  # markdown
    figures: Mapping[str, bytes]  # PNG by name
    runs: Sequence[Shown] = ()
    properties: Mapping[str, Any] | None = None  # of the study as a whole


def record_study(path: Path, page: StudyPage) -> Path:
    """Write the recording of a study in one go."""
    import rerun as rr

    make_parent(path)
    films = {run.name: thinned(read_grains(run.recording)) for run in page.runs}
    stream = rr.RecordingStream(APPLICATION, recording_id=path.stem)
    stream.save(part_path(path), default_blueprint=study_blueprint(page, films))
    stream.set_log_time_enabled(False)
    stream.set_log_tick_enabled(False)
    stream.send_recording_name(page.title)
    stream.log("/", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    stream.log("runs", rr.Transform3D(scale=MAGNIFICATION), static=True)
    stream.set_time(TIMELINE, duration=0.0)
    for entity, text in (("summary", page.summary), ("table", page.table)):
        stream.log(entity, rr.TextDocument(text, media_type=rr.MediaType.MARKDOWN))
    for name, content in page.figures.items():
        stream.log(figure_entity(name), rr.EncodedImage(contents=content, media_type="image/png"))
    for group, values in (
        {"study": page.properties or {}} | {r.name: r.properties for r in page.runs}
    ).items():
        if values:
            stream.send_property(group, rr.AnyValues(**values))
    for name, frames in films.items():
        log_film(stream, name, frames)
    stream.flush()
    stream.disconnect()
    part_path(path).replace(path)
    return path


def thinned(frames: list[GrainFrame]) -> list[GrainFrame]:
    """At most MOST_FRAMES frames, the first and the last among them."""
    places = np.linspace(0, len(frames) - 1, min(MOST_FRAMES, len(frames))).round().astype(int)
    return [frames[place] for place in places]


def log_film(stream: "rr.RecordingStream", name: str, frames: Sequence[GrainFrame]) -> None:
    """Write the grains of one run."""
    import rerun as rr

    for frame in frames:
        stream.set_time(TIMELINE, duration=frame.time)
        colours = drawing.resting_colours(frame.ident)
        stream.log(f"runs/{name}", rr.Points3D(frame.position, radii=frame.radius, colors=colours))


def study_blueprint(page: StudyPage, films: Mapping[str, list[GrainFrame]]) -> "rrb.Blueprint":
    """Runs side by side above, figures and texts below; without runs the figures have the room."""
    import rerun.blueprint as rrb

    texts = rrb.Tabs(
        rrb.TextDocumentView(name="What was found", origin="/summary"),
        rrb.TextDocumentView(name="All runs", origin="/table"),
    )
    pictures = [rrb.Spatial2DView(name=name, origin=f"/{figure_entity(name)}") for name in page.figures]
    if films:
        focus = common_focus(films)
        views = [grain_view(focus, run.caption, f"/runs/{run.name}") for run in page.runs]
        below = rrb.Horizontal(rrb.Tabs(*pictures), texts, column_shares=[1, 1])
        layout = rrb.Vertical(rrb.Grid(*views, grid_columns=ceil(sqrt(len(views)))), below, row_shares=[3, 2])
    else:
        layout = rrb.Horizontal(rrb.Grid(*pictures, grid_columns=ACROSS - 1), texts, column_shares=[2, 1])
    return rrb.Blueprint(
        layout,
        rrb.TimePanel(state="collapsed", timeline=TIMELINE, fps=FRAMES_PER_SECOND),
        rrb.SelectionPanel(state="hidden"),
        rrb.BlueprintPanel(state="hidden"),
        auto_layout=False,
        auto_views=False,
    )


def common_focus(films: Mapping[str, list[GrainFrame]]) -> Focus:
    """One camera for all runs, so that heaps can be compared by eye: the largest heap fits."""
    radii: list[NDArray[np.float64]] = [frames[-1].radius.astype(np.float64) for frames in films.values()]
    return max((heap_focus(values, FOOT) for values in radii), key=lambda focus: focus.radius)


def figure_entity(name: str) -> str:
    """Entity of a figure."""
    return f"figures/{name.replace(' ', '_').replace(',', '')}"
