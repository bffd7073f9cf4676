"""The answer of the evidence commands as one record: numbers and enumerations only, rendered elsewhere.

Quantiles are those of the posterior, averaged over all explanations; values are in the units of the model.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import isfinite, nan
from typing import Annotated, Literal

import numpy as np
from pydantic import PlainSerializer, PlainValidator

from taichi_erosion.evidence.data.problem import Floats
from taichi_erosion.evidence.race.priors import ADEQUATE

Verdict = Literal["present", "group", "none_detected", "outside_library", "not_testable", "unstable"]
Status = Literal["present", "excluded", "open", "untestable", "better_but_not_sufficient"]
Stop = Literal["", "budget"]
Shape = Literal["rises", "falls", "peak", "trough", "varies"]
Outcome = Literal["confirmed", "contradicted", "undecided", "not_made"]
to_array = PlainValidator(lambda each: np.array(each, dtype=np.float64))
to_list = PlainSerializer(lambda each: [x if isfinite(x) else str(x) for x in each.tolist()])
Column = Annotated[Floats, to_array, to_list]  # as stored, a list, with "nan" and "inf"


@dataclass(frozen=True)
class Interval:
    """Median and 90 % interval."""

    value: float
    low: float
    high: float


@dataclass(frozen=True)
class DecisionPart:
    """What is said, and with what probability."""

    verdict: Verdict
    named: tuple[str, ...]  # effects that act
    group: tuple[str, ...]  # effects of which one acts
    mechanisms: tuple[str, ...]  # of which one acts, best first, or all
    probabilities: Mapping[str, float]  # "none", "outside_library", "a", "a+b"; sums to 1
    familywise: float  # chance of a name as good if nothing acts
    refuted: tuple[str, ...] = ()  # would be named, but the fit fails or the strength is beyond the list
    unlisted: float = 0.0  # probability that something not in the list acts, alone or beside effects
    together: bool = False  # whether all mechanisms act


@dataclass(frozen=True)
class EffectPart:
    """One candidate."""

    status: Status
    probability: float  # that it acts
    strength: Interval  # where it acts; NaN where no explanation holds it
    limit: float  # strength above which it is excluded with 99 %
    log_bayes_factor: float  # against nothing
    absorption: float  # share of its signature that calibration and errors imitate
    unseen_below: float  # strength below which it could act and not be seen
    alike: tuple[str, ...] = ()  # candidates from which these measurements do not tell it
    most: float = 3.0  # largest strength of the list


@dataclass(frozen=True)
class NumberPart:
    """One calibrated number."""

    start: float
    before: Interval  # if nothing is missing
    now: Interval
    prior_share: float  # of the width of its prior, that is left
    at_end: bool  # more than half of the posterior lies in the outer tenth of its range


@dataclass(frozen=True)
class LevelPart:
    """How far an observable lies from the model at all conditions."""

    observable: str
    kind: Literal["factor", "offset"]
    size: Interval
    probability: float  # that it is off by more than half a standard error of a row


@dataclass(frozen=True)
class ErrorPart:
    """An error that nobody stated."""

    kind: Literal["source", "group", "row", "scatter"]
    observable: str
    label: str  # source, group, or number of the row in the table
    size: Interval  # in the unit of the observable; of a scatter the factor over what is stated
    other: str = ""  # the only other source or group


@dataclass(frozen=True)
class RepeatPart:
    """Two repeats of one measurement that disagree grossly."""

    observable: str
    rows: tuple[int, ...]  # numbers in the table
    difference: float  # in the unit of the observable
    suspect: int  # the one that the model does not expect; 0: either


@dataclass(frozen=True)
class FitPart:
    """Misfit of the rows that were fitted."""

    n: int
    chi2_before: float
    chi2_after: float
    p_before: float  # of as much by chance, levels, sources and groups included
    p_after: float
    p_lack_of_fit: float  # of the bare model against its repeats; NaN without repeats
    p_lack_of_fit_after: float = nan


@dataclass(frozen=True)
class ScatterPart:
    """Scatter of single measurements of one observable, on which its misfits are counted."""

    observable: str
    kind: Literal["factor", "offset"]  # of the sd: a share of the value, or in the unit of the observable
    sd: float  # median over its rows
    repeats: int  # degrees of freedom of repeated rows
    factor: float  # of their scatter over what is stated; NaN where either is missing


@dataclass(frozen=True)
class PlacePart:
    """Where the model fails if nothing is missing."""

    observable: str
    axis: str  # condition, or "level"
    sign: int  # +1: measured above the model at the upper end
    p: float


@dataclass(frozen=True)
class LawPart:
    """The law of a mechanism's dose."""

    mechanism: str
    conditions: tuple[str, ...]
    form: str
    expression: str  # with numbers and units of the model
    python: str  # of `dose_of(params, conditions)`: numbers as params.a, conditions as at["name"]
    numbers: Mapping[str, Interval]
    exponents: Mapping[str, Interval]  # by condition
    doses: tuple[tuple[Mapping[str, float], Interval], ...]  # conditions, dose
    held_out_share: float  # of the misfit of left-out groups that it explains
    template: str = ""  # the expression with the names of its numbers and sizes in braces
    sizes: Mapping[str, tuple[str, float]] = field(default_factory=dict)  # condition, and a size of it


@dataclass(frozen=True)
class CurvePart:
    """What something that is not in the list does to an observable along a condition."""

    observable: str
    condition: str
    kind: Literal["factor", "offset"]  # of a size, against that at the least value of the condition
    shape: Shape
    turn: float  # condition at the peak or trough; NaN elsewhere
    points: tuple[tuple[float, Interval], ...]  # condition, size


@dataclass(frozen=True)
class HeldOutPart:
    """Error of rows that no fit has seen, per row."""

    n: int
    before: float
    after: float
    p_after: float  # of as much if the model with what is named is adequate
    wrong: float  # with a random other effect
    opened: int
    adopted: tuple[str, ...] = ()  # effects that are tested
    wrong_effect: str = ""  # the random one
    p_worse: float = nan  # chance that the error falls as little, or grows as much, if they act


@dataclass(frozen=True)
class ExperimentPart:
    """A measurement that would decide."""

    observable: str
    conditions: Mapping[str, float]
    predictions: Mapping[str, Interval]  # explanation -> what it expects
    chance: float  # that all up to this one decide
    cost: float


@dataclass(frozen=True)
class CostPart:
    """What an answer has cost."""

    settings: int
    runs: int
    seconds: float
    stopped: Stop
    seed: int = 0  # of the runs


@dataclass(frozen=True)
class RowsPart:
    """Measured beside predicted, row by row, in the unit of the observable."""

    observable: tuple[str, ...]
    conditions: Mapping[str, Column]
    measured: Column  # of a limit its number, of an interval its middle
    low: Column  # ends of what was measured: `measured` itself, but of a limit and an interval
    high: Column
    sd: Column
    before: Column
    after: Column

    def gap(self, predicted: Floats) -> Floats:
        """Measured less predicted; 0 within a limit and an interval."""
        return np.clip(predicted, self.low, self.high) - predicted


@dataclass(frozen=True)
class GapPart:
    """Where an emulator lies farthest from fresh runs, in the unit of the observable."""

    effects: tuple[str, ...]  # that act there
    observable: str
    conditions: Mapping[str, float]
    emulated: float
    emulated_sd: float
    simulated: float
    simulated_sd: float
    p: float  # of as large a gap anywhere if the errors of the emulators are as stated


@dataclass(frozen=True)
class FreshPart:
    """What runs that no fit has used say of an answer that an emulator has found."""

    outcome: Outcome
    effects: tuple[str, ...] = ()  # of the likeliest explanation of which the answer is true
    emulated: float = nan  # probability of the answer, by the emulator
    simulated: float = nan  # by the fresh runs
    p: float = nan  # chance that as many runs of a right emulator leave as little
    gap: GapPart | None = None
    runs: int = 0
    seeds: int = 0  # of every set of conditions
    failed: int = 0  # runs without a value
    needed: int = 0  # runs for which the budget has no room, where none was made
    more_runs: int = 0  # about these explanations, that the next answer makes first
    rival: tuple[str, ...] = ()  # effects of the likeliest explanation that contradicts the answer
    rivals: float = nan  # probability of all that do and have an effect, by the fresh runs


@dataclass(frozen=True)
class Record:
    """One answer."""

    decided: DecisionPart
    effects: Mapping[str, EffectPart]
    numbers: Mapping[str, NumberPart]
    levels: tuple[LevelPart, ...]
    errors: tuple[ErrorPart, ...]
    repeats: tuple[RepeatPart, ...]
    fit: FitPart
    where: tuple[PlacePart, ...]
    rows: RowsPart
    cost: CostPart
    curves: tuple[CurvePart, ...] = ()
    scatter: tuple[ScatterPart, ...] = ()
    law: LawPart | None = None
    held_out: HeldOutPart | None = None
    experiments: tuple[ExperimentPart, ...] = ()
    fresh: FreshPart | None = None
    sensitivity: Mapping[str, Sequence[DecisionPart]] = field(default_factory=dict)  # prior halved, doubled

    @property
    def improves(self) -> bool:
        """Whether what is told lowers the misfit, and no held-out rows refute that."""
        held = self.held_out
        worse = held is not None and held.after >= held.before and not held.p_worse >= ADEQUATE
        return self.fit.chi2_after < self.fit.chi2_before and not worse


@dataclass(frozen=True)
class PredictedPart:
    """Values at one new set of conditions, in the unit of the observable; NaN where the model has none."""

    line: int  # row of the table of new conditions
    observable: str
    conditions: Mapping[str, float]  # in the units of the table
    condition_units: Mapping[str, str]
    unit: str
    value: float  # median: the model, corrected by what its residuals show
    low: float  # 90 % interval of what many repeats would give on average
    high: float
    model: float  # the calibrated model alone
    measured_low: float  # 90 % interval of one measurement
    measured_high: float
    outside: Mapping[str, float]  # end of the measured range, of every condition beyond it
    group: str = ""  # soil or batch that the table of new conditions names
    unseen: bool = False  # that is none of those measured, where these differ
    simulated: bool = False  # anew, at its conditions


@dataclass(frozen=True)
class CheckPart:
    """Measured values beside 90 % intervals that did not use them."""

    n: int
    inside: int
    p: float  # chance of as few inside where the intervals are right; NaN without rows


@dataclass(frozen=True)
class PredictionPart:
    """What the calibrated model says at new conditions, and how such intervals have held."""

    rows: tuple[PredictedPart, ...]
    fitted: CheckPart  # every fitted row, predicted from the others
    held_out: CheckPart | None  # of an open vault
    unlisted: float  # probability that something acts that the model does not have
    outdated: tuple[str, ...]  # effects adopted before the study or its table changed: left out
    lost: tuple[str, ...]  # observables without a row of known scatter: not predicted
    constant: Mapping[str, float]  # conditions that the table does not set, as in the study
    new_runs: int = 0  # of scenes, at the new conditions
