"""V21, V23: the same bits after a restart, on any number of threads, and alone or in company.

Forty grains fall through each other into a tube, with friction, rolling resistance and adhesion, long
enough for several renewals of the neighbour lists.
"""

import hashlib
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from taichi_erosion.core.setup import Laws, Setup
from taichi_erosion.core.snapshot import Snapshot
from taichi_erosion.simulation import Simulation, advance, export_state, import_state, snapshot
from taichi_erosion.verification.bench_run import bench
from taichi_erosion.verification.bulk_scenes import DIAMETER, column_scene, soft_touch
from taichi_erosion.verification.claim import Outcome, Precision, holds

LAWS = Laws(normal="jkr", rolling="elastic_plastic")
HALF, WHOLE = 0.05, 0.10  # s
PRECISIONS: tuple[Precision, Precision] = ("f64", "f32")
STATE = ("position", "velocity", "spin", "contacts")


def tumbling(seed: int, count: int = 40) -> Setup:
    """Grains poured into a narrow tube."""
    touch = soft_touch(friction=0.5, friction_rolling=0.2, surface_energy=0.01)
    return column_scene(touch, count, 3.0 * DIAMETER, seed)


def fingerprint(state: Snapshot) -> str:
    """Hash of every bit of the state."""
    digest = hashlib.sha256()
    for name in STATE:
        digest.update(np.ascontiguousarray(getattr(state, name)).tobytes())
    return digest.hexdigest()


def run_to(sim: Simulation, time: float) -> None:
    """Advance all replicas."""
    advance(sim, [time] * len(sim.setups))


def differing(first: Snapshot, second: Snapshot) -> int:
    """Numbers of the state that differ in any bit."""
    return sum(
        int(np.count_nonzero(getattr(first, name).view(np.uint8) != getattr(second, name).view(np.uint8)))
        for name in STATE
    )


def restart() -> Iterator[Outcome]:
    """V21: half a run, exported, taken over by a fresh simulation and finished, against the run in one go."""
    setups = [tumbling(1), tumbling(2)]
    for precision in PRECISIONS:
        whole = bench(setups, precision, LAWS)
        run_to(whole, HALF)
        kept = export_state(whole)
        run_to(whole, WHOLE)
        wanted = [snapshot(whole, k) for k in range(2)]
        resumed = bench(setups, precision, LAWS)
        import_state(resumed, kept)
        run_to(resumed, WHOLE)
        bits = sum(differing(snapshot(resumed, k), wanted[k]) for k in range(2))
        yield Outcome("restart: bytes of the state that differ", float(bits), 0.0, 0.0, precision)


def threads_and_ensembles() -> Iterator[Outcome]:
    """V23: one hash on one and two threads, alone and among other replicas."""
    target = tumbling(3)
    company = [
        tumbling(4),
        target,
        replace(tumbling(5), time_step=target.time_step / 2.0),
        tumbling(6, count=25),
    ]
    for precision in PRECISIONS:
        prints = {}
        for name, setups, place, threads in (
            ("1 thread", [target], 0, 1),
            ("2 threads", [target], 0, 2),
            ("in company, 2 threads", company, 1, 2),
        ):
            sim = bench(setups, precision, LAWS, threads)
            run_to(sim, WHOLE)
            prints[name] = fingerprint(snapshot(sim, place))
        for name in list(prints)[1:]:
            yield holds(
                f"same hash alone on 1 thread and {name}", prints[name] == prints["1 thread"], precision
            )
