"""What a viewer shows first when it opens a recording."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import pi, radians, tan
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from taichi_erosion.recording import pictures
from taichi_erosion.recording.wall_mesh import WallMesh

if TYPE_CHECKING:
    import rerun.blueprint as rrb

Floats = NDArray[np.float64]
Vector = tuple[float, float, float]

BED_FRACTION = 0.55  # solid volume over volume of a loose heap [1], to guess its size before it exists
HEAP_SLOPE = radians(30.0)  # flank of the guessed heap [rad]
AIR = 1.5  # radius of the ball framed over the radius of the guessed heap [1]
DISTANCE = (
    2.2  # of the eye from the centre of the ball, over its radius [1]: the ball fills the height of the view
)
VIEW_DIRECTION = (0.30, -1.0, 0.34)  # from the middle towards the eye
HEAP_KINDS = frozenset({"repose", "collapse", "lifting"})
WIND_KINDS = frozenset({"threshold", "saltation"})
SILHOUETTES = "Silhouettes at the end"
MAGNIFICATION = 1e3  # world units are m, drawn as mm: the viewer hides what is within millimetres of the eye
TIMELINE = "sim_time"  # of every recording [s]
FRAMES_PER_SECOND = 30.0  # of the viewer's playback


@dataclass(frozen=True)
class Focus:
    """Ball that the camera frames."""

    centre: Vector  # m
    radius: float  # m


def heap_focus(radii: Floats, foot: Vector) -> Focus:
    """Ball about the heap that grains of these radii [m] will form on the point `foot` [m].

    A cone of slope a and base radius R holds  V = (pi / 3) R^3 tan a,  and the grains of radii r fill
    V = sum (4 / 3) pi r^3 / bed fraction.
    """
    volume = 4.0 / 3.0 * pi * float((radii**3).sum()) / BED_FRACTION
    radius = (3.0 * volume / (pi * tan(HEAP_SLOPE))) ** (1.0 / 3.0)
    return Focus((foot[0], foot[1], foot[2] + radius * tan(HEAP_SLOPE)), AIR * radius)


def wall_focus(walls: Sequence[WallMesh]) -> Focus:
    """Ball about all walls."""
    corners = np.concatenate([wall.vertices for wall in walls])
    low, high = corners.min(axis=0), corners.max(axis=0)
    middle = 0.5 * (low + high)
    return Focus((middle[0], middle[1], middle[2]), 0.5 * float(np.linalg.norm(high - low)))


def choose_focus(kind: str, radii: Floats, walls: Sequence[WallMesh], foot: Vector) -> Focus:
    """What the camera frames: the heap where one forms, the apparatus otherwise."""
    has_corners = any(len(wall.vertices) for wall in walls)
    return heap_focus(radii, foot) if kind in HEAP_KINDS or not has_corners else wall_focus(walls)


def blueprint(kind: str, focus: Focus) -> "rrb.Blueprint":
    """Layout for a kind of scene: grains large on the left; on the right measure, series and texts."""
    import rerun.blueprint as rrb

    right = rrb.Vertical(
        *kind_views(kind),
        rrb.Tabs(
            rrb.TextDocumentView(name="Scene", origin="/scene"),
            rrb.TextLogView(name="Log", origin="/log"),
            series_view("Overlap", ["overlap_largest"]),
            active_tab="Scene",
        ),
    )
    return rrb.Blueprint(
        rrb.Horizontal(grain_view(focus), right, column_shares=[5, 3]),
        rrb.TimePanel(state="collapsed", timeline=TIMELINE, fps=FRAMES_PER_SECOND),
        rrb.SelectionPanel(state="hidden"),
        rrb.BlueprintPanel(state="hidden"),
        auto_layout=False,
        auto_views=False,
    )


def kind_views(kind: str) -> "list[rrb.View]":
    """What a kind of scene is looked at for: a heap's outline, the wind and what it carries, or a speed."""
    import rerun.blueprint as rrb

    energy = rrb.TimeSeriesView(
        name="Energy, decades of J", origin="/decades", plot_legend=rrb.Corner2D.LeftBottom
    )
    if kind in WIND_KINDS:
        profile = rrb.Spatial2DView(
            name="Wind: height against speed", origin="/profile", background=pictures.NIGHT
        )
        flux = transport_view("What the wind carries", ["flux"])
        return [profile, flux, transport_view("Wind and flying grains", ["friction_velocity", "flying"])]
    contacts = series_view("Contacts", ["contacts", "released"])
    if kind in HEAP_KINDS:
        outline = rrb.Spatial2DView(name=SILHOUETTES, origin="/silhouette", background=pictures.NIGHT)
        return [outline, energy, contacts]
    return [series_view("Speed", ["speed_largest"]), energy, contacts]


def transport_view(name: str, series: list[str]) -> "rrb.TimeSeriesView":
    """Curves of grains under wind."""
    import rerun.blueprint as rrb

    contents = [f"$origin/{entry}" for entry in series]
    return rrb.TimeSeriesView(
        name=name, origin="/transport", contents=contents, plot_legend=rrb.Corner2D.LeftTop
    )


def grain_view(focus: Focus, name: str = "Grains", below: str = "/world") -> "rrb.Spatial3DView":
    """Grains and walls of an entity from the front, a little from above and from the right."""
    import rerun.blueprint as rrb

    towards_eye = np.array(VIEW_DIRECTION) / np.linalg.norm(VIEW_DIRECTION)
    centre = MAGNIFICATION * np.array(focus.centre)
    eye = centre + MAGNIFICATION * DISTANCE * focus.radius * towards_eye
    return rrb.Spatial3DView(
        name=name,
        origin="/",
        contents=f"{below}/**",
        background=pictures.NIGHT,
        line_grid=rrb.LineGrid3D(visible=False),
        eye_controls=rrb.EyeControls3D(position=eye, look_target=centre, eye_up=(0.0, 0.0, 1.0)),
    )


def series_view(name: str, series: list[str]) -> "rrb.TimeSeriesView":
    """Curves of entries of the ledger."""
    import rerun.blueprint as rrb

    contents = [f"$origin/{entry}" for entry in series]
    return rrb.TimeSeriesView(
        name=name, origin="/ledger", contents=contents, plot_legend=rrb.Corner2D.LeftTop
    )
