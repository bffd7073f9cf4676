"""Laboratories of sealed cases that our own simulator makes: heaps of 100 grains, and studies of them.

A set says how the runs of one laboratory differ from the scene; everything else is the same for all sets:
conditions, repeats, observables, calibrated numbers and candidates.
"""

import json
import random
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import typer

from doe.sealed.studies import Case
from taichi_erosion.core.setup import Numerics
from taichi_erosion.run.checks import compatibility_key, read_scene
from taichi_erosion.run.ensemble import ReplicaRequest, run_replicas

ENSEMBLE = 200  # replicas that run beside each other
CANDIDATES = (
    "liquid_bridge",
    "dry_adhesion",
    "rolling_resistance",
    "restitution_speed",
    "size_distribution",
    "packing_preparation",
    "image_charge",
    "grain_density",
)
MOST = {"size_distribution": 1.0, "grain_density": 1.5, "image_charge": 2.0, "restitution_speed": 2.0}
OUTSIDE = ("sliding friction that grows with angularity", "restitution that falls with moisture")
DIAMETERS = (1.5e-3, 3e-3)  # m
CONDITIONS = ((0.0, 0.0), (0.01, 0.0), (0.0, 0.5), (0.0, 1.0))  # moisture, angularity
OBSERVABLES = ("centroid_height", "pile_height", "column_height", "radius_90")
REPEATS = 3
SLIDING, ROLLING = "contact.grain-grain.friction_sliding", "contact.grain-grain.friction_rolling"
RESTITUTION = "contact.grain-grain.restitution"
USUAL = {SLIDING: 0.52, ROLLING: 0.15, RESTITUTION: 0.5}  # of the scene
Settings = Callable[[Case], tuple[str, ...]]  # of all runs of a laboratory

STUDY = """
[study]
title = "Sealed case {number}"
measurements = "case_{number}.csv"
runs = "runs"
{observables}
[conditions]
moisture = "conditions.moisture"
angularity = "conditions.angularity"
diameter = "grains.size.diameter"
[parameters."{sliding}"]
start = 0.52
low = 0.3
high = 0.8
prior_sd_log = 0.1
[parameters."{rolling}"]
start = 0.15
low = 0.02
high = 0.6
prior_sd_log = 0.5
[candidates]
effects = {candidates}
[vault]
fraction = 0.3
"""


@dataclass(frozen=True)
class Heaps:
    """Where a set lies, its scene, and how its laboratories differ from the scene."""

    folder: Path  # studies and tables
    scene: Path
    settings: Settings


def drawn_numbers(generator: random.Random) -> dict[str, float]:
    """Sliding and rolling friction of a laboratory."""
    sliding = USUAL[SLIDING] * generator.lognormvariate(0.0, 0.08)
    return {SLIDING: sliding, ROLLING: USUAL[ROLLING] * generator.lognormvariate(0.0, 0.3)}


def orders(
    settings: Settings, case: Case, diameter: float, moisture: float, angularity: float
) -> tuple[str, ...]:
    """Settings of one laboratory run."""
    numbers = dict(case["numbers"])
    if case["outside"] == OUTSIDE[0]:
        numbers[SLIDING] *= 1.0 + 0.8 * angularity
    if case["outside"] == OUTSIDE[1]:
        numbers[RESTITUTION] = USUAL[RESTITUTION] / (1.0 + 150.0 * moisture)
    words = {"grains.size.diameter": diameter, "conditions.moisture": moisture, **numbers}
    words |= {"conditions.angularity": angularity}
    words |= {f"effects.{name}.strength": value for name, value in case["effects"].items()}
    return (*settings(case), *(f"{path}={value!r}" for path, value in words.items()))


def measure(heaps: Heaps, cases: Sequence[Case], seed: int) -> None:
    """Studies and tables."""
    (heaps.folder / "column.toml").write_text(heaps.scene.read_text("utf-8"), encoding="utf-8")
    rows = [
        (case, d, w, a) for case in cases for d in DIAMETERS for w, a in CONDITIONS for _ in range(REPEATS)
    ]
    tables: dict[int, list[str]] = {case["number"]: [] for case in cases}
    for (case, d, w, a), values in zip(rows, simulated(heaps, rows, seed), strict=True):
        for name in OBSERVABLES:
            if values.get(name) is not None:
                line = f"{name},{values[name]:.6g},1,m,w{w:g} a{a:g} d{d:g},{w:g},{a:g},{d:g},made"
                tables[case["number"]].append(line)
    for number, lines in tables.items():
        head = "observable,value,n,unit,group,moisture,angularity,diameter,source"
        table = heaps.folder / f"case_{number}.csv"
        table.write_text("\n".join([head, *lines]) + "\n", encoding="utf-8")
        table.with_suffix(".toml").write_text(study_text(number), encoding="utf-8")


def study_text(number: int) -> str:
    """The study of one case."""
    entries = "".join(
        f'[observables.{name}]\nscene = "column.toml"\ntransform = "log"\n' for name in OBSERVABLES
    )
    names = json.dumps(list(CANDIDATES))
    return STUDY.format(
        number=number, observables=entries, sliding=SLIDING, rolling=ROLLING, candidates=names
    )


def simulated(
    heaps: Heaps, rows: list[tuple[Case, float, float, float]], seed: int
) -> list[dict[str, float]]:
    """Values of every laboratory run; a run that stopped has none."""
    generator = random.Random(seed)
    found: dict[int, dict[str, float]] = {k: {} for k in range(len(rows))}
    groups: dict[str, list[tuple[int, ReplicaRequest]]] = {}
    for k, (case, *at) in enumerate(rows):
        scene = read_scene(heaps.scene, orders(heaps.settings, case, *at))
        part = ReplicaRequest(scene, generator.randrange(2**30, 2**31))
        groups.setdefault(compatibility_key(scene), []).append((k, part))
    for members in groups.values():
        for start in range(0, len(members), ENSEMBLE):
            batch = members[start : start + ENSEMBLE]

            def tell(
                place: int, record: dict[str, Any], batch: list[tuple[int, ReplicaRequest]] = batch
            ) -> None:
                measures = record.get("measures") or {}
                found[batch[place][0]] = {name: measure["value"] for name, measure in measures.items()}

            run_replicas([part for _, part in batch], Numerics("cpu", 1, "f32"), tell)
            typer.echo(f"{start + len(batch)} of {len(members)} runs")
    return [found[k] for k in range(len(rows))]
