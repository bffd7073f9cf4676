"""Grains in air: settling velocity, pressure drop and height of a bed, flux, stresses and hop heights."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import exp, nan, sqrt

import numpy as np

from taichi_erosion.core.setup import Floats
from taichi_erosion.core.snapshot import AirProfile, Snapshot
from taichi_erosion.measures.result import Measurement, no_measurement
from taichi_erosion.measures.shortfalls import drift_shortfalls

BLOCKS = 8  # of a time series: each so long that their means are nearly independent
LEAST_FRAMES = 16  # two a block
TOP_SHARE = 0.98  # of the grains lie below what is called the top of a bed [1]
FLIGHT = 1.0  # diameters above the bed from which on a grain counts as flying [1]
FIT_SHARE = (0.05, 0.95)  # of the flux above the bed: the part of the profile that is fitted [1]
BINS = 24  # of the flux profile


@dataclass(frozen=True)
class Patch:
    """The periodic patch that grains move over."""

    area: float  # m2
    surface: float  # m, height of the undisturbed bed
    diameter: float  # m, nominal
    density: float  # kg m-3, of the air
    viscosity: float  # m2 s-1, kinematic

    @property
    def clear(self) -> float:
        """Height above which every grain flies [m]."""
        return self.surface + FLIGHT * self.diameter


def settling_velocity(state: Snapshot) -> Measurement:
    """Mean downward velocity of all grains [m s-1]; `sd` is that of single grains."""
    falling = -state.velocity[:, 2]
    sd = float(np.std(falling, ddof=1)) if len(falling) > 1 else nan
    return Measurement("settling_velocity", float(falling.mean()), sd, "m s-1")


def pressure_drop(airs: Sequence[AirProfile]) -> Measurement:
    """Pressure that rising air loses between floor and lid [Pa], mean over the second half of the frames."""
    drops = [float((air.lift * np.diff(air.face)).sum()) for air in airs[len(airs) // 2 :]]
    if not drops:
        return no_measurement("pressure_drop", "Pa", "no air, or measure.pressure_drop.every is not given")
    sd = float(np.std(drops, ddof=1)) if len(drops) > 1 else nan
    return Measurement("pressure_drop", float(np.mean(drops)), sd, "Pa")


def bed_height(state: Snapshot) -> Measurement:
    """Height of the top of a bed over z = 0 [m]: of the top of the grain that 98 % lie below."""
    top = float(np.quantile(state.position[:, 2], TOP_SHARE) + np.median(state.radius))
    return Measurement("bed_height", top, nan, "m")


def blocked(name: str, series: Sequence[float], unit: str) -> Measurement:
    """Mean of a series; `sd` is the standard error of that mean from the scatter of block means.

    Reference: Flyvbjerg & Petersen (1989), J. Chem. Phys. 91, 461.
    """
    if len(series) < LEAST_FRAMES:
        return no_measurement(name, unit, f"{len(series)} frames; at least {LEAST_FRAMES} are needed")
    means = [float(np.mean(block)) for block in np.array_split(np.asarray(series), BLOCKS)]
    error = float(np.std(means, ddof=1)) / sqrt(BLOCKS)
    lacking = tuple(drift_shortfalls(means))
    return Measurement(
        name, float(np.mean(series)), error, unit, details={"blocks": means}, shortfalls=lacking
    )


def flux(frames: Sequence[Snapshot], patch: Patch) -> Measurement:
    """Mass that passes a line across the wind, per width and time [kg m-1 s-1].

    Q = sum m v_x / A   over all grains of a patch of area A.
    """
    return blocked("flux", [flux_of(frame, patch) for frame in frames], "kg m-1 s-1")


def flux_of(frame: Snapshot, patch: Patch) -> float:
    """Flux at one moment [kg m-1 s-1]."""
    return float((frame.mass * frame.velocity[:, 0]).sum()) / patch.area


def flux_profile(frames: Sequence[Snapshot], patch: Patch) -> tuple[Floats, Floats]:
    """Heights above the bed [m] and horizontal flux density [kg m-2 s-1] of the flying grains."""
    heights = [frame.position[:, 2] - patch.surface for frame in frames]
    carried = [frame.mass * frame.velocity[:, 0] for frame in frames]
    height, momentum = np.concatenate(heights), np.concatenate(carried)
    flying = height > FLIGHT * patch.diameter
    if not flying.any():
        return np.zeros(0), np.zeros(0)
    edges = np.linspace(FLIGHT * patch.diameter, float(height[flying].max()), BINS + 1)
    total, _ = np.histogram(height[flying], edges, weights=momentum[flying])
    return 0.5 * (edges[1:] + edges[:-1]), total / (len(frames) * patch.area * np.diff(edges))


def flux_height(frames: Sequence[Snapshot], patch: Patch) -> Measurement:
    """Height over which the horizontal flux density falls by e [m].

    q = q_0 exp(-z / h), least squares in ln q weighted by q, over the part of the profile that carries the
    flux between its 5th and 95th percent.
    """
    height, density = flux_profile(frames, patch)
    carried = np.cumsum(density)
    if not len(carried) or carried[-1] <= 0.0:
        return no_measurement("flux_height", "m", "no grain flew")
    share = carried / carried[-1]
    fitted = (density > 0.0) & (share > FIT_SHARE[0]) & (share < FIT_SHARE[1])
    if np.count_nonzero(fitted) < 3:
        return no_measurement("flux_height", "m", "fewer than three heights carry the flux")
    weight = np.sqrt(density[fitted])
    line, scatter = np.polyfit(height[fitted], np.log(density[fitted]), 1, w=weight, cov="unscaled")
    value = -1.0 / float(line[0])
    details = {"height": height.tolist(), "density": density.tolist(), "surface_density": exp(line[1])}
    sd = value**2 * float(np.sqrt(scatter[0, 0]))
    return Measurement("flux_height", value, sd, "m", details=details)


def air_stress(air: AirProfile, patch: Patch) -> Floats:
    """Stress that the air carries across the inner faces of its layers [Pa]."""
    centre = 0.5 * (air.face[1:] + air.face[:-1])
    shear = np.diff(air.velocity[:, 0]) / np.diff(centre)
    open_share = 0.5 * (air.void_fraction[1:] + air.void_fraction[:-1])
    return patch.density * open_share * (patch.viscosity + air.eddy_viscosity[1:]) * shear


def bed_stress(airs: Sequence[AirProfile], patch: Patch) -> Measurement:
    """Stress that the air itself still carries just above the grains of the undisturbed bed [Pa].

    Below that height, one diameter over the bed, grains at rest take it all within a layer or two.
    """
    series = [float(np.interp(patch.clear, air.face[1:-1], air_stress(air, patch))) for air in airs]
    return blocked("bed_stress", series, "Pa")


def grain_stress(airs: Sequence[AirProfile], patch: Patch) -> Measurement:
    """Stress that grains carry across the height of `bed_stress` [Pa]: what they take from the air above."""
    series = []
    for air in airs:
        share = np.clip((air.face[1:] - patch.clear) / np.diff(air.face), 0.0, 1.0)
        series.append(-float((air.drag[:, 0] * np.diff(air.face) * share).sum()))
    return blocked("grain_stress", series, "Pa")
