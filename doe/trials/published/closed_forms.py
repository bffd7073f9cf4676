"""Closed forms of the literature, beside which the answers stand: values at held-out rows.

A form has the numbers of its source throughout. Where it gives no absolute value, `level` takes one factor
from the fitted rows.
"""

import csv
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from math import exp
from pathlib import Path

import numpy as np

from doe.trials.published.models import share_above
from taichi_erosion.evidence.data.problem import Floats, Measurements
from taichi_erosion.evidence.models.reduced import AIR_DENSITY, GRAIN_DENSITY, GRAVITY

HERE = Path(__file__).parent
BAGNOLD = 0.08  # A of the impact threshold [1]; Bagnold (1941)
SHAO_LU, GAMMA = 0.0123, 3e-4  # [1], N m-1; Shao & Lu (2000), J. Geophys. Res. 105, 22437
RATIO = 0.82  # impact over fluid threshold [1]; Kok et al. (2012), Rep. Prog. Phys. 75, 106901
KOK, KAWAMURA = 5.0, 2.78  # [1]; Kok et al. (2012); Kawamura (1951)
FLUID, IMPACT = "fluid_threshold_u_star", "impact_threshold_u_star"
Form = Callable[[Measurements], Floats]


@dataclass(frozen=True)
class ClosedForm:
    """A form of the literature; `level` where its absolute value is taken from the fitted rows."""

    name: str
    form: Form
    level: bool = False

    def at(self, fitted: Measurements, held_out: Measurements) -> Floats:
        """Values at the held-out rows, in the unit of their observable."""
        if not self.level:
            return self.form(held_out)
        known = ~fitted.censored
        return exp(float(np.mean(np.log(fitted.value / self.form(fitted))[known]))) * self.form(held_out)


@cache
def site_thresholds() -> dict[tuple[str, str], float]:
    """Measured thresholds by site and kind [m s-1]."""
    with (HERE / "field_thresholds.csv").open(encoding="utf-8", newline="") as file:
        return {(row["source"], row["observable"]): float(row["value"]) for row in csv.DictReader(file)}


@cache
def interval_heights() -> dict[str, float]:
    """Fitted layer heights of the intervals of one experiment [m]."""
    with (HERE / "layer_height.csv").open(encoding="utf-8", newline="") as file:
        rows = [row for row in csv.DictReader(file) if row["group"].startswith("Farrell")]
    return {row["group"].replace("Farrell", "interval"): float(row["value"]) for row in rows}


def stated(rows: Measurements, name: str, usual: float) -> Floats:
    """A condition, the usual value where it is not stated."""
    column = rows.conditions.get(name, np.full(rows.size, np.nan))
    return np.where(np.isfinite(column), column, usual)


def bagnold(rows: Measurements) -> Floats:
    """u*t = A sqrt((s - 1) g d) at the impact threshold [m s-1]."""
    buoyant = GRAIN_DENSITY / stated(rows, "air_density", AIR_DENSITY) - 1.0
    return BAGNOLD * np.sqrt(buoyant * GRAVITY * rows.conditions["diameter"])


def shao_lu(rows: Measurements) -> Floats:
    """u*t = sqrt(A (s g d + gamma / (rho d))), RATIO of it at the impact threshold [m s-1]."""
    air, d = stated(rows, "air_density", AIR_DENSITY), rows.conditions["diameter"]
    fluid = np.sqrt(SHAO_LU * (GRAIN_DENSITY / air * GRAVITY * d + GAMMA / (air * d)))
    return np.where(np.array(rows.observable) == FLUID, 1.0, RATIO) * fluid


def thresholds_of(rows: Measurements) -> Floats:
    """Impact thresholds measured at the site; Bagnold's where none is [m s-1]."""
    known = site_thresholds()
    own = np.array([known.get((source, IMPACT), np.nan) for source in rows.source])
    return np.where(np.isfinite(own), own, bagnold(rows))


def kok(rows: Measurements) -> Floats:
    """Q = C (rho / g) u*t (u*^2 - u*t^2), u*t the impact threshold [kg m-1 s-1]."""
    threshold, wind = thresholds_of(rows), rows.conditions["u_star"]
    density = stated(rows, "air_density", AIR_DENSITY) / GRAVITY
    return KOK * density * threshold * np.maximum(wind**2 - threshold**2, 0.0)


def kawamura(rows: Measurements) -> Floats:
    """Q = C (rho / g) (u* - u*t) (u* + u*t)^2 [kg m-1 s-1]."""
    threshold, wind = thresholds_of(rows), rows.conditions["u_star"]
    density = stated(rows, "air_density", AIR_DENSITY) / GRAVITY
    return KAWAMURA * density * np.maximum(wind - threshold, 0.0) * (wind + threshold) ** 2


def owen_height(rows: Measurements) -> Floats:
    """A height that grows with u*^2; Owen (1964), J. Fluid Mech. 20, 225."""
    return rows.conditions["u_star"] ** 2


def constant_height(rows: Measurements) -> Floats:
    """A height that no wind changes; Martin & Kok (2017), Sci. Adv. 3, e1602569."""
    return np.ones(rows.size)


def falling_threshold(rows: Measurements) -> Floats:
    """A stress that falls from fluid to impact threshold with the share of time with transport.

    With both thresholds as measured at the site; Martin & Kok (2018), Geophys. Res. Lett.
    """
    known, site = site_thresholds(), "Martin Oceano"
    ratio = (known[site, IMPACT] / known[site, FLUID]) ** 2
    return np.sqrt(1.0 - (1.0 - ratio) * rows.conditions["activity"])


def exponential_profile(rows: Measurements) -> Floats:
    """Mean flux density of a trap over the flux, exp(-z / h), h fitted to each interval by itself [m-1]."""
    height = np.array([interval_heights()[group] for group in rows.group])
    low, high = rows.conditions["trap_bottom"], rows.conditions["trap_top"]
    return (share_above(low, height, {}) - share_above(high, height, {})) / (high - low)
