"""Forces and torques of the grains on walls, and what soil tests read from them."""

from collections.abc import Sequence
from math import atan, degrees, nan, sqrt

import numpy as np

from taichi_erosion.core.setup import Floats
from taichi_erosion.core.snapshot import ContactNetwork
from taichi_erosion.measures.result import Measurement, no_measurement
from taichi_erosion.measures.wind_bed import block_mean

PEAK_SHARE = 1.0 / 16.0  # of the frames, over which a strength is averaged [1]
LEAST_FRAMES = 16


def wall_loads(contacts: ContactNetwork) -> Floats:
    """Force [N] of the grains on every wall, and torque about the origin [N m], [walls, 6].

    The torque of rolling resistance, which acts in the contact itself, is left out.
    """
    loads = np.zeros((len(contacts.walls), 6))
    at_wall = contacts.second < 0
    force = -contacts.force[at_wall]
    rows = np.hstack([force, np.cross(contacts.point[at_wall], force)])
    np.add.at(loads, -1 - contacts.second[at_wall], rows)
    return loads


def force_along(loads: Sequence[Floats], axis: Floats) -> Measurement:
    """Force of the grains along an axis [N], mean over frames [6]; `sd` is the error of the mean."""
    return mean_of("wall_force", [float(load[:3] @ axis) for load in loads], "N")


def torque_about(loads: Sequence[Floats], axis: Floats, centre: Floats) -> Measurement:
    """Torque of the grains about an axis through a centre [N m]; mean and `sd` as of a force."""
    torques = [float((load[3:] - np.cross(centre, load[:3])) @ axis) for load in loads]
    return mean_of("wall_torque", torques, "N m")


def mean_of(name: str, series: Sequence[float], unit: str) -> Measurement:
    """Mean of a series, or its single value."""
    return Measurement(name, series[0], nan, unit) if len(series) == 1 else block_mean(name, series, unit)


def friction_angle(loads: Sequence[Floats], axis: Floats) -> Measurement:
    """Angle of friction in a plane that is sheared [deg]: that of the force on all that lies on its one side.

        angle = atan(max T / N)

    N force along `axis`, the normal of the plane, T force across it; the ratio is a running mean over a
    sixteenth of the frames. `sd` is the standard error in that window. `details` has the ratio at the peak
    and at the end, and N there.
    """
    name, width = "friction_angle", max(round(PEAK_SHARE * len(loads)), 1)
    if len(loads) < LEAST_FRAMES:
        return no_measurement(name, "deg", f"{len(loads)} frames; at least {LEAST_FRAMES} are needed")
    force = np.array([load[:3] for load in loads])
    normal = force @ axis
    across = np.linalg.norm(force - normal[:, np.newaxis] * axis, axis=1)
    if not normal.any():
        return no_measurement(name, "deg", "no grain presses on the walls")
    mean = np.ones(width) / width
    pressed = np.maximum(np.convolve(np.abs(normal), mean, "valid"), 1e-30)
    ratio = np.convolve(across, mean, "valid") / pressed
    peak = int(np.argmax(ratio))
    window = across[peak : peak + width] / pressed[peak]
    error = float(np.std(window, ddof=1)) / sqrt(width) / (1.0 + ratio[peak] ** 2) if width > 1 else nan
    details = {"peak": float(ratio[peak]), "end": float(ratio[-1]), "normal_force": float(pressed[peak])}
    return Measurement(name, degrees(atan(ratio[peak])), degrees(error), "deg", details=details)
