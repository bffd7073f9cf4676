"""Campaigns that are killed again and again at random moments.

Parents are forked from one process that has loaded the campaign and started nothing, which takes a tenth
of the time of a new interpreter. One kill in three strikes a worker first, then the parent.
"""

import json
import os
import random
import signal
import sys
import time
from pathlib import Path

import psutil
from stand_in import FUNCTION, requests, starts, table

from taichi_erosion.campaign.execute import execute
from taichi_erosion.campaign.ledger import close_ledger, open_ledger

RUNS = 120
PAUSE = 0.004  # s of a run
MOST = 25  # runs that are begun before a kill; with none the parent is struck as it sets out
JITTER = 0.05  # s between the last of them and the kill, several runs
PATIENCE = 600.0  # s; the cores may be busy
WORKER_FIRST = 1.0 / 3.0  # share of the kills


def carry_out(folder: Path) -> list[tuple[str, float, str | None]]:
    """A parent: work until everything is done."""
    store = open_ledger(folder)
    results = execute(requests(folder, RUNS, PAUSE), store, workers=2, function=FUNCTION)
    close_ledger(store)
    return table(results)


def finished(folder: Path) -> set[int]:
    """Seeds whose results stand in the ledger."""
    store = open_ledger(folder)
    rows = store.database.rows("SELECT key FROM run WHERE state IN ('done', 'failed')")
    close_ledger(store)
    return {int(key.removeprefix("scene-")) for (key,) in rows}


def start_parent(folder: Path) -> int:
    """A parent in a process of its own; its number."""
    child = os.fork()
    if child == 0:
        try:
            carry_out(folder)
        finally:
            os._exit(0)
    return child


def strike(folder: Path, parent: int, chance: random.Random) -> None:
    """Kill the parent after a random number of runs and a moment, or first one of its workers."""
    wait_for_runs(folder, parent, chance)
    workers = psutil.Process(parent).children()
    if workers and chance.random() < WORKER_FIRST:
        os.kill(chance.choice(workers).pid, signal.SIGKILL)
        wait_for_runs(folder, parent, chance)
    os.kill(parent, signal.SIGKILL)
    os.waitpid(parent, 0)


def wait_for_runs(folder: Path, parent: int, chance: random.Random) -> None:
    """Until some more runs have begun, or none are left to begin."""
    wanted = len(starts(folder)) + chance.randint(0, MOST)
    end = time.monotonic() + PATIENCE
    while len(starts(folder)) < wanted and psutil.Process(parent).status() != psutil.STATUS_ZOMBIE:
        assert time.monotonic() < end, "nothing happened"
        time.sleep(0.005)
    time.sleep(chance.uniform(0.0, JITTER))


def kill_and_count(folder: Path, chance: random.Random, kills: int) -> dict[str, int]:
    """Strike one campaign until it is whole or the kills are used up, then let it end; what was found."""
    found = {"kills": 0, "lost": 0, "repeated": 0, "cut": 0}
    (folder / "journal").touch()
    done: set[int] = set()
    while len(done) < RUNS and found["kills"] < kills:
        before = len(starts(folder))
        strike(folder, start_parent(folder), chance)
        found["kills"] += 1
        now = finished(folder)
        found["lost"] += len(done - now)
        found["repeated"] += len(set(starts(folder)[before:]) & done)
        done = now
    whole = carry_out(folder)
    found["cut"] = len(starts(folder)) - RUNS
    expected = [(f"scene-{seed}", 37.0 * seed % 11.0 + 25.0, None) for seed in range(RUNS)]
    found["wrong"] = sum(row != want for row, want in zip(whole, expected, strict=True))
    return found


def main(folder: Path, kills: int, seed: int) -> None:
    """So many kills, over as many campaigns as they take; prints the sums."""
    chance = random.Random(seed)
    sums = dict.fromkeys(("kills", "lost", "repeated", "cut", "wrong", "campaigns"), 0)
    while sums["kills"] < kills:
        place = folder / str(sums["campaigns"])
        place.mkdir()
        found = kill_and_count(place, chance, kills - sums["kills"])
        sums = {name: sums[name] + found.get(name, 1) for name in sums}
    sys.stdout.write(json.dumps(sums))


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3]))
