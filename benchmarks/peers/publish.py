"""The table of `docs/speed.md` from what `compare` has found: `python -m benchmarks.peers.publish FILE...`.

Each FILE was written by `compare --json`. Samples of the same case from several files are put together, round
after round, as if they had been taken in one go.
"""

import json
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from benchmarks.page import PAGE, fill
from benchmarks.peers.compare import MEGA, Row, Sample, summary
from taichi_erosion.tables.number_words import markdown_table

OURS = ("ours f32", "ours f64")
OTHERS = ("LAMMPS", "LAMMPS 2025", "LIGGGHTS", "YADE")
HEADER = ("case", "cores", *OURS, *(f"f32 and f64 over {code}" for code in OTHERS))
NAMES = {
    "bed10k": "settled bed, 10,000",
    "bed100k": "settled bed, 100,000",
    "jkr10k": "the bed of 10,000 with JKR",
    "pile2000": "funnel, 2,000",
    "pile10000": "funnel, 10,000",
    "ensemble": "32 beds of 2,000, with start-up",
}


def joined(files: Sequence[Path]) -> list[Sample]:
    """Samples of all files; a file's rounds come after those of the files before it."""
    samples: list[Sample] = []
    begun: dict[tuple[str, int], int] = {}
    for file in files:
        entries = [Sample(**entry) for entry in json.loads(file.read_text())["samples"]]
        for one in entries:
            first = begun.get((one.case, one.cores), 0)
            samples.append(replace(one, round=first + one.round))
        for one in samples:
            begun[one.case, one.cores] = max(begun.get((one.case, one.cores), 0), one.round + 1)
    return samples


def lines(rows: Sequence[Row]) -> list[tuple[str, ...]]:
    """Rows of the page: a case on some cores, our speed and its ratios to that of every other code."""
    cases: dict[tuple[str, int], dict[str, Row]] = {}
    for row in rows:
        cases.setdefault((row.case, row.cores), {})[row.code] = row
    order = list(NAMES)
    return [
        (
            NAMES[case],
            str(cores),
            *(rate(found[name]) if name in found else "" for name in OURS),
            *(ratios(found[name]) if name in found else "" for name in OTHERS),
        )
        for (case, cores), found in sorted(
            cases.items(), key=lambda item: (order.index(item[0][0]), item[0][1])
        )
    ]


def rate(row: Row) -> str:
    """Million grain-steps per second: median, lowest and highest."""
    median, low, high = (f"{each / MEGA:.2f}" for each in (row.rate, row.rate_low, row.rate_high))
    return f"{median} ({low} to {high})"


def ratios(row: Row) -> str:
    """Our speed over that of a code, in single precision and in double precision where it was measured."""
    return ", ".join(f"{row.gain[name]:.2f}" for name in OURS if name in row.gain)


def main(words: Sequence[str]) -> int:
    """Fill the table and say where."""
    rows = summary(joined([Path(word) for word in words]))
    sys.stdout.write(f"{fill(PAGE, {'peers': markdown_table(HEADER, lines(rows))})}\n")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
