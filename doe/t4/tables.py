"""Published series as tidy tables, written beside this file from a folder with the tables of their sources.

    python -m doe.t4.tables FOLDER

`README.md` says what each table holds. What a source does not state is left empty. Standard errors of layer
heights and the scatter of thresholds by activity are computed here from the readings behind them.
"""

import csv
import sys
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from math import sqrt
from pathlib import Path

import numpy as np
from scipy.optimize import curve_fit

from doe.common.command import words
from taichi_erosion.core.files import write_atomic

HERE = Path(__file__).parent
HEAD = ("observable", "value", "sd", "n", "unit", "group")
SITES = {
    "Oceano": "Martin Oceano",
    "Jericoacoara": "Martin Jericoacoara",
    "RanchoGuadalupe": "Martin Rancho Guadalupe",
}
DETECTED = 0.03  # g m-1 s-1, the least mean flux of the field table that is not zero
ACTIVITY_BINS = np.linspace(0.0, 1.0, 6)
Line = dict[str, str]


def lines(folder: Path, name: str) -> list[Line]:
    """Rows of a table of the sources."""
    with (folder / f"{name}.csv").open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def write(name: str, conditions: Sequence[str], rows: Iterable[Sequence[object]]) -> None:
    """Write a tidy table: six cells of HEAD, then the conditions, then the source."""
    text = [",".join((*HEAD, *conditions, "source"))]
    text += [",".join(told(cell) for cell in row) for row in rows]
    write_atomic(HERE / f"{name}.csv", ("\n".join(text) + "\n").encode())


def told(cell: object) -> str:
    """A cell as the table has it."""
    return f"{cell:.6g}" if isinstance(cell, float) else str(cell)


def spread_of(folder: Path) -> Mapping[str, float]:
    """d90 over d50 of the surface by site [1]."""
    rows = [row for row in lines(folder, "grainsize_field_martin_sites") if row["sample"] == "surface"]
    return {row["site"]: float(row["d90_mm"]) / float(row["d50_mm"]) for row in rows}


def flux_field(folder: Path) -> None:
    """Flux in steady half hours at three field sites; a bin without flux is below what was detected."""
    spread, rows = spread_of(folder), []
    for row in lines(folder, "flux_field_martin_kok"):
        none = float(row["Q_g_m_s"]) == 0.0
        value = (f"<{DETECTED}", "") if none else (row["Q_g_m_s"], row["Q_err"])
        group = f"{row['site']} {row['u_star_m_s']}"
        at = (row["u_star_m_s"], row["u_star_err"], row["d50_surface_mm"], row["air_density_assumed_kg_m3"])
        end = (f"{spread[row['site']]:.4g}", SITES[row["site"]])
        rows.append(("flux", *value, 1, "g/(m s)", group, *at, *end))
    conditions = ("u_star [m/s]", "sd of u_star", "diameter [mm]", "air_density [kg/m3]", "spread")
    write("flux_field", conditions, rows)


def flux_quarter_mm(folder: Path) -> None:
    """Flux over sand of a quarter of a millimetre: one wind tunnel, two beaches."""
    rows: list[Sequence[object]] = []
    for row in lines(folder, "flux_tunnel_creyssels2009"):
        sd = (float(row["Q_hi"]) - float(row["Q_lo"])) / 2.0  # half of the bar, as in ../measured
        at = (row["u_star_m_s"], row["d_mm"], "tunnel", "Creyssels 2009")
        rows.append(("flux", row["Q_g_m_s"], sd, 1, "g/(m s)", f"Creyssels {row['u_star_m_s']}", *at))
    for name, source in (("namikas2003", "Namikas 2003"), ("greeley1996", "Greeley 1996")):
        for row in lines(folder, f"flux_field_{name}_runs"):
            if row["Q_published_g_m_s"]:
                at = (row["u_star_m_s"], row["d50_mm"], row["note"].replace(",", ";"), source)
                value = ("flux", row["Q_published_g_m_s"], "", 1, "g/(m s)")
                rows.append((*value, f"{source} run {row['run']}", *at))
    write("flux_quarter_mm", ("u_star [m/s]", "diameter [mm]", "note"), rows)


def layer_height(folder: Path) -> None:
    """Height over which the flux of the blown layer falls by e, three field sites and an experiment."""
    rows: list[Sequence[object]] = []
    for row in lines(folder, "flux_field_martin_kok"):
        if float(row["efold_height_zq_m"]) > 0.0:
            at = (row["u_star_m_s"], row["u_star_err"], row["d50_surface_mm"], SITES[row["site"]])
            group = f"{row['site']} {row['u_star_m_s']}"
            rows.append(("layer_height", row["efold_height_zq_m"], row["zq_err"], 1, "m", group, *at))
    profiles: dict[str, list[Line]] = defaultdict(list)
    for row in lines(folder, "fluxprofile_field_farrell2012"):
        profiles[row["interval"]].append(row)
    for row in lines(folder, "flux_field_farrell2012_runs"):
        height, error = fitted_height(profiles[row["interval"]])
        at = (row["u_star_m_s"], "", "", "Farrell 2012")
        rows.append(("layer_height", height, error, 1, "m", f"Farrell {row['interval']}", *at))
    write("layer_height", ("u_star [m/s]", "sd of u_star", "diameter [mm]"), rows)


def trap_density(row: Line) -> tuple[float, float, float]:
    """Lower and upper edge of a trap [m], and its catch over time, width and height [g m-2 s-1]."""
    top, height = float(row["trap_top_height_m"]), float(row["trap_height_m"])
    return (
        top - height,
        top,
        float(row["weight_g"]) / (float(row["duration_s"]) * float(row["trap_width_m"]) * height),
    )


def fitted_height(traps: Sequence[Line]) -> tuple[float, float]:
    """E-folding height of a profile and its standard error [m], traps of equal relative error.

    ln q_i = ln( q0 zq / h_i (exp(-z_i / zq) - exp(-(z_i + h_i) / zq)) ): the mean over a trap of height h_i
    """
    low, high, density = (np.array(column) for column in zip(*map(trap_density, traps), strict=True))

    def mean_density(_: object, log_start: float, scale: float) -> np.ndarray:
        return log_start + np.log(scale / (high - low) * (np.exp(-low / scale) - np.exp(-high / scale)))

    found, covariance = curve_fit(mean_density, low, np.log(density), p0=(np.log(density[0]), 0.1))
    return float(found[1]), sqrt(float(covariance[1, 1]))


def field_thresholds(folder: Path) -> None:
    """Fluid and impact threshold at three field sites, and a fluid threshold of a wind tunnel."""
    rows: list[Sequence[object]] = []
    for row in lines(folder, "threshold_field_martin_kok_sites"):
        density = float(row["air_density_assumed_kg_m3"])
        at = (row["d50_surface_mm"], row["d50_err_mm"], density, SITES[row["site"]])
        pairs = (("fluid", "tau_fluid_threshold_Pa", "err"), ("impact", "tau_impact_threshold_Pa", "err_it"))
        for kind, value, error in pairs:
            speed = sqrt(float(row[value]) / density)
            sd = 0.5 * speed * float(row[error]) / float(row[value])
            rows.append((f"{kind}_threshold_u_star", speed, sd, 1, "m/s", f"{row['site']} {kind}", *at))
    for row in lines(folder, "points_from_abstracts_and_citing_text"):
        if row["quantity"] == "fluid threshold u*t" and "Earth" in row["condition"]:
            diameter = row["condition"].partition("d=")[2].partition(" ")[0]
            at = (f"{float(diameter) / 1000.0:g}", "", "", "Greeley 1980")
            value = ("fluid_threshold_u_star", row["value"], rounding(row["value"]))
            rows.append((*value, 1, row["unit"], "Greeley tunnel", *at))
    write("field_thresholds", ("diameter [mm]", "sd of diameter", "air_density [kg/m3]"), rows)


def rounding(text: str) -> float:
    """Half of the last printed digit: the error of a number that is known from an abstract alone."""
    return 0.5 * 10.0 ** -len(text.partition(".")[2])


def threshold_by_activity(folder: Path) -> None:
    """Threshold winds of single minutes against the share of the minute with transport, in two half hours.

    Minutes of one half hour with alike activity are repeats: their mean, their scatter and their number.
    """
    bins: dict[tuple[str, int], list[tuple[float, float]]] = defaultdict(list)
    for row in lines(folder, "threshold_field_oceano_1min_tfem"):
        share = float(row["saltation_activity_fQ"])
        place = int(np.clip(np.searchsorted(ACTIVITY_BINS, share) - 1, 0, ACTIVITY_BINS.size - 2))
        bins[row["zL_stability"], place].append((share, float(row["u_threshold_TFEM_m_s"])))
    names = {key: f"half hour {k + 1}" for k, key in enumerate(dict.fromkeys(half for half, _ in bins))}
    rows = []
    for half, place in sorted(bins, key=lambda key: (names[key[0]], key[1])):
        shares, winds = np.array(bins[half, place]).T
        sd = float(np.std(winds, ddof=1)) if winds.size > 1 else ""
        at = (float(shares.mean()), half, f"Oceano {names[half]}")
        group = f"{names[half]} activity {ACTIVITY_BINS[place]:.1f}"
        rows.append(("threshold_wind_speed", float(winds.mean()), sd, winds.size, "m/s", group, *at))
    write("threshold_by_activity", ("activity", "stability"), rows)


def flux_profile(folder: Path) -> None:
    """Flux density over flux against height in 14 intervals; the first and the last seven apart."""
    flux = {
        row["interval"]: float(row["Q_estimated_g_m_s"])
        for row in lines(folder, "flux_field_farrell2012_runs")
    }
    wind = {row["interval"]: row["u_star_m_s"] for row in lines(folder, "flux_field_farrell2012_runs")}
    rows = []
    for row in lines(folder, "fluxprofile_field_farrell2012"):
        low, high, density = trap_density(row)
        interval = row["interval"]
        part = "first" if int(interval) <= len(flux) // 2 else "last"
        at = (low, high, wind[interval], f"Farrell {part} intervals")
        rows.append(
            ("flux_density_share", density / flux[interval], "", 1, "1/m", f"interval {interval}", *at)
        )
    write("flux_profile", ("trap_bottom [m]", "trap_top [m]", "u_star [m/s]"), rows)


def main(folder: Path) -> None:
    """All tables."""
    for table in (
        flux_field,
        flux_quarter_mm,
        layer_height,
        field_thresholds,
        threshold_by_activity,
        flux_profile,
    ):
        table(folder)


if __name__ == "__main__":
    asked = words(__doc__)
    if len(asked) != 1:
        sys.exit(str(__doc__))
    main(Path(asked[0]))
