"""Speed on a processor that Taichi's compiler does not know, without and with the remedy.

python -m benchmarks.unknown_processor [TURNS]

The row of this processor in the compiler's table first receives what the compiler knows of an unknown one,
then, with the remedy, the features of `compiler_target.WIDE`, then those of `compiler_target.WIDEST`, which
the remedy takes on processors that carry 512 bits out at once; beside them the row as it is. Two beds of
2,016 grains: Hertz, and JKR, whose law has more arithmetic. Every row has a process of its own with an empty
cache; they take turns, on one thread and in its processor time: other work on the machine counts less.
x86-64 Linux only. Fills the table of `docs/speed.md` with medians over the turns.
"""

import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path
from statistics import median

from benchmarks import turns
from benchmarks.grain_cases import START, Precision, grain_count
from benchmarks.setups import LAWS, lattice_bed
from benchmarks.speed_page import fill
from taichi_erosion.core import compiler_target as target
from taichi_erosion.core.setup import Numerics
from taichi_erosion.report.markdown import markdown_table
from taichi_erosion.simulation import Simulation, advance, assemble

ROOT = Path(__file__).parents[1]
ROWS = {  # whose features, whose tuning
    "as it is": None,
    "unknown": (target.UNKNOWN, target.UNKNOWN),
    "unknown, with the remedy": (target.WIDE, target.WIDE),
    "unknown, with the remedy for 512 bits": (target.WIDEST, target.WIDE),
}
STICKY = 0.05  # surface energy of the bed with JKR [J m-2]
PRECISIONS: tuple[Precision, ...] = ("f32", "f64")
CASES: dict[str, tuple[str, Precision]] = {
    f"{law} {precision}": (law, precision) for law in ("Hertz", "JKR") for precision in PRECISIONS
}
TURNS, STEPS = 9, 500


def settled_bed(law: str, precision: Precision) -> Simulation:
    """The settled bed of `bench`, on one thread."""
    setup, laws = lattice_bed(0), LAWS
    if law == "JKR":
        laws, energy = replace(LAWS, normal="jkr"), STICKY + 0.0 * setup.contacts.surface_energy
        setup = replace(setup, contacts=replace(setup.contacts, surface_energy=energy))
    sim = assemble([setup], laws, Numerics("cpu", 1, precision))
    advance(sim, [START])
    return sim


def advance_portion(sim: Simulation, turn: int) -> float:
    """Speed [M grain-steps/s of processor time] of one portion of a bed."""
    start = time.process_time()
    advance(sim, [START + turn * STEPS * sim.setups[0].time_step])
    return 1e-6 * grain_count(sim) * STEPS / (time.process_time() - start)


def serve(row: str, case: str) -> None:
    """Measure a bed for every line read: speed [M grain-steps/s] and width of vectors."""
    name, rows = target.compiler_rows()
    source = ROWS[row]
    if source is not None:
        target.write_row(rows[name], *(rows[one] for one in source))
    sim = settled_bed(*CASES[case])
    turns.serve(lambda turn: [advance_portion(sim, turn), target.packed_width()])


def measured(case: str, count: int) -> dict[str, list[tuple[float, int]]]:
    """Speeds and widths of one case, by row and turn."""
    with tempfile.TemporaryDirectory() as cache:
        processes = {
            row: turns.start(
                "benchmarks.unknown_processor", [row, case], {"XDG_CACHE_HOME": str(Path(cache) / str(k))}
            )
            for k, row in enumerate(ROWS)
        }
        return turns.take_turns(processes, count)


def main(count: int) -> None:
    """Measure all cases and fill the table."""
    columns = {case: measured(case, count) for case in CASES}
    lines = [
        (
            row,
            *(f"{median(speed for speed, _ in found[row]):.1f}" for found in columns.values()),
            " / ".join(str(found[row][0][1]) for found in columns.values()),
        )
        for row in ROWS
    ]
    header = ("row of the processor", *(f"{case} [M/s]" for case in CASES), "vector bits")
    fill(ROOT / "docs", {"unknown": markdown_table(header, lines)})


if __name__ == "__main__":
    if sys.argv[1:2] and sys.argv[1] in ROWS:
        serve(sys.argv[1], sys.argv[2])
    else:
        main(int(sys.argv[1]) if sys.argv[1:] else TURNS)
