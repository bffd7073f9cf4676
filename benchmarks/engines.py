"""Both engines in turn on a settled bed: speed, and whether the grains have the same bits.

python -m benchmarks.engines [TURNS]

Both must be installed. Every engine has a process of its own with an empty cache; they take turns, on one
thread and in its processor time: other work on the machine counts less. Fills the table of `docs/speed.md`
with medians over the turns; the digest is that of position, velocity and spin of all grains at the end.
"""

import hashlib
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from statistics import median
from typing import Any

from benchmarks.speed_page import fill
from benchmarks.unknown_processor import CASES, START, STEPS, TURNS, settled_bed
from benchmarks.versions import answer
from taichi_erosion.benchmark.grain_cases import grain_count
from taichi_erosion.core.compiler_target import packed_width
from taichi_erosion.core.engine.choice import ENGINES, SWITCH
from taichi_erosion.report.markdown import markdown_table
from taichi_erosion.simulation import advance, snapshot

ROOT = Path(__file__).parents[1]


def serve(case: str) -> None:
    """Run one portion for every line read; print its speed [M grain-steps/s], width of vectors and digest."""
    sim = settled_bed(*CASES[case])
    step = sim.setups[0].time_step
    sys.stdout.write("ready\n")
    sys.stdout.flush()
    for turn, _ in enumerate(sys.stdin, 1):
        start = time.process_time()
        advance(sim, [START + turn * STEPS * step])
        speed = 1e-6 * grain_count(sim) * STEPS / (time.process_time() - start)
        state = snapshot(sim, 0)
        bits = b"".join(column.tobytes() for column in (state.position, state.velocity, state.spin))
        sys.stdout.write(json.dumps([speed, packed_width(), hashlib.sha256(bits).hexdigest()]) + "\n")
        sys.stdout.flush()


def started(engine: str, case: str, cache: str) -> subprocess.Popen[str]:
    """A process that compiles one case with one engine; it is ready when it has written a line."""
    command = [sys.executable, "-m", "benchmarks.engines", case]
    environment = os.environ | {"XDG_CACHE_HOME": cache, SWITCH: engine}
    return subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=environment, cwd=ROOT
    )


def measured(case: str, turns: int) -> dict[str, list[Any]]:
    """What every engine answers in every turn."""
    found: dict[str, list[Any]] = {engine: [] for engine in ENGINES}
    with tempfile.TemporaryDirectory() as cache:
        waiting = {engine: started(engine, case, cache) for engine in ENGINES}
        for process in waiting.values():
            answer(process)
        for _ in range(turns):
            for engine, process in waiting.items():
                assert process.stdin is not None
                process.stdin.write("go\n")
                process.stdin.flush()
                found[engine].append(json.loads(answer(process)))
        for process in waiting.values():
            process.communicate()
    return found


def row(case: str, found: dict[str, list[Any]]) -> tuple[str, ...]:
    """Speeds, their ratio turn by turn, widths, and whether the grains agree."""
    speeds = {engine: [turn[0] for turn in found[engine]] for engine in ENGINES}
    ratio = median(other / first for first, other in zip(*speeds.values(), strict=True))
    widths = " / ".join(str(found[engine][-1][1]) for engine in ENGINES)
    alike = len({found[engine][-1][2] for engine in ENGINES}) == 1
    medians = (f"{median(values):.1f}" for values in speeds.values())
    return case, *medians, f"{ratio:.2f}", widths, "yes" if alike else "no"


def main(turns: int) -> None:
    """Measure all cases and fill the table."""
    names = (f"{engine} [M/s]" for engine in ENGINES)
    header = ("case", *names, "second over first", "vector bits", "same bits")
    table = markdown_table(header, [row(case, measured(case, turns)) for case in CASES])
    fill(ROOT / "docs", {"engines": table})


if __name__ == "__main__":
    if sys.argv[1:2] and sys.argv[1] in CASES:
        serve(sys.argv[1])
    else:
        main(int(sys.argv[1]) if sys.argv[1:] else TURNS)
