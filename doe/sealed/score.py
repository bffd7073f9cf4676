"""Scores of sealed cases against their targets, each with its 95 % Clopper-Pearson bounds."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

from doe.sealed.laboratory import Truth
from doe.sealed.oracle import Difficulty
from doe.sealed.solve import Outcome
from taichi_erosion.evidence.data.findings import NONE, OUTSIDE

STRONG, IDENTIFIABLE, DISTINCT = 7.0, 4.5, 3.0  # signal-to-noise ratios and separation [sd]
BINS = 10  # of probabilities
CONFIDENT = 0.9


@dataclass(frozen=True)
class Marked:
    """One case with its truth, difficulty and answer."""

    truth: Truth
    hard: Difficulty
    answer: Outcome
    further: bool = False  # asked for because cases of its kind are few; counts with that kind only

    @property
    def told(self) -> set[str]:
        """Every name that the answer gives, alone or in a group."""
        return {*self.answer.named, *self.answer.group}

    @property
    def right(self) -> bool:
        """The answer names what acts and nothing else."""
        return self.answer.verdict == "present" and set(self.answer.named) == set(self.truth.effects)

    @property
    def top(self) -> str:
        """The likeliest explanation that names effects."""
        named = {k: v for k, v in self.answer.probabilities.items() if k not in (NONE, OUTSIDE)}
        return max(named, key=lambda key: named[key]) if named else NONE


@dataclass(frozen=True)
class Metric:
    """One line of the table."""

    name: str
    value: float
    low: float
    high: float
    count: int
    target: str
    met: bool


def share(name: str, hits: Sequence[bool], target: tuple[str, float]) -> Metric:
    """A proportion and its bounds; the target is (relation, limit)."""
    n, k = len(hits), int(np.sum(hits))
    low = float(stats.beta.ppf(0.025, k, n - k + 1)) if k > 0 else 0.0
    high = float(stats.beta.ppf(0.975, k + 1, n - k)) if k < n else 1.0
    value = k / n if n else float("nan")
    relation, limit = target
    met = value <= limit if relation == "<=" else value >= limit
    return Metric(name, value, low, high, n, f"{relation} {limit:g}", bool(met))


def number(name: str, values: Sequence[float], target: tuple[str, float]) -> Metric:
    """A median with the quartiles of the values."""
    finite = np.array([value for value in values if np.isfinite(value)])
    if finite.size == 0:
        return Metric(name, float("nan"), float("nan"), float("nan"), 0, f"{target[0]} {target[1]:g}", False)
    value = float(np.median(finite))
    low, high = (float(q) for q in np.quantile(finite, [0.25, 0.75]))
    met = value <= target[1] if target[0] == "<=" else value >= target[1]
    return Metric(name, value, low, high, finite.size, f"{target[0]} {target[1]:g}", bool(met))


def scores(everything: Sequence[Marked]) -> Iterator[Metric]:
    """All metrics of the protocol."""
    cases = [case for case in everything if not case.further]

    def by_kind(kind: str) -> list[Marked]:
        return [case for case in cases if case.truth.kind == kind]

    yield from null_scores(by_kind("null"))
    yield from single_scores(by_kind("single"))
    yield from outside_scores(cases, by_kind("outside"))
    yield from pair_scores([case for case in everything if case.truth.kind == "pair"])
    impossible = [c for c in by_kind("impossible") if c.hard.separation < DISTINCT]
    lone = [c.answer.verdict != "present" for c in impossible]
    yield share("impossible designs: no lone name", lone, (">=", 0.97))
    yield calibration(cases)
    yield from coverage(cases)
    yield from vault_scores(by_kind("single"))
    yield number("seconds of one core per case", [c.answer.seconds for c in cases], ("<=", 0.3))


def null_scores(nulls: list[Marked]) -> Iterator[Metric]:
    """False alarms."""
    honest = [c for c in nulls if c.truth.understated == 1.0]
    yield share("nulls, sd as stated: any name", [bool(c.told) for c in honest], ("<=", 0.06))
    low = [c for c in nulls if c.truth.understated > 1.0]
    for repeats, words in ((True, "with repeats"), (False, "without repeats")):
        chosen = [c for c in low if c.truth.repeats == repeats]
        yield share(
            f"nulls, sd understated 1.5, {words}: any name", [bool(c.told) for c in chosen], ("<=", 0.10)
        )
    outside = [c.answer.verdict == "outside_library" for c in nulls]
    yield share("nulls: flagged as outside the library", outside, ("<=", 0.03))
    yield share(
        "nulls, sd as stated: family-wise p < 0.05", [c.answer.p < 0.05 for c in honest], ("<=", 0.06)
    )


def single_scores(singles: list[Marked]) -> Iterator[Metric]:
    """Names, groups and top ranks of single effects."""
    distinct = [c for c in singles if c.hard.separation >= DISTINCT]
    strong = [c for c in distinct if c.hard.ratio >= STRONG]
    middle = [c for c in distinct if IDENTIFIABLE <= c.hard.ratio < STRONG]
    yield share("single, ratio >= 7, distinct: ranked first", [is_top(c) for c in strong], (">=", 0.97))
    yield share("single, ratio >= 7, distinct: named alone", [c.right for c in strong], (">=", 0.93))
    yield share("single, ratio 4.5 to 7, distinct: ranked first", [is_top(c) for c in middle], (">=", 0.88))
    found = [c for c in singles if c.hard.ratio >= IDENTIFIABLE and c.told]
    yield share("single, ratio >= 4.5: told set holds the truth", [holds(c) for c in found], (">=", 0.95))
    yield number("single, ratio >= 4.5: mean size of the told set", mean_size(found), ("<=", 1.5))
    seen = [c for c in singles if c.hard.ratio >= IDENTIFIABLE]
    yield share("single, ratio >= 4.5: detected", [bool(c.told) for c in seen], (">=", 0.88))
    flagged = [c.answer.verdict == "outside_library" for c in seen]
    yield share("single, ratio >= 4.5: flagged as outside", flagged, ("<=", 0.01))
    yield share(
        "single, ratio >= 7: unstable", [c.answer.verdict == "unstable" for c in strong], ("<=", 0.03)
    )


def is_top(case: Marked) -> bool:
    """Whether the effect that acts is the likeliest explanation."""
    return set(case.top.split("+")) == set(case.truth.effects)


def holds(case: Marked) -> bool:
    """Whether the truth is among what was told."""
    return set(case.truth.effects) <= case.told


def mean_size(cases: list[Marked]) -> list[float]:
    """Mean number of names told, as one number."""
    return [float(np.mean([len(c.told) for c in cases]))] if cases else []


def outside_scores(cases: Sequence[Marked], outside: list[Marked]) -> Iterator[Metric]:
    """Effects that no candidate describes."""
    strong = [c for c in outside if c.hard.ratio >= STRONG and c.hard.separation >= STRONG]
    flagged = [c.answer.verdict == "outside_library" for c in strong]
    yield share("outside the library, ratio and separation >= 7: flagged", flagged, (">=", 0.95))
    apart = [c for c in outside if c.hard.separation >= DISTINCT]
    misnamed = [c.answer.verdict == "present" and confidence(c) > CONFIDENT for c in apart]
    yield share("outside the library, separation >= 3: named with > 0.9", misnamed, ("<=", 0.005))
    anywhere = [c.answer.verdict == "present" and confidence(c) > CONFIDENT for c in outside]
    yield share("outside the library, all: named with > 0.9", anywhere, ("<=", 0.03))


def confidence(case: Marked) -> float:
    """Probability of what was named."""
    return case.answer.probabilities.get(case.top, 0.0)


def pair_scores(pairs: list[Marked]) -> Iterator[Metric]:
    """Two effects at once."""
    strong = [c for c in pairs if c.hard.ratio >= STRONG and c.hard.separation >= DISTINCT]
    exact = [set(c.answer.named) == set(c.truth.effects) for c in strong]
    yield share("pair, both ratios >= 7, distinct: exact", exact, (">=", 0.93))
    one = [bool(c.told & set(c.truth.effects)) for c in strong]
    yield share("pair, both ratios >= 7, distinct: one right", one, (">=", 0.99))


def likeliest(cases: Sequence[Marked]) -> tuple[np.ndarray, np.ndarray]:
    """Probability of the likeliest claim of every case, and whether it is true.

    The claims are: nothing is missing; something outside the list is; these effects act, alone or with
    others. Impossible designs are left out: a twin of the truth cannot be told from it.
    """
    given, true = [], []
    for case in (case for case in cases if case.truth.kind != "impossible"):
        probability = case.answer.probabilities
        top = max(probability, key=lambda name: probability[name])
        if top in (NONE, OUTSIDE):
            given.append(probability[top])
            true.append(case.truth.kind == ("null" if top == NONE else "outside"))
        else:
            acting = set(top.split("+"))
            given.append(sum(p for names, p in probability.items() if acting <= set(names.split("+"))))
            true.append(acting <= set(case.truth.effects))
    return np.array(given), np.array(true, dtype=float)


def calibration_bins(cases: Sequence[Marked]) -> list[tuple[float, float, int]]:
    """Mean probability, share that is true and number of cases in BINS bins of the probability."""
    given, true = likeliest(cases)
    cell = np.minimum((given * BINS).astype(int), BINS - 1)
    return [
        (float(given[cell == k].mean()), float(true[cell == k].mean()), int(np.sum(cell == k)))
        for k in np.unique(cell)
    ]


def calibration(cases: Sequence[Marked]) -> Metric:
    """Expected calibration error of the probability of the likeliest explanation."""
    bins = calibration_bins(cases)
    count = sum(size for _, _, size in bins)
    error = sum(abs(given - true) * size for given, true, size in bins) / max(count, 1)
    nothing = float("nan")
    return Metric(
        "calibration error of the likeliest", error, nothing, nothing, count, "<= 0.03", error <= 0.03
    )


def coverage(cases: Sequence[Marked]) -> Iterator[Metric]:
    """Intervals of strengths and calibrated numbers where the truth was named or rightly found absent."""
    strengths, numbers = [], []
    for case in cases:
        if case.truth.understated > 1.0:
            continue
        if case.right:
            strengths += [
                low <= case.truth.effects[name] <= high
                for name, (_, low, high) in case.answer.strengths.items()
                if name in case.truth.effects
            ]
        if case.right or (case.truth.kind == "null" and not case.told):
            numbers += [
                low <= case.truth.parameters[path] <= high
                for path, (_, low, high) in case.answer.parameters.items()
                if path in case.truth.parameters
            ]
    for name, hits in (("strength", strengths), ("calibrated number", numbers)):
        metric = share(f"90 % interval of a {name}", hits, (">=", 0.88))
        yield Metric(
            metric.name,
            metric.value,
            metric.low,
            metric.high,
            metric.count,
            "0.88 to 0.92",
            0.88 <= metric.value <= 0.92,
        )


def vault_scores(singles: list[Marked]) -> Iterator[Metric]:
    """Held-out error before and after a right name, and with a random wrong effect."""
    named = [c for c in singles if c.right and np.isfinite(c.answer.vault[1]) and c.hard.ratio >= STRONG]
    ratio = [c.answer.vault[1] / c.answer.vault[0] for c in named]
    wrong = [c.answer.vault[2] / c.answer.vault[0] for c in named]
    yield number("held-out misfit after / before, right name", ratio, ("<=", 0.3))
    yield number("held-out misfit after / before, random wrong effect", wrong, (">=", 0.9))
    beats = [c.answer.vault[1] < c.answer.vault[2] for c in named if np.isfinite(c.answer.vault[2])]
    yield share("right name beats a random wrong effect on held-out rows", beats, (">=", 0.95))
