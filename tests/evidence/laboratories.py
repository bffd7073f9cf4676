"""A heap small enough for a test, and laboratories in whose world an effect acts.

A laboratory has its own seeds, and some have their own time step, packing and friction. Of grains that stick
when wet, two studies list no effect of water. A laboratory is run as a program of its own:

    python -m tests.evidence.laboratories FOLDER NAME...
"""

import json
import random
import sys
from dataclasses import dataclass, replace
from hashlib import sha256
from pathlib import Path

from taichi_erosion.core.setup import Numerics
from taichi_erosion.execution.checks import read_scene
from taichi_erosion.execution.ensemble import ReplicaRequest, run_replicas

ROOT = Path(__file__).parents[2]
REPEATS = 2
HIDDEN = "liquid_bridge"
SHIPPED, SCENE = ROOT / "doe" / "foreign_lab" / "column.toml", "column.toml"
SMALLER = {  # 100 grains ten times as soft: a run takes half a second
    "count = 1800": "count = 100",
    "radius_d = 9.0": "radius_d = 3.5",
    "radius_d = 8.4": "radius_d = 3.0",
    "young_modulus = 5e6": "young_modulus = 5e5",
    "time_step_d = 1e-2": "time_step_d = 3e-2",
}


@dataclass(frozen=True)
class Laboratory:
    """A study of moist heaps, and the world in which its table is measured."""

    observables: tuple[str, ...]
    moistures: tuple[float, ...]  # kg kg-1
    strengths: tuple[float, ...]  # range of that of liquid bridges; empty: 0, without a draw
    orders: tuple[str, ...]
    study: str  # numbers and candidates

    def text(self, name: str) -> str:
        observables = "".join(
            f'[observables.{each}]\nscene = "{SCENE}"\ntransform = "log"\n' for each in self.observables
        )
        head = f'[study]\nmeasurements = "{name}.csv"\nruns = "runs"\n{observables}[conditions]\n'
        return f'{head}moisture = "conditions.moisture"\n{self.study}[vault]\nfraction = 0.3\n'

    def rows(self, folder: Path, strength: float, drawn: random.Random) -> list[str]:
        """Rows of the table, every run with a seed that is drawn."""
        moistures = [w for w in self.moistures for _ in range(REPEATS)]
        acting = (f"effects.{HIDDEN}.strength={strength}", *self.orders)
        scenes = [read_scene(folder / SCENE, (f"conditions.moisture={w}", *acting)) for w in moistures]
        parts = [ReplicaRequest(scene, drawn.randrange(2**30, 2**31)) for scene in scenes]
        records: dict[int, dict] = {}
        run_replicas(parts, Numerics("cpu", 1, "f32"), records.__setitem__)
        lines = []
        for place, w in enumerate(moistures):
            assert records[place]["failure"] is None
            values = {name: records[place]["measures"][name]["value"] for name in self.observables}
            lines += [f"{name},{value:.6g},1,m,w{w:g},{w:g},made" for name, value in values.items()]
        return lines


HEAP = Laboratory(
    ("centroid_height", "pile_height"),
    (0.0, 0.002, 0.005, 0.01, 0.02),
    (0.8, 1.5),
    ("run.time_step_d=2.4e-2", "fill.pitch_d=1.25", "contact.grain-grain.friction_rolling=0.2"),
    """[parameters]
"contact.grain-grain.friction_rolling" = { start = 0.15, low = 0.02, high = 0.6 }
[candidates]
effects = ["liquid_bridge", "dry_adhesion", "restitution_speed"]
[budget]
runs = 25
""",
)
WET = replace(
    HEAP,
    observables=("centroid_height", "pile_height", "radius_90"),
    moistures=(0.0, 0.002, 0.005, 0.01, 0.015, 0.02),
    strengths=(1.2, 1.6),
    orders=("effects.liquid_bridge.exponent=0.7",),
    study="""[parameters]
"contact.grain-grain.friction_rolling" = { start = 0.12, low = 0.02, high = 0.6, prior_sd_log = 0.3 }
[candidates]
effects = ["restitution_speed"]
mechanisms = ["contact_pull", "rolling_friction"]
""",
)
LABORATORIES = {
    "heap_moist": HEAP,
    "heap_plain": replace(HEAP, strengths=(0.0, 0.0)),  # a draw, as of what acts
    "wet": WET,
    "plain": replace(WET, strengths=()),
}
SEEDS = {("heap_moist", "heap_plain"): 7, ("wet", "plain"): 3}  # of laboratories that one process makes


def make(folder: Path, names: tuple[str, ...]) -> None:
    """Scene, studies and tables; the digest of the truth is written before all measurements."""
    made, drawn = {name: LABORATORIES[name] for name in names}, random.Random(SEEDS[names])
    truth = {name: drawn.uniform(*lab.strengths) if lab.strengths else 0.0 for name, lab in made.items()}
    sealed = json.dumps({"strengths": truth, "salt": drawn.random()})
    (folder / "truth.sha256").write_text(sha256(sealed.encode()).hexdigest())
    text = SHIPPED.read_text("utf-8")
    for old, new in SMALLER.items():
        assert old in text, f"{SHIPPED.name} does not say {old}"
        text = text.replace(old, new)
    (folder / SCENE).write_text(text, encoding="utf-8")
    for name, lab in made.items():
        rows = ["observable,value,n,unit,group,moisture,source", *lab.rows(folder, truth[name], drawn)]
        (folder / f"{name}.csv").write_text("\n".join(rows) + "\n", encoding="utf-8")
        (folder / f"{name}.toml").write_text(lab.text(name), encoding="utf-8")
    (folder / "sealed").mkdir()
    (folder / "sealed" / "truth.json").write_text(sealed)


if __name__ == "__main__":
    make(Path(sys.argv[1]), tuple(sys.argv[2:]))
