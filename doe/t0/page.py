"""The page of a trial by sealed cases: every metric beside its target, from the table of results."""

import csv
from collections.abc import Sequence
from math import isfinite
from pathlib import Path

from doe.sealed.cases import KINDS
from doe.sealed.score import IDENTIFIABLE, STRONG, Marked, Metric, calibration_bins, scores
from doe.sealed.trial import marked
from taichi_erosion.core.files import write_atomic
from taichi_erosion.report.markdown import fill_tables, markdown_table

TABLES = {"results": "", "fresh": "fresh "}  # table of results -> words before its tables on the page


def publish(folder: Path) -> None:
    """Fill the tables of the page from the tables of results."""
    csv.field_size_limit(1_000_000)
    page, tables = folder / "README.md", dict[str, str]()
    for stem, words in TABLES.items():
        path = folder / f"{stem}.csv"
        if not path.exists():
            continue
        with path.open(encoding="utf-8", newline="") as file:
            cases = marked(list(csv.DictReader(file)))
        tables[f"{words}cases"] = case_table(cases)
        tables[f"{words}metrics"] = metric_table(list(scores(cases)))
        tables[f"{words}calibration"] = calibration_table([case for case in cases if not case.further])
    write_atomic(page, fill_tables(page.read_text(encoding="utf-8"), tables).encode())


def case_table(cases: Sequence[Marked]) -> str:
    """How many cases of every kind were solved, and how many of them could be seen at all."""
    rows = []
    for kind in KINDS:
        ratios = [case.hard.ratio for case in cases if case.truth.kind == kind]
        seen = [sum(ratio >= least for ratio in ratios) for least in (IDENTIFIABLE, STRONG)]
        rows.append((kind, str(len(ratios)), *("" if kind == "null" else str(count) for count in seen)))
    total = ("all", str(len(cases)), "", "")
    header = ("kind", "cases", f"ratio >= {IDENTIFIABLE:g}", f"ratio >= {STRONG:g}")
    return markdown_table(header, [*rows, total])


def metric_table(metrics: Sequence[Metric]) -> str:
    """Every metric with its bounds, the number of cases behind it, and its target."""
    rows = [
        (
            metric.name,
            f"{metric.value:.3f}" if isfinite(metric.value) else "none",
            f"{metric.low:.3f} to {metric.high:.3f}" if isfinite(metric.low) else "",
            str(metric.count),
            metric.target,
            ("yes" if metric.met else "**no**") if metric.count else "",
        )
        for metric in metrics
    ]
    return markdown_table(("metric", "value", "bounds", "cases", "target", "met"), rows)


def calibration_table(cases: Sequence[Marked]) -> str:
    """Probability given to the likeliest explanation, and how often it was the truth."""
    rows = [
        (f"{given:.2f}", f"{true:.2f}", str(count)) for given, true, count in calibration_bins(cases) if count
    ]
    return markdown_table(("mean probability", "share that was true", "cases"), rows)
