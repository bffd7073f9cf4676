"""Small pictures made of characters, for terminals without a screen."""

import numpy as np
from taichi_erosion.recording.canvas import Image

from taichi_erosion.recording import palette


SHADES = " .:-=+*#%@"  # from dark to bright
HALF = "▀"  # upper half in the colour of the text, lower half in that of the background
CELL = 2  # a character is about twice as high as it is wide


def shrunk(image: Image, columns: int, rows: int) -> Image:
    """The picture averaged down to [rows, columns, 3]."""
    height, width = image.shape[:2]
    down = np.linspace(0, height, rows + 1).astype(int)[:-1]
    across = np.linspace(0, width, columns + 1).astype(int)[:-1]
    sums = np.add.reduceat(np.add.reduceat(image.astype(float), down, axis=0), across, axis=1)
    counts = np.outer(np.diff([*down, height]), np.diff([*across, width]))[..., None]
    return (sums / counts).astype(np.uint8)


def in_colour(image: Image, columns: int) -> str:
    """Two pixels a character, in 24-bit colours."""
    rows = max(image.shape[0] * columns // image.shape[1] // CELL, 1)
    small = shrunk(image, columns, CELL * rows)
    lines = []
    for upper, lower in zip(small[::2], small[1::2], strict=True):
        cells = (
            f"\x1b[38;2;{a[0]};{a[1]};{a[2]}m\x1b[48;2;{b[0]};{b[1]};{b[2]}m{HALF}"
            for a, b in zip(upper.tolist(), lower.tolist(), strict=True)
        )
        lines.append("".join(cells) + "\x1b[0m")
    return "\n".join(lines)


def in_shades(image: Image, columns: int) -> str:
    """One character a pixel, by brightness: for logs and pipes; the sky behind the grains stays empty."""
    rows = max(image.shape[0] * columns // image.shape[1] // CELL, 1)
    above = np.maximum(shrunk(image, columns, rows).mean(axis=2) - np.mean(palette.DUSK), 0.0)
    place = (above / max(float(above.max()), 1.0) * (len(SHADES) - 1)).round().astype(int)
    return "\n".join("".join(SHADES[k] for k in row).rstrip() for row in place)
