"""Grains in air: settling velocity, pressure drop and height of a bed, flux, stresses and hop heights.

Transport is measured where it is steady. The momentum P of the air over the bed changes by

    dP/dt = rho u*^2 - tau,    tau the stress that air and grains carry across the lowest height of flight,

so that a mean of tau / (rho u*^2) over a time T differs from 1 by what the air has gained or lost, over
rho u*^2 T. Air that is too fast for its grains, or too slow, shows there for as long as a second: grains gain
from it, and their flux rises and falls again, without a slope over the whole. A window is steady where its
first dozen hop times and both of its halves are within `BALANCE` of 1, as means over all repeats. Few grains
fly over a small patch, and column and grains swing slowly about the balance: air without inertia
(`steady_air` of a stage) does not.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import exp, nan, sqrt

import numpy as np

from taichi_erosion.core.setup import Floats
from taichi_erosion.core.snapshot import AirProfile, Snapshot
from taichi_erosion.measures.result import Measurement, Shortfall, no_measurement
from taichi_erosion.measures.shortfalls import drift_shortfalls, unsteady_shortfalls

BLOCKS = 8  # of a time series: each so long that their means are nearly independent
LEAST_FRAMES = 16  # two a block
TOP_SHARE = 0.98  # of the grains lie below what is called the top of a bed [1]
FLIGHT = 1.0  # diameters above the bed from which on a grain counts as flying [1]
FIT_SHARE = (0.05, 0.95)  # of the flux above the bed: the part of the profile that is fitted [1]
BINS = 24  # of the flux profile
BALANCE = 0.05  # of the stress of the wind: largest departure of a part of a steady window [1]
LEAST_HOP_TIMES = 12  # duration of a steady window in those of a hop [1]
# duration of a hop over u* / g [1]; Reference: Sauermann, Kroy & Herrmann (2001), Phys. Rev. E 64, 031305
HOP_TIME = 1.7


@dataclass(frozen=True)
class Window:
    """Frames of a stage, to its end, over which transport is measured."""

    first: int  # frame
    start: float  # s after the begin of the stage
    balance: float  # stress of air and grains over that of the wind, mean over the window [1]
    lacking: tuple[Shortfall, ...] = ()  # where transport never became steady


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


def mean_settling_velocity(state: Snapshot) -> Measurement:
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


def mean_by_block(name: str, series: Sequence[float], unit: str) -> Measurement:
    """Mean of a series; `sd` is the standard error of that mean from the scatter of block means.

    Reference: Flyvbjerg & Petersen (1989), J. Chem. Phys. 91, 461.
    """
    if len(series) < LEAST_FRAMES:
        return no_measurement(name, unit, f"{len(series)} frames; at least {LEAST_FRAMES} are needed")
    means = [float(np.mean(block)) for block in np.array_split(np.asarray(series), BLOCKS)]
    error = float(np.std(means, ddof=1)) / sqrt(BLOCKS)
    lacking = tuple(drift_shortfalls(means))
    mean, details = float(np.mean(series)), {"blocks": means}
    return Measurement(name, mean, error, unit, details=details, shortfalls=lacking)


def mean_sand_flux(frames: Sequence[Snapshot], patch: Patch) -> Measurement:
    """Mass that passes a line across the wind, per width and time [kg m-1 s-1].

    Q = sum m v_x / A   over all grains of a patch of area A.
    """
    return mean_by_block("flux", [flux_of_frame(frame, patch) for frame in frames], "kg m-1 s-1")


def flux_of_frame(frame: Snapshot, patch: Patch) -> float:
    """Flux at one moment [kg m-1 s-1]."""
    return float((frame.mass * frame.velocity[:, 0]).sum()) / patch.area


def flux_density_profile(frames: Sequence[Snapshot], patch: Patch) -> tuple[Floats, Floats]:
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


def flux_decay_height(frames: Sequence[Snapshot], patch: Patch) -> Measurement:
    """Height over which the horizontal flux density falls by e [m].

    q = q_0 exp(-z / h), least squares in ln q weighted by q, over the part of the profile that carries the
    flux between its 5th and 95th percent.
    """
    height, density = flux_density_profile(frames, patch)
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


def air_stress_at_bed(air: AirProfile, patch: Patch) -> float:
    """Stress that the air itself carries a diameter over the undisturbed bed [Pa]."""
    centre = 0.5 * (air.face[1:] + air.face[:-1])
    shear = np.diff(air.velocity[:, 0]) / np.diff(centre)
    open_share = 0.5 * (air.void_fraction[1:] + air.void_fraction[:-1])
    stress = patch.density * open_share * (patch.viscosity + air.eddy_viscosity[1:]) * shear
    return float(np.interp(patch.clear, air.face[1:-1], stress))


def grain_stress_at_bed(air: AirProfile, patch: Patch) -> float:
    """Stress that grains carry across that height [Pa]: what they take from the air above."""
    share = np.clip((air.face[1:] - patch.clear) / np.diff(air.face), 0.0, 1.0)
    return -float((air.drag[:, 0] * np.diff(air.face) * share).sum())


def mean_air_stress_at_bed(airs: Sequence[AirProfile], patch: Patch) -> Measurement:
    """Stress that the air itself still carries just above the grains of the undisturbed bed [Pa].

    Below that height, one diameter over the bed, grains at rest take it all within a layer or two.
    """
    return mean_by_block("bed_stress", [air_stress_at_bed(air, patch) for air in airs], "Pa")


def mean_grain_stress_at_bed(airs: Sequence[AirProfile], patch: Patch) -> Measurement:
    """Stress that grains carry across the height of `mean_air_stress_at_bed` [Pa]."""
    return mean_by_block("grain_stress", [grain_stress_at_bed(air, patch) for air in airs], "Pa")


def stress_ratio(airs: Sequence[AirProfile], patch: Patch, stress: float) -> Floats:
    """Stress of air and grains together over that of the wind [Pa], by frame [1]."""
    both = [air_stress_at_bed(air, patch) + grain_stress_at_bed(air, patch) for air in airs]
    return np.array(both) / stress


def steady_window(times: Sequence[float], shares: Sequence[Floats], hop: float) -> Window:
    """Longest steady window that reaches to the last of some times [s] after the begin of a stage.

    `shares` are those of `stress_ratio`, by repeat; `hop` is the duration of a hop [s]. Where no window is
    steady, the one nearest to it; of a stage that is too short, the whole.
    """
    count = min(len(share) for share in shares)
    mean, times = np.mean([share[:count] for share in shares], axis=0), times[:count]
    length = LEAST_HOP_TIMES * hop
    admissible = [k for k in range(count) if times[-1] - times[k] >= length] or [0]

    def departure_from_steady(first: int) -> float:
        begin = mean[first : int(np.searchsorted(times, times[first] + length)) + 1]
        parts = (begin, *np.array_split(mean[first:], 2))
        return max(abs(float(part.mean()) - 1.0) for part in parts)

    first = next((k for k in admissible if departure_from_steady(k) <= BALANCE), None)
    first = min(admissible, key=departure_from_steady) if first is None else first
    lacking = unsteady_shortfalls(times[-1], length, departure_from_steady(first), BALANCE)
    return Window(first, float(times[first]), float(mean[first:].mean()), tuple(lacking))
