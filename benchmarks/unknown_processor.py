"""Speed on a processor that Taichi's compiler does not know, without and with the remedy.

python -m benchmarks.unknown_processor [ROUNDS]

The row of this processor in the compiler's table first receives what the compiler knows of an unknown one,
then, with the remedy, what it knows of `compiler_target.WIDE`; beside them the row as it is. Every case
runs in a process of its own with an empty cache, the three in turn. x86-64 Linux only. Fills the table of
`docs/speed.md` with medians over the rounds, on one thread.
"""

import json
import os
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

from benchmarks.speed_page import fill
from taichi_erosion.benchmark.grain_cases import grain_case, standard_grain_cases
from taichi_erosion.core import compiler_target as target
from taichi_erosion.report.markdown import markdown_table

ROOT = Path(__file__).parents[1]
ROWS = {"as it is": None, "unknown": target.UNKNOWN, "unknown, with the remedy": target.WIDE}
PRECISIONS = ("f32", "f64")
ROUNDS = 3


def bed(row: str, precision: str) -> None:
    """Print speed and vector width of the settled bed, with another row in place of the processor's own."""
    name, rows = target.compiler_rows()
    if ROWS[row] is not None:
        target.copy_row(rows[ROWS[row]], rows[name])
    (case,) = (c for c in standard_grain_cases(1) if (c.name, c.precision) == ("settled bed", precision))
    found = grain_case(case)
    sys.stdout.write("\n" + json.dumps([found["M grain-steps/s"], found["vector bits"]]))


def measured(row: str, precision: str) -> tuple[float, int]:
    """Speed [M grain-steps/s] and vector width of the settled bed, from a process of its own."""
    with tempfile.TemporaryDirectory() as cache:
        command = [sys.executable, "-m", "benchmarks.unknown_processor", row, precision]
        environment = os.environ | {"XDG_CACHE_HOME": cache}
        done = subprocess.run(command, env=environment, cwd=ROOT, capture_output=True, text=True, check=True)
    speed, bits = json.loads(done.stdout.strip().splitlines()[-1])
    return speed, bits


def main(rounds: int) -> None:
    """Measure all rows in turn and fill the table."""
    found: dict[tuple[str, str], list[tuple[float, int]]] = {}
    for _ in range(rounds):
        for row in ROWS:
            for precision in PRECISIONS:
                found.setdefault((row, precision), []).append(measured(row, precision))
    lines = []
    for row in ROWS:
        speeds = [statistics.median(speed for speed, _ in found[row, one]) for one in PRECISIONS]
        bits = (str(found[row, one][0][1]) for one in PRECISIONS)
        lines.append((row, *(f"{speed:.1f}" for speed in speeds), *bits))
    columns = (*(f"{one} [M/s]" for one in PRECISIONS), *(f"vector bits, {one}" for one in PRECISIONS))
    fill(ROOT / "docs", {"unknown": markdown_table(("row of the processor", *columns), lines)})


if __name__ == "__main__":
    if sys.argv[1:2] and sys.argv[1] in ROWS:
        bed(sys.argv[1], sys.argv[2])
    else:
        main(int(sys.argv[1]) if sys.argv[1:] else ROUNDS)
