"""Findings of fresh runs: simulations at fitted numbers, with seeds that no fit has used."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from taichi_erosion.evidence.data.problem import Floats

Outcome = Literal["confirmed", "contradicted", "undecided", "not_made"]
Role = Literal["told", "runner_up", "bare"]


@dataclass(frozen=True)
class EmulatorGap:
    """Where the emulator of one observable lies farthest from fresh runs, in sd of the difference."""

    observable: str
    conditions: Mapping[str, float]
    emulated: float  # in the unit of the observable
    emulated_sd: float
    simulated: float
    simulated_sd: float
    p: float  # of as large gaps at all conditions if the errors are as stated, Holm-adjusted


@dataclass(frozen=True)
class FreshSetting:
    """One explanation at its fitted numbers, by the emulator and by fresh runs."""

    role: Role
    effects: tuple[str, ...]
    chi2_per_row_emulated: float
    chi2_per_row_simulated: float
    log_odds_emulated: float  # ln odds of the explanation that is told over this one; NaN of itself
    log_odds_simulated: float
    log_odds_expected: float  # by as many fresh runs, were the emulator right
    gap: EmulatorGap | None  # the least likely one of its observables; None: no run gave a value


@dataclass(frozen=True)
class FreshRows:
    """Simulated values of all rows under one explanation, in the unit of the observable; NaN: none."""

    simulated: Floats
    simulated_sd: Floats  # standard error


@dataclass(frozen=True)
class FreshCheck:
    """What fresh runs say about an answer that an emulator has found."""

    outcome: Outcome
    settings: tuple[FreshSetting, ...] = ()
    agreement: float = float("nan")  # share of the seeds, each alone, that prefer what is told [1]
    runs: int = 0
    seeds: int = 0  # of every set of conditions
    failed: int = 0  # runs without a value
    needed: int = 0  # runs that the budget has no room for, where none was made
    more_runs: int = 0  # about these explanations, which the next `discover` makes
    sentence: str = ""
    rows: Mapping[Role, FreshRows] = field(default_factory=dict)  # for figures
