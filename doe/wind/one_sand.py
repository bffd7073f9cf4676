"""Uniform quartz with one contact, bed by bed: thresholds.csv beside this file, and tables of README.md.

python -m doe.wind.one_sand                 only the tables
python -m doe.wind.one_sand LABEL SEED...   some beds first, such as "1 mm" 1 2, "sorting 1.4" 1, "patch" 1
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from doe.common.cases import ROOT, Case, perform, settings
from doe.common.command import words
from doe.common.pages import write_pages
from taichi_erosion.core.files import make_parent_folder, write_atomic
from taichi_erosion.measures.result import Measurement
from taichi_erosion.measures.threshold import Bracket, pool_beds, threshold_from_bracket
from taichi_erosion.measures.wind_formulas import Sand, iversen_white, kok_impact_threshold
from taichi_erosion.tables.number_words import markdown_table
from taichi_erosion.wind.survey import Survey, survey_scenes

TABLE, STARTS = (Path(__file__).with_name(f"{name}.csv") for name in ("thresholds", "starts"))
FLUID, IMPACT, LINE = "fluid_threshold", "impact_threshold", "impact_threshold_linear"
HALVES = {FLUID: 1.04**0.25, IMPACT: 0.9**-0.5}  # upper end of a bracket over its middle [1]
WIND = 0.4123  # u* of Creyssels et al. (2009) [m s-1]
PATCH = settings("grains.count=3200", "wind.length_d=50", "wind.width_d=16")
SIXTEEN = settings("grains.count=12800", "wind.length_d=100", "wind.width_d=32")
REST = settings("measure={ fluid_threshold={} }")
ALONE = REST + settings("threshold.landings=false")
SIZES = 'grains.size={ law = "lognormal", sigma_log = %s, median = 0.00025, low = %s, high = %s }'
WIDE = "fill.pitch_d=2.05", "wind.width_d=13", "grains.count=1300", SIZES % ("0.336", "0.000128", "0.00049")
STIFF = "fill.pitch_d=3.3", "wind.width_d=20", "grains.count=2000", "materials.sand.shear_modulus=3e5"
STIFF += (SIZES % ("0.588", "0.000077", "0.00081"),)  # each cut at twice the width
SANDS, SHIPPED = {f"{d:g} mm": d for d in (0.15, 0.25, 0.5, 1.0)}, "0.25 mm"
ORDERS = {name: () for name in (*SANDS, "flux")} | {"patch": REST + PATCH, "flux of the patch": PATCH}
ORDERS |= {"two of 200": REST, "carried off": ALONE, "patch, carried off": ALONE + PATCH}
ORDERS |= {"sixteen": REST + SIXTEEN, "sorting 1.4": REST + settings(*WIDE)}
ORDERS["sorting 1.8"] = REST + settings(*STIFF)
ONE, BY_LINE = "impact over fluid, flux below 1 %", "impact over fluid, line of the flux"
HEAD = "d [mm]", "beds", "fluid u* [m/s]", "Iversen & White", "impact u* [m/s], flux below 1 %", "Kok et al."
HEAD += "impact u* [m/s], line of the flux", ONE, BY_LINE
VARIANTS = {"as shipped": (SHIPPED, "flux"), "four times the area": ("patch", "flux of the patch")}
VARIANTS |= {"two grains of 200": ("two of 200", ""), "as shipped, carried off": ("carried off", "")}
VARIANTS |= {"four times, carried off": ("patch, carried off", "")}
VARIANTS |= {name: (name, "") for name in ("sorting 1.4", "sorting 1.8")}
SHOWN, WATCH, STEPS = (1, 4, 16), 5.0, 50  # areas over that as shipped [1]; s; of Newton's rule
STARTS_HEAD = "trials", "with a start", "a", "n", *(f"u* of half, area x {over} [m/s]" for over in SHOWN)


def simulate(label: str, *seeds: str) -> None:
    """Beds of one case, each a row group of the table."""
    diameter, name = SANDS.get(label, 0.25), f"flux_{WIND}" if "flux" in label else "thresholds"
    path = ROOT / f"wind-{diameter:g}mm" / f"{name}.toml"
    make_parent_folder(path)
    write_atomic(path, survey_scenes(Survey(Sand(1e-3 * diameter), (WIND,), beds=1))[name].encode())
    cases = [Case(label, f"bed {seed}", ("--seed", seed, *ORDERS[label])) for seed in seeds]
    perform(str(path.relative_to(ROOT)), cases, TABLE)


def interval(beds: pd.DataFrame, name: str, scale: float = 1.0) -> str:
    """Pooled value of beds with its interval of 95 %."""
    half, values = HALVES.get(name, 1.0), [scale * value for value in beds[name].dropna()]
    single = [threshold_from_bracket(name, Bracket(value / half, value * half)) for value in values]
    pooled = pool_beds(single if half > 1.0 else [Measurement(name, value, 0.0, "") for value in values])
    if not (ends := pooled.details.get("interval")):
        return f"{pooled.value:#.3g} (one bed)"
    return f"{pooled.value:#.3g} ({ends['low']:#.3g} to {ends['high']:#.3g})"


def starts() -> str:
    """Table of the rate c A^a u*^n at which a first grain starts, constant in time; A: 1 as shipped.

    Most likely c, a and n by the first starts of all trials with landings, errors from the curvature there;
    and the winds in which half of such patches have a start within `WATCH`.
    """
    trials = pd.read_csv(STARTS).query("landings")
    started, seconds = trials["first"].notna(), trials["first"].fillna(trials["watched"])
    area = trials["length_d"] * trials["width_d"] / 200.0
    terms = np.column_stack([np.ones(len(trials)), np.log(area), np.log(trials["u_star"] / WIND)])
    fit, covariance = np.array([np.log(started.sum() / seconds.sum()), 0.0, 0.0]), np.eye(3)
    for _ in range(STEPS):
        expected = np.exp(terms @ fit) * seconds.to_numpy()
        covariance = np.linalg.inv(terms.T * expected @ terms)
        fit += covariance @ terms.T @ (started - expected)
    cells = [f"{fit[k]:.2f} ± {1.96 * covariance[k, k] ** 0.5:.2f}" for k in (1, 2)]
    for over in np.log(SHOWN):
        power = (np.log(np.log(2.0) / WATCH) - fit[0] - fit[1] * over) / fit[2]
        slope = np.array([1.0, over, power]) / fit[2]
        err = 1.96 * float(slope @ covariance @ slope) ** 0.5
        cells.append("{:.3f} ({:.3f} to {:.3f})".format(*WIND * np.exp([power, power - err, power + err])))
    return markdown_table(STARTS_HEAD, [(str(len(trials)), str(started.sum()), *cells)])


def main(asked: Sequence[str]) -> None:
    """Simulate what was asked for, and fill the tables."""
    if asked:
        simulate(*asked)
    table = pd.read_csv(TABLE).pivot_table("value", ["group", "label"], "observable", dropna=False)
    table[ONE], table[BY_LINE] = (table[name] / table[FLUID] for name in (IMPACT, LINE))
    groups = {str(name): beds.dropna(how="all") for name, beds in table.groupby("group")}
    rows = []
    for name, diameter in SANDS.items():
        beds, sand = groups[name], Sand(1e-3 * diameter)
        fluid, impact, line, one, by_line = (interval(beds, k) for k in (FLUID, IMPACT, LINE, ONE, BY_LINE))
        curve, kok = f"{iversen_white(sand):.3f}", f"{kok_impact_threshold(sand):.3f}"
        rows.append((f"{diameter:g}", str(len(beds)), fluid, curve, impact, kok, line, one, by_line))
    whole = pd.concat([groups[name] for name in SANDS])
    rows.append(("all", str(len(whole)), *[""] * 5, interval(whole, ONE), interval(whole, BY_LINE)))
    variants = []
    for title, (rest, blown) in VARIANTS.items():
        beds, flux = groups[rest], groups.get(blown)
        cells = ("", "") if flux is None else (str(len(flux)), interval(flux, "flux", 1e3))
        variants.append((title, str(len(beds)), interval(beds, FLUID), *cells))
    head = ("0.25 mm", "beds", "fluid u* [m/s]", "beds", f"flux at u* {WIND} m/s [g/(m s)]")
    tables = {
        "one sand": markdown_table(HEAD, rows),
        "patch": markdown_table(head, variants),
        "starts": starts(),
    }
    write_pages([TABLE.with_name("README.md")], tables)


if __name__ == "__main__":
    main(words(__doc__))
