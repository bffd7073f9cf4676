"""Thresholds and flux of one's own sand in words: tables beside the formulas, and warnings."""

from collections.abc import Iterator, Mapping
from math import isfinite
from typing import Any

from taichi_erosion.evidence.words.answer_lines import Table
from taichi_erosion.evidence.words.run_words import comparisons, run_warnings, with_deviation
from taichi_erosion.evidence.words.vocabulary import quantity
from taichi_erosion.tables.number_words import plain
from taichi_erosion.wind.survey import departure

Document = Mapping[str, Any]


def threshold_table(document: Document) -> Table:
    """Thresholds u* by source, simulated ones first, with their intervals of 95 %."""
    rows = []
    for name, measure in document["runs"].get("thresholds", {}).get("measures", {}).items():
        text, bounds = with_deviation(measure), measure.get("details", {}).get("interval")
        if bounds:
            text = f"{plain(measure['value'])} ({plain(bounds['low'])} to {plain(bounds['high'])})"
        rows.append((quantity(name), "simulated", text))
    for name in ("fluid_threshold", "impact_threshold"):
        laws = document[name].items()
        rows += [(quantity(name), law, plain(value) if isfinite(value) else "-") for law, value in laws]
    return Table("thresholds", ("u* [m/s]; ratio [1]", "by", "value"), tuple(rows))


def flux_table(document: Document) -> Table:
    """Flux by wind [g/(m s)]: simulated, by the formulas, measured; without columns that are empty."""

    def grams(measure: Document) -> str:
        numbers = {key: 1e3 * measure[key] for key in ("value", "sd") if measure.get(key) is not None}
        return with_deviation({**measure, **numbers})

    runs, measured, laws = document["runs"], document["measured"], tuple(document["flux"][0])
    head = ("u* [m/s]", *["simulated"] * bool(runs), *laws, *["measured"] * any(measured))
    rows = []
    for wind, formulas, wanted in zip(document["winds"], document["flux"], measured, strict=True):
        measure = runs.get(f"flux_{wind:g}", {}).get("measures", {}).get("flux", {})
        cells = [f"{wind:g}", *[grams(measure)] * bool(runs), *(plain(1e3 * formulas[law]) for law in laws)]
        rows.append((*cells, *[grams(wanted)] * any(measured)))
    return Table("flux [g/(m s)]", head, tuple(rows))


def survey_notes(document: Document) -> Iterator[str]:
    """Comparisons and warnings of all runs, each with its scene, and where formulas do not hold."""
    for name, run in document["runs"].items():
        yield from (f"{name}: {line}" for line in comparisons(run))
        yield from (f"warning: {name}: {line}" for line in run_warnings(run))
    for name, share in document["precision"].items():
        if document["runs"] and (off := departure(document["runs"]["thresholds"], name)) > share:
            yield f"warning: {quantity(name)}: known to {off:.0%}, {share:.0%} was asked: use more --beds"
    if document["sand"]["moisture"] > 0.0:
        yield "The formulas are those of dry sand."
    if not all(map(isfinite, document["impact_threshold"].values())):
        yield "Kok et al. (2012) hold for quartz of 0.05 to 2 mm in air; fluxes take 0.8 of Iversen & White."
