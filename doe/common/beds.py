"""Fluid thresholds bed by bed: cases simulated in processes of their own, and their table."""

import json
import shlex
import subprocess
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from math import exp, isfinite, nan, sqrt
from typing import Any

import numpy as np
from scipy.stats import t as student

from doe.common.cases import ROOT, Case, command, method_commit
from taichi_erosion.core.errors import BadInput
from taichi_erosion.measures.result import Measurement
from taichi_erosion.measures.threshold import CONFIDENCE, Bracket, bracketed, pool_beds


@dataclass(frozen=True)
class Start:
    """The winds between which one bed starts."""

    seed: int
    low: float  # m s-1, highest wind that it withstood
    high: float  # m s-1, lowest wind that moved it
    wall_s: float  # of all beds of the case
    command: str
    commit: str


def simulate(scene: str, case: Case) -> list[Start]:
    """Beds of one case; those that a guard stopped have none. Raises BadInput where the run is refused."""
    typed = command(scene, case)
    program = [sys.executable, "-m", "taichi_erosion", *typed]
    done = subprocess.run(program, cwd=ROOT, capture_output=True, text=True, check=False)
    if not done.stdout:
        raise BadInput(f"{case.label}: {(done.stderr.strip().splitlines() or ['no answer'])[-1]}")
    return starts_of(json.loads(done.stdout), shlex.join(["./erosion", *typed]), method_commit())


def starts_of(document: dict[str, Any], typed: str, made: str) -> list[Start]:
    """Beds of the document that `run --json` prints."""
    found = [(each["seed"], each["measures"].get("threshold_u_star")) for each in document["replicas"]]
    return [
        Start(seed, one["details"]["low"], one["details"]["high"], document["wall_s"], typed, made)
        for seed, one in found
        if one and one["details"]
    ]


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
