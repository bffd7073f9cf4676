"""Our physics beside LAMMPS and LIGGGHTS: `python -m benchmarks.peers.physics [CASE]...`.

The same grains, laws and steps in every code; what is compared is read from the places of the grains, in one
way for all. Scatter is that of the seeds; a difference from ours is given in its standard errors. Results go
to physics.csv beside this file; `--page` fills the tables of README.md and docs/results.md from it.
"""

import argparse
import json
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import chain
from math import nan
from pathlib import Path

import numpy as np

from benchmarks.page import fill
from benchmarks.peers.cases import Floats
from benchmarks.peers.codes import DECKS, LAMMPS, NEW_LAMMPS
from benchmarks.peers.physics_cases import BED_STEPS, RELAX_STEPS, Failed, falling_bed, lying, two_grains
from benchmarks.peers.physics_codes import Code, contestants, our_beds
from benchmarks.peers.physics_column import (
    BOUNCING,
    FREE,
    ONE_LAW,
    STICKY,
    STICKY_FREE,
    USUAL,
    Column,
    column_soil,
    laid_columns,
)
from benchmarks.peers.physics_impact import IMPACT, impact_numbers, oblique
from benchmarks.peers.physics_measures import (
    Numbers,
    Rest,
    bed_numbers,
    close_numbers,
    heap_numbers,
    stack_numbers,
)
from benchmarks.peers.physics_pair import lammps_curve, pair_numbers
from doe.common.tables import read_table, write_table
from taichi_erosion.tables.number_words import markdown_table
from tests.verification.contact import adhesion

Seeds = list[dict[str, float]]  # numbers of every seed by quantity

KEPT = DECKS / "cases" / "physics"  # delete it to run everything again
TABLE = Path(__file__).with_name("physics.csv")
PAGE = Path(__file__).with_name("README.md")
SHORT_PAGE = Path(__file__).parents[2] / "docs" / "results.md"
IN_SHORT = ("angle of repose, deg", "height, d")  # quantities of heaps that docs/results.md shows
BED_SEEDS = range(1, 5)
STACK_STEPS = 20_000  # 0.1 s: the two grains come to rest


@dataclass(frozen=True)
class Row:
    """One quantity of one code in one case; `mean` and `sd` are over the seeds."""

    case: str
    quantity: str  # with its unit
    code: str
    mean: float
    sd: float  # of a single seed
    n: int
    apart: float  # difference from ours over its standard error [1]


@dataclass(frozen=True)
class Case:
    """What every code is given, and what is read from where its grains come to rest."""

    runs: Callable[[Code], list[Rest] | None]  # none where a code lacks the law
    numbers: Callable[[Rest], Numbers]
    paired: bool = False  # whether a seed gives every code the very same bed


def stacks(code: Code) -> list[Rest]:
    """Two grains, one on top of the other."""
    return code.beds([two_grains()], STACK_STEPS)


def beds(code: Code) -> list[Rest]:
    """Beds that fell."""
    return code.beds(list(map(falling_bed, BED_SEEDS)), BED_STEPS)


def laid_beds(code: Code) -> list[Rest]:
    """Beds of ours, laid down at rest."""
    ours = our_beds(list(map(falling_bed, BED_SEEDS)), BED_STEPS)
    return code.beds([lying(rest.position) for rest in ours], RELAX_STEPS)


def heaps(column: Column) -> Case:
    """Columns that collapse."""
    return Case(
        lambda code: code.columns(column, laid_columns(column)),
        lambda rest: heap_numbers(rest, column_soil(column), not column.rolls_freely),
    )


def sticky_heaps(column: Column) -> Case:
    """Columns of grains that adhere to each other."""
    dry = heaps(column)
    return Case(
        dry.runs, lambda rest: chain(dry.numbers(rest), close_numbers(rest, column_soil(column))), dry.paired
    )


PAIR = "sticky pair"
CASES = {
    "two grains": Case(stacks, stack_numbers),
    "bed": Case(beds, bed_numbers),
    "laid bed": Case(laid_beds, bed_numbers, paired=True),
    "oblique impact": Case(lambda code: code.columns(IMPACT, [oblique()]), impact_numbers),
    "heap, no rolling friction": heaps(FREE),
    "heap, one rolling law": heaps(ONE_LAW),
    "heap, one rolling law, restitution 0.9": heaps(BOUNCING),
    "heap, rolling friction 0.15": heaps(USUAL),
    "sticky heap, no rolling friction": sticky_heaps(STICKY_FREE),
    "sticky heap, rolling friction 0.15": sticky_heaps(STICKY),
}


def apart(values: Floats, ours: Floats, paired: bool) -> float:
    """Difference of two means over its standard error; nan for single values."""
    if len(ours) < 2:
        return nan
    error = np.sqrt(values.var(ddof=1) / len(values) + ours.var(ddof=1) / len(ours))
    if paired:
        error = np.std(values - ours, ddof=1) / np.sqrt(len(ours))
    return float((values.mean() - ours.mean()) / error) if error > 0.0 else nan


def rows_of(name: str, found: dict[str, dict[str, Floats]], paired: bool) -> list[Row]:
    """Rows of a case; `found` holds by code and quantity a value for every seed."""
    ours = next(iter(found.values()))
    rows = []
    for code, numbers in found.items():
        for quantity, values in numbers.items():
            sd = float(values.std(ddof=1)) if len(values) > 1 else nan
            from_ours = nan if numbers is ours else apart(values, ours[quantity], paired)
            rows.append(Row(name, quantity, code, float(values.mean()), sd, len(values), from_ours))
    return rows


def compared(name: str, codes: Sequence[Code]) -> list[Row]:
    """Run one case in all codes that have not run it yet; what they found is kept in the folder of cases."""
    case, found = CASES[name], dict[str, dict[str, Floats]]()
    for code in codes:
        seeds = kept(name, code, lambda code=code: seeds_of(case, code))
        if seeds:
            found[code.name] = {key: np.array([seed[key] for seed in seeds]) for key in seeds[0]}
    return rows_of(name, found, case.paired)


def seeds_of(case: Case, code: Code) -> Seeds:
    """Numbers of every seed; none where a code lacks the law."""
    return [dict(case.numbers(rest)) for rest in case.runs(code) or ()]


def kept(name: str, code: Code, run: Callable[[], Seeds]) -> Seeds:
    """What a code found in a case, from the folder of cases or by running it."""
    file = KEPT / f"{name}, {code.name}.json"
    if not file.exists():
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(json.dumps(run(), indent=1), encoding="utf-8")
        sys.stderr.write(f"{name}: {code.name} done\n")
    return json.loads(file.read_text(encoding="utf-8"))


def compared_pair(codes: Sequence[Code]) -> list[Row]:
    """The pull-off curve, where LAMMPS is there."""
    lammps = {peer.name: partial(lammps_curve, peer) for peer in (LAMMPS, NEW_LAMMPS)}
    curves = {"ours": adhesion.bounce, **lammps}
    found = {}
    for code in codes:
        if code.name in curves:
            (numbers,) = kept(PAIR, code, lambda code=code: [dict(pair_numbers(*curves[code.name]()))])
            found[code.name] = {key: np.array([value]) for key, value in numbers.items()}
    return rows_of(PAIR, found, False)


def write_rows(rows: Sequence[Row]) -> None:
    """The table, cases in their order."""
    names = [*CASES, PAIR]
    ordered = sorted(rows, key=lambda row: names.index(row.case))
    write_table(TABLE, Row, ordered, digits=6, none="nan")


def shown(row: Row | None) -> str:
    """A mean with its standard error, and its distance from ours."""
    if row is None:
        return ""
    if row.n == 1:
        return f"{row.mean:.6g}"
    error = row.sd / np.sqrt(row.n)
    places = max(0, 1 - int(np.floor(np.log10(error)))) if error > 0.0 else 4
    text = f"{row.mean:.{places}f} ± {error:.{places}f}"
    return text if np.isnan(row.apart) else f"{text} ({row.apart:+.1f})"


def page_table(rows: Sequence[Row]) -> str:
    """Quantities down, codes across; every code has run the same seeds."""
    codes = list(dict.fromkeys(row.code for row in rows))
    by_place = {(row.case, row.quantity, row.code): row for row in rows}
    places = dict.fromkeys((row.case, row.quantity) for row in rows)
    seeds = {row.case: row.n for row in rows}
    lines = [
        (case, str(seeds[case]), quantity, *(shown(by_place.get((case, quantity, code))) for code in codes))
        for case, quantity in places
    ]
    return markdown_table(("case", "seeds", "quantity", *codes), lines)


def publish() -> None:
    """Fill the tables of the pages."""
    for page, name, table in page_tables():
        fill(page, {name: table})


def page_tables() -> list[tuple[Path, str, str]]:
    """Pages with the name and the text of their tables: all numbers, and angles and heights of heaps.

    LAMMPS of 2025 has the laws of 2021, so that one of them is enough in the short table.
    """
    rows = read_table(TABLE, Row)
    short = [row for row in rows if row.quantity in IN_SHORT and row.code != NEW_LAMMPS.name]
    return [(PAGE, "other codes", page_table(rows)), (SHORT_PAGE, "heaps of codes", page_table(short))]


def main(words: Sequence[str] | None = None) -> int:
    """Run what was asked for; 3 where a code fails."""
    names = [*CASES, PAIR]
    parser = argparse.ArgumentParser(prog="python -m benchmarks.peers.physics", description=__doc__)
    parser.add_argument("cases", nargs="*", metavar="CASE", help=f"any of {', '.join(names)} (default: all)")
    parser.add_argument("--page", action="store_true", help="only fill the tables of the pages")
    chosen = parser.parse_args(words)
    for case in chosen.cases:
        if case not in names:
            parser.error(f"CASE = {case}: must be one of {', '.join(names)}")
    if not chosen.page:
        codes = contestants()
        for code in codes:
            if code.missing:
                sys.stderr.write(f"{code.name} left out: {code.missing}\n")
        present = [code for code in codes if not code.missing]
        for name in chosen.cases or names:
            try:
                fresh = compared_pair(present) if name == PAIR else compared(name, present)
            except Failed as failure:
                sys.stderr.write(f"{failure}\n")
                return 3
            write_rows([row for row in read_table(TABLE, Row) if row.case != name] + fresh)
            publish()
    publish()
    return 0


if __name__ == "__main__":
    sys.exit(main())
