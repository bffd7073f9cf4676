"""The page on speed: the cases of `bench` as a table."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from taichi_erosion.recording.whole_file import write_whole
from taichi_erosion.report.page import fill_tables, markdown_table

PAGE = "speed.md"
STAGES = ("pairs", "walls", "motion", "rebuild")

Case = Mapping[str, Any]


def grain_table(cases: Sequence[Case]) -> str:
    """Speed on grains, with the share of every stage."""
    header = ("case", "grains", "threads", "precision", "M grain-steps/s", "per core", "contacts per grain")
    rows = [
        (
            case["case"],
            *(str(case[key]) for key in ("grains", "threads", "precision")),
            *(f"{case[key]:.2f}" for key in ("M grain-steps/s", "per core", "contacts per grain")),
            *(f"{100.0 * case['stages'][stage]:.0f} %" for stage in STAGES),
        )
        for case in cases
        if "contacts per grain" in case
    ]
    return markdown_table((*header, *STAGES), rows)


def air_table(cases: Sequence[Case]) -> str:
    """Speed on grids of air."""
    header = ("case", "threads", "M cell-steps/s", "per core", "iterations of a pressure solve")
    keys = ("M cell-steps/s", "per core", "pressure iterations")
    rows = [
        (case["case"], str(case["threads"]), *(f"{case[key]:.2f}" for key in keys))
        for case in cases
        if "pressure iterations" in case
    ]
    return markdown_table(header, rows)


def scaling_table(cases: Sequence[Case]) -> str:
    """Cost of a grain-step and memory on wider and wider beds, the cost also over that of the smallest."""
    beds = [case for case in cases if "bytes per grain" in case]
    header = ("grains", "ns per grain-step", "over the smallest", "contacts per grain", "bytes per grain")
    rows = [
        (
            str(bed["grains"]),
            f"{bed['ns per grain-step']:.0f}",
            f"{bed['ns per grain-step'] / beds[0]['ns per grain-step']:.2f}",
            f"{bed['touching']:.2f}",
            f"{bed['bytes per grain']:.0f}",
        )
        for bed in beds
    ]
    return markdown_table(header, rows)


def publish(document: Mapping[str, Any], docs: Path) -> Path:
    """Fill the tables of the page."""
    makers = {"grains": grain_table, "air": air_table, "scaling": scaling_table}
    tables = {name: table(document["cases"]) for name, table in makers.items()}
    page = docs / PAGE
    return write_whole(page, fill_tables(page.read_text(encoding="utf-8"), tables).encode())
