"""The tables of `docs/speed.md` that need no other code: `python -m benchmarks.page`.

On a machine that does nothing else; a quarter of an hour. Other codes are timed by
`benchmarks.peers`, a quick discovery is timed by `benchmarks.discovery`; `benchmarks.threshold` adds a row to
the table of thresholds.
"""

import sys
from pathlib import Path

from benchmarks import start
from benchmarks.cases import run_benchmarks
from benchmarks.speed_page import publish

DOCS = Path(__file__).parents[1] / "docs"


def announce(_: float, name: str) -> None:
    """Name of the case that is timed now, on stderr."""
    sys.stderr.write(f"{name}\n")


def main() -> int:
    """Time all cases and fill the tables."""
    publish(run_benchmarks(announce), DOCS)
    start.main([])
    return 0


if __name__ == "__main__":
    sys.exit(main())
