"""Picture files that need no display: silhouettes with their fitted flanks, and the film of a run."""

from collections.abc import Iterable, Sequence
from math import radians, tan
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from taichi_erosion.core.snapshot import Snapshot
from taichi_erosion.recording import palette
from taichi_erosion.recording.canvas import Image, blank, draw_line, draw_text
from taichi_erosion.recording.side_view import SideView, draw_scale_bar, render_side
from taichi_erosion.recording.wall_mesh import WallMesh
from taichi_erosion.recording.whole_file import write_whole

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]

GAP = 6  # px between the silhouettes of a grid
HEADROOM = 24  # px of sky above a silhouette, for its caption
CAPTION_CORNER = (8, 8)  # px
FAINT = 0.35  # opacity of a flank line beyond the fitted columns [1]


def flank_ends(rows: int, axis: float, side: int, line: tuple[float, float, float, float]) -> Floats:
    """Places (column, row) [2, 2] of both ends of a fitted flank in a silhouette of `rows` rows.

    The line is  height = apex - tan(angle) distance  from `start` to `end`, `distance` counted outward from
    the axis; `line` = (angle [deg], apex, start, end). Lengths are in pixels, heights from the lower edge,
    `axis` from the left edge of the picture. `side` is -1 for the left flank and 1 for the right.
    """
    angle, apex, start, end = line
    distance = np.array([start, end])
    height = apex - tan(radians(angle)) * distance
    return np.stack([axis + side * distance - 0.5, rows - height - 0.5], axis=-1)


def silhouette_picture(mask: Mask, flanks: Floats, caption: str = "") -> Image:
    """Silhouette, sand on night, with flank lines [k, 2, 2] in pixels: bright where fitted, faint beyond."""
    rows, columns = mask.shape
    image = blank((columns, rows + HEADROOM), palette.NIGHT, palette.DUSK)
    image[HEADROOM:][mask] = palette.SAND
    width = max(2.0, rows / 150.0)
    for ends in flanks + np.array([0.0, HEADROOM]):
        along = ends[1] - ends[0]
        reach = (rows + columns) / max(float(np.linalg.norm(along)), 1.0)
        draw_line(image, ends + np.array([-reach, reach])[:, None] * along, palette.EMBER, 0.6 * width, FAINT)
        draw_line(image, ends, palette.EMBER, width)
    draw_text(image, caption, CAPTION_CORNER, palette.CHALK)
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
    colours = palette.resting_colours(snapshot.ident)
    colours[moving] = palette.speed_colours(speed[moving], *speeds)
    return render_side(snapshot.position, snapshot.radius, view, colours, walls)


def film_frame(
    snapshot: Snapshot, view: SideView, walls: Sequence[WallMesh], speeds: tuple[float, float]
) -> Image:
    """One picture of a film: grains from the side, the time and a scale bar."""
    image = side_picture(snapshot, view, walls, speeds)
    draw_text(image, f"{snapshot.time:.2f} s", CAPTION_CORNER, palette.CHALK)
    draw_scale_bar(image, view)
    return image


def write_png(path: Path, image: Image) -> Path:
    """Write one picture; the same image gives the same bytes."""
    import imageio.v3 as imageio

    return write_whole(path, imageio.imwrite("<bytes>", image, extension=".png"))


def write_gif(path: Path, frames: Iterable[Image], frame_duration: float = 0.05) -> Path:
    """Write an endless film, `frame_duration` [s] per picture (GIF counts hundredths of a second)."""
    import imageio.v3 as imageio

    milliseconds = round(1e3 * frame_duration)
    film = imageio.imwrite("<bytes>", list(frames), extension=".gif", duration=milliseconds, loop=0)
    return write_whole(path, film)
