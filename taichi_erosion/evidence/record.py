"""The answer of the evidence commands as one record: numbers and enumerations only, rendered elsewhere.

Its fields are the keys of docs/json_and_python.md. Quantiles are those of the posterior, averaged over all
explanations; values are in the units of the model. A number that is not finite is null in JSON.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import inf, isfinite, nan
from typing import Annotated, Literal

import numpy as np
from pydantic import BeforeValidator, PlainSerializer, PlainValidator, computed_field

from taichi_erosion.evidence.data.problem import Floats

Verdict = Literal["present", "group", "none_detected", "outside_library", "not_testable", "unstable"]
Status = Literal["present", "excluded", "open", "untestable", "better_but_not_sufficient"]
Stop = Literal["", "budget"]
Shape = Literal["rises", "falls", "peak", "trough", "varies"]
Outcome = Literal["confirmed", "contradicted", "undecided", "not_made"]
to_array = PlainValidator(lambda each: np.array(each, dtype=np.float64))
to_list = PlainSerializer(lambda each: [x if isfinite(x) else str(x) for x in each.tolist()])
Column = Annotated[Floats, to_array, to_list]  # as stored, a list, with "nan" and "inf"
to_null = PlainSerializer(lambda each: each if isfinite(each) else None)
Number = Annotated[float, BeforeValidator(lambda each: nan if each is None else each), to_null]
Limit = Annotated[float, BeforeValidator(lambda each: inf if each is None else each), to_null]


@dataclass(frozen=True)
class Interval:
    """Median and 90 % interval."""

    value: Number
    low: Number
    high: Number


@dataclass(frozen=True, kw_only=True)
class DecisionPart:
    """What is said, and with what probability."""

    verdict: Verdict
    named: tuple[str, ...] = ()  # effects that act
    group: tuple[str, ...] = ()  # effects of which one acts; of an unstable answer those it doubts
    acting_mechanisms: tuple[str, ...] = ()  # of which one acts, best first, or all
    together: bool = False  # whether all mechanisms act
    refuted: tuple[str, ...] = ()  # would be named, but the fit fails or the strength is beyond the list
    imitators: Mapping[str, tuple[str, ...]] = field(default_factory=dict)  # effect that would be named ->
    # conditions that no effect reads and that vary with it: either may act
    probabilities: Mapping[str, float]  # "none", "each_set_up", "outside_library", "a", "a+b"
    p: float  # chance of a name as good if nothing acts
    unlisted: float = 0.0  # probability that something not in the list acts, alone or beside effects


@dataclass(frozen=True)
class EffectPart:
    status: Status
    probability: float  # that it acts
    strength: Number  # where it acts: median; NaN where no explanation holds it
    strength_low: Number  # 90 % interval; an excluded one lies between 0 and `limit`
    strength_high: Number
    limit: Limit = inf  # strength above which it is excluded with 99 %
    log_bayes_factor: float = 0.0  # against nothing
    absorption: float = 1.0  # share of its signature that calibration and errors imitate
    unseen_below: Limit = inf  # strength below which it could act and not be seen
    alike: tuple[str, ...] = ()  # candidates from which these measurements do not tell it
    most: float = 3.0  # largest strength of the list

    @property
    def strength_range(self) -> Interval:
        return Interval(self.strength, self.strength_low, self.strength_high)


@dataclass(frozen=True)
class ParameterPart(Interval):
    """One calibrated number, over all explanations."""

    start: float
    before: Interval  # if nothing is missing
    prior_share: float  # of the width of its prior, that is left
    at_end: bool  # more than half of the posterior lies in the outer tenth of its range


@dataclass(frozen=True)
class LevelPart(Interval):
    """How far an observable lies from the model at all conditions."""

    observable: str
    kind: Literal["factor", "offset"]
    probability: float  # that it is off by more than half a standard error of a row


@dataclass(frozen=True)
class ErrorPart(Interval):
    """An error that nobody stated [of the observable]; of a scatter, or where so said, a factor."""

    kind: Literal["source", "group", "row", "scatter"]
    observable: str
    label: str  # source, group, or number of the row in the table
    other: str = ""  # the only other source or group
    is_factor: bool = False  # over the other rows, where the observable is compared on a logarithm


@dataclass(frozen=True)
class RepeatPart:
    """Two repeats of one measurement that disagree grossly."""

    observable: str
    rows: tuple[int, ...]  # numbers in the table
    difference: float  # in the unit of the observable


@dataclass(frozen=True, kw_only=True)
class FitPart:
    """Misfit of the rows that were fitted; chi-square with levels, sources and groups at their best."""

    n: int
    chi2_before: Number
    chi2_after: Number
    p_misfit: Number  # of as much by chance, levels, sources and groups included
    p_misfit_after: Number
    p_lack_of_fit: Number  # of the bare model against its repeats; NaN without repeats
    p_lack_of_fit_after: Number = nan

    @computed_field
    @property
    def chi2_per_row_before(self) -> Number:
        """Of the calibrated model."""
        return self.chi2_before / max(self.n, 1)

    @computed_field
    @property
    def chi2_per_row_after(self) -> Number:
        """With what is named."""
        return self.chi2_after / max(self.n, 1)


@dataclass(frozen=True)
class ScatterPart:
    """Scatter of single measurements of one observable, on which its misfits are counted."""

    observable: str
    kind: Literal["factor", "offset"]  # of the sd: a share of the value, or in the unit of the observable
    sd: Number  # median over its rows
    repeats: int  # degrees of freedom of repeated rows
    factor: Number  # of their scatter over what is stated; NaN where either is missing


@dataclass(frozen=True)
class PlacePart:
    """Where the model fails if nothing is missing."""

    observable: str
    axis: str  # condition, or "level"
    sign: int  # +1: measured above the model at the upper end
    p: float
    p_as_stated: Number = nan  # if rows scatter about the trend as stated, and no more


@dataclass(frozen=True)
class LawPart:
    """The law of a mechanism's dose."""

    mechanism: str
    conditions: tuple[str, ...]
    form: str
    expression: str  # with numbers and units of the model
    python: str  # of `dose_of(params, conditions)`: numbers as params.a, conditions as at["name"]
    numbers: Mapping[str, Interval]
    exponents: Mapping[str, float]  # by condition, with a 90 % interval
    low: Mapping[str, float]
    high: Mapping[str, float]
    held_out_share: Number  # of the misfit of left-out groups that it explains
    template: str = ""  # the expression with the names of its numbers and sizes in braces
    sizes: Mapping[str, tuple[str, float]] = field(default_factory=dict)  # condition, and a size of it

    @property
    def powers(self) -> dict[str, Interval]:
        return {name: Interval(x, self.low[name], self.high[name]) for name, x in self.exponents.items()}


@dataclass(frozen=True)
class DosePart:
    """Dose of a mechanism in one set of conditions, by its law."""

    conditions: Mapping[str, float]
    dose: float
    low: float
    high: float


@dataclass(frozen=True)
class MechanismPart:
    """A mechanism of which one acts, or that has a law."""

    probability: float  # that it acts alone
    doses: tuple[DosePart, ...] = ()
    law: LawPart | None = None


@dataclass(frozen=True)
class PointPart(Interval):
    """A point of a curve: size against that at the least value of the condition."""

    at: float


@dataclass(frozen=True)
class CurvePart:
    """What something that is not in the list does to an observable along a condition."""

    observable: str
    condition: str
    kind: Literal["factor", "offset"]
    shape: Shape
    turn: Number  # condition at the peak or trough; NaN elsewhere
    points: tuple[PointPart, ...]
    unread: bool = False  # neither the model nor an effect reads the condition
    alike: tuple[str, ...] = ()  # conditions that vary with it in these rows: each may act in its place


@dataclass(frozen=True)
class HeldOutPart:
    """Error of rows that no fit has seen."""

    n: int
    chi2_per_row_before: Number
    chi2_per_row_after: Number
    chi2_per_row_wrong_effect: Number  # with a random other effect; NaN without one
    p_after: Number  # of as much if the model with what is named is adequate
    p_worse: Number  # chance that the error falls as little, or grows as much, if they act
    opened: int
    adopted: tuple[str, ...] = ()  # effects that are tested
    wrong_effect: str = ""  # the random one
    alike: Mapping[str, float] = field(default_factory=dict)  # conditions that vary in fitted rows alone
    slips: tuple[int, ...] = ()  # rows of the table that are about ten times too large or too small

    @computed_field
    @property
    def chi2_before(self) -> Number:
        return self.n * self.chi2_per_row_before

    @computed_field
    @property
    def chi2_after(self) -> Number:
        return self.n * self.chi2_per_row_after

    @computed_field
    @property
    def chi2_wrong_effect(self) -> Number:
        return self.n * self.chi2_per_row_wrong_effect


@dataclass(frozen=True)
class ExperimentPart:
    """A measurement that would decide."""

    observable: str
    conditions: Mapping[str, float]
    predictions: Mapping[str, Interval]  # explanation -> what it expects
    chance: float  # that all up to this one decide
    cost: float


@dataclass(frozen=True, kw_only=True)
class CostPart:
    settings: int  # of the model, all rows at once
    runs: int
    wall_s: Number = nan
    stopped: Stop = ""
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

    def residuals(self, predicted: Floats) -> Floats:
        """Measured less predicted; 0 within a limit and an interval."""
        return np.clip(predicted, self.low, self.high) - predicted


@dataclass(frozen=True)
class GapPart:
    """Where an emulator lies farthest from fresh runs, in the unit of the observable."""

    effects: tuple[str, ...]  # that act there
    observable: str
    conditions: Mapping[str, float]
    emulated: Number
    emulated_sd: Number
    simulated: Number
    simulated_sd: Number
    p: float  # of as large a gap anywhere if the errors of the emulators are as stated


@dataclass(frozen=True)
class FreshPart:
    """What runs that no fit has used say of an answer that an emulator has found."""

    outcome: Outcome
    effects: tuple[str, ...] = ()  # of the likeliest explanation of which the answer is true
    emulated: Number = nan  # probability of the answer, by the emulator
    simulated: Number = nan  # by the fresh runs
    p: Number = nan  # chance that as many runs of a right emulator leave as little
    gap: GapPart | None = None
    runs: int = 0
    seeds: int = 0  # of every set of conditions
    failed: int = 0  # runs without a value
    needed: int = 0  # runs for which the budget has no room, where none was made
    more_runs: int = 0  # about these explanations, that the next answer makes first
    rival: tuple[str, ...] = ()  # effects of the likeliest explanation that contradicts the answer
    rivals: Number = nan  # probability of all that do and have an effect, by the fresh runs


@dataclass(frozen=True, kw_only=True)
class Record(DecisionPart, FitPart, CostPart):
    effects: Mapping[str, EffectPart]
    mechanisms: Mapping[str, MechanismPart]
    parameters: Mapping[str, ParameterPart]
    levels: tuple[LevelPart, ...]
    errors: tuple[ErrorPart, ...]
    repeats: tuple[RepeatPart, ...]
    where: tuple[PlacePart, ...]
    rows: RowsPart  # of the fit; stored for figures, and not printed
    curves: tuple[CurvePart, ...] = ()
    scatter: tuple[ScatterPart, ...] = ()
    vault: HeldOutPart | None = None
    next_experiments: tuple[ExperimentPart, ...] = ()
    fresh_runs: FreshPart | None = None
    sensitivity: Mapping[str, Sequence[DecisionPart]] = field(default_factory=dict)  # prior halved, doubled

    @property
    def law(self) -> LawPart | None:
        return next((each.law for each in self.mechanisms.values() if each.law is not None), None)


@dataclass(frozen=True)
class PredictedPart:
    """Values at one new set of conditions, in the unit of the observable; NaN where the model has none."""

    line: int  # row of the table of new conditions
    observable: str
    conditions: Mapping[str, Number]  # in the units of the table
    condition_units: Mapping[str, str]
    unit: str
    value: Number  # median: the model, corrected by what its residuals show
    low: Number  # 90 % interval of what many repeats would give on average
    high: Number
    model: Number  # the calibrated model alone
    measured_low: Number  # 90 % interval of one measurement
    measured_high: Number
    outside: Mapping[str, Number]  # end of the measured range, of every condition beyond it
    group: str = ""  # soil or batch that the table of new conditions names
    unseen: bool = False  # that is none of those measured, where these differ
    simulated: bool = False  # anew, at its conditions


@dataclass(frozen=True)
class CheckPart:
    """Measured values beside 90 % intervals that did not use them."""

    n: int
    inside: int
    p: Number  # chance of as few inside where the intervals are right; NaN without rows
    limits: int = 0  # rows more that are no value


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
