"""Cases for intervals: a laboratory with or without a smooth discrepancy that its model has not.

The laboratory is the reduced model with numbers drawn from the prior, plus waves along moisture and diameter
that no calibration follows; their form is not that of the method's prior. It measures at random conditions,
and is asked at others.
"""

from dataclasses import dataclass, replace

import numpy as np

from doe.trials.reduced.laboratory import Readings, table_of
from taichi_erosion.evidence.data.problem import Candidate, Conditions, Floats, Observable, Parameter, Problem
from taichi_erosion.evidence.data.transforms import EFFECTS, STRENGTH
from taichi_erosion.evidence.models.reduced import model_mean, predict

PARAMETERS = (
    Parameter("threshold_coefficient", 0.1, 0.04, 0.25, 0.2),
    Parameter("friction_sliding", 0.5, 0.1, 1.5, 0.2),
    Parameter("friction_rolling", 0.1, 0.01, 0.8, 0.4),
)
OBSERVABLES = {
    "repose_angle": Observable("repose_angle"),
    "threshold_u_star": Observable("threshold_u_star", "log"),
}
SCATTER = {"repose_angle": 0.8, "threshold_u_star": 0.04}  # of one repeat: deg, relative
UNITS = {"repose_angle": "deg", "threshold_u_star": "m/s"}
REPEATS = 3
MOISTURE, DIAMETER = (0.0, 0.03), (1e-4, 6e-4)  # kg/kg, m
ADOPTED = Candidate("liquid_bridge", 1.0, 3.0)


@dataclass(frozen=True)
class Case:
    """A problem, new conditions, and what the laboratory would find there."""

    problem: Problem
    observable: tuple[str, ...]
    conditions: Conditions
    truth: Floats  # mean of many repeats
    measured: Floats  # one more measurement
    numbers: dict[str, float]  # true calibrated numbers and strengths, by path


@dataclass(frozen=True)
class Waves:
    """A smooth discrepancy of one observable."""

    size: float
    turns: Floats  # over the range of each condition
    phase: Floats

    def __call__(self, at: Conditions) -> Floats:
        place = (
            (at["moisture"] - MOISTURE[0]) / (MOISTURE[1] - MOISTURE[0]),
            np.log(at["diameter"] / DIAMETER[0]) / np.log(DIAMETER[1] / DIAMETER[0]),
        )
        angles = [2.0 * np.pi * t * x for t, x in zip(self.turns, place, strict=True)]
        waves = np.sin(np.array(angles) + self.phase[:, np.newaxis])
        return self.size * np.sum(waves, axis=0)  # two waves of rms sqrt(1/2): rms 1


def conditions_of(random: np.random.Generator, count: int) -> Conditions:
    """Random conditions within the ranges, some of them dry."""
    moisture = np.where(random.random(count) < 0.2, 0.0, random.uniform(*MOISTURE, count))
    return {
        "moisture": moisture,
        "diameter": np.exp(random.uniform(np.log(DIAMETER[0]), np.log(DIAMETER[1]), count)),
    }


def draw(seed: int, discrepancy: float) -> Case:
    """One case; `discrepancy` is the rms of the waves over the standard error of a row.

    Stored cases of a salt have `SeedSequence([salt, number, round(10 * discrepancy)]).generate_state(1)[0]`.
    """
    random = np.random.default_rng(seed)
    truth = {p.path: p.start * np.exp(p.prior_sd_log * random.normal()) for p in PARAMETERS}
    truth = {p.path: float(np.clip(truth[p.path], p.low, p.high)) for p in PARAMETERS}
    effects = {"liquid_bridge": float(np.abs(random.normal())) if random.random() < 0.5 else 0.0}
    adopted = (ADOPTED,) if effects["liquid_bridge"] else ()
    tables, asked = [], []
    for name, scatter in SCATTER.items():
        size = discrepancy * scatter / np.sqrt(REPEATS)
        waves = Waves(size, random.uniform(0.4, 1.2, 2), random.uniform(0.0, 2.0 * np.pi, 2))
        count = int(random.integers(12, 25))

        def mean(at: Conditions, name: str = name, waves: Waves = waves) -> Floats:
            value = np.asarray(model_mean(name, at, truth, effects))
            return value * np.exp(waves(at)) if name == "threshold_u_star" else value + waves(at)

        def sd(value: Floats, name: str = name, scatter: float = scatter) -> Floats:
            return scatter * (value if name == "threshold_u_star" else np.ones_like(value))

        at, new = conditions_of(random, count), conditions_of(random, 10)
        value, wanted = mean(at), mean(new)
        noisy = value + sd(value) / np.sqrt(REPEATS) * random.normal(size=count)
        tables.append(Readings(name, at, noisy, sd(value), ()))
        asked.append((name, new, wanted, wanted + sd(wanted) * random.normal(size=10)))
    table = table_of(tables, REPEATS)
    table = replace(
        table,
        unit=tuple(UNITS[name] for name in table.observable),
        group=tuple(f"g{k}" for k in range(table.size)),
    )
    problem = Problem(table, OBSERVABLES, PARAMETERS, (), predict, adopted=adopted)
    return Case(
        problem,
        tuple(name for name, _, value, _ in asked for _ in value),
        {key: np.concatenate([at[key] for _, at, _, _ in asked]) for key in ("moisture", "diameter")},
        np.concatenate([value for _, _, value, _ in asked]),
        np.concatenate([value for *_, value in asked]),
        truth | ({f"{EFFECTS}liquid_bridge{STRENGTH}": effects["liquid_bridge"]} if adopted else {}),
    )
