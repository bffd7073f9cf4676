"""Timed air: a wind tunnel, boxes of wind on growing grids, a patch of sand that blows, a fluid threshold.

Tunnel, patch and threshold are those of `scenes/`, but patch and threshold at `STEP_FRACTION`, and the
threshold under drag alone. It has five beds and its interval, in processor time of one thread, divided among
what it was spent on: `compile`, which loads every kernel before the first step, then `settle`, `ramp` and
`hold` as in `run.threshold_search`. The time between two checks is shared evenly among the beds that ran,
which all did as many steps.
"""

import time
from collections import Counter
from typing import Any

import numpy as np

from taichi_erosion.air.grid import allocate_air
from taichi_erosion.air.step import STAGES, advance_air
from taichi_erosion.core.air_setup import SIDES, AirModel, AirSetup, AirSide, log_profile, stretched_faces
from taichi_erosion.core.device import start_device
from taichi_erosion.core.setup import Numerics
from taichi_erosion.execution.ensemble_loop import EnsembleRun, run_ensemble
from taichi_erosion.execution.stages import ReplicaState
from taichi_erosion.measures.threshold import pool_beds
from taichi_erosion.scene import Scene, laws, load_scene, parse_scene, replica_setup
from taichi_erosion.scene.load import SCENES, load_air_scene, read_toml
from taichi_erosion.scene.preparation.air import build_air
from taichi_erosion.simulation import (
    Simulation,
    advance,
    assemble,
    energy_sums,
    export_bed,
    export_state,
    import_bed,
    import_state,
    snapshot,
    spin_up_wind,
)

BOX_SIDE, FINEST, ROUGHNESS, FRICTION = 0.4, 2e-3, 1e-4, 0.3  # of the box of wind: m, m, m, m s-1
BOX_LAYERS, BOX_COLUMNS = 32, (16, 32, 64)
AIR_UNTIMED, AIR_STEPS = 2, 5  # steps before the clock starts, and timed ones
PATCH_SEED = 1
STEP_FRACTION = 0.25  # of the Rayleigh time, in patch and threshold: that of all earlier speeds [1]
# u* [m s-1] that starts the transport and sustains it, and until when [s]
WINDS = ((0.6, 0.1), (0.4123, 0.2))
SEEDS = (1, 2, 3, 4, 5)  # of the beds of an interval
COMPILE, SETTLE = "compile", "settle"


def box_of_wind(columns: int) -> AirSetup:
    """A square box of wind over a rough floor, under a lid that drives it; cells widen upwards."""
    faces = stretched_faces(0.0, BOX_SIDE, BOX_LAYERS, FINEST)
    ends = {"z_low": AirSide("rough", roughness=ROUGHNESS), "z_high": AirSide("stress")}
    wind = log_profile(0.5 * (faces[1:] + faces[:-1]), FRICTION, ROUGHNESS, 0.4)
    rng = np.random.Generator(np.random.Philox(columns))
    start = rng.normal(0.0, FRICTION, (3, columns, columns, BOX_LAYERS))
    start[0] += wind
    return AirSetup(
        cells=(columns, columns, BOX_LAYERS),
        low=(0.0, 0.0, 0.0),
        high=(BOX_SIDE, BOX_SIDE, BOX_SIDE),
        faces_z=faces,
        sides={name: ends.get(name, AirSide()) for name in SIDES},
        density=1.2,
        viscosity=1.5e-5,
        time_step=BOX_SIDE / columns / float(wind.max()),
        model=AirModel(closure="smagorinsky"),
        friction_velocity=FRICTION,
        start=start,
    )


def standard_air_cases() -> list[tuple[str, AirSetup]]:
    """The working section of a wind tunnel, and boxes of wind."""
    setups = [build_air(load_air_scene(SCENES / "tunnel_section.toml"), 0), *map(box_of_wind, BOX_COLUMNS)]
    kinds = ("tunnel section", *("air" for _ in BOX_COLUMNS))
    return [
        ("{}, {} x {} x {} cells".format(kind, *s.cells), s) for kind, s in zip(kinds, setups, strict=True)
    ]


def air_case(name: str, setup: AirSetup, threads: int) -> dict[str, Any]:
    """Cells advanced by one step a second, and iterations of a pressure solve, on one grid of air."""
    workers = start_device(Numerics("cpu", threads, "f64"))
    air = allocate_air([setup])
    advance_air(air, AIR_UNTIMED)
    start = time.perf_counter()
    iterations = advance_air(air, AIR_STEPS)
    speed = 1e-6 * air.cell_count * AIR_STEPS / (time.perf_counter() - start)
    return {
        "case": name,
        "threads": threads,
        "precision": "f64",
        "M cell-steps/s": speed,
        "per core": speed / min(threads, workers),
        "pressure iterations": iterations / (len(STAGES[setup.model.scheme]) * AIR_STEPS),
    }


def blowing_patch(numerics: Numerics) -> Simulation:
    """A patch of sand when grains hop over it."""
    scene = load_scene(SCENES / "saltation.toml", [f"run.time_step_fraction={STEP_FRACTION}"])
    sim = assemble([replica_setup(scene, PATCH_SEED)], laws(scene), numerics)
    for wind, until in WINDS:
        spin_up_wind(sim, 0, wind)
        advance(sim, [until])
    return sim


def threshold_scene(awake: bool = False) -> Scene:
    """The scene of a threshold, measured by its search alone; `awake`: no grain sleeps."""
    table = read_toml(SCENES / "wind_threshold.toml")
    del table["measured"], table["record"]
    table |= {"measure": {"fluid_threshold": {}}, "effects": {}}  # under drag alone
    table["run"]["time_step_fraction"] = STEP_FRACTION
    table["wind"] |= {"sleep_after": None} if awake else {}
    return parse_scene(table)


def load_kernels(sim: Simulation) -> None:
    """Compile all that a threshold search calls; the simulation stays as it was."""
    state = export_state(sim)
    advance(sim, [setup.time_step for setup in sim.setups])
    import_bed(sim, 0, export_bed(sim, 0))
    spin_up_wind(sim, 0, 0.0)
    snapshot(sim, 0)
    energy_sums(sim)
    import_state(sim, state)


def threshold_case(awake: bool = False) -> dict[str, Any]:
    """Core-seconds of five beds on one thread, split by what they were doing; `awake`: no grain sleeps."""
    spent, since, phases = Counter[str](), time.process_time(), [COMPILE]

    def book(coming: list[str]) -> None:
        nonlocal since, phases
        now = time.process_time()
        for phase in phases:
            spent[phase] += (now - since) / len(phases)  # type: ignore[assignment]
        since, phases = now, coming

    def watch(ensemble: EnsembleRun) -> None:
        running = [state for state in ensemble.states if state.active]
        book([SETTLE if state.search is None else state.search.phase for state in running])

    scene, states = threshold_scene(awake), [ReplicaState(seed) for seed in SEEDS]
    sim = assemble([replica_setup(scene, seed) for seed in SEEDS], laws(scene), Numerics("cpu", 1, "f32"))
    load_kernels(sim)
    book([SETTLE] * len(SEEDS))
    whole = EnsembleRun([scene] * len(SEEDS), sim, states)
    run_ensemble(whole, [watch])
    total = sum(spent.values())
    found = pool_beds([state.measurements["fluid_threshold"] for state in states])
    interval = found.details["interval"]
    return {
        "case": f"fluid threshold of {len(SEEDS)} beds" + (", all grains awake" if awake else ""),
        "grains": scene.grains.count,
        "threads": 1,
        "precision": "f32",
        "M grain-steps/s": 1e-6 * whole.grain_steps / (total - spent[COMPILE]),
        "steps": round(whole.grain_steps / scene.grains.count),
        "core-seconds": total,
        "threshold u* [m/s]": found.value,
        "from": interval["low"],
        "to": interval["high"],
        "stages": {name: seconds / total for name, seconds in spent.items()},
    }
