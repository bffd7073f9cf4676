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
    from collections.abc import Iterator

    from taichi_erosion.campaign.ledger import Ledger
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

    shared = {"journal": str(folder / "journal"), "pause": pause}
    payloads = [{"seed": seed, "mishap": (mishaps or {}).get(seed, "")} | shared for seed in range(count)]
    return [RunRequest(key=f"scene-{payload['seed']}", payload=payload) for payload in payloads]


def table(results: list[RunResult]) -> list[tuple[str, float, str | None]]:
    return [(result.key, result.value("angle"), result.failure) for result in results]


def starts(folder: Path) -> list[int]:
    return [int(line.split()[0]) for line in (folder / "journal").read_text(encoding="utf-8").splitlines()]


def processes(folder: Path) -> set[int]:
    return {int(line.split()[1]) for line in (folder / "journal").read_text(encoding="utf-8").splitlines()}


@contextmanager
def opened(folder: Path) -> Iterator[Ledger]:
    """The ledger of a folder, closed whatever happens."""
    from taichi_erosion.campaign.ledger import close_ledger, open_ledger

    store = open_ledger(folder)
    try:
        yield store
    finally:
        close_ledger(store)


def carry_out(folder: Path, listed: list[RunRequest], **words: Any) -> list[RunResult]:
    """Results of runs that go through a ledger and two workers."""
    from taichi_erosion.campaign.execute import run_requests

    with opened(folder) as store:
        return run_requests(listed, store, **{"workers": 2, "function": FUNCTION} | words)


if __name__ == "__main__":  # a parent in a process of its own
    place = Path(sys.argv[1])
    sys.stdout.write(str(len(carry_out(place, requests(place, pause=float(sys.argv[2]))))))
