"""Thresholds and flux of one's own sand in words: tables beside the formulas, and warnings."""

from collections.abc import Iterator, Mapping
from math import isfinite
from typing import Any

from taichi_erosion.evidence.words.answer_lines import Table
from taichi_erosion.evidence.words.run_words import measured_value_texts, run_warnings, with_sd_text
from taichi_erosion.evidence.words.vocabulary import in_words
from taichi_erosion.measures.wind_formulas import RANGES
from taichi_erosion.scene.preparation.limits import DUST
from taichi_erosion.tables.number_words import plain
from taichi_erosion.wind.survey import MOST_BEDS, Survey, relative_half_width

Document = Mapping[str, Any]
THRESHOLDS = ("fluid_threshold", "impact_threshold")
PATCH = (
    "The fluid threshold is of this patch and watch: the first grain that flies sets off others, so four "
    "times the area or the watch lower it by a tenth; `threshold.landings = false` counts the wind alone."
)
INTERVAL = ", brackets: 95 % over beds; ±: standard deviation"  # of what is simulated or measured


def survey_cost_text(survey: Survey, cores: int) -> str:
    """`about 13 core-minutes, 7 minutes on 2 cores`; at most how many where a precision is asked for."""
    beds, most = survey.beds, max(survey.beds, MOST_BEDS)
    cost, limit = (sum(survey.core_minutes(count)) for count in (beds, most))
    more = f"; at most {most} beds, {limit:.0f} core-minutes" * isfinite(survey.precision)
    return f"about {cost:.0f} core-minutes, {cost / min(cores, beds):.0f} minutes on {cores} cores{more}"


def formula_line(document: Document) -> str:
    """`by the formulas: fluid threshold u* 0.243 to 0.252 m/s, ...`, which needs no simulation."""
    laws = [(f"{in_words(name)} u*", document[name], 1.0, "m/s") for name in THRESHOLDS]
    fluxes = zip(document["winds"], document["flux"], strict=True)
    laws += [(f"flux at {wind:g} m/s", by_law, 1e3, "g/(m s)") for wind, by_law in fluxes]
    parts = []
    for name, by_law, scale, unit in laws:
        if sizes := [scale * value for value in by_law.values() if isfinite(value)]:
            ends = dict.fromkeys((plain(min(sizes)), plain(max(sizes))))
            parts.append(f"{name} {' to '.join(ends)} {unit}")
    return f"by the formulas: {', '.join(parts)}"


def run_result_line(name: str, run: Document) -> str:
    """`flux_0.3: sand flux 12 (10 to 14) g/(m s)`: what a scene of the survey gives."""
    units = {**dict.fromkeys(THRESHOLDS, (1.0, "m/s")), "flux": (1e3, "g/(m s)")}
    measures = ((key, run["measures"].get(key), *unit) for key, unit in units.items())
    parts = (f"{in_words(key)} {interval_text(m, scale)} {unit}" for key, m, scale, unit in measures if m)
    return f"{name}: {', '.join(parts)}"


def threshold_table(document: Document) -> Table:
    """Thresholds u* by source, simulated ones first."""
    measures = document["runs"].get("thresholds", {}).get("measures", {})
    rows = [(in_words(name), "simulated", interval_text(measure)) for name, measure in measures.items()]
    for name in THRESHOLDS:
        laws = document[name].items()
        rows += [(in_words(name), law, plain(value) if isfinite(value) else "-") for law, value in laws]
    columns = "u* [m/s]; ratio [1]", "by", "value"
    return Table(f"thresholds{INTERVAL * bool(measures)}", columns, tuple(rows))


def interval_text(measure: Document, scale: float = 1.0) -> str:
    """`0.27 (0.26 to 0.28)` by the 95 % interval over beds; a deviation of its own where one bed has it."""
    numbers = {key: scale * measure[key] for key in ("value", "sd") if measure.get(key) is not None}
    if not (bounds := measure.get("details", {}).get("interval")):
        return with_sd_text({**measure, **numbers})
    return f"{plain(numbers['value'])} ({plain(scale * bounds['low'])} to {plain(scale * bounds['high'])})"


def flux_table(document: Document) -> Table:
    """Flux by wind [g/(m s)]: simulated, by the formulas, measured; without columns that are empty."""
    runs, measurements, laws = document["runs"], document["measured"], tuple(document["flux"][0])
    head = ("u* [m/s]", *["simulated"] * bool(runs), *laws, *["measured"] * any(measurements))
    rows = []
    for wind, formulas, measurement in zip(document["winds"], document["flux"], measurements, strict=True):
        measure = runs.get(f"flux_{wind:g}", {}).get("measures", {}).get("flux", {})
        cells = [f"{wind:g}", *[interval_text(measure, 1e3)] * bool(runs)]
        cells += (plain(1e3 * formulas[law]) for law in laws)
        rows.append((*cells, *[interval_text(measurement, 1e3)] * any(measurements)))
    return Table(f"flux [g/(m s)]{INTERVAL * bool(runs or any(measurements))}", head, tuple(rows))


def survey_notes(document: Document) -> Iterator[str]:
    """Comparisons and warnings of all runs, each with its scene, and where formulas do not hold."""
    for name, run in document["runs"].items():
        yield from (f"{name}: {line}" for line in measured_value_texts(run))
        lines = (line.replace("--replicas", "--beds") for line in run_warnings(run))
        yield from (f"warning: {name}: {line}" for line in lines)
    yield from [PATCH] * ("thresholds" in document["runs"])
    for name, share in document["precision"].items():
        if document["runs"] and (off := relative_half_width(document["runs"]["thresholds"], name)) > share:
            yield f"warning: {in_words(name)}: known to {off:.0%}, {share:.0%} was asked: use more --beds"
    if document["sand"]["diameter"] < DUST:
        yield "warning: such grains are dust, which stays aloft: formulas and scenes are of sand that hops"
    if document["sand"]["moisture"] > 0.0:
        yield "The formulas are those of dry sand."
    laws = document["fluid_threshold"] | document["impact_threshold"]
    yield from (f"{law} {RANGES[law]}." for law, value in laws.items() if not isfinite(value))
