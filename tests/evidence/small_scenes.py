"""Two scenes small enough for a test, and laboratories in whose world an effect acts.

A laboratory has its own seeds, time step, packing and friction; it is run as a program of its own:

    python -m tests.evidence.small_scenes FOLDER SEED NAME...
"""

import json
import random
import sys
from hashlib import sha256
from pathlib import Path
from typing import Literal

from taichi_erosion.core.setup import Numerics
from taichi_erosion.run.checks import read_scene
from taichi_erosion.run.ensemble import ReplicaRequest, run_replicas

ROOT = Path(__file__).parents[2]
# 100 grains ten times as soft: a run takes half a second
COLUMN = {
    "count = 1800": "count = 100",
    "radius_d = 9.0": "radius_d = 3.5",
    "radius_d = 8.4": "radius_d = 3.0",
    "young_modulus = 5e6": "young_modulus = 5e5",
    "time_step_d = 1e-2": "time_step_d = 3e-2",
}
FALL = {"duration_max = 3.0": "duration_max = 0.8", "check_interval = 0.05": "check_interval = 0.1"}
MOISTURES = (0.0, 0.002, 0.005, 0.01, 0.02)  # kg kg-1
ALTITUDES = (0.0, 500.0, 1000.0, 2000.0, 3000.0, 4000.0)  # m
REPEATS = 2
LABORATORY = ("run.time_step_d=2.4e-2", "fill.pitch_d=1.25", "contact.grain-grain.friction_rolling=0.2")
TUNNEL = ("run.time_step=7e-5", "materials.quartz.density=2680")
HeapCase = tuple[str, float, tuple[str, ...], int]
READING = 0.01  # relative scatter of a velocity that is read

HEAP = """
[study]
measurements = "{name}.csv"
runs = "runs"
[observables.centroid_height]
scene = "column.toml"
transform = "log"
[observables.pile_height]
scene = "column.toml"
transform = "log"
[conditions]
moisture = "conditions.moisture"
[parameters."contact.grain-grain.friction_rolling"]
start = 0.15
low = 0.02
high = 0.6
[candidates]
effects = ["liquid_bridge", "dry_adhesion", "restitution_speed"]
[vault]
fraction = 0.3
[budget]
runs = 25
"""
GRAIN = """
[study]
measurements = "{name}.csv"
runs = "runs"
[observables.settling_velocity]
scene = "fall.toml"
transform = "log"
[conditions]
altitude = "conditions.altitude"
[parameters."materials.quartz.density"]
start = 2650.0
low = 2400.0
high = 2900.0
prior_sd_log = 0.02
[candidates]
effects = ["air_density", "grain_density", "bed_slope"]
[vault]
fraction = 0.3
[budget]
runs = 30
"""
STUDIES = {"heap_moist": HEAP, "heap_plain": HEAP, "grain_high": GRAIN}
HEAPS = ("heap_moist", "heap_plain")
HIDDEN = {"heap_moist": "liquid_bridge", "heap_plain": None, "grain_high": "air_density"}


def write_scenes(folder: Path) -> None:
    """Both scenes, cut down from shipped ones."""
    column = replaced(ROOT / "doe" / "foreign_lab" / "column.toml", COLUMN)
    (folder / "column.toml").write_text(column, encoding="utf-8")
    fall = replaced(ROOT / "scenes" / "terminal_velocity.toml", FALL)
    (folder / "fall.toml").write_text(fall, encoding="utf-8")


def replaced(scene: Path, changes: dict[str, str]) -> str:
    text = scene.read_text("utf-8")
    for old, new in changes.items():
        assert old in text, f"{scene.name} does not say {old}"
        text = text.replace(old, new)
    return text


def measured(
    scene: Path, precision: Literal["f32", "f64"], asked: list[tuple[tuple[str, ...], int]]
) -> list[dict[str, float]]:
    """Values of every run that is asked for, with its orders and seed."""
    found: dict[int, dict[str, float]] = {}

    def tell(place: int, record: dict) -> None:
        assert record["failure"] is None
        found[place] = {name: measure["value"] for name, measure in record["measures"].items()}

    parts = [ReplicaRequest(read_scene(scene, orders), seed) for orders, seed in asked]
    run_replicas(parts, Numerics("cpu", 1, precision), tell)
    return [found[place] for place in range(len(parts))]


def heap_cases(strengths: dict[str, float], drawn: random.Random) -> list[HeapCase]:
    """Study, moisture, orders and seed of every heap."""
    cases = []
    for name, w in ((name, w) for name in strengths for w in MOISTURES for _ in range(REPEATS)):
        wet = (f"conditions.moisture={w}", f"effects.liquid_bridge.strength={strengths[name]}")
        cases.append((name, w, (*LABORATORY, *wet), drawn.randrange(2**30, 2**31)))
    return cases


def heaps(folder: Path, cases: list[HeapCase]) -> dict[str, list[str]]:
    """Tables of the two heap studies, out of one ensemble."""
    asked = [(orders, seed) for _, _, orders, seed in cases]
    tables: dict[str, list[str]] = {name: [] for name, *_ in cases}
    for (name, w, *_), values in zip(cases, measured(folder / "column.toml", "f32", asked), strict=True):
        for observable in ("centroid_height", "pile_height"):
            tables[name].append(f"{observable},{values[observable]:.6g},1,m,w{w:g},{w:g},made")
    return tables


def falls(folder: Path, strength: float, drawn: random.Random) -> list[str]:
    """Table of settling velocities, read with some scatter."""
    acting = f"effects.air_density.strength={strength}"
    asked = [((*TUNNEL, f"conditions.altitude={h}", acting), 1) for h in ALTITUDES]
    values = measured(folder / "fall.toml", "f64", asked)
    lines = []
    for h, found in zip(ALTITUDES, values, strict=True):
        for _ in range(REPEATS):
            read = found["settling_velocity"] * drawn.gauss(1.0, READING)
            lines.append(f"settling_velocity,{read:.6g},1,m/s,h{h:g},{h:g},made")
    return lines


def make(folder: Path, seed: int, names: tuple[str, ...]) -> None:
    """Scenes, some studies and their tables; the digest of the truth is written before all measurements."""
    drawn = random.Random(seed)
    truth = {name: drawn.uniform(0.8, 1.5) if effect else 0.0 for name, effect in HIDDEN.items()}
    sealed = json.dumps({"strengths": truth, "salt": drawn.random()})
    (folder / "truth.sha256").write_text(sha256(sealed.encode()).hexdigest())
    write_scenes(folder)
    cases = heap_cases({name: truth[name] for name in HEAPS}, drawn)  # those of the falls come after them
    tables = heaps(folder, cases) if {*HEAPS} & {*names} else {}
    if "grain_high" in names:
        tables["grain_high"] = falls(folder, truth["grain_high"], drawn)
    for name in names:
        axis = "altitude" if name == "grain_high" else "moisture"
        head = f"observable,value,n,unit,group,{axis},source"
        (folder / f"{name}.csv").write_text("\n".join([head, *tables[name]]) + "\n", encoding="utf-8")
        (folder / f"{name}.toml").write_text(STUDIES[name].format(name=name), encoding="utf-8")
    (folder / "sealed").mkdir()
    (folder / "sealed" / "truth.json").write_text(sealed)


if __name__ == "__main__":
    make(Path(sys.argv[1]), int(sys.argv[2]), tuple(sys.argv[3:]))
