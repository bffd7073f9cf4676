"""A run function that needs no simulator: it answers at once, and does what its payload says beside that.

A journal beside the ledger notes every start and every process, so that a test can count. The campaign is
imported where it is used: a worker starts faster without it.
"""

from __future__ import annotations

import os
import signal
import sys
import time
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from taichi_erosion.campaign.request import RunRequest, RunResult

FUNCTION = "stand_in:answering"
PAUSE = 0.004  # s that a run takes


def answer(payloads: list[dict[str, Any]], tell: Any) -> None:
    for place, payload in enumerate(payloads):
        journal = Path(payload["journal"])
        with journal.open("a", encoding="utf-8") as file:
            file.write(f"{payload['seed']} {os.getpid()}\n")
        happen(payload, journal)
        time.sleep(payload["pause"])
        value = (37.0 * payload["seed"] % 11.0) + 25.0
        failure = "grains overlap" if payload["mishap"] == "fails" else None
        angle = {"value": value, "sd": None, "unit": "deg", "n": 1}
        tell(place, {"seed": payload["seed"], "measures": {"angle": angle}, "failure": failure})


def answering() -> Any:
    return nullcontext(answer)


@contextmanager
def without_ledger() -> Any:
    """A worker that cannot write the ledger: the parent enters its records."""
    from taichi_erosion.campaign import pool
    from taichi_erosion.core.errors import BadInput

    def refuse(*_: Any) -> None:
        raise BadInput("the disk is full")

    pool.record_result = refuse
    yield answer


def happen(payload: dict[str, Any], journal: Path) -> None:
    mark = journal.with_name(f"happened-{payload['seed']}")
    if payload["mishap"] == "kills" or (payload["mishap"] == "kills once" and not mark.exists()):
        mark.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    if payload["mishap"] == "raises":
        raise ValueError("no such soil")


def requests(
    folder: Path, count: int = 120, pause: float = PAUSE, mishaps: dict[int, str] | None = None
) -> list[RunRequest]:
    from taichi_erosion.campaign.request import RunRequest

    journal = str(folder / "journal")
    return [
        RunRequest(
            key=f"scene-{seed}",
            payload={
                "seed": seed,
                "journal": journal,
                "pause": pause,
                "mishap": (mishaps or {}).get(seed, ""),
            },
        )
        for seed in range(count)
    ]


def table(results: list[RunResult]) -> list[tuple[str, float, str | None]]:
    return [(result.key, result.value("angle"), result.failure) for result in results]


def starts(folder: Path) -> list[int]:
    return [int(line.split()[0]) for line in (folder / "journal").read_text(encoding="utf-8").splitlines()]


def processes(folder: Path) -> set[int]:
    return {int(line.split()[1]) for line in (folder / "journal").read_text(encoding="utf-8").splitlines()}


def main(folder: Path, pause: float) -> None:
    """A parent in a process of its own."""
    from taichi_erosion.campaign.execute import execute
    from taichi_erosion.campaign.ledger import close_ledger, open_ledger

    store = open_ledger(folder)
    results = execute(requests(folder, pause=pause), store, workers=2, function=FUNCTION)
    close_ledger(store)
    sys.stdout.write(str(len(results)))


if __name__ == "__main__":
    main(Path(sys.argv[1]), float(sys.argv[2]))
