"""Tables of speed that need no other code: `python -m benchmarks.page [threshold]`.

`docs/speed.md` has those of grains and of a start, `benchmarks/README.md` the others.

On a machine that does nothing else; a quarter of an hour. With the word, only the cost of a fluid threshold
and its interval, deep grains asleep and awake. Other codes are timed by `benchmarks.peers`.
"""

import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from benchmarks.cases import run_benchmarks
from benchmarks.start import ROUNDS, starts
from benchmarks.wind_cases import threshold_case
from doe.common.pages import fill_tables
from taichi_erosion.core.files import write_atomic
from taichi_erosion.tables.number_words import markdown_table

PAGE = Path(__file__).parents[1] / "docs" / "speed.md"
DETAILS = Path(__file__).with_name("README.md")
STAGES = ("pairs", "walls", "motion", "rebuild", "looks")

Case = Mapping[str, Any]


def grain_table(cases: Sequence[Case]) -> str:
    """Speed on grains, with the share of every stage."""
    known, rates = ("grains", "threads", "precision"), ("M grain-steps/s", "per core", "contacts per grain")
    rows = [
        (
            case["case"],
            *(str(case[key]) for key in known),
            *(f"{case[key]:.2f}" for key in rates),
            f"{case['bytes per grain']:.0f}",
            *shares(case, STAGES),
        )
        for case in cases
        if "contacts per grain" in case
    ]
    return markdown_table(("case", *known, *rates, "bytes per grain", *STAGES), rows)


def shares(case: Case, stages: Sequence[str]) -> tuple[str, ...]:
    """Share of every stage; those that a case does not have stay empty."""
    found = case["stages"]
    return tuple(f"{100.0 * found[stage]:.0f} %" if stage in found else "" for stage in stages)


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
    beds = [case for case in cases if "ns per grain-step" in case]
    header = ("grains", "ns per grain-step", "over the smallest", "contacts per grain", "bytes per grain")
    stages = STAGES[:-1]  # no looks at the air
    rows = [
        (
            str(bed["grains"]),
            f"{bed['ns per grain-step']:.0f}",
            f"{bed['ns per grain-step'] / beds[0]['ns per grain-step']:.2f}",
            f"{bed['touching']:.2f}",
            f"{bed['bytes per grain']:.0f}",
            *shares(bed, stages),
        )
        for bed in beds
    ]
    return markdown_table((*header, *stages), rows)


def shared_table(cases: Sequence[Case]) -> str:
    """Speed alone and beside busy programs: one thread, two that are fixed, the adaptive team."""
    header = (
        "case",
        "one thread",
        "two threads",
        "adaptive",
        "adaptive / one thread",
        "adaptive / two threads",
    )
    rows = [
        (case["case"], *(f"{case[key]:.2f}" for key in header[1:])) for case in cases if "adaptive" in case
    ]
    return markdown_table(header, rows)


def threshold_table(cases: Sequence[Case]) -> str:
    """What a fluid threshold with its interval costs, by what the time was spent on."""
    stages = tuple(dict.fromkeys(stage for case in cases for stage in case["stages"]))
    header = ("case", "u* [m/s]", "95 % interval", "simulated steps", "core-seconds", *stages)
    rows = [
        (
            case["case"],
            f"{case['threshold u* [m/s]']:.3f}",
            f"{case['from']:.3f} to {case['to']:.3f}",
            f"{case['steps']:,}",
            f"{case['core-seconds']:.1f}",
            *(f"{case['core-seconds'] * case['stages'].get(stage, 0.0):.1f}" for stage in stages),
        )
        for case in cases
    ]
    return markdown_table(header, rows)


def start_table(starts: Mapping[str, Mapping[str, float]]) -> str:
    """What it takes from the call of `run` to the first step, by the state of the cache."""
    rows = [(name, f"{took['wall']:.1f} s", f"{took['cpu']:.1f} s") for name, took in starts.items()]
    return markdown_table(("cache", "wall time", "of one core"), rows)


def fill(page: Path, tables: Mapping[str, str]) -> Path:
    """Fill some tables of a page; the others stay. Raises ValueError where the page has no such mark."""
    return write_atomic(page, fill_tables(page.read_text(encoding="utf-8"), tables).encode())


def announce(_: float, name: str) -> None:
    """Name of the case that is timed now, on stderr."""
    sys.stderr.write(f"{name}\n")


def main(words: Sequence[str]) -> None:
    """Time all cases, or a threshold alone, and fill the tables."""
    if "threshold" in words:
        fill(DETAILS, {"threshold": threshold_table([threshold_case(), threshold_case(awake=True)])})
        return
    cases = run_benchmarks(announce)["cases"]
    makers = {"air": air_table, "scaling": scaling_table, "shared": shared_table}
    fill(PAGE, {"grains": grain_table(cases), "start": start_table(starts(ROUNDS))})
    fill(DETAILS, {name: table(cases) for name, table in makers.items()})


if __name__ == "__main__":
    main(sys.argv[1:])
