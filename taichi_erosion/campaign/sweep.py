"""Sweep: the measures of a scene along values of one entry, each value run with the same seeds."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from math import isfinite, nan
from pathlib import Path

import numpy as np
import pandas as pd

from taichi_erosion.campaign.execute import run_requests
from taichi_erosion.campaign.ledger import close_ledger, open_ledger
from taichi_erosion.campaign.request import RunResult, request_of_file
from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.files import ListedFolder, make_parent_folder
from taichi_erosion.execution import Report
from taichi_erosion.execution.checks import read_effects, read_scene, setup_report

TABLE, FIGURE = "sweep.csv", "sweep.png"
NO_VALUE = " has no value: "  # of a measure, whose own notes say why


@dataclass(frozen=True)
class SweepPoint:
    entry: str  # value as it was given
    measure: str
    value: float  # mean over the seeds, NaN without any
    sd: float  # of single runs; of one run what the measure says of itself
    unit: str
    n: int  # seeds that gave a value
    note: str  # why seeds gave none, or what a value lacks


def parse_sweep_values(over: str) -> tuple[str, list[str]]:
    """Path and values of `PATH=a,b,c`. Raises BadInput."""
    path, _, text = over.partition("=")
    values = [value.strip() for value in text.split(",")]
    if not path.strip() or len(values) < 2 or "" in values or "[" in text or len(set(values)) < len(values):
        raise BadInput(f"--over {over}: write PATH=a,b,c with two or more values that differ")
    return path.strip(), values


def sweep_entry(
    scene: Path,
    over: str,
    overrides: Sequence[str] = (),
    replicas: int | None = None,
    effect_files: Sequence[Path] = (),
    where: tuple[Path, int | None, str | None] = (Path("sweep"), None, None),
    progress: Report | None = None,
) -> list[SweepPoint]:
    """All measures at all values; `where`: folder of the ledger, local workers, Dask scheduler.

    Runs that stand in the ledger are not made again. Raises BadInput for what cannot run.
    """
    path, values = parse_sweep_values(over)
    if path == "run.seed":
        raise BadInput("--over run.seed: every value runs with the same seeds; repeats are --replicas")
    files, (folder, workers, scheduler) = read_effects(effect_files), where
    entries = [(*overrides, f"{path}={value}") for value in values]
    scenes = [read_scene(scene, one, files) for one in entries]
    first, warnings = scenes[0], [setup_report(one, files)["warnings"] for one in scenes]
    seeds = [first.run.seed + k for k in range(replicas or first.run.replicas)]
    if not first.measure:
        raise BadInput(f"{scene}: has no [measure], so a sweep has no curve")
    requests = [request_of_file(scene, one, seed, files) for one in entries for seed in seeds]
    make_parent_folder(folder / TABLE)
    ledger = open_ledger(folder)
    try:
        results = run_requests(requests, ledger, workers, scheduler, progress)
    finally:
        close_ledger(ledger)
    rows = [results[k : k + len(seeds)] for k in range(0, len(results), len(seeds))]
    points = list(zip(values, rows, warnings, strict=True))
    return [sweep_point(value, name, row, lines) for name in first.measure for value, row, lines in points]


def sweep_point(entry: str, name: str, results: Sequence[RunResult], warnings: Sequence[str]) -> SweepPoint:
    """One measure of the runs of a value; the note has `warnings` of its scene, and why runs say nothing."""
    measures = [result.record.get("measures", {}).get(name, {}) for result in results]
    blocking = [[lack for lack in one.get("shortfalls", ()) if lack["blocks"]] for one in measures]
    pairs = [(result.value(name), one.get("sd")) for result, one in zip(results, measures, strict=True)]
    values = [pair for pair, block in zip(pairs, blocking, strict=True) if isfinite(pair[0]) and not block]
    notes = [result.failure or result.record.get("stopped") for result in results]
    notes += [
        *warnings,
        *(line for result in results for line in result.record.get("warnings", ()) if NO_VALUE not in line),
    ]
    lacks = (lack for one in measures for lack in one.get("shortfalls", ()))
    notes += [lack["sentence"] for lack in lacks if not lack["stated"]]
    notes += ["; ".join(one["notes"]) for one in measures if one and one["value"] is None]
    numbers = np.array([value for value, _ in values])
    own_sd = next((sd for _, sd in values if sd is not None), nan)
    sd = float(numbers.std(ddof=1)) if len(values) > 1 else own_sd
    unit, mean = next((one["unit"] for one in measures if one), ""), float(numbers.mean()) if values else nan
    return SweepPoint(entry, name, mean, sd, unit, len(values), "; ".join(dict.fromkeys(filter(None, notes))))


def write_sweep(folder: Path, over: str, points: Sequence[SweepPoint], figure: bytes) -> list[Path]:
    table = pd.DataFrame(map(asdict, points)).rename(columns={"entry": parse_sweep_values(over)[0]})
    text = table.to_csv(index=False, float_format="%.6g", lineterminator="\n")
    files = {TABLE: text.encode(), FIGURE: figure}
    return [ListedFolder(folder).write_file(name, content) for name, content in files.items()]
