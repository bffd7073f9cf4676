"""The page of the cases beyond the list: every target of the method, met or missed by its bound."""

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy import stats

from doe.beyond.trial import read_results
from doe.sealed.score import Metric, share
from taichi_erosion.core.files import write_atomic
from taichi_erosion.evidence.data.mechanism_findings import told_members
from taichi_erosion.report.markdown import fill_tables, markdown_table

STRONG = 7.0  # ratio [sd]
MOST_TOLD = 3  # members of a group; gain and offset of one instrument are one
TAIL = 0.025  # to either side of a bound
NO_TARGET = ("<=", 1.0)


@dataclass(frozen=True)
class Opened:
    """One case with its truth, its ratio and its answer."""

    truth: dict[str, Any]
    ratio: float
    answer: dict[str, Any]

    @property
    def group(self) -> tuple[str, ...]:
        """Mechanisms told."""
        return tuple(self.answer.get("mechanisms") or ())

    @property
    def holds(self) -> bool:
        """Whether the mechanism that acts is told."""
        return self.truth["name"] in self.group

    @property
    def unchallenged(self) -> bool:
        """Whether an effect is named and neither a mechanism nor another law of it is told."""
        return self.answer["verdict"] == "present" and not self.group and "trend" not in self.answer

    @property
    def exponent(self) -> tuple[float, float, float] | None:
        """Exponent that acts, and the interval told; None without a power of that mechanism."""
        truth, law = self.truth, self.answer.get("law")
        told = law["exponents"].get(truth["condition"]) if law else None
        if truth["form"] != "power" or told is None or self.group[0] != truth["name"]:
            return None
        sign = 1.0 if truth["condition"] == "moisture" else -1.0
        return sign * truth["exponent"], told["low"], told["high"]


def publish(folder: Path) -> None:
    """Fill the tables of the page, one for every set."""
    page = folder / "README.md"
    text = page.read_text(encoding="utf-8")
    sets = {path.stem: path for path in sorted((folder / "results").glob("*.csv"))}
    tables = {
        name: metric_table(opened(path)) for name, path in sets.items() if f"<!-- table: {name} -->" in text
    }
    write_atomic(page, fill_tables(text, tables).encode())


def opened(table: Path) -> list[Opened]:
    """Cases of a table of results."""
    return [
        Opened(json.loads(row["truth"]), float(row["ratio"]), json.loads(row["answer"]))
        for row in read_results(table)
    ]


def metric_table(cases: Sequence[Opened]) -> str:
    """Every metric with its bounds, the number of cases behind it, and whether the bound meets the target."""
    rows = []
    for m in map(met_by_bound, metrics(cases)):
        target = "" if m.target == "<= 1" else m.target
        told = (f"{m.value:.3f}", f"{m.low:.3f} to {m.high:.3f}") if m.count else ("none", "")
        met = "" if not target or not m.count else "yes" if m.met else "**no**"
        rows.append((m.name, *told, str(m.count), target, met))
    return markdown_table(("metric", "value", "bounds", "cases", "target", "met by the bound"), rows)


def met_by_bound(metric: Metric) -> Metric:
    """The metric, met where its bound on the side of the target is."""
    relation, limit = metric.target.split()
    met = metric.high <= float(limit) if relation == "<=" else metric.low >= float(limit)
    return Metric(metric.name, metric.value, metric.low, metric.high, metric.count, metric.target, met)


def median(name: str, values: Sequence[float], target: tuple[str, float]) -> Metric:
    """A median with the order statistics between which it lies with 95 %."""
    ordered = np.sort(values)
    n = ordered.size
    if n == 0:
        return Metric(name, float("nan"), float("nan"), float("nan"), 0, f"{target[0]} {target[1]:g}", False)
    last = int(stats.binom.ppf(TAIL, n, 0.5))
    low, high = (float(ordered[k]) for k in (max(last - 1, 0), min(n - last, n - 1)))
    return Metric(name, float(np.median(ordered)), low, high, n, f"{target[0]} {target[1]:g}", False)


def metrics(cases: Sequence[Opened]) -> Iterator[Metric]:
    """All metrics."""
    outside = [c for c in cases if c.truth["kind"] == "outside" and c.ratio >= STRONG]
    nulls = [c for c in cases if c.truth["kind"] == "null"]
    listed = [c for c in cases if c.truth["kind"] == "listed" and c.ratio >= STRONG]
    yield from outside_metrics(outside)
    yield share("nulls: any mechanism", [bool(c.group) for c in nulls], ("<=", 0.02))
    yield share("nulls: any listed effect named", [bool(c.answer["named"]) for c in nulls], ("<=", 0.02))
    named = [c.answer["verdict"] == "present" and c.answer["named"] == [c.truth["name"]] for c in listed]
    yield share("listed, ratio >= 7: named", named, (">=", 0.93))
    alone = [right and c.unchallenged for right, c in zip(named, listed, strict=True)]
    yield share("listed, ratio >= 7: named, nothing beside it", alone, NO_TARGET)
    asked = [c.answer["seconds"] for c in cases if "beyond" in c.answer]
    yield median("seconds of one core, with mechanisms", asked, ("<=", 5.0))
    yield median("seconds of one core, all cases", [c.answer["seconds"] for c in cases], NO_TARGET)


def outside_metrics(outside: Sequence[Opened]) -> Iterator[Metric]:
    """Metrics of strong cases in which a mechanism acts."""
    few = [len(told_members(c.group)) <= MOST_TOLD for c in outside]
    right = [c.holds and short for c, short in zip(outside, few, strict=True)]
    words = "outside, ratio >= 7"
    yield share(f"{words}: asked for a mechanism", ["beyond" in c.answer for c in outside], NO_TARGET)
    yield share(f"{words}: mechanism told, alone or in a group of at most three", right, (">=", 0.8))
    yield share(
        f"{words}: mechanism told first", [c.group[:1] == (c.truth["name"],) for c in outside], NO_TARGET
    )
    yield share(f"{words}: mechanism in the group told", [c.holds for c in outside], NO_TARGET)
    wrong = [len(c.group) == 1 and not c.holds for c in outside]
    yield share(f"{words}: wrong mechanism alone", wrong, ("<=", 0.05))
    yield share(
        f"{words}: a listed effect named, nothing beside it", [c.unchallenged for c in outside], NO_TARGET
    )
    beside = [c.answer["verdict"] == "present" and not c.unchallenged for c in outside]
    yield share(f"{words}: a listed effect named, a mechanism or another law told with it", beside, NO_TARGET)
    told = [c.exponent for c in outside]
    held = [low <= true <= high for true, low, high in filter(None, told)]
    yield share("power laws, mechanism right: exponent in its 90 % interval", held, (">=", 0.85))
    errors = [c.answer["held_out"] for c in outside if c.answer.get("held_out")]
    ratios = [after / before for before, after in errors]
    yield median(f"{words}: held-out misfit after over before, median", ratios, ("<=", 0.3))
