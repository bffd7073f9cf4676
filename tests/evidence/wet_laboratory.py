"""A laboratory whose grains stick when wet, and one in which nothing acts, for a list without such an effect.

Water between its grains makes necks whose pull grows with moisture, over gaps too. The study lists no effect
of water and has a scene of its own without any; seeds differ. It is run as a program of its own:

    python -m tests.evidence.wet_laboratory FOLDER SEED
"""

import json
import random
import sys
from hashlib import sha256
from pathlib import Path

from tests.evidence.small_scenes import measured, write_scenes

OBSERVABLES = ("centroid_height", "pile_height", "radius_90")
MOISTURES = (0.0, 0.002, 0.005, 0.01, 0.015, 0.02)  # kg kg-1
REPEATS = 2
EXPONENT = 0.7  # of moisture, in the pull of a neck
SCENE = "column.toml"

STUDY = """
[study]
measurements = "{name}.csv"
runs = "runs"
[observables.centroid_height]
scene = "column.toml"
transform = "log"
[observables.pile_height]
scene = "column.toml"
transform = "log"
[observables.radius_90]
scene = "column.toml"
transform = "log"
[conditions]
moisture = "conditions.moisture"
[parameters."contact.grain-grain.friction_rolling"]
start = 0.12
low = 0.02
high = 0.6
prior_sd_log = 0.3
[candidates]
effects = ["restitution_speed"]
mechanisms = ["contact_pull", "rolling_friction"]
[vault]
fraction = 0.3
"""
NAMES = ("wet", "plain")


def make(folder: Path, seed: int) -> None:
    """Scene, studies and tables; the digest of the truth is written before anything is measured."""
    drawn = random.Random(seed)
    truth = {"wet": drawn.uniform(1.2, 1.6), "plain": 0.0}
    sealed = json.dumps({"strengths": truth, "salt": drawn.random()})
    (folder / "truth.sha256").write_text(sha256(sealed.encode()).hexdigest())
    write_scenes(folder)
    cases = [(name, w) for name in NAMES for w in MOISTURES for _ in range(REPEATS)]
    asked = []
    for name, w in cases:
        water = (f"conditions.moisture={w}", f"effects.liquid_bridge.strength={truth[name]}")
        orders = (*water, f"effects.liquid_bridge.exponent={EXPONENT}")
        asked.append((orders, drawn.randrange(2**30, 2**31)))
    tables: dict[str, list[str]] = {name: [] for name in NAMES}
    for (name, w), values in zip(cases, measured(folder / SCENE, "f32", asked), strict=True):
        tables[name] += [f"{o},{values[o]:.6g},1,m,w{w:g},{w:g},made" for o in OBSERVABLES]
    for name in NAMES:
        text = "\n".join(["observable,value,n,unit,group,moisture,source", *tables[name]])
        (folder / f"{name}.csv").write_text(text + "\n", encoding="utf-8")
        (folder / f"{name}.toml").write_text(STUDY.format(name=name), encoding="utf-8")
    (folder / "sealed").mkdir()
    (folder / "sealed" / "truth.json").write_text(sealed)


if __name__ == "__main__":
    make(Path(sys.argv[1]), int(sys.argv[2]))
