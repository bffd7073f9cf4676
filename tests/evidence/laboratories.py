"""Two scenes small enough for a test, and laboratories in whose world an effect acts.

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
from typing import Literal

from taichi_erosion.core.setup import Numerics
from taichi_erosion.run.checks import read_scene
from taichi_erosion.run.ensemble import ReplicaRequest, run_replicas

ROOT = Path(__file__).parents[2]
REPEATS = 2
GROUP = {"moisture": "w", "altitude": "h"}  # of rows, before the level
# file of a small scene -> shipped scene, and what is changed in it
SCENES: dict[str, tuple[str, dict[str, str]]] = {
    "column.toml": (  # 100 grains ten times as soft: a run takes half a second
        "doe/foreign_lab/column.toml",
        {
            "count = 1800": "count = 100",
            "radius_d = 9.0": "radius_d = 3.5",
            "radius_d = 8.4": "radius_d = 3.0",
            "young_modulus = 5e6": "young_modulus = 5e5",
            "time_step_d = 1e-2": "time_step_d = 3e-2",
        },
    ),
    "fall.toml": (
        "scenes/terminal_velocity.toml",
        {"duration_max = 3.0": "duration_max = 0.8", "check_interval = 0.05": "check_interval = 0.1"},
    ),
}


@dataclass(frozen=True)
class Laboratory:
    """A study, and the world in which its table is measured."""

    scene: str
    observables: tuple[str, ...]
    unit: str
    axis: str
    levels: tuple[float, ...]
    hidden: str  # effect that acts
    strengths: tuple[float, ...]  # range of its strength; empty: it does not act
    orders: tuple[str, ...]
    study: str  # numbers and candidates
    precision: Literal["f32", "f64"] = "f32"
    reading: float = 0.0  # relative scatter of a value that is read

    def text(self, name: str) -> str:
        """The study file."""
        observables = "".join(
            f'[observables.{each}]\nscene = "{self.scene}"\ntransform = "log"\n' for each in self.observables
        )
        head = f'[study]\nmeasurements = "{name}.csv"\nruns = "runs"\n{observables}[conditions]\n'
        return f'{head}{self.axis} = "conditions.{self.axis}"\n{self.study}[vault]\nfraction = 0.3\n'

    @property
    def settings(self) -> list[float]:
        """Level of the axis of every run."""
        return [level for level in self.levels for _ in range(REPEATS)]

    def seeds(self, drawn: random.Random) -> list[int]:
        """Seed of every run; where a value is read with scatter, all runs have one."""
        return [1 if self.reading else drawn.randrange(2**30, 2**31) for _ in self.settings]

    def rows(self, folder: Path, strength: float, seeds: list[int], drawn: random.Random) -> list[str]:
        """Rows of the table."""
        acting = (f"effects.{self.hidden}.strength={strength}", *self.orders)
        orders = [(f"conditions.{self.axis}={level}", *acting) for level in self.settings]
        scenes = [read_scene(folder / self.scene, each) for each in orders]
        records: dict[int, dict] = {}
        parts = [ReplicaRequest(*each) for each in zip(scenes, seeds, strict=True)]
        run_replicas(parts, Numerics("cpu", 1, self.precision), records.__setitem__)
        lines = []
        for place, level in enumerate(self.settings):
            assert records[place]["failure"] is None
            for name in self.observables:
                value = records[place]["measures"][name]["value"]
                value *= drawn.gauss(1.0, self.reading) if self.reading else 1.0
                lines.append(f"{name},{value:.6g},1,{self.unit},{GROUP[self.axis]}{level:g},{level:g},made")
        return lines


HEAP = Laboratory(
    "column.toml",
    ("centroid_height", "pile_height"),
    "m",
    "moisture",
    (0.0, 0.002, 0.005, 0.01, 0.02),
    "liquid_bridge",
    (0.8, 1.5),
    ("run.time_step_d=2.4e-2", "fill.pitch_d=1.25", "contact.grain-grain.friction_rolling=0.2"),
    """[parameters."contact.grain-grain.friction_rolling"]
start = 0.15
low = 0.02
high = 0.6
[candidates]
effects = ["liquid_bridge", "dry_adhesion", "restitution_speed"]
[budget]
runs = 25
""",
)
GRAIN = Laboratory(
    "fall.toml",
    ("settling_velocity",),
    "m/s",
    "altitude",
    (0.0, 500.0, 1000.0, 2000.0, 3000.0, 4000.0),
    "air_density",
    (0.8, 1.5),
    ("run.time_step=7e-5", "materials.quartz.density=2680"),
    """[parameters."materials.quartz.density"]
start = 2650.0
low = 2400.0
high = 2900.0
prior_sd_log = 0.02
[candidates]
effects = ["air_density", "grain_density", "bed_slope"]
[budget]
runs = 30
""",
    "f64",
    0.01,
)
WET = replace(
    HEAP,
    observables=("centroid_height", "pile_height", "radius_90"),
    levels=(0.0, 0.002, 0.005, 0.01, 0.015, 0.02),
    strengths=(1.2, 1.6),
    orders=("effects.liquid_bridge.exponent=0.7",),
    study="""[parameters."contact.grain-grain.friction_rolling"]
start = 0.12
low = 0.02
high = 0.6
prior_sd_log = 0.3
[candidates]
effects = ["restitution_speed"]
mechanisms = ["contact_pull", "rolling_friction"]
""",
)
LABORATORIES = {
    "heap_moist": HEAP,
    "heap_plain": replace(HEAP, strengths=()),
    "grain_high": GRAIN,
    "wet": WET,
    "plain": replace(WET, strengths=()),
}
# seed -> laboratories whose truth is drawn with it
DRAWN = {7: ("heap_moist", "heap_plain", "grain_high"), 3: ("wet", "plain")}


def make(folder: Path, names: tuple[str, ...]) -> None:
    """Scenes, studies and tables; the digest of the truth is written before all measurements."""
    seed, together = next(each for each in DRAWN.items() if {*names} <= {*each[1]})
    made, drawn = {name: LABORATORIES[name] for name in together}, random.Random(seed)
    truth = {name: drawn.uniform(*lab.strengths) if lab.strengths else 0.0 for name, lab in made.items()}
    sealed = json.dumps({"strengths": truth, "salt": drawn.random()})
    (folder / "truth.sha256").write_text(sha256(sealed.encode()).hexdigest())
    seeds = {name: lab.seeds(drawn) for name, lab in made.items()}
    for file, (shipped, changes) in SCENES.items():
        text = (ROOT / shipped).read_text("utf-8")
        for old, new in changes.items():
            assert old in text, f"{shipped} does not say {old}"
            text = text.replace(old, new)
        (folder / file).write_text(text, encoding="utf-8")
    for name in names:
        rows = made[name].rows(folder, truth[name], seeds[name], drawn)
        head = f"observable,value,n,unit,group,{made[name].axis},source"
        (folder / f"{name}.csv").write_text("\n".join([head, *rows]) + "\n", encoding="utf-8")
        (folder / f"{name}.toml").write_text(made[name].text(name), encoding="utf-8")
    (folder / "sealed").mkdir()
    (folder / "sealed" / "truth.json").write_text(sealed)


if __name__ == "__main__":
    make(Path(sys.argv[1]), tuple(sys.argv[2:]))
