"""What an evidence study finds: plain records, one field per figure that a report prints."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from taichi_erosion.evidence.data.problem import Floats

Verdict = Literal["present", "group", "none_detected", "outside_library", "not_testable", "unstable"]
Status = Literal["present", "excluded", "not_testable"]


@dataclass(frozen=True)
class ObservableMisfit:
    """Agreement of one observable, in its own unit where a unit applies."""

    n: int
    chi2: float  # NaN where the noise is unknown
    rmse: float
    bias: float  # mean of measured minus predicted
    p: float  # of a misfit as large by chance; NaN where the noise is unknown


@dataclass(frozen=True)
class MisfitPlace:
    """A place where the model fails."""

    observable: str
    axis: str  # a condition, or "level" for the observable as a whole
    p: float  # Holm-adjusted over all places looked at [1]
    sentence: str


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
    residual: Floats  # whitened: in standard deviations


@dataclass(frozen=True)
class Estimate:
    """A calibrated number with its 90 % interval."""

    value: float
    low: float
    high: float
    at_bound: bool  # the calibration wants to leave the allowed range


@dataclass(frozen=True)
class Comparison:
    """Does the model, calibrated as well as it can be, agree with the measurements?"""

    observables: Mapping[str, ObservableMisfit]
    where: tuple[MisfitPlace, ...]
    chi2: float
    dof: float
    p: float
    noise: Noise
    parameters: Mapping[str, Estimate]
    rows: Rows
    failures: int  # model values that could not be computed
    warnings: tuple[str, ...]
    runs: int
    wall_s: float


@dataclass(frozen=True)
class EffectFinding:
    """What the measurements say about one candidate effect."""

    status: Status
    strength: float
    strength_low: float  # 90 % interval
    strength_high: float  # for an excluded effect: the strength above which it is excluded (95 %)
    log_bayes_factor: float  # against the model without it
    power: float  # chance that the test would see it at its expected strength [1]
    absorption: float  # share of its signature that calibration can imitate [1]
    signature_norm: float  # what is left of the signature at expected strength, in standard deviations
    probability: float  # that it acts, alone or with others [1]
    p: float  # family-wise, step-down
    held_out_gain: float  # log score of left-out groups, against the model without it
    held_out_error: float  # its standard error
    sentence: str


@dataclass(frozen=True)
class Law:
    """A hypothesis for an effect that no library holds: correction = sum_j c_j prod_i x_i^p_ij."""

    observable: str
    expression: str
    terms: tuple[Mapping[str, float], ...]  # condition -> power
    coefficients: tuple[float, ...]
    held_out_share: float  # share of the misfit that left-out groups see explained [1]


@dataclass(frozen=True)
class ResidualTrend:
    """What can be learnt when the missing effect is not in the library."""

    observable: str
    axis: str
    sign: int  # +1: measured above predicted at the upper end of the axis
    exponent: float  # of the scaling with the axis; NaN where the axis is not positive
    exponent_low: float  # 90 % interval
    exponent_high: float
    sentence: str
    law: Law | None


@dataclass(frozen=True)
class Experiment:
    """A measurement worth making next."""

    observable: str
    conditions: Mapping[str, float]
    predictions: Mapping[str, tuple[float, float]]  # hypothesis -> mean and sd, in the observable's unit
    chance: float  # that this and the experiments before it decide [1]
    cost: float
    sentence: str


@dataclass(frozen=True)
class VaultErrors:
    """Misfit per held-out row before and after; NaN until the vault has been opened."""

    opened: int
    chi2_before: float
    chi2_after: float
    chi2_wrong_effect: float


@dataclass(frozen=True)
class PlausibleHypothesis:
    """An explanation that is still standing: what the next experiment has to tell from the others."""

    names: tuple[str, ...]
    probability: float
    parameters: Mapping[str, float]
    strengths: Mapping[str, float]


@dataclass(frozen=True)
class Discovery:
    """Which effect is missing, as far as these measurements can tell."""

    verdict: Verdict
    named: tuple[str, ...]
    group: tuple[str, ...]  # effects that these measurements do not tell apart
    probabilities: Mapping[str, float]  # "none", "outside_library", every effect, "a+b" for pairs; sums to 1
    effects: Mapping[str, EffectFinding]
    parameters: Mapping[str, Estimate]  # calibrated with what was named
    where: tuple[MisfitPlace, ...]
    chi2_before: float
    chi2_after: float
    n: int
    vault: VaultErrors
    next_experiments: tuple[Experiment, ...]
    clues: tuple[ResidualTrend, ...]
    p: float  # family-wise, of the strongest candidate by chance
    p_misfit: float  # of the calibrated base model
    p_misfit_after: float  # of the recalibrated model with what is named; without a name, as before
    decoy_rank: int  # rank of the best made-up effect among all candidates; 1 is a red flag
    stability: float  # share of repeats with new seeds that agree on the verdict's first name [1]
    sentences: tuple[str, ...]
    warnings: tuple[str, ...]
    noise: Noise
    ambiguity: Mapping[str, tuple[str, ...]]  # effect -> effects with which it forms a group
    absorbed_by: Mapping[str, str]  # effect -> parameter that imitates it best
    survivors: tuple[PlausibleHypothesis, ...]
    closest: tuple[
        PlausibleHypothesis, ...
    ]  # the single effect and the pair that leave least, however unlikely
    rows_before: Rows
    rows_after: Rows
    failures: int
    runs: int
    wall_s: float
    seed: int


@dataclass(frozen=True)
class HypothesisFit:
    """One hypothesis, recalibrated on the visible rows and scored on the vault."""

    effects: tuple[str, ...]
    strengths: Mapping[str, Estimate]
    parameters: Mapping[str, Estimate]
    chi2: float  # per visible row
    vault_chi2: float  # per held-out row; NaN with an empty vault
    vault_rmse: Mapping[str, float]  # by observable, in its unit
    rows: Rows
    vault_rows: Rows | None


@dataclass(frozen=True)
class Adoption:
    """The error before and after an effect is added, beside effects that should not help."""

    effect: str
    base: HypothesisFit
    added: HypothesisFit
    best_wrong: HypothesisFit | None
    random_wrong: HypothesisFit | None
    vault_opened: int
    sentence: str
    runs: int
    wall_s: float
