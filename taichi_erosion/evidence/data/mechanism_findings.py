"""Findings beyond the list of effects: mechanisms, the doses that the measurements ask for, and their law."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

from taichi_erosion.evidence.data.findings import Estimate

BeyondVerdict = Literal["mechanism", "group", "none"]
GAIN, OFFSET = "reading_gain", "reading_offset"  # mechanisms of instruments
OF = ":"  # between such a mechanism and its observable
INSTRUMENT = "instrument"  # its gain and offset, where these measurements do not tell them apart


def told_members(group: Sequence[str]) -> tuple[str, ...]:
    """Members of a group as they are told: gain and offset of one instrument are one member."""
    read = Counter(name.partition(OF)[2] for name in group)
    told = []
    for name in group:
        _, _, observable = name.partition(OF)
        told.append(f"{INSTRUMENT}{OF}{observable}" if observable and read[observable] > 1 else name)
    return tuple(dict.fromkeys(told))


@dataclass(frozen=True)
class DoseEstimate:
    """Dose that one set of conditions asks for."""

    conditions: Mapping[str, float]
    dose: float  # [1]
    sd: float  # [1], calibrated numbers and shared errors integrated out
    law: float  # dose of the law there [1]; NaN without a law


@dataclass(frozen=True)
class DoseLaw:
    """Law that the doses follow: a form with its numbers and their 90 % intervals."""

    form: str  # name of the form
    expression: str  # the law in writing, of conditions as the study has them
    conditions: tuple[str, ...]
    numbers: Mapping[str, Estimate]  # of the expression
    exponents: Mapping[str, Estimate]  # condition -> exponent, where the form leaves it free
    score: float  # ln score of left-out groups over that without any dose
    held_out_share: (
        float  # share of the misfit of left-out groups that it explains, the form chosen without them
    )
    stability: float  # share of the left-out groups without which the same form is chosen [1]
    python: str  # the same as a Python expression of `dose_of`
    points: tuple[tuple[Mapping[str, float], float], ...]  # conditions, and the dose there [1]
    table: tuple[tuple[Mapping[str, float], float], ...] = ()  # the same at all that were measured
    curve: tuple[tuple[float, float, float], ...] = ()  # of one condition: its value, the dose, its sd


@dataclass(frozen=True)
class MechanismFinding:
    """What one mechanism explains."""

    name: str
    title: str
    meaning: str  # of its dose
    observable: str  # whose readings an instrument changes; "" for physics
    log_bayes_factor: float  # against the bare model
    odds: float  # of the best mechanism over this one [1]
    p_left: float  # of the misfit that it leaves
    p_one_dose: float  # of one dose for all observables; NaN where it moves one only
    moves: tuple[str, ...]  # observables that it moves
    axis: str  # condition along which its doses vary; "" for all together
    curvature: float  # of the model along the doses within their error [1]
    explains: bool  # enough evidence, no misfit left, one dose for all observables
    scale: float = float("nan")  # offset of a dose of 1, in the unit of the observable; NaN for others


@dataclass(frozen=True)
class StrengthTrend:
    """A listed effect whose strength would have to vary along a condition: by another power of it."""

    effect: str
    condition: str
    p: float  # chance of as much if one strength serves all conditions
    exponent: Estimate | None  # of the condition, beyond that of the law of the list
    share: float = float("nan")  # of what one strength leaves, which that power takes away [1]


@dataclass(frozen=True)
class BeyondList:
    """Where something is missing, and the law that it follows, where no listed effect explains a misfit.

    Where one is named, mechanisms stand beside it that explain as much, or more: it is then withdrawn.
    """

    verdict: BeyondVerdict
    mechanisms: tuple[MechanismFinding, ...]  # best first
    group: tuple[str, ...]  # names that these measurements do not separate, best first
    log_bayes_discrepancy: float  # of a free smooth discrepancy of every observable, against the bare model
    log_bayes_listed: float  # of the best listed effects
    listed: str  # those: a+b
    doses: tuple[DoseEstimate, ...]  # of the best mechanism
    law: DoseLaw | None  # of the best mechanism
    named: tuple[str, ...] = ()  # listed effects against which the mechanisms were weighed
    named_odds: float = float("nan")  # of the best mechanism over these [1]
    withdrawn: bool = False  # whether these were named before, and are no longer
    sentences: tuple[str, ...] = ()
