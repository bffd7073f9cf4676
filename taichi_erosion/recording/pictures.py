"""Pictures with NumPy alone, the same bytes on every machine, without a display.

Colours of grains; lines and letters; grains from the side as shaded spheres; silhouettes with fitted flanks;
films; pictures made of characters for terminals. An image is uint8 [height, width, 3], a point of it (column,
row) in pixels, (0, 0) the upper left.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from math import floor, log10
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from taichi_erosion.core.files import write_atomic
from taichi_erosion.core.setup import Floats
from taichi_erosion.core.snapshot import Snapshot
from taichi_erosion.recording.wall_mesh import WallMesh, section

Image = NDArray[np.uint8]
Integers = NDArray[np.int64]
Mask = NDArray[np.bool_]
Colour = tuple[int, int, int]

NIGHT = (16, 19, 26)  # background behind grains
DUSK = (38, 44, 56)  # background near the ground
SAND = (222, 184, 135)  # grain at rest
STEEL = (138, 156, 178)  # walls
EMBER = (255, 92, 57)  # fitted lines
CHALK = (232, 230, 222)  # lettering

SPEED_COLOURS = np.array(
    [SAND, (240, 150, 84), (232, 88, 96), (176, 72, 190), (88, 120, 255), (120, 220, 255)]
)
TINT_RANGE = 0.14  # largest change of brightness between two grains at rest [1]
TINT_TURN = 0.6180339887498949  # golden ratio - 1: neighbouring numbers fall far apart [1]

# rows of 3 x 5 letters, one octal digit a row, its highest bit leftmost
LETTERS = {
    **{"0": "75557", "1": "26227", "2": "71747", "3": "71717", "4": "55711", "5": "74717", "6": "74757"},
    **{"7": "71222", "8": "75757", "9": "75717", ".": "00002", "-": "00700", "+": "02720", " ": "00000"},
    **{"e": "07747", "°": "25200", "s": "03617", "m": "00775", "u": "05567", "/": "11244", "=": "07070"},
}
LETTER_WIDTH = 3
LETTER_HEIGHT = 5

SMOOTHING = 2  # pixels drawn along each edge of a picture pixel, then averaged [1]
LIGHT_FROM = (-0.45, -0.62, 0.64)  # direction towards the light: left, in front, above
AMBIENT, DIFFUSE, GLOSS = 0.30, 0.75, 0.14  # shares of the light [1]
GLOSS_SHARPNESS = 20  # exponent of the highlight [1]
HAZE = 0.45  # share of the background in the colour of the farthest grain [1]
LEAST_RADIUS = 0.75  # px, so that no grain falls between the pixels
STAMP_PIXELS = 1_000_000  # pixels shaded at once: bounds the memory of a picture to some 50 MB
BAR_SHARE = 0.25  # longest scale bar over the width of the picture [1]
MARGIN = 10  # px around lettering
GAP = 6  # px between the silhouettes of a grid
HEADROOM = 24  # px of sky above a silhouette, for its caption
CAPTION_CORNER = (8, 8)  # px
COLOUR_BAR = (150, 8)  # px, width and height of the colours of a legend
TICKS = 4  # numbers below a colour bar
FAINT = 0.35  # opacity of a flank line beyond the fitted columns [1]

SHADES = " .:-=+*#%@"  # of a terminal, from dark to bright
HALF_BLOCK = "▀"  # upper half in the colour of the text, lower half in that of the background
CELL = 2  # height over width of a character, about


def resting_colours(ident: NDArray[np.int32]) -> Image:
    """Sand, a little brighter or darker from grain to grain so that single grains can be told apart."""
    brightness = 1.0 + TINT_RANGE * (2.0 * np.mod(ident * TINT_TURN, 1.0) - 1.0)
    return np.clip(np.multiply.outer(brightness, SAND), 0, 255).astype(np.uint8)


def speed_colours(speed: Floats, low: float, high: float) -> Image:
    """Colour of a moving grain, from sand at speed `low` to ice blue at `high` [m s-1], in equal ratios."""
    bounded = np.clip(speed, low, high)
    return interpolate_colours(np.log(bounded / low) / np.log(high / low), SPEED_COLOURS)


def interpolate_colours(share: Floats, anchors: NDArray[np.int_]) -> Image:
    """Colours at shares [1] of the way along evenly spaced anchors [k, 3]."""
    position, places = share * (len(anchors) - 1), np.arange(len(anchors))
    channels = [np.interp(position, places, anchors[:, channel]) for channel in range(3)]
    return np.stack(channels, axis=-1).astype(np.uint8)


def blank(size: tuple[int, int], top: Colour, bottom: Colour) -> Image:
    """Image of `size` (width, height), its colour running from `top` to `bottom`."""
    width, height = size
    share = np.linspace(0.0, 1.0, height)[:, None]
    column = (1.0 - share) * np.array(top) + share * np.array(bottom)
    return np.repeat(column[:, None, :], width, axis=1).round().astype(np.uint8)


def draw_line(
    image_out: Image, ends: Floats, colour: Colour, width: float = 2.0, opacity: float = 1.0
) -> None:
    """Draw a straight line between two points, `ends` [2, 2] px, with smooth edges.

    A pixel at distance s from the line is covered to  c = clip((width + 1) / 2 - s, 0, 1).
    """
    margin = 0.5 * width + 1.0
    shape = np.array(image_out.shape[1::-1])
    low = np.clip(np.floor(ends.min(axis=0) - margin), 0, shape).astype(int)
    high = np.clip(np.ceil(ends.max(axis=0) + margin) + 1, 0, shape).astype(int)
    rows, columns = np.mgrid[low[1] : high[1], low[0] : high[0]]
    distance = distance_to_segment(np.stack([columns, rows], axis=-1).astype(float), ends)
    cover = opacity * np.clip(0.5 * (width + 1.0) - distance, 0.0, 1.0)[..., None]
    patch = image_out[low[1] : high[1], low[0] : high[0]]
    patch[...] = ((1.0 - cover) * patch + cover * np.array(colour)).round().astype(np.uint8)


def distance_to_segment(points: Floats, ends: Floats) -> Floats:
    """Shortest distance of points [..., 2] to a line segment [2, 2], in their own unit."""
    along = ends[1] - ends[0]
    length_squared = max(float(along @ along), np.finfo(float).tiny)
    share = np.clip((points - ends[0]) @ along / length_squared, 0.0, 1.0)
    return np.linalg.norm(points - ends[0] - share[..., None] * along, axis=-1)


def draw_text(image_out: Image, text: str, corner: tuple[int, int], colour: Colour, scale: int = 2) -> None:
    """Draw digits and unit letters, upper left corner at `corner`; cut off at the edge of the image."""
    column, row = corner
    stamp = lettering(text).repeat(scale, axis=0).repeat(scale, axis=1)
    patch = image_out[row : row + stamp.shape[0], column : column + stamp.shape[1]]
    patch[stamp[: patch.shape[0], : patch.shape[1]]] = colour


def lettering(text: str) -> NDArray[np.bool_]:
    """Mask of a text, one empty column after each letter."""
    bits = np.zeros((LETTER_HEIGHT, len(text) * (LETTER_WIDTH + 1)), dtype=bool)
    for index, letter in enumerate(text):
        rows = [[int(bit) for bit in f"{int(digit):03b}"] for digit in LETTERS[letter]]
        start = index * (LETTER_WIDTH + 1)
        bits[:, start : start + LETTER_WIDTH] = rows
    return bits


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
    colours: NDArray[np.uint8] | None = None,
    walls: Sequence[WallMesh] = (),
) -> Image:
    """Picture of spheres, centres [n, 3] and radii [n] in m, seen along +y; walls show their cut by y = 0.

    Painter's algorithm: far grains first, nearer ones over them. A pixel at (u, w) radii from the centre has

        n = (u, -sqrt(1 - u^2 - w^2), w)
        brightness = ambient + diffuse max(0, n.l) + gloss max(0, n.h)^k

    with n the normal, l the direction to the light and h half-way between l and the direction to the eye.

    Reference: Blinn (1977), Computer Graphics 11, 192-198 (highlight).
    """
    if colours is None:
        colours = resting_colours(np.arange(len(radii), dtype=np.int32))
    fine = SideView(view.low, view.high, (view.size[0] * SMOOTHING, view.size[1] * SMOOTHING))
    image = blank(fine.size, NIGHT, DUSK)
    draw_spheres(image, positions, radii, fine, colours)
    for wall in walls:
        for ends in fine.pixels(section(wall)):
            draw_line(image, ends, STEEL, width=1.5 * SMOOTHING, opacity=0.6)
    return downsample(image, *view.size)


def draw_spheres(
    image_out: Image, positions: Floats, radii: Floats, view: SideView, colours: NDArray[np.uint8]
) -> None:
    """Shade spheres into an image, far ones first."""
    if len(radii) == 0:
        return
    order = np.argsort(-positions[:, 1], kind="stable")
    depth = positions[order, 1]
    haze = HAZE * (depth - depth[-1]) / max(depth[0] - depth[-1], np.finfo(float).tiny)
    base = (1.0 - haze[:, None]) * colours[order] + haze[:, None] * np.array(DUSK)
    place = view.pixels(positions[order][:, [0, 2]])
    pixels = np.maximum(radii[order] * view.scale, LEAST_RADIUS)
    flat = image_out.reshape(-1, 3)
    for batch in batches(pixels):
        grain, index, offset = stamp(place[batch], pixels[batch], image_out.shape)
        diffuse, gloss = brightness(offset)
        shaded = base[batch][grain] * diffuse[:, None] + 255.0 * gloss[:, None]
        # where an index comes twice, the later and therefore nearer grain stays
        flat[index] = np.clip(shaded, 0.0, 255.0).astype(np.uint8)


def batches(pixels: Floats) -> Iterator[slice]:
    """Slices of grains that are shaded at once."""
    box = (2 * int(np.ceil(pixels.max())) + 1) ** 2
    count = max(1, STAMP_PIXELS // box)
    for start in range(0, len(pixels), count):
        yield slice(start, start + count)


def stamp(place: Floats, pixels: Floats, shape: tuple[int, ...]) -> tuple[Integers, Integers, Floats]:
    """Pixels that discs cover, disc by disc: which disc, flat index in the image, and (u, w) in radii."""
    reach = int(np.ceil(pixels.max()))
    rows, columns = np.mgrid[-reach : reach + 1, -reach : reach + 1].reshape(2, -1)
    nearest = np.rint(place).astype(np.int64)
    column, row = nearest[:, :1] + columns, nearest[:, 1:] + rows
    across = (column - place[:, :1]) / pixels[:, None]
    up = (place[:, 1:] - row) / pixels[:, None]
    inside = (across**2 + up**2 <= 1.0) & (column >= 0) & (column < shape[1]) & (row >= 0) & (row < shape[0])
    grain = np.nonzero(inside)[0]
    return grain, (row * shape[1] + column)[inside], np.stack([across[inside], up[inside]], axis=-1)


def brightness(offset: Floats) -> tuple[Floats, Floats]:
    """Matt and glossy share of the light at (u, w) radii from the centre of a sphere [1]."""
    light = np.array(LIGHT_FROM) / np.linalg.norm(LIGHT_FROM)
    half = light + np.array([0.0, -1.0, 0.0])
    half /= np.linalg.norm(half)
    towards_eye = -np.sqrt(np.maximum(1.0 - (offset**2).sum(axis=-1), 0.0))
    normal = np.stack([offset[:, 0], towards_eye, offset[:, 1]], axis=-1)
    matt = AMBIENT + DIFFUSE * np.maximum(normal @ light, 0.0)
    return matt, GLOSS * np.maximum(normal @ half, 0.0) ** GLOSS_SHARPNESS


def draw_scale_bar(image_out: Image, view: SideView) -> None:
    """Draw a bar of 1, 2 or 5 times a power of ten, its length above it in mm, in the lower right corner."""
    length = scale_length(1e3 * BAR_SHARE * view.size[0] / view.scale)
    right, row = view.size[0] - MARGIN, view.size[1] - MARGIN
    left = right - 1e-3 * length * view.scale
    draw_line(image_out, np.array([[left, row], [right, row]]), CHALK)
    text = f"{length:g} mm"
    middle = round(0.5 * (left + right)) - len(text) * (LETTER_WIDTH + 1)
    draw_text(image_out, text, (middle, row - 2 * LETTER_HEIGHT - MARGIN // 2), CHALK)


def scale_length(longest: float) -> float:
    """Longest of 1, 2 or 5 times a power of ten up to a length, in its unit."""
    power = 10.0 ** floor(log10(longest))
    return max(step * power for step in (1.0, 2.0, 5.0) if step * power <= longest * (1.0 + 1e-9))


def draw_colour_bar(
    image_out: Image, corner: tuple[int, int], colours: Image, numbers: Sequence[float], size: int = 1
) -> None:
    """Draw colours [k, 3] as a bar with evenly spaced numbers below, in m/s; `corner` is its upper left."""
    (column, row), (width, height) = corner, (size * COLOUR_BAR[0], size * COLOUR_BAR[1])
    across = np.linspace(0, len(colours) - 1, width).round().astype(int)
    image_out[row : row + height, column : column + width] = colours[across]
    for tick, number in enumerate(numbers):
        unit = " m/s" if tick == len(numbers) - 1 else ""
        text = f"{number:.2g}{unit}"
        left = column + round(tick / (len(numbers) - 1) * (width - 1))
        shift = 0 if tick == 0 else size * 2 * len(text.removesuffix(unit))
        draw_text(image_out, text, (left - shift, row + height + 3 * size), CHALK, size)


def draw_speed_bar(
    image_out: Image, corner: tuple[int, int], speeds: tuple[float, float], size: int = 1
) -> None:
    """Draw the colours of moving grains. Sand also is the colour of grains slower than the first number."""
    colours = interpolate_colours(np.linspace(0.0, 1.0, COLOUR_BAR[0]), SPEED_COLOURS)
    draw_colour_bar(image_out, corner, colours, np.geomspace(*speeds, TICKS).tolist(), size)


def colour_legend(speeds: tuple[float, float]) -> Image:
    """Picture of the colour bar alone, for a viewer."""
    size = 4
    image = blank((size * (COLOUR_BAR[0] + 40), size * (COLOUR_BAR[1] + 20)), NIGHT, NIGHT)
    draw_speed_bar(image, (size * 10, size * 4), speeds, size)
    return image


def silhouette_picture(mask: Mask, flanks: Floats, caption: str = "") -> Image:
    """Silhouette, sand on night, with flank lines [k, 2, 2] in pixels: bright where fitted, faint beyond."""
    rows, columns = mask.shape
    image = blank((columns, rows + HEADROOM), NIGHT, DUSK)
    image[HEADROOM:][mask] = SAND
    width = max(2.0, rows / 150.0)
    for ends in flanks + np.array([0.0, HEADROOM]):
        along = ends[1] - ends[0]
        reach = (rows + columns) / max(float(np.linalg.norm(along)), 1.0)
        draw_line(image, ends + np.array([-reach, reach])[:, None] * along, EMBER, 0.6 * width, FAINT)
        draw_line(image, ends, EMBER, width)
    draw_text(image, caption, CAPTION_CORNER, CHALK)
    return image


def silhouette_grid(
    masks: Sequence[Mask], flanks: Sequence[Floats], captions: Sequence[str] = (), columns: int = 3
) -> Image:
    """Silhouettes of all azimuths in one picture, row by row, standing on a common base within each row."""
    labels = captions or [""] * len(masks)
    tiles = [silhouette_picture(*tile) for tile in zip(masks, flanks, labels, strict=True)]
    height = max(tile.shape[0] for tile in tiles) + GAP
    width = max(tile.shape[1] for tile in tiles) + GAP
    rows = -(-len(tiles) // columns)
    grid = np.zeros((rows * height + GAP, columns * width + GAP, 3), dtype=np.uint8)
    for index, tile in enumerate(tiles):
        bottom = (index // columns + 1) * height
        left = GAP + index % columns * width + (width - GAP - tile.shape[1]) // 2
        grid[bottom - tile.shape[0] : bottom, left : left + tile.shape[1]] = tile
    return grid


def side_picture(
    snapshot: Snapshot, view: SideView, walls: Sequence[WallMesh], speeds: tuple[float, float]
) -> Image:
    """Grains from the side, coloured by speed in `speeds` (low, high) [m s-1]."""
    speed = np.linalg.norm(snapshot.velocity, axis=1)
    moving = speed > speeds[0]
    colours = resting_colours(snapshot.ident)
    colours[moving] = speed_colours(speed[moving], *speeds)
    return render_side(snapshot.position, snapshot.radius, view, colours, walls)


def film_frame(
    snapshot: Snapshot, view: SideView, walls: Sequence[WallMesh], speeds: tuple[float, float]
) -> Image:
    """One picture of a film: grains from the side, the time, the colours of speeds and a scale bar."""
    image = side_picture(snapshot, view, walls, speeds)
    draw_text(image, f"{snapshot.time:.2f} s", CAPTION_CORNER, CHALK)
    draw_scale_bar(image, view)
    draw_speed_bar(image, (image.shape[1] - COLOUR_BAR[0] - 3 * MARGIN, MARGIN), speeds)
    return image


def write_png(path: Path, image: Image) -> Path:
    """Write one picture; the same image gives the same bytes."""
    return write_atomic(path, png_bytes(image))


def png_bytes(image: Image) -> bytes:
    """One picture as PNG."""
    import imageio.v3 as imageio

    return imageio.imwrite("<bytes>", image, extension=".png")


def write_gif(path: Path, frames: Iterable[Image], frame_duration: float = 0.05) -> Path:
    """Write an endless film, `frame_duration` [s] per picture (GIF counts hundredths of a second)."""
    import imageio.v3 as imageio

    milliseconds = round(1e3 * frame_duration)
    film = imageio.imwrite("<bytes>", list(frames), extension=".gif", duration=milliseconds, loop=0)
    return write_atomic(path, film)


def downsample(image: Image, columns: int, rows: int) -> Image:
    """The picture averaged down to [rows, columns, 3]."""
    height, width = image.shape[:2]
    down = np.linspace(0, height, rows + 1).astype(int)[:-1]
    across = np.linspace(0, width, columns + 1).astype(int)[:-1]
    sums = np.add.reduceat(np.add.reduceat(image.astype(float), down, axis=0), across, axis=1)
    counts = np.outer(np.diff([*down, height]), np.diff([*across, width]))[..., None]
    return (sums / counts + 0.5).astype(np.uint8)


def terminal_colours(image: Image, columns: int) -> str:
    """Two pixels a character, in 24-bit colours."""
    rows = max(image.shape[0] * columns // image.shape[1] // CELL, 1)
    small = downsample(image, columns, CELL * rows)
    lines = []
    for upper, lower in zip(small[::2], small[1::2], strict=True):
        cells = (
            f"\x1b[38;2;{a[0]};{a[1]};{a[2]}m\x1b[48;2;{b[0]};{b[1]};{b[2]}m{HALF_BLOCK}"
            for a, b in zip(upper.tolist(), lower.tolist(), strict=True)
        )
        lines.append("".join(cells) + "\x1b[0m")
    return "\n".join(lines)


def terminal_shades(image: Image, columns: int) -> str:
    """One character a pixel, by brightness: for logs and pipes; the sky behind the grains stays empty."""
    rows = max(image.shape[0] * columns // image.shape[1] // CELL, 1)
    above = np.maximum(downsample(image, columns, rows).mean(axis=2) - np.mean(DUSK), 0.0)
    shade = (above / max(float(above.max()), 1.0) * (len(SHADES) - 1)).round().astype(int)
    return "\n".join("".join(SHADES[k] for k in row).rstrip() for row in shade)
