"""The ledger of a campaign: one SQLite file in one folder, in which every run stands with its state.

waiting -> leased -> done or failed. Several parents may work on one ledger: each leases runs before it starts
them, and renews its leases while it lives. A lease whose sign of life has not changed while another parent
looked on for LEASE seconds, or whose owner is a dead process of this machine, is free again: no two clocks
are compared, and none is trusted to go on evenly. The first result of a run stays.
"""

import json
import os
import socket
import sqlite3
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from taichi_erosion.campaign.request import RunRequest, RunResult
from taichi_erosion.core.errors import BadInput
from taichi_erosion.measures.result import without_nan

LEDGER = "ledger.sqlite"
LEASE = 60.0  # s without a sign of life after which a run is given to others
BUSY = 30.0  # s that a writer waits for another
PAUSE = 0.02  # s between two attempts
PRIMARY_CODE = 0xFF  # bits of an SQLite error code that name its kind
DEATHS_MOST = 3  # workers that one run may take with it before it counts as failed
FORMAT = 1  # of the table below
COLUMNS = ["key", "payload", "state", "owner", "beat", "deaths", "record", "failure", "wall_s", "ended"]

TABLE = """
CREATE TABLE IF NOT EXISTS run (
    key TEXT PRIMARY KEY,
    payload TEXT NOT NULL,
    state TEXT NOT NULL DEFAULT 'waiting' CHECK (state IN ('waiting', 'leased', 'done', 'failed')),
    owner TEXT,              -- machine:process that holds the lease
    beat REAL,               -- unix time of its last sign of life; only its change is read
    deaths INTEGER NOT NULL DEFAULT 0,
    record TEXT,             -- JSON that the run function told
    failure TEXT,            -- why there is no result
    wall_s REAL,
    ended REAL               -- unix time
) WITHOUT ROWID
"""


@dataclass(frozen=True)
class Ledger:
    """An open ledger; it belongs to the thread that opened it."""

    path: Path
    connection: sqlite3.Connection
    owner: str
    seen: dict[str, tuple[float, float]] = field(default_factory=dict)  # owner: (beat, s when it was new)


def open_ledger(folder: Path) -> Ledger:
    """Open the ledger of a folder, made where there is none. Raises BadInput where that is impossible."""
    path = folder / LEDGER
    with spoken(path):
        folder.mkdir(parents=True, exist_ok=True)
        connection = sqlite3.connect(path, timeout=BUSY, isolation_level=None)
        refuse_foreign(path, connection)
        write_ahead(connection)
        # a killed process loses nothing; after a power cut the last results may have to be run again
        connection.execute("PRAGMA synchronous = NORMAL")
        connection.execute(f"PRAGMA user_version = {FORMAT}")
        connection.execute(TABLE)
    return Ledger(path, connection, f"{socket.gethostname()}:{os.getpid()}")


def write_ahead(connection: sqlite3.Connection) -> None:
    """Let readers and one writer work beside each other.

    Whoever opens a new file at the same moment waits here: SQLite itself does not wait to change its journal.
    """
    until = time.monotonic() + BUSY
    while True:
        try:
            connection.execute("PRAGMA journal_mode = WAL")
            return
        except sqlite3.OperationalError as error:
            if error.sqlite_errorcode & PRIMARY_CODE != sqlite3.SQLITE_BUSY or time.monotonic() > until:
                raise
            time.sleep(PAUSE)


def refuse_foreign(path: Path, connection: sqlite3.Connection) -> None:
    """Raise BadInput for a database that this code did not write, before anything in it is changed."""
    found = connection.execute("PRAGMA user_version").fetchone()[0]
    if found not in (0, FORMAT):
        raise BadInput(f"{path}: ledger of format {found}, written by another version; this one is {FORMAT}")
    columns = [row[1] for row in connection.execute("PRAGMA table_info(run)")]
    if columns not in ([], COLUMNS):
        raise BadInput(f"{path}: a database of another program, not the ledger of a campaign")


@contextmanager
def spoken(path: Path) -> Iterator[None]:
    """Say in the user's words what the file system or SQLite refuses."""
    try:
        yield
    except sqlite3.Error as error:
        code = getattr(error, "sqlite_errorcode", None)
        if code == sqlite3.SQLITE_FULL:
            kept = "finished runs are kept; free some space and give the same command again"
            raise BadInput(f"{path}: the disk is full; {kept}") from error
        raise BadInput(f"{path}: the ledger cannot be used ({error})") from error
    except OSError as error:
        raise BadInput(f"{path}: the ledger cannot be used ({error.strerror})") from error


@contextmanager
def writing(store: Ledger) -> Iterator[sqlite3.Connection]:
    """One transaction; what fails leaves the ledger as it was."""
    with spoken(store.path):
        store.connection.execute("BEGIN IMMEDIATE")
        try:
            yield store.connection
            store.connection.execute("COMMIT")
        except BaseException:
            if store.connection.in_transaction:  # a full disk has rolled back already
                store.connection.execute("ROLLBACK")
            raise


def close_ledger(store: Ledger) -> None:
    """Close the ledger."""
    with spoken(store.path):
        store.connection.close()


def add_requests(store: Ledger, requests: Sequence[RunRequest]) -> None:
    """Put down what is to be run; what stands there already stays as it is."""
    rows = [(request.key, json.dumps(request.payload)) for request in requests]
    with writing(store) as ledger:
        ledger.executemany("INSERT OR IGNORE INTO run (key, payload) VALUES (?, ?)", rows)


def lease_runs(store: Ledger, keys: Sequence[str]) -> list[str]:
    """Lease waiting runs; returns those that could be had."""
    taken = "UPDATE run SET state = 'leased', owner = ?, beat = ? WHERE key = ? AND state = 'waiting'"
    with writing(store) as ledger:
        return [key for key in keys if ledger.execute(taken, (store.owner, time.time(), key)).rowcount]


def beat(store: Ledger) -> None:
    """Renew all leases of this process."""
    with writing(store) as ledger:
        ledger.execute(
            "UPDATE run SET beat = ? WHERE state = 'leased' AND owner = ?", (time.time(), store.owner)
        )


def release_leases(store: Ledger, owner: str) -> None:
    """Free all leases of an owner."""
    with writing(store) as ledger:
        freed = "UPDATE run SET state = 'waiting', owner = NULL WHERE state = 'leased' AND owner = ?"
        ledger.execute(freed, (owner,))


def release_stale_leases(store: Ledger) -> None:
    """Free the leases of processes that no longer exist, or whose beat stood still for LEASE seconds."""
    question = "SELECT owner, MAX(beat) FROM run WHERE state = 'leased' GROUP BY owner"
    with spoken(store.path):
        owners = store.connection.execute(question).fetchall()
    for owner, last in owners:
        machine, _, process = owner.rpartition(":")
        gone = machine == socket.gethostname() and not is_alive(int(process))
        if owner != store.owner and (gone or silence(store, owner, last) > LEASE):
            release_leases(store, owner)


def silence(store: Ledger, owner: str, last: float) -> float:
    """Time for which this parent has seen another's beat stand still [s], by its own steady clock."""
    now = time.monotonic()
    beat, since = store.seen.get(owner, (last, now))
    store.seen[owner] = (last, since if beat == last else now)
    return now - store.seen[owner][1]


def is_alive(process: int) -> bool:
    """Whether a process of this machine exists."""
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        return True
    return True


def record_result(store: Ledger, key: str, record: dict[str, Any]) -> None:
    """Write down what came out of a run, unless another parent was first."""
    failure = record.get("failure")
    text = json.dumps(without_nan(record), allow_nan=False)
    row = ("failed" if failure else "done", text, failure, record.get("wall_s"), time.time(), key)
    with writing(store) as ledger:
        ledger.execute(
            "UPDATE run SET state = ?, record = ?, failure = ?, wall_s = ?, ended = ?, owner = NULL "
            "WHERE key = ? AND state IN ('waiting', 'leased')",
            row,
        )


def record_worker_death(store: Ledger, keys: Sequence[str], reason: str) -> None:
    """Put runs back whose worker died; a run that has taken DEATHS_MOST workers with it has failed."""
    with writing(store) as ledger:
        for key in keys:
            ledger.execute(
                "UPDATE run SET state = 'waiting', owner = NULL, deaths = deaths + 1 "
                "WHERE key = ? AND state = 'leased' AND owner = ?",
                (key, store.owner),
            )
            ledger.execute(
                "UPDATE run SET state = 'failed', failure = ?, ended = ? "
                "WHERE key = ? AND state = 'waiting' AND deaths >= ?",
                (f"{DEATHS_MOST} workers died of it; the last: {reason}", time.time(), key, DEATHS_MOST),
            )


def unfinished(store: Ledger, keys: Sequence[str]) -> dict[str, tuple[str, int]]:
    """State and deaths of those runs that have not ended."""
    with spoken(store.path):
        rows = store.connection.execute(
            "SELECT key, state, deaths FROM run WHERE state IN ('waiting', 'leased')"
        ).fetchall()
    open_rows = {key: (state, deaths) for key, state, deaths in rows}
    return {key: open_rows[key] for key in keys if key in open_rows}


def read_results(store: Ledger, keys: Sequence[str]) -> list[RunResult]:
    """Results of runs that have ended, in the order of the keys."""
    found = {}
    with spoken(store.path):
        for key in dict.fromkeys(keys):
            row = store.connection.execute(
                "SELECT record, failure, wall_s FROM run WHERE key = ? AND state IN ('done', 'failed')",
                (key,),
            ).fetchone()
            if row is not None:
                record = json.loads(row[0]) if row[0] else {}
                found[key] = RunResult(key, record, row[1], row[2] or 0.0)
    return [found[key] for key in keys if key in found]
