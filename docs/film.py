"""Draws docs/pictures/film.webp from two runs, of about a minute each: a funnel test, and sand in the wind.

Spheres are drawn pixel by pixel in perspective, with the shadow that a distant light casts; no viewer and no
graphics processor take part.
"""

import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont
from scipy.spatial import ConvexHull

from taichi_erosion.cli.main import main as command
from taichi_erosion.recording.readback import GrainFrame, read_grains

Array = NDArray[np.float64]

ROOT = Path(__file__).resolve().parents[1]
FILM = ROOT / "docs" / "pictures" / "film.webp"
LIGHT = np.array([-0.45, -0.55, 0.9]) / np.linalg.norm([-0.45, -0.55, 0.9])  # towards the lamp
SHADE = 0.42  # brightness in the shadow
FINE = 2  # pixels drawn for one that is kept, along each side
PAPER = np.array([246.0, 244.0, 240.0])
SAND, FAST = np.array([204.0, 164.0, 112.0]), np.array([196.0, 60.0, 40.0])
FRAME_DURATION = 50  # ms
QUALITY = 62
SIZE, GAP = (440, 330), 8  # px
INK = (70, 66, 60)
HEAP = ("record.every=0.0125",)
WIND = (
    "grains.count=3600",
    "wind.length_d=75",
    "wind.width_d=12",
    "run.check_interval=1.5e-3",
    "record.every=1.5e-3",
    "stages.1.duration_max=0.19",
    "stages.1.friction_velocity=0.5",
    *(f"stages.{stage}.duration_max=1e-3" for stage in range(2, 7)),
)
CALM = 0.06  # s, while the bed settles
FUNNEL = ((0.060, 0.097), (0.0125, 0.042), (0.0125, 0.032))  # radius, height [m]: rim, stem, outlet


@dataclass(frozen=True)
class Camera:
    """A pinhole: where it stands, what it looks at, focal length [px], size of the picture [px]."""

    eye: tuple[float, float, float]
    target: tuple[float, float, float]
    focal: float
    size: tuple[int, int]

    def axes(self) -> Array:
        """Rows: to the right, downwards, forwards."""
        forwards = np.subtract(self.target, self.eye)
        forwards /= np.linalg.norm(forwards)
        right = np.cross(forwards, [0.0, 0.0, 1.0])
        right /= np.linalg.norm(right)
        return np.array([right, np.cross(forwards, right), forwards])


def splat(centre: Array, radius: Array, size: tuple[int, int]) -> tuple[Array, NDArray[np.int64]]:
    """Depth of the nearest sphere [px], and which one it is (-1: none), seen along the third coordinate."""
    width, height = size
    depth, front = np.full((height, width), np.inf), np.full((height, width), -1)
    for k in np.flatnonzero((np.abs(centre[:, 0] - width / 2) < width) & (radius > 0.0)):
        x, y, z, r = *centre[k], radius[k]
        left, right = max(int(x - r), 0), min(int(x + r) + 2, width)
        top, bottom = max(int(y - r), 0), min(int(y + r) + 2, height)
        if left >= right or top >= bottom:
            continue
        square = (np.arange(left, right) - x) ** 2 + (np.arange(top, bottom)[:, None] - y) ** 2
        surface = np.where(square < r * r, z - np.sqrt(np.maximum(r * r - square, 0.0)), np.inf)
        box = (slice(top, bottom), slice(left, right))
        nearer = surface < depth[box]
        depth[box][nearer], front[box][nearer] = surface[nearer], k
    return depth, front


def draw(position: Array, radius: Array, colour: Array, camera: Camera, ground: float | None) -> Array:
    """Picture [height, width, 3] of spheres, and of a plane at the height `ground` where there is one."""
    axes, (width, height) = camera.axes(), (FINE * camera.size[0], FINE * camera.size[1])
    focal, seen = FINE * camera.focal, (position - camera.eye) @ axes.T
    scale = focal / seen[:, 2]
    pixels = np.column_stack([seen[:, :2] * scale[:, None] + [width / 2, height / 2], seen[:, 2] * scale])
    _, front = splat(pixels, radius * scale, (width, height))
    column, row = np.meshgrid(np.arange(width) - width / 2, np.arange(height) - height / 2)
    ray = np.stack([column, row, np.full_like(column, focal)], axis=-1) @ axes
    ray /= np.linalg.norm(ray, axis=-1, keepdims=True)
    picture, hit = np.tile(PAPER, (height, width, 1)), front >= 0
    if ground is not None:
        down = ~hit & (ray[..., 2] < -1e-3)
        distance = (ground - camera.eye[2]) / ray[down][:, 2]
        place = camera.eye + ray[down] * distance[:, None]
        dark = 1.0 - 0.35 * in_shadow(place, position, radius)
        fade = np.exp(-((distance / (3.0 * np.linalg.norm(np.subtract(camera.eye, camera.target)))) ** 2))
        picture[down] *= (1.0 - 0.10 * fade)[:, None] * dark[:, None]
    k = front[hit]
    along = ray[hit]
    middle = np.einsum("ij,ij->i", along, position[k] - camera.eye)
    square = np.sum((position[k] - camera.eye) ** 2, axis=1) - middle**2
    place = camera.eye + along * (middle - np.sqrt(np.maximum(radius[k] ** 2 - square, 0.0)))[:, None]
    normal = (place - position[k]) / radius[k][:, None]
    bright = np.maximum(normal @ LIGHT, 0.0) * (
        1.0 - in_shadow(place + 0.2 * radius[k][:, None] * normal, position, radius)
    )
    picture[hit] = colour[k] * (SHADE + 0.18 * normal[:, 2] + 0.62 * bright)[:, None]
    return (
        np.clip(picture, 0.0, 255.0).reshape(height // FINE, FINE, width // FINE, FINE, 3).mean(axis=(1, 3))
    )


def in_shadow(place: Array, position: Array, radius: Array) -> Array:
    """1 where a sphere lies between a place and the lamp, 0 elsewhere."""
    side = np.cross(LIGHT, [0.0, 1.0, 0.0])
    side /= np.linalg.norm(side)
    axes = np.array([side, np.cross(LIGHT, side), -LIGHT])
    pixel = 0.3 * float(np.median(radius))
    seen = position @ axes.T / pixel
    low, high = np.percentile(seen[:, :2], [0.5, 99.5], axis=0)
    low, (width, height) = low - 20, np.minimum(high - low + 40, 2500)
    size = (int(width), int(height))
    centre = seen - [*low, 0.0]
    depth, _ = splat(centre, radius / pixel, size)
    at = place @ axes.T / pixel - [*low, 0.0]
    column, row = at[:, 0].round().astype(int), at[:, 1].round().astype(int)
    inside = (column >= 0) & (column < size[0]) & (row >= 0) & (row < size[1])
    dark = np.zeros(len(place))
    dark[inside] = depth[row[inside], column[inside]] < at[inside, 2] - 1.0
    return dark


def colours(frame: GrainFrame, fastest: float) -> Array:
    """From sand at rest to red at the speed `fastest` [m/s]; grains differ a little."""
    share = np.clip(np.linalg.norm(frame.state["velocity"], axis=1) / fastest, 0.0, 1.0)[:, None]
    tone = 0.88 + 0.24 * (((frame.ident.astype(np.int64) * 2654435761) >> 8) % 1024 / 1024.0)
    return (SAND + share * (FAST - SAND)) * tone[:, None]


def rings(camera: Camera, circles: Sequence[tuple[float, float]]) -> list[Array]:
    """Horizontal circles (radius, height) about the origin, as pixels [65, 2] of the picture."""
    turn = np.linspace(0.0, 2.0 * np.pi, 65)
    drawn = []
    for radius, height in circles:
        place = np.column_stack([radius * np.cos(turn), radius * np.sin(turn), np.full(65, height)])
        seen = (place - camera.eye) @ camera.axes().T
        drawn.append(seen[:, :2] * camera.focal / seen[:, 2:] + np.divide(camera.size, 2.0))
    return drawn


def with_funnel(picture: Image.Image, camera: Camera) -> Image.Image:
    """The funnel of the scene as thin glass."""
    drawn = rings(camera, FUNNEL)
    glass = Image.new("RGBA", picture.size)
    pen = ImageDraw.Draw(glass)
    for upper, lower in pairwise(drawn):
        corners = np.concatenate([upper, lower])
        hull = corners[ConvexHull(corners).vertices]
        pen.polygon([tuple(corner) for corner in hull], fill=(110, 130, 150, 34))
    for ring in drawn:
        pen.line([tuple(corner) for corner in ring], fill=(90, 105, 120, 150), width=1)
    return Image.alpha_composite(picture.convert("RGBA"), glass).convert("RGB")


def with_words(picture: Image.Image, words: str, length: float, camera: Camera) -> Image.Image:
    """A line of words above, and a bar of `length` metres, as long as one at the target of the camera."""
    pen, (width, height) = ImageDraw.Draw(picture), picture.size
    distance = float(np.linalg.norm(np.subtract(camera.target, camera.eye)))
    bar = length * camera.focal / distance
    pen.text((12, 8), words, fill=INK, font=ImageFont.load_default(15))
    pen.line([(width - 14 - bar, height - 12), (width - 14, height - 12)], fill=INK, width=2)
    pen.text(
        (width - 14 - bar, height - 32), f"{1e3 * length:g} mm", fill=INK, font=ImageFont.load_default(13)
    )
    return picture


def heap_pictures(recording: Path) -> list[Image.Image]:
    """Frames of the funnel test."""
    camera = Camera((0.03, -0.27, 0.11), (0.0, 0.0, 0.038), 640.0, SIZE)
    film = []
    for frame in read_grains(recording):
        drawn = draw(
            frame.position.astype(float), frame.radius.astype(float), colours(frame, 0.5), camera, 0.0
        )
        picture = with_funnel(Image.fromarray(drawn.astype(np.uint8)), camera)
        film.append(with_words(picture, f"funnel test, {frame.time:.2f} s", 0.02, camera))
    return film


def wind_pictures(recording: Path) -> list[Image.Image]:
    """Frames of sand in the wind; the patch is periodic, so its neighbours are drawn too."""
    frames = [frame for frame in read_grains(recording) if frame.time > CALM]
    length = float(np.ptp(frames[0].position[:, 0]))
    camera = Camera((0.5 * length, -0.040, 0.0075), (0.5 * length, 0.0, 0.0062), 880.0, SIZE)
    film = []
    for frame in frames:
        copies = [frame.position + np.array([shift * length, 0.0, 0.0]) for shift in (-1, 0, 1)]
        position, radius = np.concatenate(copies).astype(float), np.tile(frame.radius, 3).astype(float)
        drawn = draw(position, radius, np.tile(colours(frame, 2.0), (3, 1)), camera, None)
        words = f"sand in the wind, {1e3 * (frame.time - frames[0].time):.0f} ms"
        film.append(with_words(Image.fromarray(drawn.astype(np.uint8)), words, 0.002, camera))
    return film


def recording(scene: str, changes: Sequence[str], path: Path) -> Path:
    """Recording of one repeat of a scene of this project with some entries changed."""
    options = [word for change in changes for word in ("--set", change)]
    command(["run", str(ROOT / "scenes" / scene), "--replicas", "1", "--record", str(path), *options])
    return path


def main() -> None:
    """Both films side by side; the heap's takes every picture twice, and its last one stays."""
    with tempfile.TemporaryDirectory() as folder:
        left = heap_pictures(recording("funnel_repose.toml", HEAP, Path(folder) / "heap.rrd"))
        right = wind_pictures(recording("saltation.toml", WIND, Path(folder) / "wind.rrd"))
    film = []
    for k in range(len(right)):
        both = Image.new("RGB", (2 * SIZE[0] + GAP, SIZE[1]), (255, 255, 255))
        both.paste(left[min(k // 2, len(left) - 1)], (0, 0))
        both.paste(right[k], (SIZE[0] + GAP, 0))
        film.append(both)
    duration = [FRAME_DURATION] * (len(film) - 1) + [20 * FRAME_DURATION]
    film[0].save(
        FILM, save_all=True, append_images=film[1:], duration=duration, loop=0, quality=QUALITY, method=6
    )


if __name__ == "__main__":
    main()
