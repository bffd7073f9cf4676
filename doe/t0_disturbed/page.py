"""The page of the disturbed cases: answers by kind and disturbance, and targets with bounds."""

from collections.abc import Iterator, Sequence
from math import isfinite
from pathlib import Path

from doe.sealed.score import Metric, number, share
from doe.t0_disturbed.cases import SIZES
from doe.t0_disturbed.trial import Judged, judged, read_results
from taichi_erosion.core.files import write_atomic
from taichi_erosion.report.markdown import fill_tables, markdown_table

STRONG = 7.0  # ratio [sd]
RATIOS = ((1.0, 2.0), (2.0, 3.0), (3.0, 4.5), (4.5, 7.0), (7.0, float("inf")))


def publish(folder: Path) -> None:
    """Fill the tables of the page, one for every set and method."""
    page, tables = folder / "README.md", {}
    for path in sorted((folder / "results").glob("*.csv")):
        rows = read_results(path)
        for method in dict.fromkeys(row["method"] for row in rows):
            cases = judged([row for row in rows if row["method"] == method])
            tables[f"{path.stem} {method}"] = metric_table(cases)
            tables[f"{path.stem} {method} by disturbance"] = disturbance_table(cases)
    text = page.read_text(encoding="utf-8")
    present = {name: table for name, table in tables.items() if f"<!-- table: {name} -->" in text}
    write_atomic(page, fill_tables(text, present).encode())


def flagged(case: Judged) -> bool:
    """Whether the answer says that something outside the list is missing."""
    return case.answer.verdict == "outside_library"


def exact(case: Judged) -> bool:
    """Whether the answer names what acts and nothing else."""
    return case.answer.verdict == "present" and set(case.answer.named) == set(case.truth.effects)


def held(case: Judged) -> bool:
    """Whether all that acts is among what is told."""
    return bool(case.truth.effects) and set(case.truth.effects) <= case.told


def metrics(cases: Sequence[Judged]) -> Iterator[Metric]:
    """Every metric with its target."""
    nulls = [case for case in cases if case.truth.kind == "null"]
    yield share("nulls: any name", [bool(c.told) for c in nulls], ("<=", 0.02))
    yield share('nulls: "not in the list"', [flagged(c) for c in nulls], ("<=", 0.05))
    singles = [case for case in cases if case.truth.kind == "single"]
    for low, high in RATIOS:
        some = [c for c in singles if low <= c.hard.ratio < high]
        words = f"single, ratio {low:g} to {high:g}" if isfinite(high) else f"single, ratio >= {low:g}"
        target = {3.0: (">=", 0.74), STRONG: (">=", 0.95)}.get(low, (">=", 0.0))
        yield share(f"{words}: right or in the told set", [held(c) for c in some], target)
        yield share(f"{words}: named alone", [exact(c) for c in some], (">=", 0.0))
        yield share(f"{words}: not in the list", [flagged(c) for c in some], ("<=", 1.0))
    for kind in ("pair", "triple", "four"):
        some = [c for c in cases if c.truth.kind == kind and c.hard.ratio >= STRONG]
        yield share(f"{kind}, all ratios >= {STRONG:g}: exact", [exact(c) for c in some], (">=", 0.8))
        false = [not c.told - set(c.truth.effects) for c in some]
        yield share(f"{kind}, all ratios >= {STRONG:g}: none false", false, (">=", 0.97))
    outside = [c for c in cases if c.truth.kind == "outside" and c.hard.separation >= STRONG]
    yield share(
        f"not in the list, separation >= {STRONG:g}: flagged", [flagged(c) for c in outside], (">=", 0.95)
    )
    beyond = [c for c in singles if c.truth.disturbance == "beyond" and c.hard.ratio >= STRONG]
    yield share("single beyond the maximum: named", [held(c) for c in beyond], (">=", 0.9))
    yield from intervals(cases)
    yield number("seconds of one core per case", [c.answer.seconds for c in cases], ("<=", 0.5))


def intervals(cases: Sequence[Judged]) -> Iterator[Metric]:
    """Intervals of strengths that are told, and of calibrated numbers, over all cases."""
    strengths = [
        low <= case.truth.effects[name] <= high
        for case in cases
        if case.truth.disturbance != "form"
        for name, (_, low, high) in case.answer.strengths.items()
        if name in case.truth.effects
    ]
    yield share("90 % interval of a named strength", strengths, (">=", 0.87))
    for words, chosen in (
        ("all cases", list(cases)),
        ("smooth discrepancy", [c for c in cases if c.truth.disturbance == "discrepancy"]),
    ):
        hits = [
            low <= case.truth.parameters[path] <= high
            for case in chosen
            for path, (_, low, high) in case.answer.parameters.items()
            if path in case.truth.parameters
        ]
        yield share(f"90 % interval of a calibrated number, {words}", hits, (">=", 0.87))


def bound_met(metric: Metric) -> Metric:
    """The metric, met where its bound on the side of the target is; a median by itself."""
    if metric.name.startswith("seconds"):
        return metric
    relation, limit = metric.target.split()
    met = metric.high <= float(limit) if relation == "<=" else metric.low >= float(limit)
    return Metric(metric.name, metric.value, metric.low, metric.high, metric.count, metric.target, met)


def metric_table(cases: Sequence[Judged]) -> str:
    """Every metric with its bounds, the number of cases behind it, and its target."""
    rows = [
        (
            m.name,
            f"{m.value:.3f}" if m.count else "none",
            f"{m.low:.3f} to {m.high:.3f}" if m.count else "",
            str(m.count),
            "" if m.target in (">= 0", "<= 1") else m.target,
            "" if not m.count or m.target in (">= 0", "<= 1") else "yes" if m.met else "**no**",
        )
        for m in map(bound_met, metrics(cases))
    ]
    return markdown_table(("metric", "value", "bounds", "cases", "target", "met"), rows)


def disturbance_table(cases: Sequence[Judged]) -> str:
    """Answers on nulls and on singles of ratio 4.5 or more, disturbance by disturbance."""
    rows = []
    for name in SIZES:
        own = [case for case in cases if case.truth.disturbance == name]
        nulls = [case for case in own if case.truth.kind == "null"]
        singles = [case for case in own if case.truth.kind == "single" and case.hard.ratio >= 4.5]
        told, flags = sum(bool(c.told) for c in nulls), sum(map(flagged, nulls))
        one = (len(nulls), len(nulls) - told - flags, flags, told)
        right, outside = sum(map(held, singles)), sum(map(flagged, singles))
        two = (len(singles), right, outside, sum(bool(c.told) and not held(c) for c in singles))
        rows.append((name.replace("_", " "), *map(str, one), *map(str, two)))
    total = [str(sum(int(row[k]) for row in rows)) for k in range(1, 9)]
    header = (
        "disturbance", "nulls", "silent", "not in the list", "named",
        "singles, ratio >= 4.5", "right or in the set", "not in the list", "wrong",
    )  # fmt: skip
    return markdown_table(header, [*rows, ("all", *total)])
