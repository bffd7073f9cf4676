"""Runs that were made once are not made again: a store of model values, addressed by what went into them.

One entry is one seed of one observable under all conditions of a request. The key is a digest of model and
version, observable, conditions, parameters, effects that act, and seed; so `compare`, `discover`, `adopt` and
`next` share their runs, and a killed discovery goes on where it was.
"""

import sqlite3
from dataclasses import dataclass, field
from hashlib import sha256
from pathlib import Path
from time import monotonic

import numpy as np

from taichi_erosion.campaign.ledger import write_ahead
from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.files import make_parent
from taichi_erosion.evidence.data.problem import Floats, Integers, Model

FILE = "runs.sqlite"
COMMIT_INTERVAL = 1.0  # s; what a kill may lose
WAIT = 30.0  # s that a second process waits for the first to write


@dataclass
class RunStore:
    """A file of values by key, made when the first value is kept."""

    file: Path
    connection: sqlite3.Connection | None = None
    committed: float = field(default_factory=monotonic)
    found: int = 0
    made: int = 0

    def get(self, key: bytes) -> Floats | None:
        """Values of one run, None if it has not been made."""
        if self.connection is None and not self.file.exists():
            return None
        row = self.opened().execute("SELECT result FROM run WHERE key = ?", (key,)).fetchone()
        return None if row is None else np.frombuffer(row[0], dtype="<f8")

    def put(self, key: bytes, values: Floats) -> None:
        """Keep the values of one run."""
        order = "INSERT OR REPLACE INTO run VALUES (?, ?)"
        self.opened().execute(order, (key, np.asarray(values, dtype="<f8").tobytes()))
        if monotonic() - self.committed > COMMIT_INTERVAL:
            self.commit()

    def commit(self) -> None:
        """Make everything put so far safe from a kill."""
        if self.connection is not None:
            self.connection.commit()
        self.committed = monotonic()

    def opened(self) -> sqlite3.Connection:
        """The file, opened at first need."""
        if self.connection is None:
            self.connection = connect(self.file)
        return self.connection


def connect(file: Path) -> sqlite3.Connection:
    """A store's file, made when missing; raises BadInput for one that is something else."""
    make_parent(file)
    try:
        connection = sqlite3.connect(file, timeout=WAIT)
        write_ahead(connection)
        connection.execute("CREATE TABLE IF NOT EXISTS run (key BLOB PRIMARY KEY, result BLOB NOT NULL)")
        connection.commit()
    except sqlite3.Error as error:
        raise BadInput(f"{file}: cannot be used as a store of runs ({error}); remove it") from None
    return connection


@dataclass(frozen=True)
class CachedModel:
    """A model in front of its store."""

    model: Model
    identity: str  # model and version
    store: RunStore

    def __call__(
        self,
        observable: str,
        conditions: dict[str, Floats],
        parameters: dict[str, float],
        effects: dict[str, float],
        seeds: Integers,
    ) -> Floats:
        """Values [seed, row], from the store where they are there."""
        request = request_digest(self.identity, observable, conditions, parameters, effects)
        keys = [sha256(request + int(seed).to_bytes(8, "little", signed=True)).digest() for seed in seeds]
        known = {k: values for k, key in enumerate(keys) if (values := self.store.get(key)) is not None}
        missing = [k for k in range(len(keys)) if k not in known]
        self.store.found += len(known)
        self.store.made += len(missing)
        if missing:
            made = self.model(observable, conditions, parameters, effects, np.asarray(seeds)[missing])
            for k, values in zip(missing, np.asarray(made, dtype=np.float64), strict=True):
                known[k] = values
                self.store.put(keys[k], values)
        return np.array([known[k] for k in range(len(keys))])


def request_digest(
    identity: str,
    observable: str,
    conditions: dict[str, Floats],
    parameters: dict[str, float],
    effects: dict[str, float],
) -> bytes:
    """Digest of everything but the seed; an effect of strength 0 is no effect."""
    digest = sha256(f"{identity}|{observable}".encode())
    for name in sorted(conditions):
        digest.update(f"|{name}=".encode() + np.asarray(conditions[name], dtype="<f8").tobytes())
    for kind, numbers in (("p", parameters), ("e", {k: v for k, v in effects.items() if v != 0.0})):
        for name in sorted(numbers):
            digest.update(f"|{kind}:{name}={float(numbers[name])!r}".encode())
    return digest.digest()
