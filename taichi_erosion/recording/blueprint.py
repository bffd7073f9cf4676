"""Blueprints of recordings: views, camera and layout that a viewer opens with."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import pi, radians, tan
from typing import Any

import numpy as np

from taichi_erosion.core.setup import Floats, Triple
from taichi_erosion.recording import pictures, rrb
from taichi_erosion.recording.wall_mesh import WallMesh

BED_FRACTION = 0.55  # solid volume over volume of a loose heap [1], to guess its size before it exists
HEAP_SLOPE = radians(30.0)  # flank of the guessed heap [rad]
HEAP_MARGIN = 1.5  # radius of the ball framed over the radius of the guessed heap [1]
DISTANCE = 2.2  # of the eye from the centre of the ball, over its radius [1]: it fills the view's height
VIEW_DIRECTION = (0.30, -1.0, 0.34)  # from the middle towards the eye
HEAP_KINDS = frozenset({"repose", "collapse", "lifting"})
WIND_KINDS = frozenset({"threshold", "saltation"})
PROFILES = (("Solid fraction", "/solid_fraction"), ("Vertical stress", "/vertical_stress"))
CHAINS = "Force chains: wider and brighter for larger forces; blue pulls"
LEGEND = "Colour: speed of moving grains; sand, or by kind: at rest"
MAGNIFICATION = 1e3  # world units are m, drawn as mm: the viewer hides what is within millimetres of the eye
TIMELINE = "sim_time"  # of every recording [s]
FRAMES_PER_SECOND = 30.0  # of the viewer's playback


@dataclass(frozen=True)
class Focus:
    """Ball that the camera frames."""

    centre: Triple  # m
    radius: float  # m


def heap_focus(radii: Floats) -> Focus:
    """Ball about the heap that grains of these radii [m] will form on the origin.

    A cone of slope a and base radius R holds  V = (pi / 3) R^3 tan a,  and the grains of radii r fill
    V = sum (4 / 3) pi r^3 / bed fraction.
    """
    volume = 4.0 / 3.0 * pi * float((radii**3).sum()) / BED_FRACTION
    radius = (3.0 * volume / (pi * tan(HEAP_SLOPE))) ** (1.0 / 3.0)
    return Focus((0.0, 0.0, radius * tan(HEAP_SLOPE)), HEAP_MARGIN * radius)


def choose_focus(kind: str, radii: Floats, walls: Sequence[WallMesh]) -> Focus:
    """Ball about the heap where one forms, about all walls otherwise."""
    if kind in HEAP_KINDS or not any(len(wall.vertices) for wall in walls):
        return heap_focus(radii)
    corners = np.concatenate([wall.vertices for wall in walls])
    low, high = corners.min(axis=0), corners.max(axis=0)
    middle = 0.5 * (low + high)
    return Focus((middle[0], middle[1], middle[2]), 0.5 * float(np.linalg.norm(high - low)))


def add_time_panel(
    layout: Any, frames_per_second: float = FRAMES_PER_SECOND, timeline: str = TIMELINE
) -> "rrb.Blueprint":
    """Blueprint of a layout: time panel collapsed, other panels hidden, nothing added by the viewer."""
    panel = rrb.TimePanel(state="collapsed", timeline=timeline, fps=frames_per_second)
    hidden = rrb.SelectionPanel(state="hidden"), rrb.BlueprintPanel(state="hidden")
    return rrb.Blueprint(layout, panel, *hidden, auto_layout=False, auto_views=False)


def run_blueprint(kind: str, focus: Focus, contacts: bool = False, fields: bool = False) -> "rrb.Blueprint":
    """Blueprint of a run: grains, and contacts if asked, on the left; on the right measure, curves, texts."""
    texts = rrb.TextDocumentView(name="Scene", origin="/scene"), rrb.TextLogView(name="Log", origin="/log")
    tabs = rrb.Tabs(*texts, curve_view("Overlap", "/ledger", "overlap_largest"), active_tab="Scene")
    profiles = [rrb.Horizontal(*(image_view(*view) for view in PROFILES))] if fields else []
    right = rrb.Vertical(*scene_kind_views(kind), *profiles, tabs)
    views, shares = [grain_view(focus, hidden=("/world/contacts",))], [8, 1]
    if contacts:
        views.append(grain_view(focus, CHAINS, hidden=("/world/bed", "/world/mobile")))
        shares = [4, 4, 1]
    left = rrb.Vertical(*views, image_view(LEGEND, "/legend"), row_shares=shares)
    return add_time_panel(rrb.Horizontal(left, right, column_shares=[5, 3]))


def scene_kind_views(kind: str) -> "list[rrb.View]":
    """Views for a kind of scene: outline of a heap, wind and transport, or speeds."""
    corner = rrb.Corner2D.LeftBottom
    energy = rrb.TimeSeriesView(name="Energy, decades of J", origin="/decades", plot_legend=corner)
    if kind in WIND_KINDS:
        return [
            image_view("Wind: height against speed", "/profile"),
            curve_view("What the wind carries", "/transport", "flux"),
            curve_view("Wind and flying grains", "/transport", "friction_velocity", "flying"),
        ]
    contacts = curve_view("Contacts", "/ledger", "contacts", "released")
    if kind in HEAP_KINDS:
        return [image_view("Silhouettes at the end", "/silhouette"), energy, contacts]
    return [curve_view("Speed", "/ledger", "speed_largest"), energy, contacts]


def image_view(name: str, origin: str) -> "rrb.Spatial2DView":
    """Picture or plane drawing on the dark background."""
    return rrb.Spatial2DView(name=name, origin=origin, background=pictures.NIGHT)


def curve_view(name: str, origin: str, *entries: str) -> "rrb.TimeSeriesView":
    contents = [f"$origin/{entry}" for entry in entries]
    return rrb.TimeSeriesView(name=name, origin=origin, contents=contents, plot_legend=rrb.Corner2D.LeftTop)


def grain_view(
    focus: Focus,
    name: str = "Grains",
    below: str = "/world",
    distance: float = DISTANCE,
    hidden: Sequence[str] = (),
) -> "rrb.Spatial3DView":
    """Grains and walls of an entity from the front, a little from above and from the right."""
    towards_eye = np.array(VIEW_DIRECTION) / np.linalg.norm(VIEW_DIRECTION)
    centre = MAGNIFICATION * np.array(focus.centre)
    eye = centre + MAGNIFICATION * distance * focus.radius * towards_eye
    contents = [f"+ {below}/**", *(f"- {entity}/**" for entity in hidden)]
    controls = rrb.EyeControls3D(position=eye, look_target=centre, eye_up=(0.0, 0.0, 1.0))
    scenery: dict[str, Any] = {"background": pictures.NIGHT, "line_grid": rrb.LineGrid3D(visible=False)}
    return rrb.Spatial3DView(name=name, origin="/", contents=contents, eye_controls=controls, **scenery)
