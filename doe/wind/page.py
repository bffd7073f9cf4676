"""The page on sand under wind: thresholds and flux beside measurements, with its tables and figures."""

from math import hypot, isfinite, nan
from pathlib import Path

from scipy.stats import t as student

from doe.common.cases import STOPPED, Row
from doe.common.pages import write_pages
from doe.common.tables import lines_of
from doe.wind import ratio, shares
from doe.wind.blown_sand import (
    BARE,
    STRESS_LINE,
    Found,
    Table,
    adhesion_table,
    draw_flux,
    draw_impact,
    flux_table,
    found_in,
    impact_table,
    line_table,
    scaling_table,
    shown,
    splash_table,
)
from doe.wind.saturated_sand import saturated_table, saturated_thresholds, together
from taichi_erosion.measures.threshold import CONFIDENCE, MAP_SD, PLATE, Bracket, Tunnel, wind_speed
from taichi_erosion.report.markdown import markdown_table

PICTURES = {"impact": "pictures/impact_threshold.png", "flux": "pictures/flux.png"}
TABLES = ("flux", "impact", "fluid", "saturated")
CREYSSELS_SAND = "0.24"  # mm, of saturated.csv: the sand nearest to that of Creyssels et al.
ALONE = "drag alone"  # the case that others are compared with
ROLLING, FLUID = "rolling_onset", "threshold_u_star"


def half_interval(row: Row) -> float:
    """Half of Student's interval of the mean of the seeds, in the row's unit."""
    if row.n < 2:
        return nan
    return float(student.ppf(0.5 + 0.5 * CONFIDENCE, row.n - 1)) * row.standard_error


def soil_tunnel() -> Tunnel:
    """The tunnel of the study with the bed of the scene."""
    scene = shares.scene()
    assert scene.wind is not None
    return Tunnel(scene.threshold.fetch, shares.diameter(), scene.wind.viscosity)


def tunnel_speed(friction: float, half: float) -> tuple[float, float]:
    """Free-stream speed at which the floor of the tunnel feels u* [m s-1], and half of its interval.

    Half the intervals of u* and of the map add as squares.
    """
    tunnel = soil_tunnel()
    speed, beyond, other = (
        wind_speed(each, tunnel)
        for each in (friction, friction + (half if isfinite(half) else 0.0), friction * (1.0 + MAP_SD))
    )
    return speed, hypot(beyond - speed, 2.0 * (other - speed))


def fluid_table(found: Found) -> str:
    """Thresholds of the published soil, and what they depend on."""
    header = (
        *("what", "case", "beds", "rolling onset u* [m/s]", "rolling onset U in the tunnel [m/s]"),
        *("fluid threshold u* [m/s]", "over that of drag alone", "fluid threshold U in the tunnel [m/s]"),
        *("U of a flat plate [m/s]", "remark"),
    )
    rows = []
    for name, case in found.items():
        if STOPPED in case:
            rows.append((*name, "", "stopped", *[""] * 5, case[STOPPED].note))
            continue
        fluid = case[FLUID]
        rolling, (friction, speed) = onset_cells(case[ROLLING]), onset_cells(fluid)
        bare = bare_threshold(found, name[0])
        over = f"{fluid.value / bare.value:.2f}" if bare is not None else ""
        plate = shown(wind_speed(fluid.value, soil_tunnel(), PLATE))
        rows.append((*name, str(fluid.n), *rolling, friction, over, speed, plate, fluid.note))
    return markdown_table(header, rows)


def bare_threshold(found: Found, group: str) -> Row | None:
    """Threshold of drag alone: that of the same group, else the first there is."""
    names = sorted((name for name in found if name[1] == ALONE), key=lambda name: name[0] != group)
    return found[names[0]][FLUID] if names else None


def onset_cells(row: Row) -> tuple[str, str]:
    """A friction velocity with its interval, and what the tunnel makes of it."""
    half = half_interval(row)
    return shown(row.value, half), shown(*tunnel_speed(row.value, half))


def map_table(tunnel: Table) -> str:
    """Friction velocity at the floor of the working section."""
    header = ("U [m/s]", "u* [m/s]", "u* / U", "layer [m]", "u* of a flat plate [m/s]")
    rows = [
        (
            *(line["speed"], shown(float(line["friction_velocity"]), float(line["friction_velocity_sd"]))),
            *(shown(float(line[n])) for n in ("ratio", "layer_thickness", "plate_friction_velocity")),
        )
        for line in tunnel
    ]
    return markdown_table(header, rows)


def choice_table(choices: Table) -> str:
    """What every choice that the map rests on changes in u* of one wind, and in a threshold.

    A floor that feels more of the same wind reaches a given u* at a lower speed.
    """
    header = ("choice", "u* at 6.5 m/s [m/s]", "change of u*", "change of a threshold in U")
    rows = []
    for line in choices:
        change = float(line["relative_change"])
        shares = (f"{100.0 * share:+.1f} %" for share in (change, 1.0 / (1.0 + change) - 1.0))
        rows.append((line["choice"], shown(float(line["friction_velocity"])), *shares))
    return markdown_table(header, rows)


def sand_threshold(impact: Found, sand: str) -> Bracket | None:
    """Threshold of saturated transport of a bare sand, by its diameter in mm; None where it has none."""
    found = impact.get((BARE, sand), {}).get(STRESS_LINE)
    if found is None:
        return None
    return Bracket(found.value - found.standard_error, found.value + found.standard_error)


def tables(doe: Path) -> dict[str, str]:
    """Tables of the page by name."""
    flux, falling, fluid, steady = (found_in(doe / "wind" / f"{name}.csv") for name in TABLES)
    impact = together(falling, saturated_thresholds(steady))
    thresholds = lines_of(doe / "measured" / "impact_threshold.csv")
    fluxes = lines_of(doe / "measured" / "flux_creyssels2009.csv")
    tunnel, choices = (lines_of(doe / "tunnel_map" / f"{name}.csv") for name in ("map", "variants"))
    return {
        "fluid": fluid_table(fluid),
        "flux": flux_table(flux, fluxes),
        "map": map_table(tunnel),
        "choices": choice_table(choices),
        "impact": impact_table(impact, thresholds, (STRESS_LINE,)),
        "scaling": scaling_table(impact, lines_of(doe / "wind" / "hopping.csv")),
        "adhesion": adhesion_table(impact, thresholds),
        "saturated": saturated_table(steady),
        "lines": line_table(flux, fluxes, sand_threshold(impact, CREYSSELS_SAND)),
        "splash": splash_table(flux),
        **shares.tables(),
        **ratio.tables(doe),
    }


def publish(doe: Path, docs: Path) -> None:
    """Draw the figures and fill the tables of the page."""
    flux, falling, _, steady = (found_in(doe / "wind" / f"{name}.csv") for name in TABLES)
    impact = together(falling, saturated_thresholds(steady))
    thresholds = lines_of(doe / "measured" / "impact_threshold.csv")
    draw_impact(impact, thresholds, lines_of(doe / "wind" / "hopping.csv"), docs / PICTURES["impact"])
    draw_flux(flux, lines_of(doe / "measured" / "flux_creyssels2009.csv"), docs / PICTURES["flux"])
    write_pages([doe / "wind" / "README.md"], tables(doe))
