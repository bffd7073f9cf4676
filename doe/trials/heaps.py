"""Laboratories whose heaps of 100 grains our own simulator makes, of other laws of contact.

Conditions, repeats, observables, calibrated numbers and candidates are the same for all of them. A laboratory
has its own seeds, time step, packing and friction, JKR, EDEM's limit of friction, a constant rolling torque
and stiffer grains.
"""

import random
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from math import pi
from pathlib import Path
from typing import Any

import typer

from taichi_erosion.core.setup import Numerics
from taichi_erosion.execution.checks import compatibility_key, read_scene
from taichi_erosion.execution.ensemble import ReplicaRequest, run_replicas

SCENE = Path(__file__).parent / "apparatus" / "column.toml"
STUDY = SCENE.with_name("study.toml")
ENSEMBLE = 200  # replicas that run beside each other
MOST = {"size_distribution": 1.0, "grain_density": 1.5, "image_charge": 2.0, "restitution_speed": 2.0}
OUTSIDE = ("sliding friction that grows with angularity", "restitution that falls with moisture")
SINGLES = ("liquid_bridge", "dry_adhesion", "rolling_resistance", "size_distribution", "image_charge")
DIAMETERS = (1.5e-3, 3e-3)  # m
CONDITIONS = ((0.0, 0.0), (0.01, 0.0), (0.0, 0.5), (0.0, 1.0))  # moisture, angularity
OBSERVABLES = ("centroid_height", "pile_height", "column_height", "radius_90")
REPEATS = 3
SLIDING, ROLLING = "contact.grain-grain.friction_sliding", "contact.grain-grain.friction_rolling"
RESTITUTION = "contact.grain-grain.restitution"
USUAL = {SLIDING: 0.52, ROLLING: 0.15, RESTITUTION: 0.5}  # of the scene
LAWS = ("laws.normal=jkr", "laws.friction_cap=edem", "laws.rolling=constant_torque")
PULLS = (0.01, 0.05)  # of JKR at the smaller diameter over the weight, log-uniform: far below one weight [1]
STIFFER = (1.5, 3.0)  # Young's modulus over that of the scene, log-uniform [1]
PITCHES = (1.2, 1.4)  # of the filling, over the diameter [1]
MODULUS, STEP_D = 5e5, 3e-2  # of the scene [Pa, s m-1]
FINER = 0.8  # time step over the one that the stiffness asks for [1]
DENSITY, GRAVITY = 2500.0, 9.81  # kg m-3, m s-2
HEAD = "observable,value,n,unit,group,moisture,angularity,diameter,source"

Case = dict[str, Any]  # number, effects by strength, `outside` (what no candidate describes), and its numbers


@dataclass(frozen=True)
class Laboratory:
    """How the cases of a set are drawn and measured."""

    draw: Callable[[random.Random], list[Case]]
    measure: Callable[[Path, Sequence[Case], int], None]  # tables and studies into a folder, from a seed


def drawn(
    generator: random.Random,
    hidden: Iterable[tuple[tuple[str, ...], str]],
    case: Callable[[random.Random, tuple[str, ...]], Case],
) -> list[Case]:
    """The truth of every case, in an order that tells nothing: `hidden` are effects and what is unlisted."""
    mixed = list(hidden)
    generator.shuffle(mixed)
    return [
        {"number": number, "outside": outside, **case(generator, names)}
        for number, (names, outside) in enumerate(mixed)
    ]


def between(generator: random.Random, low: float, high: float) -> float:
    """A number that is log-uniform between two."""
    return low * (high / low) ** generator.random()


def other_laws_case(generator: random.Random, names: tuple[str, ...]) -> Case:
    """Strengths between 0.5 and 2, and contacts of other laws.

    The time step is that of the scene over the root of the stiffness, and finer.
    """
    effects = {name: min(between(generator, 0.5, 2.0), MOST.get(name, 2.0)) for name in names}
    energy = surface_energy(between(generator, *PULLS), DIAMETERS[0])
    modulus, pitch = MODULUS * between(generator, *STIFFER), generator.uniform(*PITCHES)
    settings = (
        *LAWS,
        f"contact.grain-grain.surface_energy={energy!r}",
        *(f"materials.{name}.young_modulus={modulus!r}" for name in ("grain", "plate", "tube")),
        f"fill.pitch_d={pitch!r}",
        f"run.time_step_d={FINER * STEP_D * (MODULUS / modulus) ** 0.5!r}",
    )
    scatters = {SLIDING: 0.08, ROLLING: 0.3}  # of the logarithms of both frictions of a laboratory
    numbers = {name: USUAL[name] * generator.lognormvariate(0.0, width) for name, width in scatters.items()}
    return {"effects": effects, "numbers": numbers, "settings": settings}


def surface_energy(pull: float, diameter: float) -> float:
    """Surface energy [J m-2] whose pull-off force is `pull` times the weight of a grain.

    F = 3 pi gamma R*, with R* = d / 4 of two equal grains; docs/physics.md.
    """
    weight = DENSITY * pi / 6.0 * diameter**3 * GRAVITY
    return pull * weight / (3.0 * pi * diameter / 4.0)


def draw_other_laws(generator: random.Random) -> list[Case]:
    """Three cases of nothing, five of one effect, two of two, two of what no candidate describes."""
    hidden = [((), "")] * 3 + [((name,), "") for name in SINGLES]
    hidden += [(("liquid_bridge", "rolling_resistance"), ""), (("dry_adhesion", "size_distribution"), "")]
    return drawn(generator, hidden + [((), outside) for outside in OUTSIDE], other_laws_case)


def orders(case: Case, diameter: float, moisture: float, angularity: float) -> tuple[str, ...]:
    """Settings of one laboratory run."""
    numbers = dict(case["numbers"])
    if case["outside"] == OUTSIDE[0]:
        numbers[SLIDING] *= 1.0 + 0.8 * angularity
    if case["outside"] == OUTSIDE[1]:
        numbers[RESTITUTION] = USUAL[RESTITUTION] / (1.0 + 150.0 * moisture)
    words = {"grains.size.diameter": diameter, "conditions.moisture": moisture, **numbers}
    words |= {"conditions.angularity": angularity}
    words |= {f"effects.{name}.strength": value for name, value in case["effects"].items()}
    return (*case["settings"], *(f"{path}={value!r}" for path, value in words.items()))


def measure(folder: Path, cases: Sequence[Case], seed: int) -> None:
    """Studies and tables of all cases, simulated together."""
    (folder / SCENE.name).write_text(SCENE.read_text("utf-8"), encoding="utf-8")
    sets = [(d, w, a) for d in DIAMETERS for w, a in CONDITIONS for _ in range(REPEATS)]
    runs = [(case, *each) for case in cases for each in sets]
    tables: dict[int, list[str]] = {case["number"]: [] for case in cases}
    for (case, d, w, a), values in zip(runs, simulated(runs, seed), strict=True):
        tables[case["number"]] += [
            line_of(name, values[name], (d, w, a), "made")
            for name in OBSERVABLES
            if values.get(name) is not None
        ]
    for number, lines in tables.items():
        write_study(folder, number, lines)


def line_of(name: str, value: float, at: tuple[float, float, float], source: str) -> str:
    """One reading at a diameter, a moisture and an angularity."""
    d, w, a = at
    return f"{name},{value:.6g},1,m,w{w:g} a{a:g} d{d:g},{w:g},{a:g},{d:g},{source}"


def write_study(folder: Path, number: int, lines: Sequence[str]) -> None:
    """Table and study of one case."""
    table = folder / f"case_{number:05d}.csv"
    table.write_text("\n".join([HEAD, *lines]) + "\n", encoding="utf-8")
    table.with_suffix(".toml").write_text(study_text(number), encoding="utf-8")


def study_text(number: int) -> str:
    """The study of one case."""
    return STUDY.read_text("utf-8").replace("case_0", f"case_{number:05d}")


def simulated(runs: list[tuple[Case, float, float, float]], seed: int) -> list[dict[str, float]]:
    """Values of every laboratory run; a run that stopped has none."""
    generator = random.Random(seed)
    found: dict[int, dict[str, float]] = {k: {} for k in range(len(runs))}
    groups: dict[str, list[tuple[int, ReplicaRequest]]] = {}
    for k, (case, *at) in enumerate(runs):
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
    return [found[k] for k in range(len(runs))]


OTHER_LAWS = Laboratory(draw_other_laws, measure)
