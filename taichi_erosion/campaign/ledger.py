"""Databases of runs, and the ledger of a campaign: one SQLite file in which every run stands with its state.

waiting -> leased -> done or failed. Several parent processes may work on one ledger: each leases runs before
it starts them, and renews its leases while it lives. A lease is free again when its owner is a dead process
of this machine, or when its last heartbeat is LEASE seconds old. The first result of a run stays.
"""

import json
import os
import socket
import sqlite3
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from taichi_erosion.campaign.request import RunRequest, RunResult
from taichi_erosion.core.errors import BadInput
from taichi_erosion.measures.result import nan_to_none

LEDGER = "ledger.sqlite"
LEASE = 60.0  # s without a heartbeat after which a run is given to others
BUSY = 30.0  # s that a writer waits for another
DEATHS_MOST = 3  # workers that may die in one run before it counts as failed

TABLE = """
CREATE TABLE IF NOT EXISTS run (
    key TEXT PRIMARY KEY,
    payload TEXT NOT NULL,
    state TEXT NOT NULL DEFAULT 'waiting' CHECK (state IN ('waiting', 'leased', 'done', 'failed')),
    owner TEXT,              -- machine:process that holds the lease
    beat REAL,               -- unix time of its last heartbeat
    deaths INTEGER NOT NULL DEFAULT 0,
    record TEXT,             -- JSON that the run function returned
    failure TEXT,            -- why there is no result
    wall_s REAL,
    ended REAL               -- unix time
) WITHOUT ROWID
"""


@dataclass(frozen=True)
class Database:
    """An open SQLite file with one table `run`; it belongs to the thread that opened it."""

    path: Path
    connection: sqlite3.Connection
    kind: str  # of file, in messages

    def query_rows(self, query: str, values: Sequence[Any] = ()) -> list[Any]:
        with translate_errors(self.path, self.kind):
            return self.connection.execute(query, values).fetchall()

    @contextmanager
    def transaction(self) -> Iterator[sqlite3.Connection]:
        """One transaction; what fails leaves the file as it was."""
        with translate_errors(self.path, self.kind), self.connection:
            self.connection.execute("BEGIN IMMEDIATE")
            yield self.connection


def open_database(path: Path, kind: str, table: str) -> Database:
    """Open a database of runs, made where there is none. Raises BadInput where that is impossible."""
    with translate_errors(path, kind):
        path.parent.mkdir(parents=True, exist_ok=True)
        connection = sqlite3.connect(path, timeout=BUSY, isolation_level=None)
        connection.execute(table)
    return Database(path, connection, kind)


@contextmanager
def translate_errors(path: Path, kind: str) -> Iterator[None]:
    """Errors of the file system and of SQLite in the user's words."""
    try:
        yield
    except (sqlite3.Error, OSError) as error:
        raise BadInput(f"{path}: the {kind} cannot be used ({error})") from error


@dataclass(frozen=True)
class Ledger:
    """An open ledger, as one parent process sees it."""

    database: Database
    owner: str  # machine:process of this parent

    @property
    def folder(self) -> Path:
        return self.database.path.parent


def open_ledger(folder: Path) -> Ledger:
    """Open the ledger of a folder, made where there is none. Raises BadInput where that is impossible."""
    return Ledger(open_database(folder / LEDGER, "ledger", TABLE), f"{socket.gethostname()}:{os.getpid()}")


def close_ledger(ledger: Ledger) -> None:
    ledger.database.connection.close()


def add_requests(ledger: Ledger, requests: Sequence[RunRequest]) -> None:
    """Enter runs to be made; what stands there already stays as it is."""
    rows = [(request.key, json.dumps(request.payload)) for request in requests]
    with ledger.database.transaction() as sql:
        sql.executemany("INSERT OR IGNORE INTO run (key, payload) VALUES (?, ?)", rows)


def lease_runs(ledger: Ledger, keys: Sequence[str]) -> list[str]:
    """Lease waiting runs; returns the keys of those that no other parent had leased."""
    order = "UPDATE run SET state = 'leased', owner = ?, beat = ? WHERE key = ? AND state = 'waiting'"
    with ledger.database.transaction() as sql:
        return [key for key in keys if sql.execute(order, (ledger.owner, time.time(), key)).rowcount]


def renew_leases(ledger: Ledger) -> None:
    """Heartbeat of this process on all its leases."""
    order = "UPDATE run SET beat = ? WHERE state = 'leased' AND owner = ?"
    with ledger.database.transaction() as sql:
        sql.execute(order, (time.time(), ledger.owner))


def release_leases(ledger: Ledger, owner: str) -> None:
    order = "UPDATE run SET state = 'waiting', owner = NULL WHERE state = 'leased' AND owner = ?"
    with ledger.database.transaction() as sql:
        sql.execute(order, (owner,))


def release_stale_leases(ledger: Ledger) -> None:
    """Free the leases of processes that no longer exist, or whose last heartbeat is LEASE seconds old."""
    query = "SELECT owner, MAX(beat) FROM run WHERE state = 'leased' GROUP BY owner"
    for owner, last in ledger.database.query_rows(query):
        machine, _, process = owner.rpartition(":")
        is_dead = machine == socket.gethostname() and not process_exists(int(process))
        if owner != ledger.owner and (is_dead or time.time() - last > LEASE):
            release_leases(ledger, owner)


def process_exists(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except PermissionError:  # it is another user's
        pass
    return True


def record_result(ledger: Ledger, key: str, record: dict[str, Any]) -> None:
    """Enter the result of a run, unless another parent was first."""
    failure = record.get("failure")
    text = json.dumps(nan_to_none(record), allow_nan=False)
    row = ("failed" if failure else "done", text, failure, record.get("wall_s"), time.time(), key)
    order = "UPDATE run SET state = ?, record = ?, failure = ?, wall_s = ?, ended = ?, owner = NULL "
    with ledger.database.transaction() as sql:
        sql.execute(f"{order} WHERE key = ? AND state IN ('waiting', 'leased')", row)


def record_worker_death(ledger: Ledger, keys: Sequence[str], reason: str) -> None:
    """Put runs back whose worker died; a run in which DEATHS_MOST workers died has failed."""
    failure = f"{DEATHS_MOST} workers died of it; the last: {reason}"
    back = "UPDATE run SET state = 'waiting', owner = NULL, deaths = deaths + 1"
    fail = "UPDATE run SET state = 'failed', failure = ?, ended = ?"
    with ledger.database.transaction() as sql:
        rows = [(key, ledger.owner) for key in keys]
        sql.executemany(f"{back} WHERE key = ? AND state = 'leased' AND owner = ?", rows)
        failed = [(failure, time.time(), key, DEATHS_MOST) for key in keys]
        sql.executemany(f"{fail} WHERE key = ? AND state = 'waiting' AND deaths >= ?", failed)


def unfinished_runs(ledger: Ledger, keys: Sequence[str]) -> dict[str, tuple[str, int]]:
    """State and deaths of those runs that have not ended."""
    query = "SELECT key, state, deaths FROM run WHERE state IN ('waiting', 'leased')"
    states = {key: (state, deaths) for key, state, deaths in ledger.database.query_rows(query)}
    return {key: states[key] for key in keys if key in states}


def finished_runs(ledger: Ledger, keys: Sequence[str]) -> dict[str, float]:
    """Wall time [s] of those runs that have ended."""
    query = "SELECT key, wall_s FROM run WHERE state IN ('done', 'failed')"
    wall_times = {key: wall_s or 0.0 for key, wall_s in ledger.database.query_rows(query)}
    return {key: wall_times[key] for key in keys if key in wall_times}


def read_results(ledger: Ledger, keys: Sequence[str]) -> list[RunResult]:
    """Results of runs that have ended, in the order of the keys."""
    query = "SELECT record, failure, wall_s FROM run WHERE key = ? AND state IN ('done', 'failed')"
    rows = ((key, row) for key in keys for row in ledger.database.query_rows(query, (key,)))
    return [RunResult(key, json.loads(text or "{}"), why, wall_s or 0.0) for key, (text, why, wall_s) in rows]
