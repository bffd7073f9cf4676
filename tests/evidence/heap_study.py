"""A study of heaps in closed form whose laboratory may be off: two observables, two conditions, one friction.

    angle  = 25 + 40 (mu - 0.5) d + 6 s_bridge w + 2 s_size (d - 1.5)                          [deg]
    height = 10 exp(0.4 ln(mu / 0.5) d + 0.3 s_bridge w - 0.2 s_size (d - 1.5))                 [mm]

with friction mu, moisture w at five levels, grain diameter d at two, strengths s. `flat` acts where `cover`
is above 0, which no row has.
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from doe.trials.reduced.laboratory import Readings, table_of
from taichi_erosion.evidence.data.problem import Candidate, Observable, Parameter, Problem, Vault
from taichi_erosion.evidence.data.table_units import TableUnits
from taichi_erosion.evidence.race.posterior import raced
from taichi_erosion.evidence.race.record import Record
from taichi_erosion.evidence.race.summary import summary
from taichi_erosion.scene.schema.units import Scale

MOISTURE, DIAMETER = np.linspace(0.0, 1.0, 5), np.array([1.0, 2.0])
SD = {"angle": 0.3, "height": 0.1}
FRICTION, TRUE_FRICTION = 0.5, 0.53
EFFECTS = ("bridge", "size", "flat")


def value(
    observable: str, w: np.ndarray, d: np.ndarray, mu: float, acting: Mapping[str, float]
) -> np.ndarray:
    """One observable at some conditions."""
    bridge, size = acting.get("bridge", 0.0) * w, acting.get("size", 0.0) * (d - 1.5)
    if observable == "angle":
        return 25.0 + 40.0 * (mu - FRICTION) * d + 6.0 * bridge + 2.0 * size
    return 10.0 * np.exp(0.4 * np.log(mu / FRICTION) * d + 0.3 * bridge - 0.2 * size)


def model(observable, conditions, parameters, effects, seeds):
    w, d = conditions["moisture"], conditions["diameter"]
    found = value(observable, w, d, parameters["friction"], effects)
    return np.repeat(found[np.newaxis], seeds.size, axis=0)


def heap_problem(
    acting: Mapping[str, float],
    seed: int = 0,
    offset: float = 0.0,
    factor: float = 1.0,
    friction: float = TRUE_FRICTION,
    scatter: float = 1.0,
    hidden: tuple[int, ...] = (),
) -> Problem:
    """A laboratory off by `offset` in angles and `factor` in heights; its sd are understated by `scatter`."""
    random = np.random.default_rng(seed)
    w, d = (column.ravel() for column in np.meshgrid(MOISTURE, DIAMETER, indexing="ij"))
    group = tuple(f"w{a:g} d{b:g}" for a, b in zip(w, d, strict=True))
    parts, at = [], {"moisture": w, "diameter": d, "cover": np.zeros(w.size)}
    for name, sd in SD.items():
        exact = value(name, w, d, friction, acting)
        noisy = exact + scatter * sd * random.standard_normal(w.size)
        level = factor if name == "height" else 1.0
        read = noisy + offset if name == "angle" else noisy * factor
        parts.append(Readings(name, at, read, np.full(w.size, level * sd), group))
    units = TableUnits({"angle": Scale("deg"), "height": Scale("mm")})
    table = replace(table_of(parts), table_units=units)
    candidates = tuple(
        Candidate(name, mask=(lambda at: at["cover"] > 0.0) if name == "flat" else None) for name in EFFECTS
    )
    return Problem(
        table,
        {"height": Observable("height", "log")},
        (Parameter("friction", FRICTION, 0.3, 0.8, 0.1),),
        candidates,
        model,
        vault=Vault(np.array(hidden, dtype=np.int64)),
    )


def narrowed(problem: Problem, low: float, high: float) -> Problem:
    """The same with another range of friction."""
    (number,) = problem.parameters
    return replace(problem, parameters=(replace(number, low=low, high=high),))


def answer(problem: Problem, seed: int = 1) -> Record:
    """The record of the race."""
    return summary(raced(problem, seed))
