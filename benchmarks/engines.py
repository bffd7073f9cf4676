"""Both engines in turn on a settled bed: speed, and whether the grains have the same bits.

python -m benchmarks.engines [TURNS]

Both must be installed. Every engine has a process of its own with an empty cache; they take turns, on one
thread and in its processor time: other work on the machine counts less. Fills the table of `docs/speed.md`
with medians over the turns; the digest is that of position, velocity and spin of all grains at the end.
"""

import hashlib
import sys
import tempfile
from pathlib import Path
from statistics import median
from typing import Any

from benchmarks import turns
from benchmarks.speed_page import fill
from benchmarks.unknown_processor import CASES, TURNS, advance_portion, settled_bed
from taichi_erosion.core.compiler_target import packed_width
from taichi_erosion.core.engine.choice import ENGINES, SWITCH
from taichi_erosion.report.markdown import markdown_table
from taichi_erosion.simulation import snapshot

ROOT = Path(__file__).parents[1]


def serve(case: str) -> None:
    """Measure a bed for every line read: speed [M grain-steps/s], width of vectors, digest of grains."""
    sim = settled_bed(*CASES[case])

    def portion(turn: int) -> list[Any]:
        speed = advance_portion(sim, turn)
        state = snapshot(sim, 0)
        bits = b"".join(column.tobytes() for column in (state.position, state.velocity, state.spin))
        return [speed, packed_width(), hashlib.sha256(bits).hexdigest()]

    turns.serve(portion)


def measured(case: str, count: int) -> dict[str, list[Any]]:
    """What every engine answers in every turn."""
    with tempfile.TemporaryDirectory() as cache:
        processes = {
            engine: turns.start("benchmarks.engines", [case], {"XDG_CACHE_HOME": cache, SWITCH: engine})
            for engine in ENGINES
        }
        return turns.take_turns(processes, count)


def row(case: str, found: dict[str, list[Any]]) -> tuple[str, ...]:
    """Speeds, their ratio turn by turn, widths, and whether the grains agree."""
    speeds = {engine: [turn[0] for turn in found[engine]] for engine in ENGINES}
    ratio = median(other / first for first, other in zip(*speeds.values(), strict=True))
    widths = " / ".join(str(found[engine][-1][1]) for engine in ENGINES)
    alike = len({found[engine][-1][2] for engine in ENGINES}) == 1
    medians = (f"{median(values):.1f}" for values in speeds.values())
    return case, *medians, f"{ratio:.2f}", widths, "yes" if alike else "no"


def main(count: int) -> None:
    """Measure all cases and fill the table."""
    names = (f"{engine} [M/s]" for engine in ENGINES)
    header = ("case", *names, "second over first", "vector bits", "same bits")
    table = markdown_table(header, [row(case, measured(case, count)) for case in CASES])
    fill(ROOT / "docs", {"engines": table})


if __name__ == "__main__":
    if sys.argv[1:2] and sys.argv[1] in CASES:
        serve(sys.argv[1])
    else:
        main(int(sys.argv[1]) if sys.argv[1:] else TURNS)
