"""Core-seconds of one fluid threshold with its interval: five beds of the published soil's fine fraction.

The beds are those of `scenes/wind_threshold.toml`. Processor time is booked on what it was spent on:
`compile`, which loads every kernel before the first step, then `settle`, `ramp` and `hold` as in
`run.threshold_search`. What passes between two checks is shared evenly among the beds
that ran, which all did as many steps.
"""

import time
from dataclasses import dataclass, field
from typing import Any

from taichi_erosion.core.setup import Numerics
from taichi_erosion.measures.threshold import pool_beds
from taichi_erosion.run.ensemble_loop import EnsembleRun, run_ensemble
from taichi_erosion.run.stages import ReplicaState
from taichi_erosion.scene import Scene, build_setup, laws, parse_scene
from taichi_erosion.simulation import (
    Simulation,
    advance,
    assemble,
    energies,
    export_bed,
    export_state,
    import_bed,
    import_state,
    snapshot,
    spin_up_wind,
)

SEEDS = (1, 2, 3, 4, 5)  # of the beds of an interval
COMPILE, SETTLE = "compile", "settle"
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
        },
        "ground": {"density": 2650.0, "shear_modulus": 6e4, "poisson_ratio": 0.25},
    },
    "laws": {"rolling": "elastic_plastic"},
    "contact": {
        "soil-soil": {"restitution": 0.6, "friction_sliding": 0.61, "friction_rolling": 0.1},
        "soil-ground": {"restitution": 0.6, "friction_sliding": 1.0, "friction_rolling": 0.3},
    },
    "geometry": {"ground": {"shape": "plane", "material": "ground"}},
    "wind": {
        "length_d": 14.0,
        "width_d": 14.0,
        "height": 0.04,
        "drag": "two_limits",
        "cell_d": 0.25,
        "look_steps": 20,
        "sleep_after": 1e-3,
    },
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
    """Processor time by what it was spent on."""

    doing: list[str] = field(default_factory=lambda: [COMPILE])  # by every bed that runs
    since: float = field(default_factory=time.process_time)  # s
    spent: dict[str, float] = field(default_factory=dict)  # s

    def book(self, coming: list[str]) -> None:
        """Book the time since the last call; says what comes next."""
        now = time.process_time()
        for name in self.doing:
            self.spent[name] = self.spent.get(name, 0.0) + (now - self.since) / len(self.doing)
        self.since, self.doing = now, coming

    def watch(self, ensemble: EnsembleRun) -> None:
        """Book the time since the last check."""
        running = [state for state in ensemble.states if state.active]
        self.book([SETTLE if state.search is None else state.search.phase for state in running])


def load_kernels(sim: Simulation) -> None:
    """Compile all that a threshold search calls; the simulation stays as it was."""
    state = export_state(sim)
    advance(sim, [setup.time_step for setup in sim.setups])
    import_bed(sim, 0, export_bed(sim, 0))
    spin_up_wind(sim, 0, 0.0)
    snapshot(sim, 0)
    energies(sim)
    import_state(sim, state)


def threshold_case(awake: bool = False) -> dict[str, Any]:
    """Core-seconds of five beds on one thread, split by what they were doing; `awake`: no grain sleeps."""
    ledger = Ledger()
    wind = BED["wind"] | ({"sleep_after": None} if awake else {})
    scene: Scene = parse_scene(BED | {"wind": wind})
    states = [ReplicaState(seed) for seed in SEEDS]
    sim = assemble([build_setup(scene, seed) for seed in SEEDS], laws(scene), Numerics("cpu", 1, "f32"))
    load_kernels(sim)
    ledger.book([SETTLE] * len(SEEDS))
    whole = EnsembleRun([scene] * len(SEEDS), sim, states)
    run_ensemble(whole, [ledger.watch])
    total = sum(ledger.spent.values())
    found = pool_beds([state.measurements["fluid_threshold"] for state in states])
    interval = found.details["interval"]
    return {
        "case": f"fluid threshold of {len(SEEDS)} beds" + (", all grains awake" if awake else ""),
        "grains": scene.grains.count,
        "threads": 1,
        "precision": "f32",
        "M grain-steps/s": 1e-6 * whole.grain_steps / (total - ledger.spent[COMPILE]),
        "steps": round(whole.grain_steps / scene.grains.count),
        "core-seconds": total,
        "threshold u* [m/s]": found.value,
        "from": interval["low"],
        "to": interval["high"],
        "stages": {name: seconds / total for name, seconds in ledger.spent.items()},
    }
