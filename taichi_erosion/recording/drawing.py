"""Colours of grains, walls and lines, shared by the recording and the pictures.

Lines and letters on an image, with NumPy alone: the same bytes on every machine, no display, no fonts.

An image is uint8 [height, width, 3]; a place on it is (column, row) in pixels; (0, 0) is the first.
"""

import numpy as np
from numpy.typing import NDArray

Colours = NDArray[np.uint8]
Floats = NDArray[np.float64]

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


def resting_colours(ident: NDArray[np.int32]) -> Colours:
    """Sand, a little brighter or darker from grain to grain so that single grains can be told apart."""
    brightness = 1.0 + TINT_RANGE * (2.0 * np.mod(ident * TINT_TURN, 1.0) - 1.0)
    return np.clip(np.multiply.outer(brightness, SAND), 0, 255).astype(np.uint8)


def speed_colours(speed: Floats, low: float, high: float) -> Colours:
    """Colour of a moving grain, from sand at speed `low` to ice blue at `high` [m s-1], in equal ratios."""
    bounded = np.clip(speed, low, high)
    place = np.log(bounded / low) / np.log(high / low) * (len(SPEED_COLOURS) - 1)
    anchors = np.arange(len(SPEED_COLOURS))
    channels = [np.interp(place, anchors, SPEED_COLOURS[:, channel]) for channel in range(3)]
    return np.stack(channels, axis=-1).astype(np.uint8)


Image = NDArray[np.uint8]
Colour = tuple[int, int, int]

# rows of 3 x 5 letters, one octal digit a row, its highest bit leftmost
LETTERS = {
    **{"0": "75557", "1": "26227", "2": "71747", "3": "71717", "4": "55711", "5": "74717", "6": "74757"},
    **{"7": "71222", "8": "75757", "9": "75717", ".": "00002", "-": "00700", "+": "02720", " ": "00000"},
    **{"°": "25200", "s": "03617", "m": "00775", "u": "05567", "/": "11244", "=": "07070"},
}
LETTER_WIDTH = 3
LETTER_HEIGHT = 5


def blank(size: tuple[int, int], top: Colour, bottom: Colour) -> Image:
    """Image of `size` (width, height), its colour running from `top` to `bottom`."""
    width, height = size
    share = np.linspace(0.0, 1.0, height)[:, None]
    column = (1.0 - share) * np.array(top) + share * np.array(bottom)
    return np.repeat(column[:, None, :], width, axis=1).round().astype(np.uint8)


def draw_line(
    image_out: Image, ends: Floats, colour: Colour, width: float = 2.0, opacity: float = 1.0
) -> None:
    """Draw a straight line between two places, `ends` [2, 2], with smooth edges.

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


def distance_to_segment(places: Floats, ends: Floats) -> Floats:
    """Shortest distance of places [..., 2] to a line segment [2, 2], in the places' own unit."""
    along = ends[1] - ends[0]
    length_squared = max(float(along @ along), np.finfo(float).tiny)
    share = np.clip((places - ends[0]) @ along / length_squared, 0.0, 1.0)
    return np.linalg.norm(places - ends[0] - share[..., None] * along, axis=-1)


def draw_text(image_out: Image, text: str, corner: tuple[int, int], colour: Colour, scale: int = 2) -> None:
    """Write digits and unit letters, upper left corner at `corner`; what leaves the image is cut off."""
    column, row = corner
    stamp = lettering(text).repeat(scale, axis=0).repeat(scale, axis=1)
    patch = image_out[row : row + stamp.shape[0], column : column + stamp.shape[1]]
    patch[stamp[: patch.shape[0], : patch.shape[1]]] = colour


def lettering(text: str) -> NDArray[np.bool_]:
    """Bits of a text, one empty column after each letter."""
    bits = np.zeros((LETTER_HEIGHT, len(text) * (LETTER_WIDTH + 1)), dtype=bool)
    for index, letter in enumerate(text):
        rows = [[int(bit) for bit in f"{int(digit):03b}"] for digit in LETTERS[letter]]
        start = index * (LETTER_WIDTH + 1)
        bits[:, start : start + LETTER_WIDTH] = rows
    return bits
