"""Faults of a set-up, which have to be known before an answer is read."""

from dataclasses import dataclass
from typing import Literal

FaultKind = Literal[
    "too_small",
    "not_converged",
    "no_value",
    "failed_runs",
    "too_few_rows",
    "repeats",
    "source_changed",
    "unit",
    "scatter",
]


@dataclass(frozen=True)
class SetUpFault:
    """Something about the set-up, not about physics, that has to be known before an answer is read."""

    kind: FaultKind
    place: str  # observable, or path of a calibrated number
    sentence: str
    blocks: bool  # the verdict on physics waits until this is settled
    rows: tuple[int, ...] = ()  # of the table, one of which is wrong
