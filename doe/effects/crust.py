"""A crust before and after it is broken, by impacts and by blows; writes crust.csv beside this file.

python -m doe.effects.crust             all plans
python -m doe.effects.crust PLAN...     some of: impact heap

Beside the bare model and `surface_crust` stands a cement that remembers nothing: it pulls with the same
strength between all grains that have touched, so it heals wherever they land. All three share their seeds.

impact  a grain strikes the bed of beds.py at 2 m/s and 10 deg; a second one follows on the same path
heap    the column of doe/effect_signatures stands free of its tube, then every grain is given a blow
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, fields, replace
from itertools import pairwise
from math import cos, radians, sin, sqrt, tan
from pathlib import Path

import numpy as np

from doe.common.command import words
from doe.common.tables import update_table
from doe.effect_signatures.run import COLUMN, COLUMN_ORDERS
from doe.effects.beds import DIAMETER, ORDERS, THRESHOLD
from taichi_erosion.core.device import stop_device
from taichi_erosion.core.effect import replica_effect
from taichi_erosion.core.setup import Floats, GrainTable, Numerics, Setup
from taichi_erosion.core.ti import ti
from taichi_erosion.effects import load_library
from taichi_erosion.measures.heap import pile_height
from taichi_erosion.run.checks import read_scene
from taichi_erosion.run.threshold_search import periodic_displacement
from taichi_erosion.scene import Scene, laws
from taichi_erosion.simulation import (
    Simulation,
    advance,
    assemble,
    export_state,
    failure,
    import_state,
    prepare,
    remove_surface,
    snapshot,
)

TABLE = Path(__file__).with_name("crust.csv")
LIBRARY = load_library()
CRUST = LIBRARY["surface_crust"]
VARIANTS = ("bare", "crust", "healing")
WEAK = 1e3  # Pa, the lowest tensile strength of Rice & McEwan (2001)
REST = 0.1  # s, before anything is done to a bed
STILL = 0.02  # m s-1, friction velocity in which nothing moves
SPEED, ANGLE = 2.0, radians(10.0)  # of the impacts
ABOVE, CRATER = 2.0, 0.06  # diameters over the bed from which a grain strikes; s after which is looked
FAR = 0.5  # of a diameter: a grain that has gone further has moved
STANDING, SPREAD = 0.15, 0.3  # s without the tube, and after the blow
BLOW = 0.05  # m s-1, sd of each component of the velocity that it gives


@ti.func
def pull_of_touch(constants, pair):
    """Attraction of grains that have touched and are nearer than a bond is long [N]."""
    radius = 2.0 * pair.radius_effective
    longest = constants.strain * radius
    attraction = 0.0
    if pair.touched > 0.0 and pair.gap > 0.0 and pair.gap < longest:
        attraction = constants.stress * radius * radius * pair.gap / longest
    return attraction


HEALING = replace(
    CRUST, name="healing_crust", act=pull_of_touch, vector=False, grain_state=None, update_state=None
)


@dataclass(frozen=True)
class Row:
    """One number of one variant: mean and standard error over seeds."""

    plan: str
    what: str
    variant: str
    value: float
    standard_error: float
    n: int


def variants(setup: Setup, strength: float) -> list[Setup]:
    """One replica bare, with the crust, and with one that heals."""
    radius = float(setup.grains.radius.max())
    params = CRUST.params(tensile_strength=strength)
    pulls = [replica_effect(effect, params, 1.0, {}, radius) for effect in (CRUST, HEALING)]
    return [setup, *(replace(setup, effects=(pull,)) for pull in pulls)]


def begin(scene: Scene, setups: Sequence[Setup], strength: float) -> Simulation:
    """All variants of all seeds, seed by seed."""
    everyone = [one for setup in setups for one in variants(setup, strength)]
    return assemble(everyone, laws(scene), Numerics(threads=1))


def rows(plan: str, found: dict[str, Sequence[float]]) -> Iterator[Row]:
    """Means over the replicas of every variant that gave a value."""
    for what, values in found.items():
        table = np.asarray(values, np.float64).reshape(-1, len(VARIANTS))
        for variant, column in zip(VARIANTS, table.T, strict=True):
            kept = column[np.isfinite(column)]
            error = float(kept.std(ddof=1) / sqrt(len(kept)))
            yield Row(plan, what, variant, float(kept.mean()), error, len(kept))


def struck_setup(scene: Scene, seed: int) -> Setup:
    """A bed, and two grains that come one after the other on the same path."""
    setup = prepare(scene, seed, LIBRARY)
    length, width = setup.period[:2]
    surface = setup.coupling.surface
    start = (0.5 * length - ABOVE * DIAMETER / tan(ANGLE), 0.5 * width, surface + (0.5 + ABOVE) * DIAMETER)
    extra = GrainTable(
        position=np.array([start, start]) % [length, width, np.inf],
        velocity=np.tile([SPEED * cos(ANGLE), 0.0, -SPEED * sin(ANGLE)], (2, 1)),
        spin=np.zeros((2, 3)),
        radius=setup.grains.radius[:2],
        mass=setup.grains.mass[:2],
        material=setup.grains.material[:2],
        release_time=np.array([REST, REST + CRATER]),
    )
    joined = {
        f.name: np.concatenate([getattr(setup.grains, f.name), getattr(extra, f.name)]) for f in fields(extra)
    }
    return replace(setup, grains=GrainTable(**joined))


def struck() -> Iterator[Row]:
    """Grains that an impact moves, and that the next one at the same place does."""
    scene = read_scene(THRESHOLD, (*ORDERS, f"wind.friction_velocity={STILL}"))
    setups = [struck_setup(scene, seed) for seed in range(1, 17)]
    bed, period = len(setups[0].grains.radius) - 2, np.array(setups[0].period[:2])
    sim = begin(scene, setups, WEAK)
    places = []
    for time in (REST, REST + CRATER, REST + 2.0 * CRATER):
        advance(sim, [time] * len(sim.setups))
        places.append([snapshot(sim, r).position[:bed] for r in range(len(sim.setups))])
    moved = [
        [
            float("nan") if failure(sim, r) else float(np.count_nonzero(gone(new, old, period)))
            for r, (old, new) in enumerate(zip(*pair, strict=True))
        ]
        for pair in pairwise(places)
    ]
    stop_device()
    yield from rows(
        "impact", dict(zip(("grains moved by an impact [1]", "by the next [1]"), moved, strict=True))
    )


def gone(after: Floats, before: Floats, period: Floats) -> Floats:
    """Which grains have moved."""
    return np.linalg.norm(periodic_displacement(after, before, period), axis=1) > FAR * DIAMETER


def shaken() -> Iterator[Row]:
    """Height of the column without its tube, and after a blow to every grain."""
    scene = read_scene(COLUMN, COLUMN_ORDERS)
    seeds = range(1, 7)
    sim = begin(scene, [prepare(scene, seed, LIBRARY) for seed in seeds], CRUST.params().tensile_strength)
    advance(sim, [REST] * len(sim.setups))
    for r in range(len(sim.setups)):
        remove_surface(sim, r, "tube")
    advance(sim, [REST + STANDING] * len(sim.setups))
    standing = heights(sim)
    state = export_state(sim)
    for r in range(len(sim.setups)):
        velocity = state[f"replica{r}_velocity"]
        random = np.random.default_rng(seeds[r // len(VARIANTS)])
        velocity += random.normal(0.0, BLOW, velocity.shape)[state[f"replica{r}_ident"].astype(int)]
    import_state(sim, state)
    advance(sim, [REST + STANDING + SPREAD] * len(sim.setups))
    fallen = heights(sim)
    stop_device()
    yield from rows("heap", {"height without its tube [m]": standing, "after a blow [m]": fallen})


def heights(sim: Simulation) -> list[float]:
    """Pile height of every replica [m]; NaN where one failed."""
    replicas = range(len(sim.setups))
    return [float("nan") if failure(sim, r) else pile_height(snapshot(sim, r)).value for r in replicas]


PLANS: dict[str, Callable[[], Iterator[Row]]] = {"impact": struck, "heap": shaken}


def main(asked: list[str]) -> None:
    """Simulate what was asked for."""
    for plan in (name for name in PLANS if not asked or name in asked):
        update_table(TABLE, Row, list(PLANS[plan]()), lambda row: row.plan, digits=6)


if __name__ == "__main__":
    main(words(__doc__))
