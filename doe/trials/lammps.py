"""Laboratories of another code: heaps that LAMMPS made with hidden effects, which the commands have to find.

Drawn and made by `doe.trials.run`: the scene of `heaps.py` on a plate that does not stick, with 1000 grains.
Packings, contact law and every effect are written here a second time, in the ways that LAMMPS has.
"""

import random
import subprocess
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from math import exp, log, pi
from pathlib import Path
from typing import Any

import numpy as np
import typer

from doe.trials import heaps
from doe.trials.heaps import DENSITY, GRAVITY, SCENE, Case
from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.setup import Floats
from taichi_erosion.core.snapshot import Snapshot
from taichi_erosion.measures import heap
from taichi_erosion.measures.result import Measurement

DECK, RAIN = SCENE.with_name("column.lmp"), SCENE.with_name("rain.data")
SLIDING_WET, ROLLING_WET = ("sliding", "moisture", -0.5), ("rolling", "moisture", 0.8)
SLIDING_ANGULAR = ("sliding", "angularity", -0.5)
LAWS = {  # what no candidate describes: numbers, conditions, and ln of a factor at the end of these
    "sliding friction that water lowers": (SLIDING_WET,),
    "sliding friction that angularity lowers": (SLIDING_ANGULAR,),
    "rolling friction that water raises": (ROLLING_WET,),
    "rolling friction that grows with the diameter": (("rolling", "diameter", 0.8),),
    "sliding and rolling friction that water lowers": (SLIDING_WET, ("rolling", "moisture", -0.9)),
    "sliding friction that angularity lowers, rolling friction that water raises": (
        SLIDING_ANGULAR,
        ROLLING_WET,
    ),
}
SINGLES = ("rolling_resistance", "liquid_bridge", "dry_adhesion", "size_distribution")
HIDDEN = (  # in grains that are stiffer than the study's, with a friction one sd off its prior
    *[((), "")] * 4,
    *[((name,), "") for name in SINGLES],
    (("liquid_bridge", "rolling_resistance"), ""),
    (("rolling_resistance", "size_distribution"), ""),
    *[((), law) for law in LAWS],
)
WEAKEST, STRONGEST = 0.5, 2.0  # of a hidden effect, log-uniform
MOST = {"size_distribution": 1.0}
WET, REPEATS = 0.015, 3  # kg kg-1, heaps
CONDITIONS = ((0.0, 0.0), (WET, 0.0), (0.0, 0.5), (0.0, 1.0), (0.5 * WET, 0.0))  # moisture, angularity
DIAMETERS = (1.5e-3, 3e-3)  # m
OBSERVABLES = ("column_height", "pile_height", "centroid_height", "radius_90")
OF_PILE = (heap.pile_height, heap.centroid_height, heap.radius_90, heap.angle_of_repose_outline)

OFF = 0.1  # of ln of the sliding friction: one sd of the prior of the study
POISSON, RESTITUTION = 0.25, 0.5  # [1]
SLIDING, ROLLING = 0.52, 0.15  # middle of the laboratories
PITCH_D, FIRST_D = 1.15, 0.7  # over the diameter
MOST_ANGULAR = 0.28  # rolling friction that the most angular grains add at strength 1
NECK = 0.3 * pi * 0.072  # pull of water over d at strength 1 [N m-1]: 0.3 of a smooth neck's
DRY_PULL = 0.03  # pull of dry grains over d at strength 1 [N m-1]
SPREAD = log(1.5) / 1.2816  # standard deviation of ln d at strength 1: d90 / d50 = 1.5
CUT = 1.6  # of the sizes, in standard deviations
DUMP_HEAD = 9  # lines of a dump before the grains

COUNT, YOUNG, STEP_D, DAMPER_DD = 1000, 5e5, 2e-2, 950.0  # -, Pa, time step s m-1, of rolling kg s-1 m-2
TUBE_D, FILL_D, BOX_D = 7.0, 6.4, 60.0  # radii over d of tube and filling, half the width of the box
CHANGES = {  # of the scene and of the study, where levels differ between codes: ../../shared/foreign_lab
    "[contact.grain-plate]\n": "[contact.grain-plate]\neffects = false\n",
    "[contact.grain-tube]\n": "[contact.grain-tube]\neffects = false\n",
    "count = 100": "count = 1000",
    "radius_d = 3.5": "radius_d = 7.0",
    "radius_d = 3.0": "radius_d = 6.4",
    "time_step_d = 3e-2": "time_step_d = 2.7e-2",
    **{
        f"[observables.{name}]": f"[observables.{name}]\nsd_shared_relative = {sd}"
        for name, sd in zip(OBSERVABLES, (0.01, 0.03, 0.05, 0.05), strict=True)
    },
}
SPRING = 0.005  # of rolling, over E d [1]


@dataclass(frozen=True)
class Grains:
    """What the deck is told of the grains at one condition."""

    sliding: float  # [1]
    rolling: float  # [1]
    pull_d: float = 0.0  # of two grains that touch, over d [N m-1]
    spread: float = 0.0  # standard deviation of ln d [1]


def drawn_case(generator: random.Random, names: tuple[str, ...]) -> Case:
    """Strengths, friction one sd off what the study says, and stiffness of one laboratory."""
    effects = {
        name: min(heaps.between(generator, WEAKEST, STRONGEST), MOST.get(name, STRONGEST)) for name in names
    }
    generator.lognormvariate(0.0, 0.08)  # of a friction that sets of another kind had
    rolling = ROLLING * generator.lognormvariate(0.0, 0.3)
    sliding = SLIDING * exp(generator.choice((-OFF, OFF)))
    case: Case = {"effects": effects, "sliding": sliding, "rolling": rolling}
    return case | {
        "stiffness": heaps.between(generator, *heaps.STIFFER),
        "size": heaps.between(generator, 0.8, 1.3),
    }


def sizes(generator: np.random.Generator, count: int, spread: float, diameter: float) -> Floats:
    """Diameters of one packing [m]: lognormal about a mass median, as many as weigh the same."""
    if spread == 0.0:
        return np.full(count, diameter)
    middle = diameter * exp(-3.0 * spread**2)
    drawn = middle * np.exp(spread * np.clip(generator.standard_normal(20 * count), -CUT, CUT))
    enough = np.searchsorted(np.cumsum(drawn**3), count * diameter**3)
    return drawn[: int(enough)]


def rain(generator: np.random.Generator, diameters: Floats, diameter: float) -> str:
    """Data file of the start: square nets, each turned and shifted at random, one above the other."""
    pitch = PITCH_D * float(diameters.max())
    half = int(FILL_D * diameter / pitch) + 2
    net = np.array([(i, j) for i in range(-half, half + 1) for j in range(-half, half + 1)]) * pitch
    places: list[Floats] = []
    height = FIRST_D * float(diameters.max())
    while len(places) < diameters.size:
        angle, shift = generator.uniform(0.0, 2.0 * pi), generator.uniform(-0.5, 0.5, 2) * pitch
        turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        flat = net @ turn + shift
        flat = flat[np.hypot(*flat.T) < TUBE_D * diameter - 0.55 * diameters.max()]
        layer = np.column_stack([flat, np.full(len(flat), height)])
        layer += generator.uniform(-0.05, 0.05, layer.shape) * diameter
        places += list(generator.permutation(layer))
        height += pitch
    wide = BOX_D * diameter
    box = {"low": -wide, "high": wide, "floor": -diameter, "top": height + 5.0 * diameter}
    speeds = generator.standard_normal((diameters.size, 3)) * 0.5 * (GRAVITY * diameter) ** 0.5
    text = RAIN.read_text("utf-8").format(count=diameters.size, **box)
    for number, (size, place) in enumerate(zip(diameters, places, strict=False), 1):
        text += f"{number} 1 {size:.12g} {DENSITY} {place[0]:.12g} {place[1]:.12g} {place[2]:.12g}\n"
    text += "\nVelocities\n\n"
    for number, (x, y, z) in enumerate(speeds, 1):
        text += f"{number} {x:.12g} {y:.12g} {z:.12g} 0 0 0\n"
    return text


def grains_of(case: Case, diameter: float, moisture: float, angularity: float) -> Grains:
    """The grains of one drawn laboratory at one condition."""
    strength, numbers = case["effects"], {key: case[key] for key in ("sliding", "rolling")}
    pull = strength.get("dry_adhesion", 0.0) * DRY_PULL
    pull += strength.get("liquid_bridge", 0.0) * NECK * (moisture > 0.0)
    share = {"diameter": diameter / DIAMETERS[0] - 1.0, "moisture": moisture / WET}
    share["angularity"] = angularity
    for number, condition, ln_factor in LAWS.get(case["outside"], ()):
        numbers[number] *= exp(ln_factor * case["size"] * share[condition])
    numbers["rolling"] += strength.get("rolling_resistance", 0.0) * MOST_ANGULAR * angularity
    return Grains(**numbers, pull_d=pull, spread=strength.get("size_distribution", 0.0) * SPREAD)


def told(stiffer: float, grains: Grains, diameter: float) -> dict[str, Any]:
    """What stands in the deck."""
    young, step_d = stiffer * YOUNG, STEP_D / stiffer**0.5
    bare = f"hertz/material {young} {RESTITUTION} {POISSON}"
    # 4 pi gamma R* with R* = d / 4 is the pull of two equal grains, so that gamma = pull / (pi d)
    sticky = f"dmt {young} {RESTITUTION} {POISSON} {grains.pull_d / pi:.8g}"
    return {
        "normal": sticky if grains.pull_d > 0.0 else bare,
        "bare": bare,
        "sliding": grains.sliding,
        "rolling": grains.rolling,
        "spring": SPRING * young * diameter,
        "damper": DAMPER_DD * diameter**2,
        "skin": 0.25 * diameter,
        "tube": TUBE_D * diameter,
        "step": step_d * diameter,
        "energy": COUNT * DENSITY * pi / 6.0 * diameter**4 * GRAVITY,
        "settle_least": round(50.0 / step_d),
        "settle": round(300.0 / step_d),
        "collapse": round(430.0 / step_d),
    }


def read_dump(file: Path) -> Snapshot:
    """Grains of a dump; only their places and sizes are in it."""
    table = np.loadtxt(file, skiprows=DUMP_HEAD)
    count, radius = len(table), table[:, 4]
    still, none = np.zeros((count, 3)), np.zeros(count, np.int32)
    mass = DENSITY * 4.0 / 3.0 * np.pi * radius**3
    return Snapshot(0.0, 0, table[:, 1:4], still, still, radius, mass, none, none, 0)


def laboratory_run(
    stiffer: float, grains: Grains, diameter: float, generator: np.random.Generator
) -> dict[str, Measurement]:
    """Observables of one heap of grains that are so many times as stiff as those of the scene."""
    start = rain(generator, sizes(generator, COUNT, grains.spread, diameter), diameter)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "rain.data").write_text(start, encoding="utf-8")
        text = DECK.read_text(encoding="utf-8").format(folder=name, **told(stiffer, grains, diameter))
        (folder / "deck").write_text(text, encoding="utf-8")
        words = ["lmp", "-in", str(folder / "deck"), "-log", "none", "-screen", "none"]
        done = subprocess.run(words, capture_output=True, text=True)
        if done.returncode:
            raise BadInput(f"LAMMPS stopped: {done.stderr[-300:]}")
        filled, pile = (read_dump(folder / f"{stage}.dump") for stage in ("column", "pile"))
    found = [heap.settled_column_height(filled), *(measure(pile) for measure in OF_PILE)]
    return {one.name: one for one in found if one.value is not None}


def measure(folder: Path, cases: Sequence[Case], seed: int) -> None:
    """Studies and tables of the drawn cases that are not there."""
    (folder / SCENE.name).write_text(changed(SCENE), encoding="utf-8")
    for case in cases:
        study = folder / f"case_{case['number']:05d}.toml"
        generator, lines = np.random.default_rng([seed, case["number"]]), list[str]()
        for d in DIAMETERS if not study.exists() else ():
            for w, a in CONDITIONS:
                for _ in range(REPEATS):
                    found = laboratory_run(case["stiffness"], grains_of(case, d, w, a), d, generator)
                    lines += [
                        heaps.line_of(name, found[name].value, (d, w, a), "LAMMPS") for name in OBSERVABLES
                    ]
        if lines:
            heaps.write_study(folder, case["number"], lines)
            study.write_text(changed(study), encoding="utf-8")
            typer.echo(f"{case['number'] + 1} of {len(cases)} laboratories")


def changed(file: Path) -> str:
    """A scene or a study of `heaps.py` for these columns."""
    text = file.read_text("utf-8")
    for old, new in CHANGES.items():
        text = text.replace(old, new)
    return text


BEYOND = heaps.Laboratory(lambda generator: heaps.drawn(generator, HIDDEN, drawn_case), measure)
