"""Published formulas of thresholds and flux, against the numbers of their sources."""

from math import exp, isnan, log, sqrt

import pytest

from taichi_erosion.measures import wind_formulas
from taichi_erosion.measures.wind_formulas import FLUX, Sand, flux_by, kok_impact_threshold, shao_lu_threshold

MM = 1e-3
# the smallest fluid threshold, and where: Iversen & White (1982), figure 3; Shao & Lu (2000), figure 2
LEAST = {"Iversen & White (1982)": (0.20, 0.075), "Shao & Lu (2000)": (0.24, 0.107)}


@pytest.mark.parametrize(("name", "least"), LEAST.items(), ids=LEAST)
def test_fluid_thresholds_have_their_minimum_where_their_sources_have_it(name, least):
    diameters = [0.04 * MM * 1.02**k for k in range(120)]
    found = [wind_formulas.FLUID[name](Sand(d)) for d in diameters]
    assert min(found) == pytest.approx(least[0], abs=0.01)
    assert diameters[found.index(min(found))] == pytest.approx(least[1] * MM, rel=0.15)


def test_the_coefficient_of_iversen_and_white_reaches_those_of_its_three_ranges():
    """A without adhesion: 0.129 / sqrt(1.928 Re^0.092 - 1) at Re = 1, 0.12 where Re is large."""
    for diameter, density in ((0.2 * MM, 2650.0), (2.0 * MM, 2650.0), (4.0 * MM, 4000.0)):
        sand = Sand(diameter, density)
        found = wind_formulas.iversen_white(sand)
        cohesive = sqrt(1.0 + 6e-7 / (density * 9.81 * diameter**2.5))
        reynolds = found * diameter / sand.viscosity
        share = found / (cohesive * sqrt(sand.density_ratio * 9.81 * diameter))
        middle = 0.129 / sqrt(1.928 * reynolds**0.092 - 1.0)
        wanted = middle if reynolds < 10.0 else 0.12 * (1.0 - 0.0858 * exp(-0.0617 * (reynolds - 10.0)))
        assert share == pytest.approx(wanted, rel=1e-6)


def test_shao_and_lu_balance_weight_and_cohesion_at_their_minimum():
    """At d = sqrt(G / (rho_s g)) both terms are equal, and u*t is sqrt(2 A s g d)."""
    at = sqrt(3e-4 / (2650.0 * 9.81))
    assert shao_lu_threshold(Sand(at)) == pytest.approx(sqrt(2.0 * 0.0123 * 2650.0 / 1.225 * 9.81 * at))
    low, high = (shao_lu_threshold(Sand(0.18 * MM), cohesion) for cohesion in (1.65e-4, 5e-4))
    assert (low, high) == pytest.approx((0.237, 0.274), abs=5e-4)


def test_the_impact_threshold_is_that_of_figure_21a_for_quartz_alone():
    assert kok_impact_threshold(Sand(0.25 * MM)) == pytest.approx(0.19811, abs=1e-4)
    assert kok_impact_threshold(Sand(1.0 * MM)) == pytest.approx(0.40730, abs=1e-4)
    assert 0.7 < kok_impact_threshold(Sand(0.25 * MM)) / wind_formulas.iversen_white(Sand(0.25 * MM)) < 0.8
    for other in (Sand(0.03 * MM), Sand(0.25 * MM, 1940.0), Sand(0.25 * MM, air_density=0.8)):
        assert isnan(kok_impact_threshold(other))


def test_fluxes_vanish_at_the_threshold_and_grow_with_their_powers():
    sand = Sand(0.25 * MM)
    threshold = kok_impact_threshold(sand)
    for name in FLUX:
        assert (flux_by(name, sand, threshold), flux_by(name, sand, 0.9 * threshold)) == (0.0, 0.0)
    powers = {  # of u*, far above the threshold; Owen's settling speed over u* is then small
        name: log(flux(sand, 200.0, threshold) / flux(sand, 100.0, threshold)) / log(2.0)
        for name, flux in FLUX.items()
    }
    assert [powers[name] for name in FLUX] == pytest.approx([3.0, 3.0, 2.0], abs=0.05)
    # evaluated apart, in the form of AeoLiS; Owen's with the settling speed by bisection, 1.9072 m/s
    fluxes = {"Kawamura (1951)": 25.072, "Owen (1964)": 11.094, "Durán et al. (2011)": 14.936}  # g m-1 s-1
    assert {name: 1e3 * flux_by(name, sand, 0.4) for name in FLUX} == pytest.approx(fluxes, rel=1e-4)


def test_fluid_thresholds_are_those_of_other_codes():
    """0.25 mm: by hand, by Martin & Kok's public code with its air, and by Shao & Lu in cgs units."""
    laws, sand = wind_formulas.FLUID, Sand(0.25 * MM)
    assert laws["Bagnold (1941)"](sand) == pytest.approx(0.23028, rel=1e-4)
    assert isnan(laws["Bagnold (1941)"](Sand(0.18 * MM)))  # it holds from 0.2 mm on
    air = Sand(0.25 * MM, air_density=1.2, viscosity=1.8365e-5 / 1.2)  # its g is 9.8 m s-2
    assert laws["Iversen & White (1982)"](air) == pytest.approx(0.27548, rel=5e-4)
    assert laws["Shao & Lu (2000)"](sand) == pytest.approx(0.27804, rel=1e-4)


def test_spheres_settle_with_their_drag_equal_to_their_weight():
    """Stokes' speed where they are fine, and C_D = 24 (1 + 0.15 Re^0.687) / Re beyond."""
    stokes = 2650 / 1.225 * 9.81e-10 / 18 / 1.46e-5
    assert wind_formulas.settling_speed_of_sphere(Sand(0.01 * MM)) == pytest.approx(stokes, rel=0.01)
    for diameter in (0.1 * MM, 0.5 * MM, 2.0 * MM):
        sand = Sand(diameter)
        speed = wind_formulas.settling_speed_of_sphere(sand)
        reynolds = speed * diameter / sand.viscosity
        drag = 24.0 / reynolds * (1.0 + 0.15 * reynolds**0.687) * 0.75 * speed**2 / diameter
        assert drag == pytest.approx((sand.density_ratio - 1.0) * 9.81, rel=1e-6)
