"""Values of a model function, each computed once, addressed by the digest of what went into them.

One entry is one seed of one observable under all conditions of a request. The key is a digest of model and
version, observable, conditions, parameters, effects that act, and seed; so `compare`, `discover`, `adopt` and
`next` share their runs, and a killed discovery goes on where it was.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from hashlib import sha256
from pathlib import Path
from time import monotonic

import numpy as np

from taichi_erosion.campaign.ledger import Database, open_database
from taichi_erosion.core.effect import Effect
from taichi_erosion.core.errors import BadInput
from taichi_erosion.evidence.data.problem import Conditions, Floats, Integers, Model, Numbers, row_count
from taichi_erosion.evidence.models.plugin import apply_instrument_effect, dose_of_rows

FILE = "runs.sqlite"
COMMIT_INTERVAL = 1.0  # s; what a kill may lose
TABLE = "CREATE TABLE IF NOT EXISTS run (key BLOB PRIMARY KEY, result BLOB NOT NULL)"


@dataclass
class RunStore:
    """A file of values by key, made when the first values are written."""

    file: Path
    pending: dict[bytes, Floats] = field(default_factory=dict)  # not written yet
    database: Database | None = None
    commit_time: float = field(default_factory=monotonic)

    def fetch_runs(self, keys: list[bytes]) -> dict[bytes, Floats]:
        """Values of those runs that have been made."""
        values = {key: self.pending[key] for key in keys if key in self.pending}
        absent = [key for key in dict.fromkeys(keys) if key not in values]
        if absent and (self.database is not None or self.file.exists()):
            marks = ", ".join("?" * len(absent))
            rows = self.connect().query_rows(f"SELECT key, result FROM run WHERE key IN ({marks})", absent)
            values |= {key: np.frombuffer(result, dtype="<f8") for key, result in rows}
        return values

    def commit_runs(self) -> None:
        if self.pending:
            rows = [(key, np.asarray(values, dtype="<f8").tobytes()) for key, values in self.pending.items()]
            with self.connect().transaction() as sql:
                sql.executemany("INSERT OR REPLACE INTO run VALUES (?, ?)", rows)
            self.pending.clear()
        self.commit_time = monotonic()

    def connect(self) -> Database:
        if self.database is None:
            self.database = open_database(self.file, "store of runs", TABLE)
        return self.database


class BudgetSpentError(BadInput):
    """No further value of the model may be computed."""


@dataclass(frozen=True)
class FunctionModel:
    """A model function with effects of files: laws for the doses of its mechanisms, then instruments.

    Values of the function are made once, and counted. An effect of strength 0 is not called.
    """

    function: Model
    identity: str  # function and version
    store: RunStore
    cap: int | None = None  # runs that one command may ask for; None: any number
    effects: Mapping[str, Effect] = field(default_factory=dict)
    run_counts: dict[bytes, int] = field(default_factory=dict)  # runs behind every key

    def __call__(
        self, observable: str, conditions: Conditions, parameters: Numbers, effects: Numbers, seeds: Integers
    ) -> Floats:
        """Values [seed, row], instruments in order of name; rows of the same doses are asked together."""
        acting = [(self.effects[n], effects[n]) for n in sorted(self.effects) if effects.get(n, 0.0) != 0.0]
        inside = {name: strength for name, strength in effects.items() if name not in self.effects}
        doses: dict[str, Floats] = {}
        for law, strength in acting:
            if law.place != "instrument":
                before = doses.get(law.mechanism, np.zeros(row_count(conditions)))
                doses[law.mechanism] = before + strength * dose_of_rows(law, conditions)
        if doses:
            _, kinds = np.unique(np.column_stack(list(doses.values())), axis=0, return_inverse=True)
            values = np.empty((seeds.size, row_count(conditions)))
            for kind in np.unique(kinds):
                rows = np.flatnonzero(kinds.reshape(-1) == kind)
                there = {name: column[rows] for name, column in conditions.items()}
                dosed = inside | {name: float(column[rows[0]]) for name, column in doses.items()}
                values[:, rows] = self.values_by_store(observable, there, parameters, dosed, seeds)
        else:
            values = self.values_by_store(observable, conditions, parameters, inside, seeds)
        for effect, strength in acting:
            if effect.place == "instrument":
                values = apply_instrument_effect(effect, strength, conditions, observable, values)
        return values

    def values_by_store(
        self, observable: str, conditions: Conditions, parameters: Numbers, effects: Numbers, seeds: Integers
    ) -> Floats:
        """Values [seed, row] of the function itself, from the store where they are there.

        Raises BudgetSpentError before the cap is passed: a run is one row.
        """
        request = request_digest(self.identity, observable, conditions, parameters, effects)
        keys = [sha256(request + int(seed).to_bytes(8, "little", signed=True)).digest() for seed in seeds]
        self.run_counts.update(dict.fromkeys(keys, row_count(conditions)))
        if self.cap is not None and (total := sum(self.run_counts.values())) > self.cap:
            words = f"the budget of {self.cap:,} runs is used up: {total:,} and more are needed"
            raise BudgetSpentError(f"{words}; those that were made are kept. Raise budget.runs")
        stored = self.store.fetch_runs(keys)
        missing = [k for k, key in enumerate(keys) if key not in stored]
        if missing:
            new = self.function(observable, conditions, parameters, effects, np.asarray(seeds)[missing])
            for k, values in zip(missing, np.asarray(new, dtype=np.float64), strict=True):
                stored[keys[k]] = values
                self.store.pending[keys[k]] = values
            if monotonic() - self.store.commit_time > COMMIT_INTERVAL:
                self.store.commit_runs()
        return np.array([stored[key] for key in keys])


def request_digest(
    identity: str, observable: str, conditions: Conditions, parameters: Numbers, effects: Numbers
) -> bytes:
    """Digest of everything but the seed; an effect of strength 0 is no effect."""
    digest = sha256(f"{identity}|{observable}".encode())
    for name in sorted(conditions):
        digest.update(f"|{name}=".encode() + np.asarray(conditions[name], dtype="<f8").tobytes())
    for kind, numbers in (("p", parameters), ("e", {k: v for k, v in effects.items() if v != 0.0})):
        for name in sorted(numbers):
            digest.update(f"|{kind}:{name}={float(numbers[name])!r}".encode())
    return digest.digest()
