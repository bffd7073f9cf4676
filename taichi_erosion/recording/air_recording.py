"""Recording of air alone: a slice along the wind, the profile, and curves over time."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from PIL import Image

from taichi_erosion.core.setup import Floats
from taichi_erosion.core.snapshot import FIELD_UNITS, AirSnapshot, GrainFields
from taichi_erosion.recording import pictures, rr, rrb, stream
from taichi_erosion.recording.blueprint import add_time_panel, image_view
from taichi_erosion.recording.pictures import Picture
from taichi_erosion.recording.stream import Recording

SLICE_PIXELS = 900  # longer side of a slice [px]
SLICE_LEAST = 160  # shorter side; thin boxes are drawn thicker than they are [px]
SPEED_COLOURS = np.array(  # from still air to the fastest wind
    [pictures.NIGHT, (38, 70, 130), (60, 150, 190), (150, 220, 170), (250, 230, 120), (255, 120, 60)]
)
PLOT_WIDTH, PLOT_HEIGHT = 100.0, 60.0  # of the profile plot, in its own units
TICKS = 2  # labelled values of each axis beside 0; more would overlap in a small view
BACKFLOW = 0.01  # of the fastest wind: slower backflow is drawn as 0 [1]
FRAMES_PER_SECOND = 10.0  # of the viewer's playback


def open_wind_recording(path: Path, name: str, scene_text: str, curves: Mapping[str, str]) -> Recording:
    """Begin PATH.part with its blueprint and the scene file (TOML); `curves` are legends by name.

    Raises BadInput where it cannot be written.
    """
    named = ((legend, [f"$origin/{curve}"]) for curve, legend in curves.items())
    series = (rrb.TimeSeriesView(name=legend, origin="/air", contents=curve) for legend, curve in named)
    texts = rrb.Tabs(*series, rrb.TextDocumentView(name="Scene", origin="/scene"), active_tab=0)
    below = rrb.Horizontal(image_view("Profile: height against speed", "/profile"), texts)
    layout = rrb.Vertical(image_view("Speed along the wind", "/slice"), below, row_shares=[1, 1])
    recording = stream.open_stream(path, name, add_time_panel(layout, FRAMES_PER_SECOND))
    stream.log_scene_text(recording, name, scene_text)
    for curve, legend in curves.items():
        stream.log_curve_legend(recording, f"air/{curve}", legend, pictures.SAND)
    stream.flush_recording(recording)
    return recording


def log_wind(recording: Recording, state: AirSnapshot, step: int, curves: Mapping[str, float]) -> None:
    """Write slice, profile and curves of one state."""
    stream.set_recording_time(recording, state.time, step)
    stream.log_image(recording, "slice", speed_slice_picture(state))
    log_height_profile(recording, state.velocity[..., 0].mean(axis=(0, 1)), state.faces_z)
    stream.log_curve_values(recording, "air", curves)


def speed_slice_picture(state: AirSnapshot) -> Picture:
    """Picture of the speed in the vertical plane along the wind through the middle of the box."""
    middle = state.velocity.shape[1] // 2
    speed = np.linalg.norm(state.velocity[:, middle], axis=-1)
    length = float(state.x[-1] + state.x[0]) if len(state.x) > 1 else float(np.ptp(state.faces_z))
    height = float(np.ptp(state.faces_z))
    scale = SLICE_PIXELS / max(length, height)
    columns, rows = (max(int(scale * size), SLICE_LEAST) for size in (length, height))
    across = np.minimum(np.arange(columns) * speed.shape[0] // columns, speed.shape[0] - 1)
    heights = state.faces_z[0] + height * (np.arange(rows)[::-1] + 0.5) / rows
    up = np.clip(np.searchsorted(state.faces_z, heights) - 1, 0, speed.shape[1] - 1)
    fastest = max(float(speed.max()), np.finfo(float).tiny)
    shares = speed[across[None, :], up[:, None]] / fastest
    picture = Image.fromarray(pictures.interpolate_colours(shares, SPEED_COLOURS))
    bar = pictures.interpolate_colours(np.linspace(0.0, 1.0, pictures.COLOUR_BAR[0]), SPEED_COLOURS)
    pictures.draw_colour_bar(picture, (pictures.MARGIN, pictures.MARGIN), bar, (0.0, fastest))
    return picture


def log_grain_fields(recording: Recording, fields: GrainFields) -> None:
    """Write all columns of a vertical profile of the grains, and two of them as curves."""
    columns = {"width": [fields.width], **{name: fields.at.get(name, np.zeros(0)) for name in "xyz"}}
    columns |= {name: getattr(fields, name).ravel() for name in FIELD_UNITS}
    recording.stream.log("fields", rr.AnyValues(**columns))
    z = fields.at["z"]
    faces = np.append(z - 0.5 * (z[1] - z[0]), z[-1] + 0.5 * (z[1] - z[0]))
    stress = fields.kinetic_stress + fields.contact_stress
    log_height_profile(recording, fields.solid_fraction.ravel(), faces, "solid_fraction", "", faces[0])
    log_height_profile(recording, stress[..., 2, 2].ravel(), faces, "vertical_stress", " Pa", faces[0])


def log_height_profile(
    recording: Recording,
    speed: Floats,
    faces: Floats,
    entity: str = "profile",
    unit: str = " m/s",
    bottom: float = 0.0,
) -> None:
    """Write speeds [n], or other values, between faces [n + 1] m by height, whose axis begins at `bottom`."""
    height, top = 0.5 * (faces[1:] + faces[:-1]) - faces[0], float(np.ptp(faces))
    high = max(float(speed.max()), np.finfo(float).tiny)
    low = float(speed.min()) if speed.min() < -BACKFLOW * high else 0.0
    x = (speed - low) / (high - low) * PLOT_WIDTH
    y = -height / top * PLOT_HEIGHT
    curve = rr.LineStrips2D([np.column_stack([x, y])], colors=[pictures.EMBER], radii=[0.3])
    recording.stream.log(f"{entity}/speed", curve)
    ticks = np.linspace(0.0, 1.0, TICKS + 1)
    places = [(PLOT_WIDTH * t, 3.0) for t in ticks] + [(-3.0, -PLOT_HEIGHT * t) for t in ticks[1:]]
    words = [f"{low + (high - low) * t:.3g}{unit}" for t in ticks]
    words += [f"{bottom + top * t:.3g} m" for t in ticks[1:]]
    axes = rr.Points2D(places, labels=words, colors=[pictures.STEEL], radii=[0.2], show_labels=True)
    recording.stream.log(f"{entity}/axes", axes)
