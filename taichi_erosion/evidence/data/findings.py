"""Findings of an evidence study: one record per answer. Its document, text and page are rendered from it."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from math import nan
from typing import TYPE_CHECKING, Literal

from taichi_erosion.evidence.data.problem import Bools, Floats, rows_picked

if TYPE_CHECKING:
    from taichi_erosion.evidence.data.fresh_findings import FreshCheck
    from taichi_erosion.evidence.data.mechanism_findings import BeyondList, DoseEstimate, StrengthTrend
    from taichi_erosion.evidence.data.repeats import LackOfFit

Verdict = Literal["present", "group", "none_detected", "outside_library", "not_testable", "unstable"]
Status = Literal["present", "excluded", "not_testable"]
HighKind = Literal["interval_90", "limit_95"]  # upper end of a 90 % interval, or of what 95 % lie below
Limit = Literal["", "below", "above", "between"]
SILENT = ("none_detected", "not_testable")  # verdicts that name nothing because nothing is seen
NAMING = ("present", "group")  # verdicts that name effects
NONE, OUTSIDE = "none", "outside_library"  # keys of probabilities beside effects and pairs "a+b"
FaultKind = Literal[
    *("too_small", "not_converged", "no_value", "failed_runs", "unit", "offset", "at_bound"),
    *("too_few_rows", "repeats", "source_changed"),
]


@dataclass(frozen=True)
class SetUpFault:
    """Something about the set-up, not about physics, that has to be known before an answer is read."""

    kind: FaultKind
    place: str  # observable, or path of a calibrated number
    sentence: str
    blocks: bool  # the verdict on physics waits until this is settled


@dataclass(frozen=True)
class ObservableMisfit:
    """Agreement of one observable, in its own unit where a unit applies."""

    n: int
    chi2: float  # NaN where the noise is unknown
    rmse: float
    bias: float  # mean of measured minus predicted
    p: float  # of a misfit as large by chance; NaN where the noise is unknown


@dataclass(frozen=True)
class Stretch:
    """Part of a condition, ends included, in which measured values lie to one side of the model."""

    sign: int  # +1: measured above the model
    low: float | None  # in the unit of the model; None for an end of what was measured
    high: float | None
    level: float | None = None  # where it is one level of the condition alone


@dataclass(frozen=True)
class MisfitPlace:
    """A place where the model fails."""

    observable: str
    axis: str  # a condition, or "level" for the observable as a whole
    p: float  # Holm-adjusted over all places looked at [1]
    sentence: str
    stretches: tuple[Stretch, ...] = ()  # where and in which direction, a trend at both its ends


@dataclass(frozen=True)
class ObservableNoise:
    """Noise budget of one observable on its comparison scale: medians over its rows."""

    lab: float  # standard error of a row
    simulator: float  # standard error of the model's mean
    shared: float
    numerical: float
    repeats: int  # degrees of freedom behind the laboratory's own scatter
    stated_factor: float  # scatter found between repeated rows over stated scatter; NaN without such rows
    p: float  # of a factor as far from 1 by chance; NaN without repeated rows
    seed_correlation: float  # between paired seeds with and without an effect; NaN for a model without noise


@dataclass(frozen=True)
class Noise:
    """What is known about the scatter."""

    observables: Mapping[str, ObservableNoise]
    known: bool  # False: sd and replicates are both absent, so nothing may be named
    sentences: tuple[str, ...]


@dataclass(frozen=True)
class Rows:
    """Measured beside predicted, row by row, in the observable's unit: what figures are drawn from."""

    observable: tuple[str, ...]
    group: tuple[str, ...]
    conditions: Mapping[str, Floats]
    measured: Floats
    measured_sd: Floats  # standard error, all sources but the simulator
    predicted: Floats
    predicted_sd: Floats  # standard error of the simulated mean
    residual: Floats  # measured minus predicted and shifted, over its standard deviation
    residual_error: Floats  # that standard deviation, on which chi2 and p rest too
    model_sd: Floats  # standard error of `predicted`: calibrated numbers, strengths, simulated mean
    shift: Floats  # of `predicted` by errors that rows share, at their best; 0 where it is shifted already
    limit: tuple[Limit, ...] = ()  # of which rows `measured` is a limit, and on which side the value lies
    low: tuple[float, ...] = ()  # lower end of the interval in which the value of a row lies; NaN: none
    high: tuple[float, ...] = ()  # upper end

    def select(self, chosen: Bools) -> "Rows":
        """Some rows of the table."""
        return replace(self, **rows_picked(vars(self), chosen))


@dataclass(frozen=True)
class Estimate:
    """A calibrated number with its 90 % interval."""

    value: float
    low: float
    high: float
    at_bound: bool  # the calibration ends at a bound of the allowed range
    moved: float = nan  # prior sd by which effects have moved a calibrated number from the bare model's
    prior_share: float = nan  # of the interval of its prior, that the measurements leave to a number [1]
    remark: str = ""  # what follows from these two


@dataclass(frozen=True)
class Correlation:
    """Correlation of two calibrated numbers or strengths, as the measurements leave them."""

    first: str
    second: str
    value: float


@dataclass(frozen=True)
class LevelShift:
    """How far all rows of an observable lie above the model alike: code, instrument or method."""

    observable: str
    kind: Literal["factor", "offset"]  # measured over predicted, or measured minus predicted
    value: float
    low: float  # 90 % interval
    high: float
    probability: float  # that this level is off at all [1]
    sentence: str


@dataclass(frozen=True)
class ErrorFinding:
    """An error that nobody stated and on which the answer rests."""

    kind: Literal["source", "batch", "rows", "scatter"]
    observable: str  # empty where it concerns all
    sentence: str


@dataclass(frozen=True)
class Variants:
    """In how many variants of tolerances, priors and rows an answer holds."""

    count: int = 0
    holds: int = 0
    changes: tuple[str, ...] = ()  # what it becomes in the others, and where


@dataclass(frozen=True)
class RowMisfit:
    """The row that holds most of a misfit."""

    observable: str
    conditions: Mapping[str, float]
    residual_sd: float  # measured minus predicted, in standard deviations
    share: float  # of the misfit [1]
    p_without: float  # of the misfit that the other rows leave
    setting: str = ""  # the conditions in words, in the units of the table


@dataclass(frozen=True)
class RowOff:
    """A row that lies far from the model under every explanation."""

    observable: str
    setting: str  # its conditions in words, in the units of the table
    source: str
    residual_sd: float  # the least of all explanations, in standard deviations


@dataclass(frozen=True, kw_only=True)
class Comparison:
    """Answer of `compare`: does the model, calibrated as well as it can be, agree with the measurements?"""

    observables: Mapping[str, ObservableMisfit]
    where: tuple[MisfitPlace, ...]
    chi2: float  # of all rows
    chi2_per_row: float
    dof: float
    p: float
    noise: Noise
    parameters: Mapping[str, Estimate]
    correlations: tuple[Correlation, ...] = ()
    rows: Rows
    failures: int  # model values that could not be computed
    warnings: tuple[str, ...]
    faults: tuple[SetUpFault, ...] = ()  # told before everything else
    runs: int
    wall_s: float = nan
    levels: tuple[LevelShift, ...] = ()  # offsets between code and laboratory, where these fit better
    p_levels_free: float = nan  # of the misfit with every level free; NaN where levels do not matter
    stuck: tuple[str, ...] = ()  # calibrated numbers that would leave their range
    worst_row: RowMisfit | None = None  # where one row holds most of a misfit
    scatter_factor: float = nan  # true over stated sd that would explain the misfit
    lack_of_fit: Mapping[str, "LackOfFit"] = field(default_factory=dict)  # by observable, and of all together


@dataclass(frozen=True, kw_only=True)
class EffectFinding:
    """Status and numbers of one candidate effect; the defaults are those of an untested one."""

    status: Status = "not_testable"
    strength: float = nan
    strength_low: float = nan  # 90 % interval
    strength_high: float = nan  # for an excluded effect: the strength above which it is excluded (95 %)
    log_bayes_factor: float = 0.0  # against the model without it
    power: float = 0.0  # chance that the test would see it at its expected strength [1]
    absorption: float = nan  # share of its signature that calibration can imitate [1]
    signature_norm: float = nan  # left of the signature at expected strength, in standard deviations
    strength_high_kind: HighKind = "limit_95"
    probability: float = 0.0  # that it acts, alone or with others [1]
    probability_alone: float = 0.0  # that it acts and no other does [1]
    probability_unvisited: float = 0.0  # estimated, of sets that hold it and were not fitted [1]
    p: float = 1.0  # family-wise, step-down
    held_out_gain: float = nan  # log score of left-out groups, against the model without it
    held_out_error: float = nan  # its standard error
    stronger_than_list: bool = False  # its strength lies beyond the largest that the list allows
    sentence: str


@dataclass(frozen=True)
class MemberFinding:
    """One member of a set of three or more effects, tested beside the others."""

    name: str
    beside: tuple[str, ...]  # the others
    log_bayes_factor: float  # of the set over the others alone
    p: float  # chance that the best of all that could be added to the others gains as much
    needed: bool


@dataclass(frozen=True)
class EffectAction:
    """The value that an effect of the fitted strength moves most, all else the same."""

    observable: str
    conditions: Mapping[str, float]
    without: float  # model, in the observable's unit
    acting: float  # the same with the effect


@dataclass(frozen=True)
class OpposedSign:
    """An observable that a named effect moves in the model the other way than its source says."""

    effect: str
    observable: str
    expected: int  # +1 up, -1 down
    moved_sd: float  # of the row that it moves farthest that way, in standard errors; against `expected`
    sentence: str


@dataclass(frozen=True)
class Law:
    """A hypothesis for an effect that no library holds: correction = sum_j c_j prod_i x_i^p_ij."""

    observable: str
    expression: str  # in the units of the model
    terms: tuple[Mapping[str, float], ...]  # condition -> power
    coefficients: tuple[float, ...]
    held_out_share: float  # share of the misfit that left-out groups see explained [1]
    sentence: str = ""  # the expression in the units of the table


@dataclass(frozen=True)
class ResidualTrend:
    """Structure of the residual of one observable, where the missing effect is not in the library."""

    observable: str
    axis: str
    sign: int  # +1: measured above predicted at the upper end of the axis
    exponent: float  # of the scaling with the axis; NaN where the axis is not positive
    exponent_low: float  # 90 % interval
    exponent_high: float
    sentence: str
    law: Law | None


@dataclass(frozen=True)
class VaryingNumber:
    """A calibrated number that would have to vary with a condition, where no effect of the list suffices."""

    parameter: str
    condition: str
    share: float  # of the misfit beyond chance that would go [1]
    sentence: str


@dataclass(frozen=True)
class Experiment:
    """A measurement that decides between the remaining explanations; an answer of `next`."""

    observable: str
    conditions: Mapping[str, float]
    predictions: Mapping[str, tuple[float, float]]  # hypothesis -> mean and sd, in the observable's unit
    chance: float  # that this and the experiments before it decide [1]
    cost: float
    sentence: str


@dataclass(frozen=True)
class Proposals:
    """Answer of `next`: experiments, best first, or why there are none."""

    experiments: tuple[Experiment, ...]
    explanations: Mapping[str, float]  # live explanations with their weights
    sentence: str  # what the experiments decide together


@dataclass(frozen=True)
class VaultErrors:
    """Misfit of the held-out rows before and after; NaN until the vault has been opened."""

    opened: int
    chi2_before: float = nan  # of all held-out rows
    chi2_after: float = nan
    chi2_wrong_effect: float = nan  # of the control
    chi2_per_row_before: float = nan
    chi2_per_row_after: float = nan
    chi2_per_row_wrong_effect: float = nan
    effects: tuple[str, ...] = ()  # with which it was opened last


@dataclass(frozen=True)
class PlausibleHypothesis:
    """An explanation that is not excluded: one of those between which the next experiment has to decide."""

    names: tuple[str, ...]
    probability: float
    parameters: Mapping[str, float]
    strengths: Mapping[str, float]


@dataclass(frozen=True)
class NearestHypothesis:
    """The explanation of the list that takes away most of the misfit, where none suffices."""

    names: tuple[str, ...]
    explained: float  # share of the misfit beyond chance [1]
    p: float  # of the misfit that it leaves
    at_maximum: tuple[str, ...] = ()  # its effects at the largest strength that the list allows


@dataclass(frozen=True, kw_only=True)
class Discovery:
    """Answer of `discover`: which effect is missing, as far as these measurements show."""

    verdict: Verdict
    named: tuple[str, ...] = ()
    group: tuple[str, ...] = ()  # effects that these measurements do not separate
    probabilities: Mapping[str, float]  # "none", "outside_library", every effect, "a+b" for pairs; sums to 1
    effects: Mapping[str, EffectFinding]
    parameters: Mapping[str, Estimate]  # calibrated with what was named
    correlations: tuple[Correlation, ...] = ()  # of these, and of the strengths of what was named
    calibrated: int  # how many numbers were calibrated
    calibrated_with: tuple[str, ...] = ()  # effects in the recalibrated model
    where: tuple[MisfitPlace, ...]
    chi2_before: float  # of all rows
    chi2_after: float
    chi2_per_row_before: float
    chi2_per_row_after: float
    n: int
    vault: VaultErrors
    next_experiments: tuple[Experiment, ...] = ()
    next_sentence: str = ""  # what these decide together, or why there are none
    clues: tuple[ResidualTrend, ...] = ()
    varying: VaryingNumber | None = None
    p: float = 1.0  # family-wise, of the strongest candidate by chance
    p_misfit: float = nan  # of the calibrated base model
    p_misfit_stated: float = nan  # the same with the declared shared errors alone, where levels are free
    levels: tuple[LevelShift, ...] = ()  # offsets between code and laboratory that are part of the model here
    level_probability: float = 0.0  # that any level is off [1]
    errors: tuple[ErrorFinding, ...] = ()  # of sources, batches, rows or scatter, that nobody stated
    errors_probability: float = 0.0  # that there are any [1]
    variants: Variants = Variants()
    members: tuple[MemberFinding, ...] = ()  # of a set of three or more, each tested beside the others
    probability_unvisited: float = 0.0  # estimated, of all sets that were not fitted [1]
    errors_stated: str = ""  # what the stated errors would say, where the answer rests on others
    stuck: tuple[str, ...] = ()  # calibrated numbers of the bare model that would leave their range
    stuck_after: tuple[str, ...] = ()  # those of the recalibrated model
    range_suffices: bool = False  # the misfit is gone if they may: nothing is concluded on effects
    worst_row: RowMisfit | None = None  # where one row holds most of the misfit of the bare model
    row_off: RowOff | None = None  # with its error as stated
    scatter_factor: float = nan  # true over stated sd that would explain the misfit of the bare model
    p_misfit_after: float = nan  # of the recalibrated model with what is named; without a name, as before
    decoy_rank: int  # rank of the best made-up effect among all candidates; 1 is a red flag
    stability: float = nan  # share of repeats with new seeds that agree on the first name [1]; NaN if none
    fresh_runs: "FreshCheck | None" = None  # of scenes, where an answer names effects
    sentences: tuple[str, ...] = ()
    warnings: tuple[str, ...]
    noise: Noise
    ambiguity: Mapping[str, tuple[str, ...]] = field(default_factory=dict)  # effect -> others of its group
    absorbed_by: Mapping[str, str] = field(default_factory=dict)  # effect -> parameter that imitates it best
    survivors: tuple[PlausibleHypothesis, ...] = ()
    closest: tuple[PlausibleHypothesis, ...] = ()  # effect and set of several that leave least misfit
    nearest: NearestHypothesis | None = None
    beyond: "BeyondList | None" = None  # mechanisms, where no listed effect explains a misfit alone
    trend: "StrengthTrend | None" = None  # of the strength of the named effect
    rows_before: Rows
    rows_after: Rows
    actions: Mapping[str, EffectAction] = field(default_factory=dict)  # of the effects of the final model
    opposed: tuple[OpposedSign, ...] = ()  # of the effects of the final model
    faults: tuple[SetUpFault, ...] = ()  # told before everything else
    failures: int
    runs: int
    wall_s: float = nan
    seed: int


@dataclass(frozen=True)
class HypothesisFit:
    """One hypothesis, recalibrated on the visible rows and scored on the vault."""

    effects: tuple[str, ...]
    strengths: Mapping[str, Estimate]
    parameters: Mapping[str, Estimate]
    chi2_per_row: float  # of the visible rows
    vault_chi2_per_row: float  # of the held-out rows; NaN with an empty vault
    vault_rmse: Mapping[str, float]  # by observable, in its unit
    rows: Rows
    vault_rows: Rows | None
    actions: Mapping[str, EffectAction] = field(default_factory=dict)  # of its effects
    correlations: tuple[Correlation, ...] = ()
    vault_p: float = nan  # of as large a `vault_chi2_per_row` if the model is adequate
    vault_log_score: float = nan  # per held-out row: ln of the density that was predicted for its value


@dataclass(frozen=True, kw_only=True)
class Adoption:
    """Answer of `adopt`: errors before and after an effect is added, beside effects that should not help."""

    effect: str  # several: a+b
    base: HypothesisFit
    added: HypothesisFit
    best_wrong: HypothesisFit | None = None
    random_wrong: HypothesisFit | None = None
    with_all: HypothesisFit | None = None  # with the effects that were named beside those adopted
    held_out: int = 0  # rows in the vault, with and without a value of the model
    vault_opened: int = 0
    contradicted: bool = False  # held-out rows fail no less with what was adopted
    doses: tuple["DoseEstimate", ...] = ()  # that held-out rows ask for, of an adopted law of a mechanism
    where: tuple[MisfitPlace, ...] = ()  # of the bare model
    unstated_scatter: tuple[str, ...] = ()  # sentences about held-out sources that state no scatter
    sentence: str = ""
    runs: int = 0
    wall_s: float = nan

    @property
    def fits(self) -> list[HypothesisFit]:
        """The model before and after, and the controls."""
        fits = (self.base, self.added, self.best_wrong, self.random_wrong, self.with_all)
        return [fit for fit in fits if fit is not None]
