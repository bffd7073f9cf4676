"""Colours of grains, walls and lines, shared by the recording and the pictures."""

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
