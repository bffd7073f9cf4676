"""The layer of air that a floor slows down: profile, thicknesses, friction velocity.

All are read from mean profiles u(z) at one place along the wind, averaged across it and over the last part of
a run; `sd` is the standard deviation over that part, or what a fit says of its own value where it is larger.

Reference: Schlichting & Gersten (2017), Boundary-Layer Theory, 9th ed., sections 2.3 and 18.2.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from math import log, nan
from typing import Any

import numpy as np
import scipy

from taichi_erosion.core.setup import Floats
from taichi_erosion.core.snapshot import AirSnapshot
from taichi_erosion.measures.result import Measurement, no_measurement

KARMAN, WAKE = 0.40, 0.55  # kappa and Pi of Coles' profile [1]
GROWTH = 0.37  # of a turbulent layer on a flat plate [1]
SMOOTH = 0.11  # z0 u* / nu of a smooth wall [1]
EDGE = 0.99  # of the speed aloft: where the layer ends, by convention [1]
LOG_LOW = 30.0  # wall distance u* z / nu at which the logarithmic part begins [1]
LOG_HIGH = 0.2  # of the layer's thickness, where it ends [1]
POINTS_LEAST = 3  # of a fit


@dataclass(frozen=True)
class Profile:
    """Mean wind at one place."""

    z: Floats  # m, height over the floor
    speed: Floats  # m s-1, along x
    friction_velocity: float  # m s-1, of the floor
    viscosity: float  # m2 s-1

    @property
    def wind_aloft(self) -> float:
        """Fastest wind of the profile [m s-1]."""
        return float(self.speed.max())


def wind_profile_at(state: AirSnapshot, place: float | None) -> Profile:
    """Profile at a place along x [m], between cells by straight lines; left out: the mean along x."""
    across = state.velocity[..., 0].mean(axis=1)
    friction = state.friction_velocity.mean(axis=1)
    if place is None or len(state.x) == 1:
        speed, floor = across.mean(axis=0), float(friction.mean())
    else:
        speed = np.array([np.interp(place, state.x, layer) for layer in across.T])
        floor = float(np.interp(place, state.x, friction))
    return Profile(state.z - state.faces_z[0], speed, floor, state.viscosity)


def boundary_layer_thickness(profile: Profile) -> float:
    """Height at which the wind reaches EDGE of the wind aloft [m]."""
    edge = EDGE * profile.wind_aloft
    above = int(np.argmax(profile.speed >= edge))
    if above == 0:
        return float(profile.z[0])
    z, u = profile.z[above - 1 : above + 1], profile.speed[above - 1 : above + 1]
    return float(np.interp(edge, u, z))


def displacement_thickness(profile: Profile) -> float:
    """Displacement thickness [m]: integral of 1 - u / U up to twice the thickness of the layer."""
    z, share = inner_profile_of(profile)
    return float(np.trapezoid(1.0 - share, z))


def momentum_thickness(profile: Profile) -> float:
    """Momentum thickness [m]: integral of u / U (1 - u / U) up to twice the thickness of the layer."""
    z, share = inner_profile_of(profile)
    return float(np.trapezoid(share * (1.0 - share), z))


def inner_profile_of(profile: Profile) -> tuple[Floats, Floats]:
    """Heights [m] from the floor to twice the thickness of the layer, and u / U there, at most 1."""
    z, u = np.append(0.0, profile.z), np.append(0.0, profile.speed)
    inside = z <= 2.0 * boundary_layer_thickness(profile)
    return z[inside], np.minimum(u[inside] / profile.wind_aloft, 1.0)


@dataclass(frozen=True)
class LogFit:
    """Straight line through u against ln z."""

    friction_velocity: float  # m s-1
    error: float  # m s-1, standard error
    roughness_length: float  # m
    points: int


def fit_log_profile(profile: Profile, karman: float) -> LogFit | None:
    """Fit of  u = (u* / kappa) ln(z / z0)  to the logarithmic part of a profile; None with too few points."""
    low = LOG_LOW * profile.viscosity / max(profile.friction_velocity, np.finfo(float).tiny)
    inside = (profile.z > low) & (profile.z < LOG_HIGH * boundary_layer_thickness(profile))
    if inside.sum() < POINTS_LEAST:
        return None
    line: Any = scipy.stats.linregress(np.log(profile.z[inside]), profile.speed[inside])
    slope, intercept = float(line.slope), float(line.intercept)
    roughness = float(np.exp(-intercept / slope)) if slope > 0.0 else nan
    return LogFit(karman * slope, karman * float(line.stderr), roughness, int(inside.sum()))


@dataclass(frozen=True)
class AirMeasureInput:
    states: Sequence[AirSnapshot]  # of the last part of the run, at least one
    place: float | None  # m
    karman: float

    @property
    def wind_profiles(self) -> list[Profile]:
        """Profiles at the place, one a state."""
        return [wind_profile_at(state, self.place) for state in self.states]


def mean_over_time(
    name: str, unit: str, number: Callable[[Profile], float], air: AirMeasureInput
) -> Measurement:
    """Mean of one number over the states; `sd` is its standard deviation over them."""
    values = [number(profile) for profile in air.wind_profiles]
    sd = float(np.std(values, ddof=1)) if len(values) > 1 else 0.0
    return Measurement(name, float(np.mean(values)), sd, unit, details={"values": values})


def friction_velocity_fit(air: AirMeasureInput) -> Measurement:
    """Friction velocity from the slope of the logarithmic part, as a laboratory reads it [m s-1]."""
    name = "friction_velocity_fit"
    fits = [fit for profile in air.wind_profiles if (fit := fit_log_profile(profile, air.karman)) is not None]
    if not fits:
        return no_measurement(name, "m s-1", f"fewer than {POINTS_LEAST} points in the logarithmic part")
    values = [fit.friction_velocity for fit in fits]
    spread = float(np.std(values, ddof=1)) if len(values) > 1 else 0.0
    details = {"roughness_length": fits[-1].roughness_length, "points": fits[-1].points}
    return Measurement(name, float(np.mean(values)), max(spread, fits[-1].error), "m s-1", details=details)


# speed_least: in a cavity, how fast the air returns
AIR_OBSERVABLES: dict[str, Callable[[AirMeasureInput], Measurement]] = {
    "layer_thickness": partial(mean_over_time, "layer_thickness", "m", boundary_layer_thickness),
    "displacement_thickness": partial(mean_over_time, "displacement_thickness", "m", displacement_thickness),
    "momentum_thickness": partial(mean_over_time, "momentum_thickness", "m", momentum_thickness),
    "friction_velocity": partial(mean_over_time, "friction_velocity", "m s-1", lambda p: p.friction_velocity),
    "friction_velocity_fit": friction_velocity_fit,
    "wind_aloft": partial(mean_over_time, "wind_aloft", "m s-1", lambda p: p.wind_aloft),
    "speed_least": partial(mean_over_time, "speed_least", "m s-1", lambda p: float(p.speed.min())),
}


def flat_plate_thickness(speed: float, distance: float, viscosity: float) -> float:
    """Thickness of a turbulent layer on a smooth flat plate [m].

    delta = 0.37 x Re_x^(-1/5),    Re_x = U x / nu from 5e5 to 1e7

    with U the wind aloft [m s-1] and x the distance from the leading edge [m].

    Reference: Schlichting & Gersten (2017), section 18.2.5 (power law of 1/7).
    """
    return GROWTH * distance * (speed * distance / viscosity) ** -0.2


def free_stream_speed_by_coles(friction: float, thick: float, roughness: float, viscosity: float) -> float:
    """Wind aloft over a layer with Coles' wake [m s-1].

    U / u* = (1 / kappa) ln(delta / z0e) + 2 Pi / kappa,    z0e = z0 + 0.11 nu / u*,  Pi = 0.55, kappa = 0.40

    with u* the friction velocity [m s-1], delta the thickness [m] and z0 the roughness length [m].

    Reference: Coles (1956), J. Fluid Mech. 1, 191-226.
    """
    effective = roughness + SMOOTH * viscosity / friction
    return friction / KARMAN * (log(thick / effective) + 2.0 * WAKE)


def friction_velocity_ratio(height: float, roughness: float) -> float:
    """Friction velocity over the wind at a height [1], u* / U = kappa / ln(z / z0) over a rough bed.

    With z the height [m] and z0 the roughness length [m]. Holds in neutral air for z far above z0, within the
    lowest tenth of the layer.

    Reference: Schlichting & Gersten (2017), section 17.1.2 (law of the wall).
    """
    return KARMAN / log(height / roughness)
