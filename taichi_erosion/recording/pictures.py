"""Pictures without a display: grains from the side, silhouettes with flanks, films, pictures of characters.

A picture is a Pillow image; a point of it is (column, row) in pixels, (0, 0) the upper left.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from io import BytesIO
from math import floor, log10
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont, ImageOps
from PIL.Image import Image as Picture
from PIL.Image import Resampling

from taichi_erosion.core.files import write_atomic
from taichi_erosion.core.setup import Floats
from taichi_erosion.core.snapshot import ContactNetwork, Snapshot
from taichi_erosion.recording.wall_mesh import WallMesh, wall_cut_lines

Colours = NDArray[np.uint8]  # [n, 3]
Mask = NDArray[np.bool_]
Colour = tuple[int, int, int]

NIGHT = (16, 19, 26)  # background behind grains
DUSK = (38, 44, 56)  # background near the ground
SAND = (222, 184, 135)  # grain at rest
STEEL = (138, 156, 178)  # walls
EMBER = (255, 92, 57)  # fitted lines
KIND_COLOURS = np.array([SAND, (118, 74, 46), (226, 224, 214), (128, 152, 84), (104, 122, 140)])  # at rest
CHALK = (232, 230, 222)  # lettering

SPEED_COLOURS = np.array(
    [SAND, (240, 150, 84), (232, 88, 96), (176, 72, 190), (88, 120, 255), (120, 220, 255)]
)
FORCE_COLOURS = ((EMBER, (255, 220, 120)), ((88, 120, 255), (120, 220, 255)))  # that push, that pull
MOST_CONTACTS = 8  # of a grain, drawn in the last colour
FAINT = (52, 58, 70)  # grains behind their contacts
CHAIN_SHARE = 0.2  # widest line over the distance of the centres that it joins [1]
TINT_RANGE = 0.14  # largest change of brightness between two grains at rest [1]
TINT_TURN = 0.6180339887498949  # golden ratio - 1: neighbouring numbers fall far apart [1]

SMOOTHING = 2  # pixels drawn along each edge of a picture pixel, then averaged [1]
MOST_DISCS = 7  # that shade a sphere, the smaller the brighter and the nearer to its highlight
HIGHLIGHT = (-0.3, -0.4)  # of the radius: its place, columns and rows [1]
DARKEST, BRIGHTENING = 0.4, 0.8  # share of the colour at the rim, and what the highlight has more [1]
HAZE = 0.45  # share of the background in the colour of the farthest grain [1]
LEAST_RADIUS = 0.75  # px, so that no grain falls between the pixels
BAR_SHARE = 0.25  # longest scale bar over the width of the picture [1]
LETTER_SIZE = 12  # px
MARGIN = 10  # px around lettering
GAP = 6  # px between the silhouettes of a grid
COLUMNS = 3  # of a grid
HEADROOM = 24  # px of sky above a silhouette, for its caption
CAPTION_CORNER = (8, 6)  # px
COLOUR_BAR = (150, 8)  # px, width and height of the colours of a legend
TICKS = 4  # numbers below a colour bar


def resting_colours(ident: NDArray[np.int32], kind: NDArray[np.int32] | None = None) -> Colours:
    """Sand, a little brighter or darker from grain to grain so that single grains can be told apart.

    Of several kinds each has a colour of its own.
    """
    brightness = 1.0 + TINT_RANGE * (2.0 * np.mod(ident * TINT_TURN, 1.0) - 1.0)
    base = SAND if kind is None else KIND_COLOURS[kind % len(KIND_COLOURS)]
    return np.clip(brightness[:, np.newaxis] * base, 0, 255).astype(np.uint8)


def speed_colours(speed: Floats, low: float, high: float) -> Colours:
    """Colour of a moving grain, from sand at speed `low` to ice blue at `high` [m s-1], in equal ratios."""
    return interpolate_colours(np.log(np.clip(speed, low, high) / low) / np.log(high / low), SPEED_COLOURS)


def grain_colours(snapshot: Snapshot, low: float, high: float) -> Colours:
    """Colours of grains: up to speed `low` [m s-1] those of resting ones, by kind, beyond by speed."""
    speed = np.linalg.norm(snapshot.velocity, axis=1)
    moving = speed > low
    colours = resting_colours(snapshot.ident, snapshot.kind)
    colours[moving] = speed_colours(speed[moving], low, high)
    return colours


def interpolate_colours(share: Floats, anchors: NDArray[np.int_]) -> Colours:
    """Colours at shares [1] of the way along evenly spaced anchors [k, 3]."""
    position, places = share * (len(anchors) - 1), np.arange(len(anchors))
    channels = [np.interp(position, places, anchors[:, channel]) for channel in range(3)]
    return np.stack(channels, axis=-1).astype(np.uint8)


def colours_by_quantity(quantity: str, snapshot: Snapshot, low: float, high: float) -> Colours:
    """Colours of grains by force, material or contacts; by anything else as `grain_colours`."""
    if quantity == "force" and snapshot.force is not None:
        return force_colours(np.linalg.norm(snapshot.force, axis=1))
    if quantity == "material":
        return resting_colours(snapshot.ident, snapshot.kind)
    if quantity == "contacts":
        return interpolate_colours(np.minimum(snapshot.contacts / MOST_CONTACTS, 1.0), SPEED_COLOURS)
    return grain_colours(snapshot, low, high)


def force_line_widths(normal_force: Floats) -> Floats:
    """Width of the line of each contact over the largest: its share of thrice the mean force, at most 1."""
    size = np.abs(normal_force)
    mean = size.sum() / max(len(size), 1)
    return np.clip(size / max(3.0 * mean, np.finfo(float).tiny), 0.02, 1.0)


def force_colours(normal_force: Floats) -> Colours:
    """Colour of each contact by the same share: of those that push from dusk to ember, that pull, to ice."""
    share = force_line_widths(normal_force)
    push, pull = (interpolate_colours(share, np.array([(80, 84, 100), *ends])) for ends in FORCE_COLOURS)
    return np.where(normal_force[:, np.newaxis] < 0.0, pull, push)


def night_background(size: tuple[int, int]) -> Picture:
    """Background of `size` (width, height), from NIGHT at its top to DUSK."""
    return ImageOps.colorize(Image.linear_gradient("L").resize(size), NIGHT, DUSK)


def draw_text(picture_out: Picture, place: tuple[float, float], text: str, size: int, anchor: str) -> None:
    """Write a line at a place; `anchor` as in Pillow: la, ma and ra put its top left, middle, right there."""
    ImageDraw.Draw(picture_out).text(place, text, CHALK, ImageFont.load_default(size), anchor=anchor)


@dataclass(frozen=True)
class SideView:
    """Window of a picture seen along +y: x runs right, z up; `low` and `high` are its corners (x, z) [m]."""

    low: tuple[float, float]
    high: tuple[float, float]
    size: tuple[int, int] = (480, 360)  # width and height [px]

    @property
    def scale(self) -> float:
        """Pixels per metre, the same in both directions, so that the whole window fits."""
        return min(pixels / (b - a) for a, b, pixels in zip(self.low, self.high, self.size, strict=True))

    def pixels(self, points: Floats) -> Floats:
        """Pixels (column, row) of points (x, z) [m]; the window is centred, its floor the lower edge."""
        middle = 0.5 * (self.low[0] + self.high[0])
        column = 0.5 * self.size[0] + (points[..., 0] - middle) * self.scale - 0.5
        row = self.size[1] - (points[..., 1] - self.low[1]) * self.scale - 0.5
        return np.stack([column, row], axis=-1)


def render_side(
    positions: Floats,
    radii: Floats,
    view: SideView,
    colours: Colours | None = None,
    walls: Sequence[WallMesh] = (),
) -> Picture:
    """Spheres, centres [n, 3] and radii [n] in m, seen along +y; walls show their cut by y = 0."""
    if colours is None:
        colours = resting_colours(np.arange(len(radii), dtype=np.int32))
    fine = SideView(view.low, view.high, (view.size[0] * SMOOTHING, view.size[1] * SMOOTHING))
    picture = night_background(fine.size)
    draw = ImageDraw.Draw(picture, "RGBA")
    draw_spheres(draw, positions, radii, fine, colours)
    for wall in walls:
        for ends in fine.pixels(wall_cut_lines(wall)):
            draw.line(ends.ravel().tolist(), (*STEEL, 170), SMOOTHING)
    return picture.reduce(SMOOTHING)


def draw_spheres(
    draw_out: ImageDraw.ImageDraw, positions: Floats, radii: Floats, view: SideView, colours: Colours
) -> None:
    """Draw spheres as discs lit from the upper left, far ones first and in haze."""
    order = np.argsort(-positions[:, 1], kind="stable")
    depth = positions[order, 1:2] - positions[:, 1].min(initial=np.inf)
    haze = HAZE * depth / max(float(depth.max(initial=0.0)), np.finfo(float).tiny)
    base = (1.0 - haze) * colours[order] + haze * np.array(DUSK)
    reach = np.maximum(radii[order] * view.scale, LEAST_RADIUS)[:, None, None]
    count = min(max(int(reach.max(initial=0.0)), 1), MOST_DISCS)
    share = np.arange(count)[:, None] / count  # of the way from the rim to the highlight
    brightness = DARKEST + BRIGHTENING * (share + 0.5 / count) ** 0.75
    shades = np.clip(base[:, None] * brightness, 0, 255).astype(int).tolist()
    middle = view.pixels(positions[order][:, None, [0, 2]]) + reach * share * np.array(HIGHLIGHT)
    edge = reach * (1.0 - share)
    boxes = np.concatenate([middle - edge, middle + edge], axis=-1).tolist()
    for discs, tones in zip(boxes, shades, strict=True):
        for box, tone in zip(discs, tones, strict=True):
            draw_out.ellipse(box, tuple(tone))


def scale_bar_length(longest: float) -> float:
    """Longest of 1, 2 or 5 times a power of ten up to a length, in its unit."""
    power = 10.0 ** floor(log10(longest))
    return max(step * power for step in (1.0, 2.0, 5.0) if step * power <= longest * (1.0 + 1e-9))


def draw_scale_bar(picture_out: Picture, view: SideView) -> None:
    """Draw a bar of 1, 2 or 5 times a power of ten, its length above it in mm, in the lower right corner."""
    length = scale_bar_length(1e3 * BAR_SHARE * view.size[0] / view.scale)
    right, row = view.size[0] - MARGIN, view.size[1] - MARGIN
    left = right - 1e-3 * length * view.scale
    ImageDraw.Draw(picture_out).line((left, row, right, row), CHALK, 2)
    draw_text(picture_out, (0.5 * (left + right), row - 4), f"{length:g} mm", LETTER_SIZE, "ms")


def draw_colour_bar(
    picture_out: Picture, corner: tuple[int, int], colours: Colours, numbers: Sequence[float], size: int = 1
) -> None:
    """Draw colours [k, 3] as a bar with evenly spaced numbers below, in m/s; `corner` is its upper left."""
    (column, row), (width, height) = corner, (size * COLOUR_BAR[0], size * COLOUR_BAR[1])
    bar = Image.fromarray(colours[np.newaxis]).resize((width, height), Resampling.NEAREST)
    picture_out.paste(bar, corner)
    last = len(numbers) - 1
    for tick, number in enumerate(numbers):
        text, anchor = f"{number:.2g}", "la" if tick == 0 else "ma"
        place = (column + tick / last * width, row + height + 2 * size)
        draw_text(picture_out, place, text + (" m/s" if tick == last else ""), 10 * size, anchor)


def draw_speed_bar(
    picture_out: Picture, corner: tuple[int, int], speeds: tuple[float, float], size: int = 1
) -> None:
    """Draw the colours of moving grains. Sand also is the colour of grains slower than the first number."""
    colours = interpolate_colours(np.linspace(0.0, 1.0, COLOUR_BAR[0]), SPEED_COLOURS)
    draw_colour_bar(picture_out, corner, colours, np.geomspace(*speeds, TICKS).tolist(), size)


def colour_legend(speeds: tuple[float, float]) -> Picture:
    """Picture of the colour bar alone, for a viewer."""
    size = 4
    picture = Image.new("RGB", (size * (COLOUR_BAR[0] + 40), size * (COLOUR_BAR[1] + 20)), NIGHT)
    draw_speed_bar(picture, (size * 10, size * 4), speeds, size)
    return picture


def silhouette_picture(mask: Mask, flanks: Floats, caption: str = "") -> Picture:
    """Silhouette, sand on night, with flank lines [k, 2, 2] in pixels: bright where fitted, faint beyond."""
    rows, columns = mask.shape
    picture = night_background((columns, rows + HEADROOM))
    picture.paste(SAND, (0, HEADROOM), Image.fromarray(mask))
    if len(flanks):  # drawn large and averaged, which smooths the edges of the lines
        picture = picture.resize((SMOOTHING * columns, SMOOTHING * (rows + HEADROOM)), Resampling.NEAREST)
        draw, width = ImageDraw.Draw(picture, "RGBA"), SMOOTHING * max(2, round(rows / 150))
        for ends in SMOOTHING * (flanks + np.array([0.0, HEADROOM])):
            beyond = ends + np.array([[-1.0], [1.0]]) * (ends[1] - ends[0])
            draw.line(beyond.ravel().tolist(), (*EMBER, 90), width // 2)
            draw.line(ends.ravel().tolist(), EMBER, width)
        picture = picture.reduce(SMOOTHING)
    draw_text(picture, CAPTION_CORNER, caption, LETTER_SIZE, "la")
    return picture


def silhouette_grid(masks: Sequence[Mask], flanks: Sequence[Floats], captions: Sequence[str]) -> Picture:
    """Silhouettes of all azimuths in one picture, row by row, standing on a common base within each row."""
    tiles = [silhouette_picture(*tile) for tile in zip(masks, flanks, captions, strict=True)]
    height = max(tile.height for tile in tiles) + GAP
    width = max(tile.width for tile in tiles) + GAP
    rows = -(-len(tiles) // COLUMNS)
    grid = Image.new("RGB", (COLUMNS * width + GAP, rows * height + GAP))
    for index, tile in enumerate(tiles):
        left = GAP + index % COLUMNS * width + (width - GAP - tile.width) // 2
        grid.paste(tile, (left, (index // COLUMNS + 1) * height - tile.height))
    return grid


def film_frame(
    snapshot: Snapshot, view: SideView, walls: Sequence[WallMesh], speeds: tuple[float, float]
) -> Picture:
    """One picture of a film: grains from the side, the time, the colours of speeds and a scale bar."""
    picture = render_side(snapshot.position, snapshot.radius, view, grain_colours(snapshot, *speeds), walls)
    draw_text(picture, CAPTION_CORNER, f"{snapshot.time:.2f} s", LETTER_SIZE, "la")
    draw_scale_bar(picture, view)
    draw_speed_bar(picture, (picture.width - COLOUR_BAR[0] - 3 * MARGIN, MARGIN), speeds)
    return picture


def force_chain_picture(
    positions: Floats, radii: Floats, network: ContactNetwork, view: SideView, walls: Sequence[WallMesh]
) -> Picture:
    """Contacts as lines over faint grains, seen along +y, the largest forces in front, with their mean."""
    grains = render_side(positions, radii, view, np.tile(np.array(FAINT, np.uint8), (len(radii), 1)), walls)
    picture = grains.resize((SMOOTHING * view.size[0], SMOOTHING * view.size[1]))
    draw, size = ImageDraw.Draw(picture), network.normal_force
    widths = force_line_widths(size) * np.linalg.norm(network.branch, axis=1)
    widths = np.maximum(SMOOTHING * view.scale * CHAIN_SHARE * widths, 1.0).round().astype(int)
    ends = np.stack([network.centre, network.centre - network.branch], axis=1)[..., [0, 2]]
    places, colours = SMOOTHING * view.pixels(ends), force_colours(size)
    for row in np.argsort(np.abs(size), kind="stable"):
        draw.line(places[row].ravel().tolist(), tuple(colours[row].tolist()), int(widths[row]))
    picture = picture.reduce(SMOOTHING)
    mean = f"{network.time:.3g} s, mean {np.abs(size).mean():.2g} N" if len(size) else "no contacts"
    draw_text(picture, CAPTION_CORNER, mean, LETTER_SIZE, "la")
    draw_scale_bar(picture, view)
    return picture


def write_png(path: Path, picture: Picture) -> Path:
    """Write one picture; the same picture gives the same bytes."""
    return write_atomic(path, png_bytes(picture))


def png_bytes(picture: Picture) -> bytes:
    file = BytesIO()
    picture.save(file, "png")
    return file.getvalue()


def write_gif(path: Path, film: Sequence[Picture], frame_duration: float = 0.05) -> Path:
    """Write an endless film, `frame_duration` [s] per picture (GIF counts hundredths of a second)."""
    file = BytesIO()
    milliseconds = round(1e3 * frame_duration)
    film[0].save(file, "gif", save_all=True, append_images=film[1:], duration=milliseconds, loop=0)
    return write_atomic(path, file.getvalue())
