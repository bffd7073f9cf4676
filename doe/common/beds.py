"""Fluid thresholds bed by bed: cases simulated in processes of their own, and their table."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import exp, isfinite, nan, sqrt
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import t as student

from doe.common.cases import Case, document_of, method_commit
from doe.common.tables import read_table, write_table
from taichi_erosion.core.errors import BadInput
from taichi_erosion.measures.result import Measurement
from taichi_erosion.measures.threshold import CONFIDENCE, Bracket, bracketed, pool_beds


@dataclass(frozen=True)
class Bed:
    """The winds between which one bed of a case starts."""

    case: str
    hold: float  # s, in which it may start
    seed: int
    low: float  # m s-1, highest wind that it withstood
    high: float  # m s-1, lowest wind that moved it
    wall_s: float  # of all beds of the case
    command: str
    commit: str


def simulate(scene: str, case: Case) -> list[Bed]:
    """Beds of one case but those that a guard stopped. Raises BadInput where none is left."""
    typed, document, reason = document_of(scene, case)
    if document is None:
        raise BadInput(f"{case.label}: {reason}")
    hold, made = document["resolved"]["threshold"]["hold"], (typed, method_commit())
    found = [(each["seed"], each["measures"].get("threshold_u_star")) for each in document["replicas"]]
    return [
        Bed(case.label, hold, seed, one["details"]["low"], one["details"]["high"], document["wall_s"], *made)
        for seed, one in found
        if one and one["details"]
    ]


def read_beds(table: Path) -> list[Bed]:
    """All beds of a table."""
    return read_table(table, Bed)


def write_beds(table: Path, fresh: Sequence[Bed], order: Sequence[str]) -> None:
    """Replace the beds of these cases in a table, which has the order of the cases."""
    done = {(bed.case, bed.hold) for bed in fresh}
    rows = [*(bed for bed in read_beds(table) if (bed.case, bed.hold) not in done), *fresh]
    write_table(table, Bed, sorted(rows, key=lambda bed: (order.index(bed.case), bed.hold, bed.seed)))


def found_in(beds: Sequence[Bed]) -> dict[str, dict[int, Bracket]]:
    """Brackets by case and seed."""
    cases: dict[str, dict[int, Bracket]] = {}
    for bed in beds:
        cases.setdefault(bed.case, {})[bed.seed] = Bracket(bed.low, bed.high)
    return cases


def pooled(brackets: Mapping[Any, Bracket]) -> Measurement:
    """Threshold of some beds together."""
    return pool_beds([bracketed("threshold_u_star", each) for each in brackets.values()])


def shown(found: Measurement) -> str:
    """A threshold with its interval."""
    if not isfinite(found.value):
        return "none"
    ends = found.details["interval"]
    return f"{found.value:.3f} ({ends['low']:.3f} to {ends['high']:.3f})"


def paired_ratio(one: Mapping[Any, Bracket], other: Mapping[Any, Bracket]) -> tuple[float, float, int]:
    """Ratio of two cases over their common beds, its factor of uncertainty at 95 %, and the beds."""
    common = sorted(set(one) & set(other))
    logs = np.log([one[seed].middle / other[seed].middle for seed in common])
    if len(common) < 2:
        return nan, nan, len(common)
    half = student.ppf(0.5 + 0.5 * CONFIDENCE, len(common) - 1) * logs.std(ddof=1) / sqrt(len(common))
    return exp(logs.mean()), exp(half), len(common)
