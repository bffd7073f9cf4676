"""Cost of a fluid threshold and its interval, deep grains asleep and awake: `python -m benchmarks.threshold`.

Fills the table of `docs/speed.md`. Both searches run in one process on one thread, in processor time.
"""

import sys
from pathlib import Path

from benchmarks.speed_page import fill, threshold_table
from benchmarks.wind_cases import threshold_case

DOCS = Path(__file__).parents[1] / "docs"


def main() -> int:
    """Run both, fill the table and say where."""
    cases = [threshold_case(), threshold_case(awake=True)]
    sys.stdout.write(f"{fill(DOCS, {'threshold': threshold_table(cases)})}\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
