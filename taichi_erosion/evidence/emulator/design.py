"""Which runs a study of scenes asks for: points spread over calibrated numbers, conditions and strengths.

The bare model and every effect have a plan of their own that follows from the study file alone, never from a
measured value: studies on the same scenes share their runs, and so does a study with the one that `adopt`
makes of it. Later rounds add runs about the explanations that are left.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path

import numpy as np
from scipy.stats import qmc

from taichi_erosion.evidence.data.problem import Candidate, Floats, expected_strength
from taichi_erosion.evidence.data.transforms import Axis, axis_value
from taichi_erosion.evidence.models.simulator import SceneMeasure, Simulator, effects_of, enters, moves

REACH = 2.0  # prior sd to either side over which calibrated numbers are spread
LEAST_STRENGTH = 0.3  # of the expected one, at which an effect is tried
MOST_STRENGTH = 3.0  # likewise; effects that much stronger are read off the surface
WARP = 1.5  # > 1 puts more of the tried strengths below the middle
JITTER_NUMBERS = 0.4  # prior sd by which runs of a later round spread about an explanation
JITTER_STRENGTH = 0.25  # likewise, share of the strength
DIGITS = 6  # of a number in a run: rounding errors must not make it another run
SEEDS = 2**30  # seeds of runs lie below

Row = dict[str, float]  # dotted path of a condition -> value


@dataclass(frozen=True)
class TrainingRun:
    """One run that is asked for."""

    scene: Path
    at: Row
    parameters: dict[str, float]
    effects: dict[str, float]  # strengths above 0
    seed: int


@dataclass(frozen=True)
class SceneRows:
    """One scene of a study: what it answers, and the conditions under which it was measured."""

    answer: SceneMeasure
    observables: tuple[str, ...]
    rows: tuple[Row, ...]  # distinct
    ahead: tuple[Row, ...] = ()  # that could be measured


@dataclass(frozen=True)
class RefinementPoint:
    """Numbers and strengths about which the surface is to be sure."""

    parameters: Mapping[str, float]
    effects: Mapping[str, float]


@dataclass(frozen=True)
class PlanSize:
    """How many runs a plan holds."""

    bare: int  # per calibrated number and one more
    effect: int  # of every effect
    condition: int  # more of an effect for every condition that enters, and every number of its own
    round: int  # about every explanation in a later round
    rounds: int


PLAN_SIZES = {"quick": PlanSize(8, 8, 2, 8, 1), "full": PlanSize(20, 20, 6, 16, 3)}


def cells(bench: SceneRows, simulator: Simulator, effects: Sequence[str]) -> list[Row]:
    """Distinct conditions that a run with some effects can depend on, where all of them can act."""
    scene = bench.answer.scene
    read = {name for effect in {*effects, *effects_of(scene)} for name in simulator.library[effect].reads}
    found: dict[tuple[tuple[str, float], ...], Row] = {}
    for row in bench.rows:
        if all(simulator.can_act(effect, scene, row) for effect in effects):
            kept = {path: value for path, value in row.items() if np.isfinite(value) and enters(path, read)}
            found.setdefault(tuple(sorted(kept.items())), kept)
    return list(found.values())


def spread(key: str, count: int, dimensions: int) -> Floats:
    """Evenly spread points (count, dimensions) in the unit cube, the same for the same key."""
    start = int.from_bytes(sha256(key.encode()).digest()[:4], "little")
    power = int(np.ceil(np.log2(max(count, 2))))
    return qmc.Sobol(dimensions, scramble=True, rng=np.random.default_rng(start)).random_base2(power)[:count]


def seed_of(key: str, number: int) -> int:
    """Seed of one run of a plan."""
    return int.from_bytes(sha256(f"{key}|{number}".encode()).digest()[:4], "little") % SEEDS + 1


def bare_plan(
    bench: SceneRows, simulator: Simulator, axes: Sequence[Axis], amount: PlanSize, tag: str = ""
) -> list[TrainingRun]:
    """Runs of the bare model; plans of another tag are other runs."""
    count = amount.bare * (len(moving(bench, axes, ())) + 1)
    return list(planned(bench, simulator, axes, None, count, tag))


def moving(bench: SceneRows, axes: Sequence[Axis], effects: Sequence[str]) -> list[Axis]:
    """Calibrated numbers on which a run with some effects can depend: an effect's own need that effect."""
    present = {*effects, *effects_of(bench.answer.scene)}
    return [axis for axis in axes if moves(axis.name, present)]


def effect_plan(
    bench: SceneRows,
    simulator: Simulator,
    axes: Sequence[Axis],
    candidate: Candidate,
    amount: PlanSize,
    tag: str = "",
) -> list[TrainingRun]:
    """Runs with one effect, at strengths from weak to strong."""
    rows = cells(bench, simulator, (candidate.name,))
    columns = {tuple(row.get(path) for row in rows) for path in dict.fromkeys(p for row in rows for p in row)}
    varying = [column for column in columns if len(set(column)) > 1]
    own = len(moving(bench, axes, (candidate.name,))) - len(moving(bench, axes, ()))
    count = amount.effect + amount.condition * (len(varying) + own) if rows else 0
    return list(planned(bench, simulator, axes, candidate, count, tag))


def planned(
    bench: SceneRows,
    simulator: Simulator,
    axes: Sequence[Axis],
    candidate: Candidate | None,
    count: int,
    tag: str = "",
) -> Iterator[TrainingRun]:
    """Runs spread over the reach of the priors, the conditions, and the strengths of at most one effect."""
    names = () if candidate is None else (candidate.name,)
    rows, scene = cells(bench, simulator, names), bench.answer.scene
    free, middle = moving(bench, axes, names), middles(axes)
    key = f"{scene.name}|{'+'.join(names)}|{tag}"
    for number, point in enumerate(spread(key, count, len(free) + 2)):
        row = rows[min(int(point[-1] * len(rows)), len(rows) - 1)]
        chosen = {axis.name: number_at(axis, share) for axis, share in zip(free, point, strict=False)}
        parameters = middle | chosen
        effects = {} if candidate is None else {candidate.name: strength_at(candidate, point[-2])}
        yield TrainingRun(scene, row, parameters, effects, seed_of(key, number))


def middles(axes: Sequence[Axis]) -> dict[str, float]:
    """Calibrated numbers in the middle of their priors."""
    return {axis.name: rounded(axis_value(axis, 0.0)) for axis in axes}


def number_at(axis: Axis, share: float) -> float:
    """A calibrated number at some share of its reach."""
    low, high = max(axis.low, -REACH), min(axis.high, REACH)
    return rounded(axis_value(axis, low + (high - low) * share))


def strength_at(candidate: Candidate, share: float) -> float:
    """A strength at some share of the range in which an effect is tried."""
    unit = expected_strength(candidate)
    low, high = LEAST_STRENGTH * unit, min(candidate.maximum, MOST_STRENGTH * unit)
    return rounded(low + (high - low) * share**WARP)


def round_plan(
    bench: SceneRows,
    simulator: Simulator,
    axes: Sequence[Axis],
    candidates: Mapping[str, Candidate],
    about: RefinementPoint,
    count: int,
    key: str,
) -> list[TrainingRun]:
    """Runs about one explanation, with fresh seeds."""
    names = tuple(name for name, strength in about.effects.items() if strength > 0.0)
    rows, scene = cells(bench, simulator, names), bench.answer.scene
    if not rows:
        return []
    free, middle = moving(bench, axes, names), middles(axes)
    settings = []
    for number, point in enumerate(spread(f"{key}|{names}", count, len(free) + len(names) + 1)):
        row = rows[min(int(point[-1] * len(rows)), len(rows) - 1)]
        chosen = {
            axis.name: near(axis, about.parameters[axis.name], share)
            for axis, share in zip(free, point, strict=False)
        }
        parameters = middle | chosen
        effects = {
            name: rounded(
                min(
                    about.effects[name] * (1.0 + JITTER_STRENGTH * (2.0 * share - 1.0)),
                    candidates[name].maximum,
                )
            )
            for name, share in zip(names, point[len(free) :], strict=False)
        }
        settings.append(TrainingRun(scene, row, parameters, effects, seed_of(f"{key}|{names}", number)))
    return settings


def near(axis: Axis, value: float, share: float) -> float:
    """A calibrated number close to a given one, within its range."""
    shift = axis.scale * JITTER_NUMBERS * (2.0 * share - 1.0)
    moved = value * float(np.exp(shift)) if axis.logarithmic else value + shift
    low, high = axis_value(axis, max(axis.low, -10.0 * REACH)), axis_value(axis, min(axis.high, 10.0 * REACH))
    return rounded(min(max(moved, low), high))


def rounded(value: float) -> float:
    """A number without meaningless digits."""
    return float(f"{value:.{DIGITS}g}")
