"""Forces and torques of the grains on walls, and what soil tests read from them."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import atan, degrees, nan, sqrt

import numpy as np

from taichi_erosion.core.setup import Floats
from taichi_erosion.core.snapshot import ContactNetwork
from taichi_erosion.measures.result import Measurement, no_measurement
from taichi_erosion.measures.wind_bed import mean_by_block

PEAK_SHARE = 1.0 / 16.0  # of the frames, over which a strength is averaged [1]
LEAST_FRAMES = 16
TINY = 1e-30  # keeps a ratio finite where nothing presses [N]


def forces_and_torques_on_walls(contacts: ContactNetwork) -> Floats:
    """Force [N] of the grains on every wall, and torque about the origin [N m], [walls, 6].

    The torque of rolling resistance, which acts in the contact itself, is left out.
    """
    loads = np.zeros((len(contacts.walls), 6))
    at_wall = contacts.second < 0
    force = -contacts.force[at_wall]
    rows = np.hstack([force, np.cross(contacts.point[at_wall], force)])
    np.add.at(loads, -1 - contacts.second[at_wall], rows)
    return loads


def mean_force_along_axis(loads: Sequence[Floats], axis: Floats) -> Measurement:
    """Force of the grains along an axis [N], mean over frames [6]; `sd` is the error of the mean."""
    return mean_of_series("wall_force", [float(load[:3] @ axis) for load in loads], "N")


def mean_torque_about(loads: Sequence[Floats], axis: Floats, centre: Floats) -> Measurement:
    """Torque of the grains about an axis through a centre [N m]; mean and `sd` as of a force."""
    torques = [float((load[3:6] - np.cross(centre, load[:3])) @ axis) for load in loads]
    return mean_of_series("wall_torque", torques, "N m")


def mean_of_series(name: str, series: Sequence[float], unit: str) -> Measurement:
    """Mean of a series, or its single value."""
    return Measurement(name, series[0], nan, unit) if len(series) == 1 else mean_by_block(name, series, unit)


@dataclass(frozen=True)
class Strength:
    """Force across and along the normal of a sheared plane [N], and where their ratio is largest."""

    across: Floats  # by frame
    normal: Floats
    peak: int  # first frame of the window of the largest mean ratio
    width: int  # of that window, in frames

    def at_peak_of(self, series: Floats) -> Floats:
        """Part of a series in the window of the largest ratio."""
        return series[self.peak : self.peak + self.width]


def shear_strength(loads: Sequence[Floats], axis: Floats) -> Strength | str:
    """Strength in a plane that is sheared, of the force on all on its one side, or what it lacks."""
    width = max(round(PEAK_SHARE * len(loads)), 1)
    if len(loads) < LEAST_FRAMES:
        return f"{len(loads)} frames; at least {LEAST_FRAMES} are needed"
    force = np.array([load[:3] for load in loads])
    normal = force @ axis
    across = np.linalg.norm(force - normal[:, np.newaxis] * axis, axis=1)
    if not normal.any():
        return "no grain presses on the walls"
    mean = np.ones(width) / width
    base = np.maximum(np.convolve(np.abs(normal), mean, "valid"), TINY)
    return Strength(across, np.abs(normal), int(np.argmax(np.convolve(across, mean, "valid") / base)), width)


def peak_friction_angle(loads: Sequence[Floats], axis: Floats) -> Measurement:
    """Angle of friction in a plane that is sheared [deg], at its peak.

        angle = atan(max T / N)

    N force along `axis`, the normal of the plane, T force across it; the ratio is a running mean over a
    sixteenth of the frames. `sd` is the standard error in that window. `details` has the ratio there, and N.
    """
    name = "friction_angle"
    if isinstance(peak := shear_strength(loads, axis), str):
        return no_measurement(name, "deg", peak)
    across, load = peak.at_peak_of(peak.across), float(peak.at_peak_of(peak.normal).mean())
    window, ratio = across / load, float(across.mean()) / load
    error = float(np.std(window, ddof=1)) / sqrt(peak.width) / (1.0 + ratio**2) if peak.width > 1 else nan
    details = {"peak": ratio, "normal_force": load}
    return Measurement(name, degrees(atan(ratio)), degrees(error), "deg", details=details)


def residual_friction_angle(loads: Sequence[Floats], axis: Floats) -> Measurement:
    """Angle of friction over the last quarter of the frames [deg]; `sd` is the error of that mean."""
    name = "residual_friction_angle"
    if isinstance(peak := shear_strength(loads, axis), str):
        return no_measurement(name, "deg", peak)
    rest = len(loads) - len(loads) // 4
    mean = mean_by_block(name, (peak.across[rest:] / max(peak.normal[rest:].mean(), TINY)).tolist(), "deg")
    return replace(mean, value=degrees(atan(mean.value)), sd=degrees(mean.sd / (1.0 + mean.value**2)))


def value_at_peak(name: str, loads: Sequence[Floats], axis: Floats, area: float) -> Measurement:
    """Stress across or along the normal [Pa], or displacement across it [m], where the ratio is largest."""
    unit = "m" if name == "peak_displacement" else "Pa"
    if isinstance(peak := shear_strength(loads, axis), str):
        return no_measurement(name, unit, peak)
    shift = np.array([load[6:] - loads[0][6:] for load in loads])
    series = {
        "shear_stress": peak.across / area,
        "normal_stress": peak.normal / area,
        "peak_displacement": np.linalg.norm(shift - np.outer(shift @ axis, axis), axis=1),
    }[name]
    window = peak.at_peak_of(series)
    error = float(np.std(window, ddof=1)) / sqrt(peak.width) if peak.width > 1 else nan
    return Measurement(name, float(window.mean()), error, unit)
