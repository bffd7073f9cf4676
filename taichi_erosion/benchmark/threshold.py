"""Core-seconds of one fluid threshold: one bed of the published soil's fine fraction, from its filling on.

The bed is that of `scenes/wind_threshold.toml`. Processor time is booked on what the bed was doing: `compile`
until the first check, `settle`, `ramp` and `hold` as in `run.hunt`. An interval takes five beds, which are
compiled for once.
"""

import time
from dataclasses import dataclass, field
from typing import Any

from taichi_erosion.core.setup import Numerics
from taichi_erosion.run.play import Play, play
from taichi_erosion.run.stages import Actor
from taichi_erosion.scene import Scene, build_setup, laws, parse_scene
from taichi_erosion.simulation import assemble

SEED = 1
BEDS = 5  # of an interval
COMPILE = "compile"
BED: dict[str, Any] = {
    "scene": {"kind": "threshold"},
    "run": {"time_step_fraction": 0.25, "check_interval": 5e-3, "overlap_limit": 0.9},
    "grains": {
        "count": 900,
        "material": "soil",
        "size": {"law": "sieve", "table": "hao2022", "low": 0.15e-3, "high": 0.5e-3},
    },
    "materials": {
        "soil": {
            "density": 2650.0,
            "shear_modulus": 6e4,
            "poisson_ratio": 0.25,
            "softening": {"rule": "bond_number", "true_modulus": 1e7},
        }
    },
    "laws": {"rolling": "elastic_plastic"},
    "contact": {"soil-soil": {"restitution": 0.6, "friction_sliding": 0.61, "friction_rolling": 0.1}},
    "geometry": {"ground": {"shape": "plane", "material": "soil"}},
    "wind": {"length_d": 14.0, "width_d": 14.0, "height": 0.04, "cell_d": 0.25, "look_steps": 20},
    "fill": {"law": "layers", "pitch_d": 2.2, "jitter_d": 0.03, "first_height_d": 1.0},
    "threshold": {"first": 0.24, "rise": 0.06},
    "stages": [
        {
            "name": "settle",
            "duration_min": 0.02,
            "duration_max": 0.4,
            "rest_energy": 1e-5,
            "rest_contact_share": 0.5,
        },
        {"name": "hunt", "until": "threshold", "duration_max": 20.0},
    ],
    "measure": {"fluid_threshold": {}},
}


@dataclass
class Ledger:
    """Processor time by what the bed was doing."""

    doing: str = COMPILE
    since: float = field(default_factory=time.process_time)  # s
    spent: dict[str, float] = field(default_factory=dict)  # s

    def watch(self, stage_play: Play) -> None:
        """Book the time since the last check; the checks say what comes next."""
        now, actor = time.process_time(), stage_play.actors[0]
        self.spent[self.doing] = self.spent.get(self.doing, 0.0) + now - self.since
        self.since = now
        self.doing = actor.hunt.phase if actor.hunt is not None else "settle"


def threshold_case() -> dict[str, Any]:
    """Core-seconds of one bed on one thread, split by what it was doing."""
    scene: Scene = parse_scene(BED)
    ledger, actor = Ledger(), Actor(SEED)
    sim = assemble([build_setup(scene, SEED)], laws(scene), Numerics("cpu", 1, "f32"))
    whole = Play([scene], sim, [actor])
    play(whole, [ledger.watch])
    total = sum(ledger.spent.values())
    found = actor.measurements["fluid_threshold"]
    return {
        "case": "fluid threshold of one bed",
        "grains": scene.grains.count,
        "threads": 1,
        "precision": "f32",
        "M grain-steps/s": 1e-6 * whole.grain_steps / (total - ledger.spent[COMPILE]),
        "core-seconds": total,
        f"core-seconds of {BEDS} beds": total + (BEDS - 1) * (total - ledger.spent[COMPILE]),
        "threshold u* [m/s]": found.value,
        "stages": {name: seconds / total for name, seconds in ledger.spent.items()},
    }
