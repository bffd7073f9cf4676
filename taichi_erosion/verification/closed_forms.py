"""Closed forms that tell whether the program computes rightly on this machine: the short list of `verify`.

Scenes are tables as in scene files, with the grains at stated places, run on the CPU in both precisions.

Reference: Chung & Ooi (2011), Granular Matter 13, 643 (V02); Schiller & Naumann (1935), Z. VDI 77, 318 (V30).
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import cache
from math import nan, sqrt
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from taichi_erosion.air.grid import allocate_air
from taichi_erosion.air.readback import air_snapshot
from taichi_erosion.air.single_column import advance_columns
from taichi_erosion.core.air_setup import SIDES, AirModel, AirSetup, AirSide, log_profile, stretched_faces
from taichi_erosion.core.device import start_device
from taichi_erosion.core.setup import Floats, Laws, Numerics, Setup
from taichi_erosion.core.snapshot import Snapshot
from taichi_erosion.scene import parse_scene, replica_setup
from taichi_erosion.scene.change import sample_scene
from taichi_erosion.simulation import advance, assemble, failure_of, snapshot
from taichi_erosion.verification.claims import PRECISIONS, Ladder, Outcome, Precision, below, holds, relative

GRAVITY = 9.81  # m s-2
HERTZ = Laws()
# contact time times speed over peak overlap: 4 sqrt(pi) Gamma(2/5) / (5 Gamma(9/10)) [1]
DURATION_FACTOR = 2.9432751843


def equal_grains(
    diameter: float, solid: dict[str, float], time_step: float, starts: list[dict[str, Any]], **sections: Any
) -> Setup:
    """Equal grains without weight at stated starts, elastic and smooth; `sections` replaces or adds some."""
    size = {"law": "monodisperse", "diameter": diameter}
    table: dict[str, Any] = {
        "scene": {"kind": "collapse"},
        "run": {"time_step": time_step, "force_time_step": True, "overlap_limit": 0.5},
        "gravity": {"magnitude": 0.0},
        "grains": {"count": len(starts), "material": "solid", "size": size},
        "materials": {"solid": solid},
        "contact": {"solid-solid": {"restitution": 1.0, "friction_sliding": 0.0}},
        "fill": {"law": "positions", "grains": starts},
        "stages": [{"name": "all", "duration_max": 1.0}],
    }
    return replica_setup(parse_scene(table | sections), 1)


def sample_states(
    setups: Sequence[Setup], times: ArrayLike, precision: Precision, laws: Laws = HERTZ, threads: int = 0
) -> list[tuple[Snapshot, ...]]:
    """Snapshots of each replica at `times` [samples, replicas] in s. Raises RuntimeError if one stopped."""
    sim = assemble(setups, laws, Numerics(threads=threads, precision=precision))
    rows = []
    for row in np.asarray(times, dtype=float):
        advance(sim, row.tolist())
        rows.append([snapshot(sim, replica) for replica in range(len(setups))])
    for replica in range(len(setups)):
        if fault := failure_of(sim, replica):
            raise RuntimeError(f"replica {replica} stopped: {fault}")
    return list(zip(*rows, strict=True))


def crossing_time(time: Floats, value: Floats, level: float = 0.0) -> float:
    """First time at which a sampled value falls through `level`, interpolated; NaN if it never does."""
    falls = np.flatnonzero((value[:-1] > level) & (value[1:] <= level))
    if falls.size == 0:
        return nan
    k = int(falls[0])
    share = (value[k] - level) / (value[k] - value[k + 1])
    return float(time[k] + share * (time[k + 1] - time[k]))


def sphere_mass(radius: float, density: float) -> float:
    """Mass of a solid sphere [kg]."""
    return 4.0 / 3.0 * np.pi * radius**3 * density


def hertz_impact(young: float, radius: float, mass: float, speed: float) -> tuple[float, float, float]:
    """K [N m^-1.5], deepest overlap d [m] and duration [s] of an elastic head-on impact, from E*, R* and m*.

    K = (4/3) E* sqrt(R*) stores (2/5) K d^2.5 = m* v^2 / 2 at the deepest overlap.
    """
    stiffness = 4.0 / 3.0 * young * sqrt(radius)
    overlap = (5.0 * mass * speed**2 / (4.0 * stiffness)) ** 0.4
    return stiffness, overlap, DURATION_FACTOR * overlap / speed


PER_CONTACT, AHEAD = 200, 3.5  # steps in one elastic contact time and before the touch [1]
IMPACTS = {  # pairs of test 1 of Chung & Ooi, of 10 mm radius at 20 m/s: E [Pa], Poisson ratio, kg m-3
    "T1 glass": (4.8e10, 0.20, 2800.0),
    "T1 limestone": (2.0e10, 0.25, 2500.0),
}


def hertz_outcomes() -> Iterator[Outcome]:
    """V02: head-on impacts against Hertz's closed form.

    The deepest sample misses the deepest point by at most half a step, (pi/400)^2/2 = 3e-5 of the overlap,
    and the order of the step leaves 1e-4.
    """
    radius, speed, setups, closed = 0.01, 20.0, [], []
    for young, poisson, density in IMPACTS.values():
        mass = sphere_mass(radius, density)
        impact = hertz_impact(0.5 * young / (1.0 - poisson**2), radius / 2.0, mass / 2.0, speed)
        step = impact[2] / PER_CONTACT
        away = radius + 0.5 * AHEAD * speed * step
        starts = [{"position": (0.0, 0.0, s * away), "velocity": (0.0, 0.0, -s * speed / 2)} for s in (1, -1)]
        solid = {"density": density, "young_modulus": young, "poisson_ratio": poisson}
        setups.append(equal_grains(2.0 * radius, solid, step, starts))
        closed.append(impact)
    times = np.outer(np.arange(1.0, PER_CONTACT + 13.0), [setup.time_step for setup in setups])
    for precision in PRECISIONS:
        paths = sample_states(setups, times, precision)
        for name, impact, path in zip(IMPACTS, closed, paths, strict=True):
            yield from peak_outcomes(name, impact, path, precision)


def peak_outcomes(
    name: str, impact: tuple[float, float, float], path: Sequence[Snapshot], precision: Precision
) -> Iterator[Outcome]:
    """Deepest overlap, largest force, force along the path and contact time of an impact along z."""
    stiffness, deepest, duration = impact
    time = np.array([state.time for state in path])
    height = np.array([state.position[:, 2] for state in path])
    overlap = path[0].radius.sum() - height @ [1.0, -1.0][: height.shape[1]]  # of two spheres, or on z = 0
    # the second difference of the path is exactly force over mass at the middle sample of a leapfrog step
    force = path[0].mass[0] * np.abs(np.diff(height[:, 0], 2)) / np.diff(time)[:-1] ** 2
    peak = stiffness * deepest**1.5
    yield relative(f"{name}: deepest overlap [m]", overlap.max(), deepest, 1e-3, precision)
    if precision == "f64":
        yield relative(f"{name}: largest force [N]", force.max(), peak, 1e-3, precision)
        along = (force - stiffness * np.maximum(overlap[1:-1], 0.0) ** 1.5) / peak
        yield below(f"{name}: force along the path off K d^1.5, over its peak", along, 1e-3, precision)
    got = crossing_time(time, overlap) + crossing_time(-time[::-1], overlap[::-1])
    yield relative(f"{name}: contact time [s]", got, duration, 5e-3, precision)


def tumbling_setup(seed: int, count: int = 40) -> Setup:
    """Grains that fall through each other into a tube, with friction, rolling resistance and adhesion."""
    contact = {"restitution": 0.5, "friction_sliding": 0.5, "friction_rolling": 0.2}
    scene = sample_scene(
        run={"time_step": 8e-6, "overlap_limit": 0.5},
        grains={"count": count},
        laws={"normal": "jkr", "rolling": "elastic_plastic"},
        contact=dict.fromkeys(("sand-sand", "sand-steel"), contact | {"surface_energy": 0.01}),
    )
    return replica_setup(scene, seed)


TUMBLING = Laws(normal="jkr", rolling="elastic_plastic")
WHOLE = 0.10  # s, in which they rebuild their neighbour lists


def state_bytes(state: Snapshot) -> bytes:
    parts = (state.position, state.velocity, state.spin, state.contacts)
    return b"".join(np.ascontiguousarray(part).tobytes() for part in parts)


def thread_outcomes() -> Iterator[Outcome]:
    """V23: the same bits on one and two threads, alone and among other replicas."""
    target = tumbling_setup(3)
    half_step = replace(tumbling_setup(5), time_step=target.time_step / 2.0)
    company = [tumbling_setup(4), target, half_step, tumbling_setup(6, count=25)]
    cases = {"2 threads": ([target], 0), "in company, 2 threads": (company, 1)}
    for precision in PRECISIONS:
        ((alone,),) = sample_states([target], [[WHOLE]], precision, TUMBLING, 1)
        for name, (setups, place) in cases.items():
            states = sample_states(setups, np.full((1, len(setups)), WHOLE), precision, TUMBLING, 2)[place][0]
            same = state_bytes(states) == state_bytes(alone)
            yield holds(f"same hash alone on 1 thread and {name}", same, precision)


KARMAN, VISCOSITY, FRICTION = 0.40, 1.5e-5, 0.3  # 1, m2 s-1, u* in m s-1
HEIGHT, STEPS = 0.05, 4000  # of the channel [m]; of 0.05 s
SUBLAYER, LOG_LAYER = 4.0, (40.0, 0.2)  # in wall units: below, from; share of the height up to


def channel_setup() -> AirSetup:
    """Half a channel over a smooth floor, driven by a mean pressure gradient."""
    faces = stretched_faces(0.0, HEIGHT, 96, 2e-5)  # u* z / nu = 0.4
    ends = {"z_low": AirSide("wall"), "z_high": AirSide("symmetry")}
    return AirSetup(
        cells=(1, 1, 96),
        low=(0.0, 0.0, 0.0),
        high=(0.1, 0.1, HEIGHT),
        faces_z=faces,
        sides={name: ends.get(name, AirSide()) for name in SIDES},
        density=1.2,
        viscosity=VISCOSITY,
        time_step=0.05,
        model=AirModel(closure="mixing_length", advection="none", scheme="euler"),
        driving_gradient=(-1.2 * FRICTION**2 / HEIGHT, 0.0, 0.0),
        start=log_profile(0.5 * (faces[1:] + faces[:-1]), FRICTION, 0.11 * VISCOSITY / FRICTION, KARMAN),
    )


def channel_outcomes() -> Iterator[Outcome]:
    """V28: stress, friction velocity, viscous sublayer and law of the wall in a channel.

    tau = rho u*^2 (1 - z / H) with rho u*^2 = -G H for a mean pressure gradient G, whatever the closure. Over
    a smooth floor the mixing length gives u+ = z+ in the sublayer and u+ = ln(z+) / kappa + 5.2 above;
    kappa = 0.40 and R_c = 7 leave 0.3 about it, and 1 - z / H, which that law does not contain, 3 % at H / 5.
    """
    start_device(Numerics())
    air = allocate_air([channel_setup()])
    advance_columns(STEPS, air)
    state = air_snapshot(air, 0)
    viscosity = state.viscosity + state.eddy_viscosity[0, 0, 1:-1]
    stress = viscosity * np.diff(state.velocity[0, 0, :, 0]) / np.diff(state.z)
    off = stress / FRICTION**2 - (1.0 - state.faces_z[1:-1] / HEIGHT)
    yield below("channel: total stress off a straight line, over that of the floor", off, 1e-3, "f64")
    yield relative("channel: u* of the floor [m/s]", state.friction_velocity[0, 0], FRICTION, 1e-3, "f64")
    height, speed = state.z * FRICTION / VISCOSITY, state.velocity[0, 0, :, 0] / FRICTION
    low = height < SUBLAYER
    yield below("viscous sublayer: u+ over z+ less 1", speed[low] / height[low] - 1.0, 0.03, "f64")
    middle = (height > LOG_LAYER[0]) & (state.z < LOG_LAYER[1] * HEIGHT)
    law = np.log(height[middle]) / KARMAN + 5.2
    yield below("law of the wall: u+ off ln(z+)/kappa + 5.2", speed[middle] - law, 0.8, "f64")


AIR = {"density": 1.225, "viscosity": 1.789e-5 / 1.225}  # kg m-3, m2 s-1
QUARTZ = 2650.0  # kg m-3
TERMINAL = {50: 0.1820, 100: 0.5815, 200: 1.4778, 250: 1.9070, 500: 3.826, 1000: 7.042, 2000: 11.34}


@cache
def simulated_settling_speeds() -> Floats:
    """Speeds [m s-1] of the grains of TERMINAL after a fall of 9 s through still air."""
    solid = {"density": QUARTZ, "young_modulus": 1e9, "poisson_ratio": 0.2}
    # so wide that a grain does not move the air
    air = {"length": 1.0, "width": 1.0, "height": 120.0, "surface": 1.0, "cell": 1.0, "closure": "none"}
    start = [{"position": (0.5, 0.5, 115.0)}]
    more = {"gravity": {"magnitude": GRAVITY}, "wind": AIR | air | {"look_steps": 5}}
    setups = [equal_grains(1e-6 * microns, solid, 2e-4, start, **more) for microns in TERMINAL]
    paths = sample_states(setups, np.full((1, len(setups)), 9.0), "f64")
    return np.array([-path[-1].velocity[0, 2] for path in paths])


def settling_outcomes() -> Iterator[Outcome]:
    """V30: quartz spheres fall at the published terminal velocities, four digits each."""
    for (microns, speed_of_table), speed in zip(TERMINAL.items(), simulated_settling_speeds(), strict=True):
        yield relative(f"terminal velocity of {microns} um quartz [m/s]", speed, speed_of_table, 0.005, "f64")


LADDER = Ladder(
    {"V02": hertz_outcomes, "V23": thread_outcomes, "V28": channel_outcomes, "V30": settling_outcomes}
)
