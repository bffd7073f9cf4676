"""One timed run of taichi_erosion in a process of its own.

`python -m benchmarks.peers.ours DECK CASE STEPS THREADS PRECISION` writes the figures as one line of JSON,
the last line of its output.
"""

import json
import sys
from pathlib import Path


def main(deck: str, case: str, steps: str, threads: str, precision: str) -> None:
    """Time a bed or a pile; the import stays inside, since a comparison of peers alone needs no simulator."""
    from taichi_erosion.benchmark import bed_rate, funnel_rate

    rate = {"bed": bed_rate, "pile": funnel_rate}[deck]
    figures = rate(Path(case), int(steps), int(threads), precision)
    sys.stdout.write("\n" + json.dumps(figures) + "\n")


if __name__ == "__main__":
    main(*sys.argv[1:])
