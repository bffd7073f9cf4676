"""Answered cases of trials, and shares and medians over them with 95 % bounds beside their targets."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf, isfinite, nan
from typing import Any

import numpy as np
from scipy import stats

from doe.trials.table import Row

NONE, OUTSIDE = "none", "outside_library"  # explanations that name nothing
ACTING = ("null", "single", "pair", "triple", "four")  # kinds by the number of effects that act
MOST_TOLD = 3  # members of a group that is an answer
STRONG, IDENTIFIABLE, DISTINCT = 7.0, 4.5, 3.0  # signal-to-noise ratios and separation [sd]
CONFIDENT = 0.9
TAIL = 0.025  # to either side of a bound
HEADER = ("metric", "value", "bounds", "cases", "target", "met by the bound")


@dataclass(frozen=True)
class Case:
    """One case with its truth, difficulty and answer."""

    row: Row

    @property
    def truth(self) -> dict[str, Any]:
        return self.row["truth"]

    @property
    def answer(self) -> dict[str, Any]:
        return self.row["answer"]

    @property
    def kind(self) -> str:
        """One of ACTING, impossible, unlisted (an effect that is not in the list), mechanism."""
        kind = self.truth["kind"]
        if kind == "outside":
            return "mechanism" if "form" in self.truth else "unlisted"
        return kind if kind in ("null", "impossible") else ACTING[len(self.acting)]

    @property
    def acting(self) -> set[str]:
        """Listed or unlisted effects that act."""
        return set(self.truth["effects"] if "effects" in self.truth else self.listed)

    @property
    def listed(self) -> dict[str, float]:
        """The listed effect of a case beyond the list, if that acts."""
        return {self.truth["name"]: self.truth["size"]} if self.truth["kind"] == "listed" else {}

    @property
    def named(self) -> set[str]:
        return set(self.answer["named"])

    @property
    def told(self) -> set[str]:
        """Every name that the answer gives, alone or in a group."""
        return self.named | set(self.answer["group"])

    @property
    def exact(self) -> bool:
        """The answer names what acts and nothing else."""
        return self.answer["verdict"] == "present" and self.named == self.acting

    @property
    def held(self) -> bool:
        """All that acts is among what is told."""
        return bool(self.acting) and self.acting <= self.told

    @property
    def flagged(self) -> bool:
        """The answer says that something outside the list is missing."""
        return self.answer["verdict"] == "outside_library"

    @property
    def mechanisms(self) -> tuple[str, ...]:
        """Mechanisms told, best first."""
        return tuple(self.answer.get("mechanisms") or ())

    @property
    def ratio(self) -> float:
        return self.row["difficulty"]["ratio"]

    @property
    def separation(self) -> float:
        separation = self.row["difficulty"].get("separation")
        return inf if separation is None else separation

    @property
    def top(self) -> str:
        """The likeliest explanation that names effects."""
        named = {k: v for k, v in self.answer["probabilities"].items() if k not in (NONE, OUTSIDE)}
        return max(named, key=lambda key: named[key]) if named else NONE

    @property
    def misnamed(self) -> bool:
        """Something is named with confidence, with the one strength that its law has."""
        likely = self.answer.get("probabilities", {}).get(self.top, 0.0)
        return self.answer["verdict"] == "present" and likely > CONFIDENT and not self.varying

    @property
    def varying(self) -> set[str]:
        """Effects that are named with a strength that varies: their law is another one."""
        return self.named - set(self.answer.get("strengths", self.named))

    def intervals(self, what: str) -> list[bool]:
        """Whether each interval (`strengths` of what acts, `parameters`) holds the truth."""
        truth = self.truth["parameters"]
        if what == "strengths":
            truth = self.truth.get("effects", self.listed)
        known = self.answer.get(what, {})
        return [low <= truth[name] <= high for name, (_, low, high) in known.items() if name in truth]


Cases = Sequence[Case]


def of_kind(cases: Cases, *kinds: str) -> list[Case]:
    return [case for case in cases if case.kind in kinds]


@dataclass(frozen=True)
class Metric:
    """One line of a table."""

    name: str
    value: float
    low: float
    high: float
    count: int
    target: str = ""  # "<= limit", ">= limit", or empty

    @property
    def met(self) -> bool:
        """The bound on the side of the target meets it."""
        relation, limit = self.target.split()
        return self.high <= float(limit) if relation == "<=" else self.low >= float(limit)

    def cells(self) -> tuple[str, ...]:
        met = "" if not self.target or not self.count else "yes" if self.met else "**no**"
        told = ("none", "")
        if self.count:
            told = (f"{self.value:.3f}", f"{self.low:.3f} to {self.high:.3f}" if isfinite(self.low) else "")
        return (self.name, *told, str(self.count), self.target, met)


def share(name: str, hits: Sequence[bool], target: str = "") -> Metric:
    """A proportion and its bounds."""
    n, k = len(hits), int(np.sum(hits))
    low = float(stats.beta.ppf(TAIL, k, n - k + 1)) if k > 0 else 0.0
    high = float(stats.beta.ppf(1.0 - TAIL, k + 1, n - k)) if k < n else 1.0
    return Metric(name, k / n if n else nan, low, high, n, target)


def median(name: str, values: Sequence[float | None], target: str = "") -> Metric:
    """A median and its bounds."""
    ordered = np.sort([value for value in values if value is not None])
    n = ordered.size
    if n == 0:
        return Metric(name, nan, nan, nan, 0, target)
    last = int(stats.binom.ppf(TAIL, n, 0.5))
    low, high = (float(ordered[k]) for k in (max(last - 1, 0), min(n - last, n - 1)))
    return Metric(name, float(np.median(ordered)), low, high, n, target)
