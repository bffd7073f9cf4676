"""Sealed cases on the simulator: heaps made with hidden effects, which the commands then have to find.

    python -m doe.t1.run seal SECRET      draw the truths into the folder SECRET, write their digest
    python -m doe.t1.run make SECRET      simulate the laboratories' tables
    python -m doe.t1.run solve            discover and adopt, by the commands, without the truths
    python -m doe.t1.run score SECRET     open the truths and write results.csv

Six cases hide nothing, twelve one effect, four two, two something that no candidate describes. A laboratory
has its own seeds, time step, packing and friction. All cases share one campaign: surfaces are simulated once.
"""

import json
import random
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import typer

from doe.sealed.studies import Case, SealedSet, steps
from taichi_erosion.core.setup import Numerics
from taichi_erosion.run.checks import compatibility_key, read_scene
from taichi_erosion.run.ensemble import ReplicaRequest, run_replicas

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
CAMPAIGN = ROOT / "campaigns" / "t1"
SCENE = HERE / "column.toml"
SINGLE = (
    "liquid_bridge",
    "dry_adhesion",
    "rolling_resistance",
    "restitution_speed",
    "size_distribution",
    "packing_preparation",
    "image_charge",
    "grain_density",
)
AGAIN = ("liquid_bridge", "dry_adhesion", "rolling_resistance", "size_distribution")  # at another strength
PAIRS = (
    ("liquid_bridge", "rolling_resistance"),
    ("dry_adhesion", "rolling_resistance"),
    ("liquid_bridge", "size_distribution"),
    ("rolling_resistance", "size_distribution"),
)
STRENGTHS = (0.3, 1.0, 2.0)  # over the textbook, times up to 1.3 either way
MOST = {"size_distribution": 1.0, "grain_density": 1.5, "image_charge": 2.0, "restitution_speed": 2.0}
OUTSIDE = ("sliding friction that grows with angularity", "restitution that falls with moisture")
DIAMETERS = (1.5e-3, 3e-3)  # m
SURFACES = ((0.0, 0.0), (0.01, 0.0), (0.0, 0.5), (0.0, 1.0))  # moisture, angularity
OBSERVABLES = ("centroid_height", "pile_height", "column_height", "radius_90")
REPEATS = 3
SLIDING, ROLLING = "contact.grain-grain.friction_sliding", "contact.grain-grain.friction_rolling"
PACKING = ("run.time_step_d=2.4e-2", "fill.pitch_d=1.2")
ENSEMBLE = 200  # replicas that run beside each other

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


def draw(generator: random.Random) -> list[Case]:
    """The truth of every case, in an order that tells nothing."""
    hidden = [((), None)] * 6 + [((name,), None) for name in (*SINGLE, *AGAIN)]
    hidden += [(pair, None) for pair in PAIRS] + [((), outside) for outside in OUTSIDE]
    generator.shuffle(hidden)
    cases = []
    for number, (names, outside) in enumerate(hidden):
        effects = {name: drawn_strength(generator, name, len(names)) for name in names}
        sliding = 0.52 * generator.lognormvariate(0.0, 0.08)
        rolling = 0.15 * generator.lognormvariate(0.0, 0.3)
        numbers = {SLIDING: sliding, ROLLING: rolling}
        cases.append({"number": number, "effects": effects, "outside": outside, "numbers": numbers})
    return cases


def drawn_strength(generator: random.Random, name: str, together: int) -> float:
    """A strength near one of three levels; effects of a pair are not weak."""
    level = generator.choice(STRENGTHS[1:] if together > 1 else STRENGTHS)
    return min(level * generator.uniform(0.77, 1.3), MOST.get(name, 3.0))


def orders(case: Case, diameter: float, moisture: float, angularity: float) -> tuple[str, ...]:
    """Settings of one laboratory run."""
    numbers = dict(case["numbers"])
    if case["outside"] == OUTSIDE[0]:
        numbers[SLIDING] *= 1.0 + 0.8 * angularity
    if case["outside"] == OUTSIDE[1]:
        numbers["contact.grain-grain.restitution"] = 0.5 / (1.0 + 150.0 * moisture)
    words = {"grains.size.diameter": diameter, "conditions.moisture": moisture, **numbers}
    words |= {"conditions.angularity": angularity}
    words |= {f"effects.{name}.strength": value for name, value in case["effects"].items()}
    return (*PACKING, *(f"{path}={value!r}" for path, value in words.items()))


def measure(cases: Sequence[Case], seed: int) -> None:
    """Studies and tables."""
    (CAMPAIGN / "column.toml").write_text(SCENE.read_text("utf-8"), encoding="utf-8")
    rows = [(case, d, w, a) for case in cases for d in DIAMETERS for w, a in SURFACES for _ in range(REPEATS)]
    tables: dict[int, list[str]] = {case["number"]: [] for case in cases}
    for (case, d, w, a), values in zip(rows, simulated(rows, seed), strict=True):
        for name in OBSERVABLES:
            if values.get(name) is not None:
                line = f"{name},{values[name]:.6g},1,m,w{w:g} a{a:g} d{d:g},{w:g},{a:g},{d:g},made"
                tables[case["number"]].append(line)
    for number, lines in tables.items():
        head = "observable,value,n,unit,group,moisture,angularity,diameter,source"
        (CAMPAIGN / f"case_{number}.csv").write_text("\n".join([head, *lines]) + "\n", encoding="utf-8")
        SET.study(number).write_text(study_text(number), encoding="utf-8")


def study_text(number: int) -> str:
    """The study of one case."""
    entries = "".join(
        f'[observables.{name}]\nscene = "column.toml"\ntransform = "log"\n' for name in OBSERVABLES
    )
    names = json.dumps(list(SINGLE))
    return STUDY.format(
        number=number, observables=entries, sliding=SLIDING, rolling=ROLLING, candidates=names
    )


def simulated(rows: list[tuple[Case, float, float, float]], seed: int) -> list[dict[str, float]]:
    """Values of every laboratory run; a run that stopped has none."""
    generator = random.Random(seed)
    found: dict[int, dict[str, float]] = {k: {} for k in range(len(rows))}
    groups: dict[str, list[tuple[int, ReplicaRequest]]] = {}
    for k, (case, *at) in enumerate(rows):
        scene = read_scene(SCENE, orders(case, *at))
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


SET = SealedSet(CAMPAIGN, HERE, draw, measure)

if __name__ == "__main__":
    steps(SET)()
