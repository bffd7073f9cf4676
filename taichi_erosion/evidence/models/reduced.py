"""A wind-erosion model in closed form: threshold, flux and angle of repose in microseconds.

    u*t = A sqrt((rho_p / rho - 1) g d)                                         [m s-1]
    Q   = C (rho / g) u*t (u*^2 - u*t^2) (u* / u*t)^(n - 2), 0 below the threshold    [kg m-1 s-1]
    a   = arctan(mu_s) + 15 mu_r                                                [deg]

times the shifts of fourteen effects. Every effect takes its strength psi (0: absent, 1: textbook) and the
conditions and gives a `Shift`. The forms keep the scaling of their sources; where a source gives none, the
size is marked as plausible. The model is the example of an evidence study and the test of the statistics; use
it as `model = "taichi_erosion.evidence.models.reduced:predict"`.

Observables: threshold_u_star, flux, repose_angle. Parameters: threshold_coefficient A, flux_coefficient C,
flux_exponent n (2 if it is not given), friction_sliding mu_s, friction_rolling mu_r. Conditions: the keys of
DEFAULTS, which also say what is assumed when one is not given.

Reference: Bagnold (1941) for the threshold; for the flux Ungar & Haff (1987), Sedimentology 34, 289 (n = 2),
Owen (1964), J. Fluid Mech. 20, 225 (n = 3), and Kawamura (1951), whose law lies between.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtri

from taichi_erosion.core.errors import BadInput
from taichi_erosion.evidence.data.problem import Conditions, Floats, Integers, Numbers, row_count

GRAVITY = 9.81  # m s-2
GRAIN_DENSITY = 2650.0  # kg m-3, quartz, where none is given
AIR_DENSITY = 1.2  # kg m-3, what the bare model assumes everywhere
SCALE_HEIGHT = 8581.0  # m, R T / g of air at 20 C
MEDIAN_DIAMETER = 2.5e-4  # m
REPOSE_TANGENT = 0.6  # tangent of the angle of repose on a slope [1]
DEFAULTS = {
    "diameter": MEDIAN_DIAMETER,  # m
    "grain_density": GRAIN_DENSITY,  # kg m-3
    "moisture": 0.0,  # kg water per kg of dry soil
    "slope": 0.0,  # rad, uphill positive
    "roughness": 0.0,  # frontal area of obstacles per ground area [1]
    "air_density": AIR_DENSITY,  # kg m-3, at these:
    "temperature": 293.15,  # K
    "pressure": 101325.0,  # Pa
    "altitude": 0.0,  # m
    "spread": 1.5,  # d90 / d50 [1]
    "angularity": 0.3,  # 0 round, 1 crushed
    "turbulence": 0.1,  # sd of the wind over its mean [1]
    "fetch": 10.0,  # m of erodible bed upwind
    "width": np.inf,  # m between the walls of a box; a heap stands free
    "u_star": 0.4,  # m s-1
}


@dataclass(frozen=True)
class Shift:
    """Action of one effect: threshold and flux are multiplied by exp(.), the angle is raised [deg]."""

    threshold: Floats | float = 0.0
    flux: Floats | float = 0.0
    repose: Floats | float = 0.0


Law = Callable[[float, Conditions], Shift]


def dry_cohesion(psi: float, at: Conditions) -> Shift:
    """As dry_adhesion in scenes: u*t^2 gains gamma / (rho d); Reference: Shao & Lu (2000), JGR 105, 22437."""
    gamma = 2.0e-4  # N m-1
    weight = GRAVITY * at["grain_density"] / AIR_DENSITY * at["diameter"]
    ratio = psi * gamma / (AIR_DENSITY * at["diameter"]) / weight
    return Shift(threshold=0.5 * np.log1p(ratio), repose=9.0 * ratio / (1.0 + ratio))


def liquid_bridge(psi: float, at: Conditions) -> Shift:
    """u*tw = u*td sqrt(1 + 1.21 w^0.68), w [%]; Reference: Fecan et al. (1999), Ann. Geophys. 17, 149."""
    percent = 100.0 * np.maximum(at["moisture"], 0.0)
    bridges = 1.0 - np.exp(-percent / 0.8)
    threshold = 0.5 * np.log1p(psi * 1.21 * percent**0.68)
    return Shift(threshold=threshold, repose=psi * 7.0 * bridges / (1.0 + 0.3 * psi))


def saffman_lift(psi: float, at: Conditions) -> Shift:
    """As shear_lift in scenes: 0.3 of the drag at 0.25 mm; u*t falls as (1 + lift)^-1/2 (plausible size)."""
    lift = 0.3 * psi * (at["diameter"] / MEDIAN_DIAMETER) ** 0.5
    return Shift(threshold=-0.5 * np.log1p(lift))


def gusts(psi: float, at: Conditions) -> Shift:
    """As turbulent_gusts in scenes: u*t falls as 1 / (1 + 2 psi I), flux gains 3 psi I^2 (plausible size)."""
    intensity = at["turbulence"]
    return Shift(threshold=-np.log1p(2.0 * psi * intensity), flux=np.log1p(3.0 * psi * intensity**2))


def rolling_resistance(psi: float, at: Conditions) -> Shift:
    """Angular grains pivot harder: angle up by 12 deg, u*t by 15 % at angularity 1 (plausible size)."""
    return Shift(threshold=np.log1p(0.15 * psi * at["angularity"]), repose=12.0 * psi * at["angularity"])


def sheltering(psi: float, at: Conditions) -> Shift:
    """Coarse grains hide fine ones: u*t up as (d90/d50)^0.4; Reference: Egiazaroff (1965), rounded."""
    return Shift(threshold=0.4 * psi * np.log(at["spread"]), repose=psi * 1.5 * np.log(at["spread"]))


def bed_slope(psi: float, at: Conditions) -> Shift:
    """sqrt(cos a + sin a / tan phi); Reference: Iversen & Rasmussen (1994), Sedimentology 41, 721."""
    factor = np.sqrt(np.maximum(np.cos(at["slope"]) + np.sin(at["slope"]) / REPOSE_TANGENT, 0.05))
    return Shift(threshold=np.log(np.maximum(1.0 + psi * (factor - 1.0), 0.05)))


def drag_partition(psi: float, at: Conditions) -> Shift:
    """sqrt((1 - m s L)(1 + m b L)), m = 0.5, b = 100; Reference: Raupach et al. (1993), JGR 98, 3023."""
    density = np.minimum(at["roughness"], 0.5)
    return Shift(threshold=0.5 * np.log((1.0 - 0.5 * density) * (1.0 + 50.0 * psi * density)))


def electrostatics(psi: float, at: Conditions) -> Shift:
    """As electric_field in scenes: weight less by 20 % at 0.1 mm, lost above 1 % water (plausible size)."""
    relief = 0.2 * psi * (1e-4 / at["diameter"]) * np.exp(-at["moisture"] / 0.005)
    return Shift(threshold=-0.5 * np.log1p(relief), flux=0.6 * relief)


def air_density(psi: float, at: Conditions) -> Shift:
    """u*t ~ rho^-1/2 and Q ~ rho, rho ~ p / T e^(-g h / R T): the bare model: sea level, 20 C."""
    usual = DEFAULTS["temperature"] / at["temperature"]
    thin = at["air_density"] / AIR_DENSITY * at["pressure"] / DEFAULTS["pressure"] * usual
    ratio = np.log(thin) - at["altitude"] / SCALE_HEIGHT * usual
    return Shift(threshold=-0.5 * psi * ratio, flux=psi * ratio)


def mid_air_collisions(psi: float, at: Conditions) -> Shift:
    """Always there in scenes: u* raises the flux more; Reference: Carneiro et al. (2013), PRL 111, 058001."""
    return Shift(flux=np.log1p(0.8 * psi * np.maximum(at["u_star"] - 0.25, 0.0) / 0.25))


def short_fetch(psi: float, at: Conditions) -> Shift:
    """As finite_fetch in scenes: 1 - exp(-x / L), L = psi 5 m; Reference: Dong (2004), Geomorphology 57."""
    length = 5.0 * max(psi, 1e-12)
    return Shift(flux=np.log(np.maximum(-np.expm1(-at["fetch"] / length), 1e-6)))


def side_walls(psi: float, at: Conditions) -> Shift:
    """Walls carry part of the heap: angle up by 8 deg at a width of 10 grains (plausible size)."""
    width = np.where(at["width"] > 0.0, at["width"], np.inf)  # 0: there are none
    return Shift(repose=8.0 * psi * np.minimum(10.0 * at["diameter"] / width, 3.0))


def trap_efficiency(psi: float, at: Conditions) -> Shift:
    """An instrument, not physics: a trap loses fine grains, more in stronger wind (plausible size)."""
    loss = 0.35 * psi * np.exp(-at["diameter"] / 1.5e-4) * at["u_star"] / 0.4
    return Shift(flux=-loss)


LAWS = (dry_cohesion, liquid_bridge, saffman_lift, gusts, rolling_resistance)
LAWS += (sheltering, bed_slope, drag_partition, electrostatics, air_density)
LAWS += (mid_air_collisions, short_fetch, side_walls, trap_efficiency)
LARGEST = {"air_density": 1.5, "bed_slope": 1.5}  # strengths that are physical, of laws without a free size
EFFECTS: dict[str, Law] = {law.__name__: law for law in LAWS}
OBSERVABLES = ("threshold_u_star", "flux", "repose_angle")
PARAMETERS = {"threshold_coefficient": 0.1, "flux_coefficient": 1.5}
PARAMETERS |= {"friction_sliding": 0.5, "friction_rolling": 0.1}
SCATTER = {"threshold_u_star": 0.02, "flux": 0.08, "repose_angle": 0.5}  # of one seed; relative, or deg
DEFAULT_COLUMNS: Conditions = {name: np.asarray(value) for name, value in DEFAULTS.items()}
GOLDEN, LAST_SHIFT = np.uint64(0x9E3779B97F4A7C15), np.uint64(31)  # of splitmix64
MIXERS = ((np.uint64(30), np.uint64(0xBF58476D1CE4E5B9)), (np.uint64(27), np.uint64(0x94D049BB133111EB)))
DEGREES_PER_ROLLING = 15.0  # deg per unit of rolling friction, from heaps of spheres


def predict(
    observable: str, conditions: Conditions, parameters: Numbers, effects: Numbers, seeds: Integers
) -> Floats:
    """The model of the study contract: one observable, n conditions, r seeds -> (r, n), paired by seed."""
    value = model_mean(observable, conditions, parameters, effects)
    kick = SCATTER[observable] * paired_normal_numbers(observable, conditions, seeds)
    return value + kick if observable == "repose_angle" else value * np.exp(kick)


def closed_form(
    observable: str, conditions: Conditions, parameters: Numbers, effects: Numbers, seeds: Integers
) -> Floats:
    """The same without scatter (r, n), each seed alike: the model of tables of laboratories."""
    return np.repeat(model_mean(observable, conditions, parameters, effects)[np.newaxis], len(seeds), axis=0)


def model_mean(observable: str, conditions: Conditions, parameters: Numbers, effects: Numbers) -> Floats:
    at = DEFAULT_COLUMNS | conditions  # a row without what others state has NaN; a default stays one number
    shifts = [EFFECTS[name](psi, at) for name, psi in effects.items() if psi != 0.0]
    return mean_with_shifts(observable, row_count(conditions), at, {**PARAMETERS, **parameters}, shifts)


def mean_with_shifts(
    observable: str, count: int, at: Conditions, parameters: Numbers, shifts: list[Shift]
) -> Floats:
    """The model without its scatter in `count` rows with some shifts; all conditions and parameters."""
    if observable == "repose_angle":
        angle = np.degrees(np.arctan(parameters["friction_sliding"]))
        bare = angle + DEGREES_PER_ROLLING * parameters["friction_rolling"]
        return bare + sum((shift.repose for shift in shifts), start=np.zeros(count))
    weight = (at["grain_density"] / AIR_DENSITY - 1.0) * GRAVITY * at["diameter"]
    threshold = parameters["threshold_coefficient"] * np.sqrt(weight)
    threshold = threshold * np.exp(sum((shift.threshold for shift in shifts), start=0.0))
    if observable == "threshold_u_star":
        return threshold * np.ones(count)
    if observable != "flux":
        raise BadInput(f"reduced model: observable = {observable!r} is not one of {', '.join(OBSERVABLES)}")
    excess = np.maximum(at["u_star"] ** 2 - threshold**2, 0.0)
    flux = parameters["flux_coefficient"] * AIR_DENSITY / GRAVITY * threshold * excess
    flux = flux * (at["u_star"] / threshold) ** (parameters.get("flux_exponent", 2.0) - 2.0)
    return flux * np.exp(sum((shift.flux for shift in shifts), start=np.zeros(count)))


def paired_normal_numbers(observable: str, conditions: Conditions, seeds: Integers) -> Floats:
    """Standard normal number of every (seed, condition), the same whatever the parameters and effects."""
    return normal_numbers_of_states(hash_rows(observable, conditions), seeds)


def normal_numbers_of_states(rows: np.ndarray, seeds: Integers) -> Floats:
    """Standard normal numbers (seeds, rows) of rows in their states."""
    grid = splitmix64(rows[np.newaxis, :] ^ splitmix64(np.asarray(seeds).astype(np.uint64))[:, np.newaxis])
    uniform = (np.right_shift(grid, np.uint64(11)).astype(np.float64) + 0.5) * 2.0**-53
    return ndtri(uniform)


def hash_rows(observable: str, conditions: Conditions) -> np.ndarray:
    """A number for every row that its observable and conditions make.

    A hash of the bits, so that the order of rows does not matter. Reference: the finaliser of Steele, Lea &
    Flood (2014), OOPSLA, fig. 15 (splitmix64).
    """
    state = np.full(row_count(conditions), OBSERVABLES.index(observable) + 1, dtype=np.uint64)
    for name in sorted(conditions):
        state = splitmix64(state ^ np.asarray(conditions[name], dtype=np.float64).view(np.uint64))
    return state


def splitmix64(state: np.ndarray) -> np.ndarray:
    """One step of splitmix64: every bit of the result depends on every bit of the state."""
    state = state + GOLDEN
    for shift, factor in MIXERS:
        state ^= np.right_shift(state, shift)
        state *= factor
    state ^= np.right_shift(state, LAST_SHIFT)
    return state
