"""Air density: the air of the day and of the site, in place of what the scene assumes.

    rho = rho_0 + strength ((p - 0.378 H e_s) M / (R T) - rho_0)
    p   = p_0 exp(-g M h / (R T)) where no pressure is stated,    e_s = 611.21 exp(17.502 t / (240.97 + t)) Pa
    mu  = mu_0 + strength (mu_S (T / T_S)^(3/2) (T_S + S) / (T + S) - mu_0)

with rho_0 and mu_0 density [kg m-3] and viscosity [Pa s] of the scene's air, p the pressure [Pa], T the
temperature [K], t the same [C], H the relative humidity [1] and h the altitude [m] of the conditions, p_0
and T_0 those at sea level and H = 0 where the conditions state none, e_s the pressure of saturated vapour,
0.378 one less the ratio of the molar masses of water and air, M = 0.02897 kg mol-1 the molar mass of dry
air, R the gas constant, g gravity; mu_S = 1.716e-5 Pa s at T_S = 273.15 K and S = 110.4 K. Thresholds of
u* go with rho^(-1/2): 7 % at 1100 m. Strength is linear in both. Holds for dry air between 200 and 400 K,
for moist air between -20 and 60 C. Saturated air is lighter than dry air by 0.9 % at 20 C and 2.8 % at 40
C.

Reference: Sutherland (1893), Phil. Mag. 36, 507; mu_S and T_S of White (2006), Viscous Fluid Flow, 3rd ed.,
table 1-2; S of the US Standard Atmosphere (1976); Buck (1981), J. Appl. Meteorol. 20, 1527 (e_s over water).
"""

from collections.abc import Mapping
from dataclasses import dataclass
from math import exp
from typing import Any

import numpy as np

from taichi_erosion.core.effect import Check, Checks, Conditions, Probe, effect_of, quantity
from taichi_erosion.scene import Scene
from taichi_erosion.scene.change import sample_scene, with_section

MOLAR_MASS = 0.0289652  # of dry air [kg mol-1]
GAS_CONSTANT = 8.314462618  # [J mol-1 K-1], CODATA 2018
GRAVITY = 9.80665  # standard [m s-2]
VISCOSITY = 1.716e-5  # at the reference temperature, White (2006) [Pa s]
REFERENCE_TEMPERATURE = 273.15  # [K]
SUTHERLAND = 110.4  # of air, US Standard Atmosphere (1976) [K]
VAPOUR_LIGHTER = 0.378  # one less molar mass of water over that of dry air [1]
FREEZING = 273.15  # 0 C [K]
STATED = ("pressure", "temperature", "altitude", "relative_humidity")


@dataclass(frozen=True)
class Params:
    pressure: float = quantity(101325.0, "Pa", "at sea level", low=1e3, high=2e5)
    temperature: float = quantity(293.15, "K", "where the conditions state none", low=200.0, high=400.0)


def change(params: Params, strength: float, conditions: Conditions, scene: Scene) -> Scene:
    """The scene in its true air; without wind, or where nothing is stated, as it is."""
    wind = scene.wind
    if wind is None or strength == 0.0 or not any(name in conditions for name in STATED):
        return scene
    temperature = conditions.get("temperature", params.temperature)
    specific = GAS_CONSTANT * temperature / MOLAR_MASS
    column = params.pressure * exp(-GRAVITY * conditions.get("altitude", 0.0) / specific)
    pressure = conditions.get("pressure", column)
    celsius = temperature - FREEZING
    saturated = 611.21 * exp(17.502 * celsius / (240.97 + celsius))  # Pa, Buck (1981)
    vapour = min(conditions.get("relative_humidity", 0.0) * saturated, pressure)
    density = (pressure - VAPOUR_LIGHTER * vapour) / specific
    bare = wind.viscosity * wind.density
    mixed = wind.density + strength * (density - wind.density)
    ratio = (temperature / REFERENCE_TEMPERATURE) ** 1.5
    dynamic = VISCOSITY * ratio * (REFERENCE_TEMPERATURE + SUTHERLAND) / (temperature + SUTHERLAND)
    viscosity = (bare + strength * (dynamic - bare)) / mixed
    return with_section(scene, "wind", density=mixed, viscosity=viscosity)


def can_act(conditions: Mapping[str, Any]) -> Any:
    """Where pressure, temperature, altitude or humidity is stated."""
    columns = [np.isfinite(np.asarray(conditions[name])) for name in STATED if name in conditions]
    return np.any(columns, axis=0) if columns else np.False_


def checks(probe: Probe) -> Checks:
    patch = {"length": 0.02, "width": 0.01, "height": 0.05, "density": 1.2, "viscosity": 1.5e-5}
    site = Params(pressure=1e5, temperature=300.0)

    def air(name: str, strength: float = 1.0, **conditions: float) -> float:
        return getattr(probe(site, conditions, scene=sample_scene(wind=patch), strength=strength).wind, name)

    yield Check("1000 hPa and 20 C", air("density", pressure=1e5, temperature=293.15), 1.18836, rtol=1e-4)
    yield Check("half way", air("density", 0.5, pressure=1e5, temperature=293.15), 1.19418, rtol=1e-4)
    # scale height R T / (M g) of 300 K: 8781.6 m
    yield Check("one scale height up a third is left", air("density", altitude=8781.6), 0.427196, rtol=1e-4)
    # saturated vapour at 40 C: 7.384 kPa in tables of steam
    humid = air("density", pressure=1e5, temperature=313.15, relative_humidity=0.8)
    yield Check("moist air is lighter", humid, (1e5 - 0.378 * 0.8 * 7384.0) / (287.055 * 313.15), rtol=2e-4)
    dynamic = air("viscosity", temperature=313.15) * air("density", temperature=313.15)
    yield Check("at 40 C air is as viscous as tables say", dynamic, 1.912e-5, rtol=3e-3)
    yield Check("a laboratory that states nothing changes nothing", air("density"), 1.2)


EFFECT = effect_of(
    __name__, "density and viscosity of the air of the site", "scene", change, reads=STATED, most=1.5
)
