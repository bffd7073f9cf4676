"""Design of the training runs: points spread over calibrated numbers, conditions and strengths of effects.

The bare model and every effect have a design of their own that follows from the study file alone, never from
a measured value: studies on the same scenes share their runs, and so does a study with the one that `adopt`
makes of it. Later rounds add runs about the explanations that are left.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path

import numpy as np
import scipy

from taichi_erosion.core.effect import read_effect_entries
from taichi_erosion.core.errors import BadInput
from taichi_erosion.evidence.data.problem import Candidate, Mechanism, Numbers, expected_strength
from taichi_erosion.evidence.data.transforms import Axis, value_on_axis
from taichi_erosion.evidence.models import simulator as simulators
from taichi_erosion.mechanisms.library import dose_position
from taichi_erosion.scene import Scene
from taichi_erosion.tables.number_words import round_number

REACH = 2.0  # prior sd to either side over which calibrated numbers are spread
LEAST_STRENGTH = 0.3  # of the expected one, at which an effect is tried
MOST_STRENGTH = 3.0  # likewise; effects that much stronger are read off the emulator
WARP = 1.5  # > 1 puts more of the tried strengths below the middle
JITTER_NUMBERS = 0.4  # prior sd by which runs of a later round spread about an explanation
JITTER_STRENGTH = 0.25  # likewise, share of the strength
LEAST_DOSE = 0.1  # of the largest of an explanation, below which a run shows no mechanism
BOTH_SIDES = 1.25  # runs along a dose, which has two signs, over those along a strength
SEEDS = 2**30  # seeds of runs lie below

Row = dict[str, float]  # dotted path of a condition -> value


@dataclass(frozen=True)
class TrainingRun:
    scene: Path
    at: Row
    parameters: Numbers
    effects: Numbers  # strengths above 0
    seed: int


@dataclass(frozen=True)
class StudyScene:
    """One scene of a study: what it measures, under which conditions, and what is calibrated."""

    measure: simulators.SceneMeasure
    observables: tuple[str, ...]
    rows: tuple[Row, ...]  # distinct conditions of the measurements
    axes: tuple[Axis, ...]
    simulator: simulators.Simulator
    proposed_rows: tuple[Row, ...] = ()  # conditions that could be measured

    @property
    def mid_prior_numbers(self) -> Numbers:
        return {axis.name: value_on_axis(axis, 0.0) for axis in self.axes}


@dataclass(frozen=True)
class Setting:
    parameters: Mapping[str, float]
    effects: Mapping[str, float]  # strengths of effects, and the largest dose of a mechanism; 0: none
    doses: Sequence[tuple[Row, Numbers]] = ()  # of mechanisms under sets of conditions that are stated
    along: str = ""  # condition with which the doses vary

    def at(self, row: Row) -> list[Numbers]:
        """What acts under some conditions; where some are left out, under each set that has the others."""
        numbers = {path: value for path, value in row.items() if np.isfinite(value)}.items()
        sets = sorted(self.doses, key=lambda each: len(each[0]))
        doses = [{**self.effects, **numbers_here} for at, numbers_here in sets if numbers <= at.items()]
        return doses or [dict(self.effects)]


@dataclass(frozen=True)
class PlanSize:
    bare: int  # per calibrated number and one more
    effect: int  # of every effect
    condition: int  # more of an effect for every condition that enters, and every number of its own
    round: int  # about every explanation in a later round
    rounds: int
    fresh: int  # seeds of every set of conditions at which the answer is tested


PLAN_SIZES = {"quick": PlanSize(8, 8, 2, 8, 1, 2), "full": PlanSize(20, 20, 6, 16, 3, 4)}


def distinct_conditions(scene: StudyScene, effects: Sequence[str]) -> list[Row]:
    """Distinct conditions that a run with some effects can depend on, where all of them can act."""
    path, simulator = scene.measure.scene, scene.simulator
    present = {*effects, *simulator.effects_acting_in_scene(path)}
    read = {name for effect in present for name in simulator.library[effect].reads}
    able = (row for row in scene.rows if all(simulator.can_act(effect, path, row) for effect in effects))
    return distinct_condition_sets(able, lambda path: simulators.condition_matters(path, read))


def distinct_condition_sets(rows: Iterable[Row], matters: Callable[[str], bool]) -> list[Row]:
    """Conditions that are stated and matter, each set of them once."""
    sets = ({path: x for path, x in row.items() if np.isfinite(x) and matters(path)} for row in rows)
    return list({tuple(sorted(row.items())): row for row in sets}.values())


def relevant_axes(scene: StudyScene, effects: Sequence[str]) -> list[Axis]:
    """Calibrated numbers on which a run with some effects can depend: an effect's own need that effect."""
    present = {*effects, *scene.simulator.effects_acting_in_scene(scene.measure.scene)}
    return [axis for axis in scene.axes if simulators.parameter_can_change_run(axis.name, present)]


def scene_with_numbers(scene: StudyScene, numbers: Numbers) -> Scene:
    """The scene with calibrated numbers, in which nothing is missing."""
    words = scene.simulator.overrides(scene.measure, {}, numbers, {})
    return scene.simulator.load_scene_at(scene.measure.scene, words)


def mechanisms_scaling_numbers(scene: StudyScene) -> dict[str, str]:
    """Mechanisms that are a factor of a calibrated number, with its path: a half of them is half of it."""
    simulator, start, factors = scene.simulator, scene.mid_prior_numbers, {}
    bare = scene_with_numbers(scene, start)
    for effect in (simulator.library[name] for name in simulator.mechanisms):
        if effect.place == "scene":
            halved = effect.act(effect.params(dose=-0.5), 1.0, {}, bare)
            for path, value in start.items():
                if halved != bare and scene_with_numbers(scene, start | {path: 0.5 * value}) == halved:
                    factors[effect.name] = path
    return factors


def why_effect_cannot_act(scene: StudyScene, acting: Candidate | Mechanism) -> str | None:
    """Why an effect of usual strength changes nothing that a scene measures, None where it may."""
    strength = 0.5 * acting.high if isinstance(acting, Mechanism) else expected_strength(acting)
    if not (rows := distinct_conditions(scene, (acting.name,))):
        return "none of the conditions lets it act"
    try:
        inactive = all(leaves_readings_unchanged(scene, acting.name, strength, row) for row in rows)
    except BadInput as error:
        return str(error)
    return f"{scene.measure.scene.name} does not depend on it" if inactive else None


def leaves_readings_unchanged(scene: StudyScene, name: str, strength: float, row: Row) -> bool:
    from taichi_erosion.simulation.scene_setup import effect_conditions, effective_scene

    simulator, effect = scene.simulator, scene.simulator.library[name]
    if effect.place not in ("scene", "instrument"):
        return False
    words = simulator.overrides(scene.measure, row, {}, {name: strength})
    changed = simulator.load_scene_at(scene.measure.scene, words)
    after = effective_scene(changed, simulator.library)
    if effect.place == "scene":
        return after is changed
    params, _ = read_effect_entries(effect, changed.effects[name])
    conditions = effect_conditions(after)
    measures = [simulator.measures[each].measure for each in scene.observables]
    return all(effect.act(params, strength, conditions, measure, 1.0) == 1.0 for measure in measures)


def design_runs(
    scene: StudyScene, acting: Candidate | Mechanism | None, size: PlanSize, tag: str
) -> list[TrainingRun]:
    """Runs of the bare model, with one effect, or along the dose of a mechanism: these serve any law of it.

    They spread over the reach of the priors, the conditions and strengths. Another tag makes other runs. None
    where what acts changes nothing that the scene measures.
    """
    if acting is not None and why_effect_cannot_act(scene, acting) is not None:
        return []
    names = () if acting is None else (acting.name,)

    def strength(_: str, share: float, __: Row) -> float:
        assert acting is not None
        return strength_at_share(acting, share)

    key = f"{scene.measure.scene.name}|{'+'.join(names)}|{tag}"
    return sobol_runs(scene, names, count_runs(scene, acting, size), key, (number_at_share, strength), 2)


def count_runs(scene: StudyScene, acting: Candidate | Mechanism | None, size: PlanSize) -> int:
    """Runs of a design: more where more conditions or calibrated numbers can enter."""
    bare = len(relevant_axes(scene, ()))
    if acting is None:
        return size.bare * (bare + 1)
    names = (acting.name,)
    rows = distinct_conditions(scene, names)
    columns = {tuple(row.get(path) for row in rows) for path in {path for row in rows for path in row}}
    varying = sum(len(set(column)) > 1 for column in columns)
    least = round(BOTH_SIDES * size.effect) if isinstance(acting, Mechanism) else size.effect
    return least + size.condition * (varying + len(relevant_axes(scene, names)) - bare)


def strength_at_share(acting: Candidate | Mechanism, share: float) -> float:
    """A strength from weak to strong, or a dose, as often below 0 as above where its range has both."""
    if isinstance(acting, Mechanism):
        low, high = dose_position(acting.low), dose_position(acting.high)
        middle = 0.0 if low < 0.0 < high else 0.5 * (low + high)
        position = float(np.interp(share, (0.0, 0.5, 1.0), (low, middle, high)))
        return float(np.sign(position) * np.expm1(abs(position)))
    unit = expected_strength(acting)
    low, high = LEAST_STRENGTH * unit, min(acting.maximum, MOST_STRENGTH * unit)
    return low + (high - low) * share**WARP


def number_at_share(axis: Axis, share: float) -> float:
    """A calibrated number within the reach of its prior."""
    low, high = max(axis.low, -REACH), min(axis.high, REACH)
    return value_on_axis(axis, low + (high - low) * share)


def refinement_runs(
    scene: StudyScene, limits: Mapping[str, tuple[float, float]], about: Setting, count: int, key: str
) -> list[TrainingRun]:
    """Runs about one explanation, within limits of strengths and doses, with fresh seeds."""
    names = tuple(name for name, strength in about.effects.items() if strength != 0.0)

    def jitter_strength(name: str, share: float, row: Row) -> float:
        least = LEAST_DOSE * abs(about.effects[name])
        strengths = sorted({each[name] for each in about.at(row) if abs(each[name]) >= least}) or [least]
        place, jitter = divmod(share * len(strengths), 1.0)
        jittered = strengths[int(place)] * (1.0 + JITTER_STRENGTH * (2.0 * jitter - 1.0))
        return float(np.clip(jittered, *limits[name]))

    def jitter_number(axis: Axis, share: float) -> float:
        value, shift = about.parameters[axis.name], axis.scale * JITTER_NUMBERS * (2.0 * share - 1.0)
        new_value = value * float(np.exp(shift)) if axis.logarithmic else value + shift
        return float(np.clip(new_value, value_on_axis(axis, axis.low), value_on_axis(axis, axis.high)))

    return sobol_runs(scene, names, count, f"{key}|{names}", (jitter_number, jitter_strength), len(names) + 1)


def sobol_runs(
    scene: StudyScene,
    names: Sequence[str],
    count: int,
    key: str,
    values: tuple[Callable[[Axis, float], float], Callable[[str, float, Row], float]],
    more: int,
) -> list[TrainingRun]:
    """Runs at Sobol points over calibrated numbers, strengths and conditions; none where no effect can act.

    `values` turn a share of the unit interval into a calibrated number, and into a strength under some
    conditions; `more` counts the dimensions beside the calibrated numbers.
    """
    rows, free = distinct_conditions(scene, names), relevant_axes(scene, names)
    centre = {name: round_number(value) for name, value in scene.mid_prior_numbers.items()}
    (parameter, strength), runs = values, []
    start = np.random.default_rng(int.from_bytes(sha256(key.encode()).digest()[:4], "little"))
    sobol = scipy.stats.qmc.Sobol(len(free) + more, scramble=True, rng=start)
    points = sobol.random_base2(int(np.ceil(np.log2(max(count, 2)))))
    for number, point in enumerate(points[: count if rows else 0]):
        chosen = {a.name: round_number(parameter(a, share)) for a, share in zip(free, point, strict=False)}
        row = rows[min(int(point[-1] * len(rows)), len(rows) - 1)]
        strengths = zip(names, point[len(free) :], strict=False)
        acting = {n: round_number(strength(n, s, row)) for n, s in strengths}
        runs.append(TrainingRun(scene.measure.scene, row, centre | chosen, acting, design_seed(key, number)))
    return runs


def design_seed(key: str, number: int) -> int:
    return int.from_bytes(sha256(f"{key}|{number}".encode()).digest()[:4], "little") % SEEDS + 1
