"""Speed: grain-steps per second of standard cases, with the time split by stage.

Cases are generated here, so that they need no file: a settled bed and a funnel. `bed_rate` and `funnel_rate`
time prepared cases (NumPy files), which other codes can run as well. Times are wall times of one sitting:
only ratios taken side by side carry over to another machine.
"""

import os
import time
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path
from typing import Any, Literal

import numpy as np

from taichi_erosion import __version__
from taichi_erosion.air.assemble import allocate_air
from taichi_erosion.air.step import advance_air
from taichi_erosion.core.air_setup import SIDES, AirModel, AirSetup, AirSide, log_profile, stretched_faces
from taichi_erosion.core.device import start_device
from taichi_erosion.core.setup import (
    ContactTable,
    Floats,
    GrainTable,
    Laws,
    Numerics,
    PrimitiveKind,
    PrimitiveTable,
    Setup,
    Surface,
)
from taichi_erosion.simulation import Simulation, advance, assemble, ledger
from taichi_erosion.simulation.stage_times import stage_times

Precision = Literal["f32", "f64"]
Report = Callable[[float, str], None]

DAMPING = 0.3  # of rolling, share of the critical value [1]
SKIN = 0.1  # list margin of a resting grain over its radius [1], as the other codes' 0.1 d for a pair
BED_UNTIMED = 200  # steps before the clock starts: compilation, and contacts that engage
LAWS = Laws(rolling="elastic_plastic")
SOIL = {  # of the generated cases, SI units: the soil of the published study, softened
    "diameter": 1e-3,
    "density": 2130.0,
    "young": 1e7,
    "poisson": 0.29,
    "restitution": 0.6,
    "friction": 0.61,
    "friction_wall": 0.34,
    "friction_rolling": 0.1,
    "gravity": 9.81,
    "time_step": 5e-6,
}
BED_SIDE = 12  # grains along each period of the generated bed
BED_LAYERS = 14
PITCH = 1.08  # of the lattice that it settles from, over the diameter [1]
JITTER = 0.03  # of that lattice, over the diameter [1]
SETTLING = 0.05  # s, until the contacts of the bed last
TIMED_STEPS = 1000
ENSEMBLE = 8  # replicas of the bed in the ensemble case
ROUNDS = 3  # the median is reported
AIR = {  # of the box of wind, SI units
    "height": 0.4,
    "lowest": 2e-3,
    "roughness": 1e-4,
    "friction_velocity": 0.3,
    "density": 1.2,
    "viscosity": 1.5e-5,
    "courant": 1.0,
}
AIR_LAYERS, AIR_COLUMNS = 32, (16, 32, 64)
AIR_UNTIMED, AIR_STEPS = 2, 5  # steps before the clock starts, and timed ones
AIR_STAGES = 3  # pressure solves a step


def contact_table(case: Any) -> ContactTable:
    """Contact of grain and grain, grain and rigid wall, wall and wall, from the scalars of a case file."""
    young, poisson, one = float(case["young"]), float(case["poisson"]), np.ones(3)
    frictions = [case["friction"], case["friction_wall"], case["friction_wall"]]
    return ContactTable(
        young_effective=young / (2.0 * (1.0 - poisson**2)) * one,
        shear_effective=young / (4.0 * (2.0 - poisson) * (1.0 + poisson)) * one,
        restitution=float(case["restitution"]) * one,
        friction_sliding=np.array(frictions, dtype=np.float64),
        friction_rolling=float(case["friction_rolling"]) * one,
        rolling_damping=DAMPING * one,
        surface_energy=0.0 * one,
    )


def grain_table(position: Floats, case: Any) -> GrainTable:
    """Equal spheres at rest."""
    count, radius = len(position), 0.5 * float(case["diameter"])
    mass = float(case["density"]) * 4.0 / 3.0 * np.pi * radius**3
    still = np.zeros((count, 3))
    return GrainTable(
        position=np.asarray(position, np.float64),
        velocity=still,
        spin=still,
        radius=np.full(count, radius),
        mass=np.full(count, mass),
        material=np.zeros(count, np.int32),
        release_time=np.zeros(count),
    )


def floor(height: float = 0.0) -> Floats:
    """Row of an upward plane."""
    return np.array([[0.0, 0.0, height, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0]])


def bed_setup(case: Any) -> Setup:
    """Bed on a floor, periodic in x and y."""
    period = np.asarray(case["period"], np.float64)
    return Setup(
        grains=grain_table(case["position"], case),
        materials=("grain", "wall"),
        contacts=contact_table(case),
        primitives=PrimitiveTable(np.zeros(1, np.int32), np.zeros(1, np.int32), floor()),
        surfaces=(Surface("floor", 1),),
        time_step=float(case["time_step"]),
        gravity=(0.0, 0.0, -float(case["gravity"])),
        domain=((0.0, 0.0, -1.0), (float(period[0]), float(period[1]), 1.0)),
        period=(float(period[0]), float(period[1]), 0.0),
        skin=SKIN,
    )


def funnel_setup(case: Any) -> Setup:
    """Grains in a cone above a floor."""
    bottom, height, orifice = (float(case[k]) for k in ("funnel_bottom", "funnel_height", "orifice_radius"))
    cone = np.array([[0.0, 0.0, 0.0, 0.0, 0.0, 1.0, orifice, bottom, orifice + height, bottom + height]])
    kinds = np.array([PrimitiveKind.PLANE, PrimitiveKind.REVOLVED], np.int32)
    return Setup(
        grains=grain_table(case["position"], case),
        materials=("grain", "wall"),
        contacts=contact_table(case),
        primitives=PrimitiveTable(kinds, np.array([0, 1], np.int32), np.concatenate([floor(), cone])),
        surfaces=(Surface("floor", 1), Surface("funnel", 1)),
        time_step=float(case["time_step"]),
        gravity=(0.0, 0.0, -float(case["gravity"])),
        skin=SKIN,
    )


def numerics(threads: int, precision: Precision) -> Numerics:
    """CPU with so many threads."""
    return Numerics("cpu", threads, precision)


def timed(sim: Simulation, steps: int, done: int) -> float:
    """Wall time [s] of `steps` more steps of every replica."""
    start = time.perf_counter()
    advance(sim, [(done + steps) * setup.time_step for setup in sim.setups])
    return time.perf_counter() - start


def warmed(setup: Setup, threads: int, precision: Precision, untimed: int) -> Simulation:
    """A simulation whose kernels are compiled; without untimed steps, one more that stands at its start."""
    sim = assemble([setup], LAWS, numerics(threads, precision))
    advance(sim, [max(untimed, 1) * setup.time_step])
    return sim if untimed else assemble([setup], LAWS, numerics(threads, precision))


def rate(sim: Simulation, steps: int, done: int) -> dict[str, float]:
    """Grain-steps per second, contacts among grains per grain, rebuilds."""
    before = ledger(sim, 0).rebuilds
    seconds = timed(sim, steps, done)
    sums = ledger(sim, 0)
    return {
        "grain_steps_per_s": sim.sizes.replicas * len(sim.setups[0].grains.radius) * steps / seconds,
        "contacts_per_grain": 2.0 * sums.contacts / max(sums.released, 1),
        "rebuilds": sums.rebuilds - before,
    }


def bed_rate(case: Path, steps: int, threads: int, precision: Precision) -> dict[str, float]:
    """Speed on a settled bed from a case file."""
    with np.load(case) as arrays:
        setup = bed_setup(arrays)
    return rate(warmed(setup, threads, precision, BED_UNTIMED), steps, BED_UNTIMED)


def funnel_rate(case: Path, steps: int, threads: int, precision: Precision) -> dict[str, float]:
    """Speed of a funnel that empties, from its first step on."""
    with np.load(case) as arrays:
        setup = funnel_setup(arrays)
    return rate(warmed(setup, threads, precision, 0), steps, 0)


def lattice_bed(seed: int) -> Setup:
    """Jittered lattice over a periodic floor, which settles to a bed."""
    diameter = SOIL["diameter"]
    axes = (np.arange(sites) for sites in (BED_SIDE, BED_SIDE, BED_LAYERS))
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    rng = np.random.Generator(np.random.Philox(seed))
    sites = grid.reshape(-1, 3) * PITCH + 0.6
    position = diameter * (sites + rng.uniform(-JITTER, JITTER, sites.shape))
    return bed_setup(SOIL | {"position": position, "period": (diameter * PITCH * BED_SIDE,) * 2})


def settled(replicas: int, threads: int, precision: Precision) -> Simulation:
    """Beds that have settled; their kernels are compiled."""
    sim = assemble([lattice_bed(seed) for seed in range(replicas)], LAWS, numerics(threads, precision))
    advance(sim, [SETTLING] * replicas)
    return sim


def bed_case(name: str, replicas: int, threads: int, precision: Precision) -> dict[str, Any]:
    """Median speed on settled beds, with the share of every stage."""
    sim = settled(replicas, threads, precision)
    done = round(SETTLING / SOIL["time_step"])
    figures = [rate(sim, TIMED_STEPS, done + k * TIMED_STEPS) for k in range(ROUNDS)]
    middle = sorted(figures, key=lambda f: f["grain_steps_per_s"])[ROUNDS // 2]
    cores = min(threads, sim.workers)
    return {
        "case": name,
        "grains": replicas * len(sim.setups[0].grains.radius),
        "threads": threads,
        "precision": precision,
        "M grain-steps/s": 1e-6 * middle["grain_steps_per_s"],
        "per core": 1e-6 * middle["grain_steps_per_s"] / cores,
        "contacts per grain": middle["contacts_per_grain"],
        "stages": stage_shares(sim, middle["rebuilds"] / TIMED_STEPS),
    }


def stage_shares(sim: Simulation, rebuilds_per_step: float) -> dict[str, float]:
    """Share of a step's time that every stage takes [1]."""
    cost = stage_times(sim)
    cost["rebuild"] *= rebuilds_per_step
    return {stage: spent / sum(cost.values()) for stage, spent in cost.items()}


def air_setup(columns: int) -> AirSetup:
    """A square box of wind over a rough floor, under a lid that drives it; cells widen upwards."""
    faces = stretched_faces(0.0, AIR["height"], AIR_LAYERS, AIR["lowest"])
    ends = {"z_low": AirSide("rough", roughness=AIR["roughness"]), "z_high": AirSide("stress")}
    wind = log_profile(0.5 * (faces[1:] + faces[:-1]), AIR["friction_velocity"], AIR["roughness"], 0.4)
    rng = np.random.Generator(np.random.Philox(columns))
    stirred = rng.normal(0.0, AIR["friction_velocity"], (3, columns, columns, AIR_LAYERS))
    stirred[0] += wind
    side = AIR["height"]
    return AirSetup(
        cells=(columns, columns, AIR_LAYERS),
        low=(0.0, 0.0, 0.0),
        high=(side, side, side),
        faces_z=faces,
        sides={name: ends.get(name, AirSide()) for name in SIDES},
        density=AIR["density"],
        viscosity=AIR["viscosity"],
        time_step=AIR["courant"] * side / columns / float(wind.max()),
        model=AirModel(closure="smagorinsky"),
        friction_velocity=AIR["friction_velocity"],
        start=stirred,
    )


def air_case(columns: int, threads: int) -> dict[str, Any]:
    """Cells advanced by one step a second, and iterations of a pressure solve, on one grid of air."""
    workers = start_device(numerics(threads, "f64"))
    air = allocate_air([air_setup(columns)])
    advance_air(air, AIR_UNTIMED)
    start = time.perf_counter()
    iterations = advance_air(air, AIR_STEPS)
    seconds = time.perf_counter() - start
    rate_of_cells = air.cells[0] * air.cells[1] * air.cells[2] * AIR_STEPS / seconds
    return {
        "case": f"air, {columns} x {columns} x {AIR_LAYERS} cells",
        "threads": threads,
        "precision": "f64",
        "M cell-steps/s": 1e-6 * rate_of_cells,
        "per core": 1e-6 * rate_of_cells / min(threads, workers),
        "pressure iterations": iterations / (AIR_STAGES * AIR_STEPS),
    }


def run_benchmarks(progress: Report | None = None) -> dict[str, Any]:
    """The cases of `bench`: a settled bed in f32 and f64, an ensemble of beds on one thread and on all."""
    cores = len(os.sched_getaffinity(0))
    orders: list[tuple[str, int, int, Precision]] = [
        ("settled bed", 1, 1, "f32"),
        ("settled bed", 1, 1, "f64"),
        ("ensemble of beds", ENSEMBLE, 1, "f32"),
        ("ensemble of beds", ENSEMBLE, cores, "f32"),
    ]
    cases = []
    for index, order in enumerate(orders):
        if progress:
            progress(index / len(orders), f"{order[0]}, {order[2]} thread(s), {order[3]}")
        cases.append(bed_case(*order))
    for columns in AIR_COLUMNS:
        if progress:
            progress(1.0, f"air, {columns} x {columns} columns")
        cases.append(air_case(columns, cores))
    versions = {"taichi_erosion": __version__, "taichi": version("taichi")}
    return {"cases": cases, "versions": versions, "cores": cores}
