"""Two versions of this program on the same case, in turn: `python -m benchmarks.versions OLD NEW CASE`.

OLD and NEW are folders that hold a checkout each, CASE is one of the cases of `benchmarks.peers`. Each
version runs in a process of its own and waits while the other is timed. On one thread processor time is
compared, portion by portion, so that work of others on the machine, which slows both, counts little; on more
threads wall time, for which the machine must be quiet.
"""

import argparse
import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from statistics import median, quantiles

CASES = Path(__file__).parent / "peers" / "cases"
PIECE = """
import sys, time
from dataclasses import replace
import numpy as np
from benchmarks.setups import LAWS, bed_setup, funnel_setup
from taichi_erosion.core.setup import Numerics
from taichi_erosion.simulation import advance, assemble
case, precision, threads = sys.argv[1], sys.argv[2], int(sys.argv[3])
skip, portion, gamma = map(float, sys.argv[4:])
clock = time.process_time if threads == 1 else time.perf_counter
with np.load(case) as arrays:
    setup = (bed_setup if "period" in arrays else funnel_setup)(arrays)
if gamma > 0.0:
    LAWS = replace(LAWS, normal="jkr")
    energy = gamma + 0.0 * setup.contacts.surface_energy
    setup = replace(setup, contacts=replace(setup.contacts, surface_energy=energy))
sim = assemble([setup], LAWS, Numerics("cpu", threads, precision))
done = skip
advance(sim, [done * setup.time_step])
print(len(setup.grains.radius), flush=True)
for _ in sys.stdin:
    start, done = clock(), done + portion
    advance(sim, [done * setup.time_step])
    print(clock() - start, flush=True)
"""


def started(tree: Path, words: Sequence[str], threads: int) -> tuple[subprocess.Popen[str], int]:
    """A version that waits for its turns, and its number of grains."""
    environment = os.environ | {"PYTHONPATH": str(tree), "TI_NUM_THREADS": str(threads)}
    command = [sys.executable, "-c", PIECE, *words]
    process = subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=environment, cwd=tree
    )
    return process, int(answer(process))


def answer(process: subprocess.Popen[str]) -> str:
    """The next line that a version writes. Raises RuntimeError where it has ended."""
    line = process.stdout.readline() if process.stdout else ""
    if not line:
        raise RuntimeError(f"a version ended with {process.wait()}")
    return line


def turn(process: subprocess.Popen[str]) -> float:
    """Processor time of one portion [s]."""
    assert process.stdin is not None
    process.stdin.write("\n")
    process.stdin.flush()
    return float(answer(process))


def main(words: Sequence[str] | None = None) -> int:
    """Print both rates and their ratio."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.versions", description=__doc__)
    parser.add_argument("trees", nargs=2, type=Path, metavar="TREE")
    parser.add_argument("case")
    parser.add_argument("--precision", choices=("f32", "f64"), default="f32")
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--skip", type=int, default=200, help="steps before the first portion")
    parser.add_argument("--portion", type=int, default=40, help="steps of a turn")
    parser.add_argument("--turns", type=int, default=20)
    parser.add_argument("--sticky", type=float, default=0.0, metavar="GAMMA", help="JKR, J/m2")
    chosen = parser.parse_args(words)
    numbers = (chosen.threads, chosen.skip, chosen.portion, chosen.sticky)
    options = [str(CASES / f"{chosen.case}.npz"), chosen.precision, *map(str, numbers)]
    versions = [started(tree.resolve(), options, chosen.threads) for tree in chosen.trees]
    times = [[turn(process) for process, _ in versions] for _ in range(chosen.turns + 1)][1:]
    work = 1e-6 * versions[0][1] * chosen.portion
    rates = [work / median(column) for column in zip(*times, strict=True)]
    low, middle, high = quantiles([old / new for old, new in times], n=4)
    sys.stdout.write(
        f"{chosen.case} {chosen.precision}, {chosen.threads} thread(s): "
        f"{rates[0]:.2f} and {rates[1]:.2f} million grain-steps/s, "
        f"ratio {middle:.2f} (quartiles {low:.2f} and {high:.2f}) over {chosen.turns} turns\n"
    )
    return 0


if __name__ == "__main__":
    sys.exit(main())
