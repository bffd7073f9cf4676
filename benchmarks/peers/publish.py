"""The table of `docs/speed.md` from what `compare` has found: `python -m benchmarks.peers.publish FILE...`.

Each FILE was written by `compare --json`. Samples of the same case from several files are put together, round
after round, as if they had been taken in one go.
"""

import json
import sys
from collections.abc import Sequence
from pathlib import Path

from benchmarks.page import fill
from benchmarks.peers.compare import MEGA, Row, Sample, summary
from taichi_erosion.report.markdown import markdown_table

DOCS = Path(__file__).parents[2] / "docs"
HEADER = (
    "case",
    "cores",
    "code",
    "million grain-steps per second, median (lowest to highest)",
    "contacts per grain",
    "ours in f32 over it",
    "in f64",
    "asked",
)
OURS = ("ours f32", "ours f64")
NAMES = {
    "bed10k": "settled bed, 10,000",
    "bed100k": "settled bed, 100,000",
    "jkr10k": "the bed of 10,000 with JKR",
    "pile2000": "funnel, 2,000",
    "pile10000": "funnel, 10,000",
    "ensemble": "32 beds of 2,000, with start-up",
}
ASKED = {  # of f32, on one core and on two
    ("bed10k", "LAMMPS"): (3.0, 3.0),
    ("bed10k", "LIGGGHTS"): (3.0, 3.0),
    ("bed10k", "YADE"): (15.0, 15.0),
    ("bed100k", "LIGGGHTS"): (3.3, 3.3),
    ("jkr10k", "LAMMPS"): (3.0, 3.0),
    ("pile2000", "LIGGGHTS"): (2.2, 2.0),
    ("pile10000", "LIGGGHTS"): (2.5, 2.5),
    ("pile10000", "YADE"): (10.0, 10.0),
    ("ensemble", "LIGGGHTS"): (3.0, 3.0),
}


def joined(files: Sequence[Path]) -> list[Sample]:
    """Samples of all files; a file's rounds come after those of the files before it."""
    samples: list[Sample] = []
    begun: dict[tuple[str, int], int] = {}
    for file in files:
        entries = [Sample(**entry) for entry in json.loads(file.read_text())["samples"]]
        for one in entries:
            first = begun.get((one.case, one.cores), 0)
            samples.append(Sample(**vars(one) | {"round": first + one.round}))
        for one in samples:
            begun[one.case, one.cores] = max(begun.get((one.case, one.cores), 0), one.round + 1)
    return samples


def cells(row: Row) -> tuple[str, ...]:
    """One row of the page."""
    rates = [f"{rate / MEGA:.2f}" for rate in (row.rate, row.rate_low, row.rate_high)]
    gains = ["" if row.code in OURS or name not in row.gain else f"{row.gain[name]:.2f}" for name in OURS]
    asked = ASKED.get((row.case, row.code))
    return (
        NAMES[row.case],
        str(row.cores),
        row.code,
        f"{rates[0]} ({rates[1]} to {rates[2]})",
        f"{row.contacts_per_grain:.2f}",
        *gains,
        "" if asked is None else f"{asked[row.cores - 1]:g}",
    )


def main(words: Sequence[str]) -> int:
    """Fill the table, in the order of the cases, and say where."""
    rows = summary(joined([Path(word) for word in words]))
    order = list(NAMES)
    rows.sort(key=lambda row: (order.index(row.case), row.cores))
    sys.stdout.write(f"{fill(DOCS, {'peers': markdown_table(HEADER, [cells(row) for row in rows])})}\n")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
