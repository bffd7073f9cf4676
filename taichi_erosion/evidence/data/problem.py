"""Records of an evidence study: measurements, model, calibrated parameters, candidate effects.

They are the whole input of the statistics; `evidence/record.py` holds the output.
"""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from taichi_erosion.evidence.data.table_units import TableUnits

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Integers = NDArray[np.int64]

MOST_SETTINGS = 3000  # of the model, each over all rows, that one answer may evaluate

Transform = Literal["identity", "log", "log_floor"]
Drawn = Literal["", "held out", "fitted"]  # what became of a row when rows were drawn for the vault
Conditions = dict[str, Floats]  # one value per row, in the unit of what it sets; of a model function SI
Numbers = dict[str, float]  # parameters by path, or strengths by effect
Progress = Callable[[str, float], None]  # (stage, share of the whole that is done [1])


def row_count(conditions: Conditions) -> int:
    """Number of rows; one where no condition is given."""
    return next((column.size for column in conditions.values()), 1)


def pick_rows(columns: Mapping[str, Any], chosen: Integers | Bools) -> dict[str, Any]:
    """Columns restricted to some rows: arrays, tuples, and tables of columns; anything else as it is."""
    index = np.flatnonzero(chosen) if chosen.dtype == np.bool_ else chosen

    def pick(column: Any) -> Any:
        if isinstance(column, np.ndarray):
            return column[index]
        if isinstance(column, tuple):
            return tuple(column[row] for row in index) if column else ()
        return {name: pick(each) for name, each in column.items()} if isinstance(column, Mapping) else column

    return {name: pick(column) for name, column in columns.items()}


class Model(Protocol):
    """Anything that predicts: one observable, n conditions, r seeds -> r rows of n values in its own unit.

    The same seed gives the same random disturbance whatever the parameters and effects. Effects come with
    their strengths, 0 included. A value that could not be computed is NaN.
    """

    def __call__(
        self, observable: str, conditions: Conditions, parameters: Numbers, effects: Numbers, seeds: Integers
    ) -> Floats: ...


@dataclass(frozen=True)
class Measurements:
    """A table of measured values, one entry per row; rows that repeat a condition are lab replicates."""

    observable: tuple[str, ...]
    value: Floats  # mean of `n` repeats, in the observable's unit; ignored where censored
    sd: Floats  # standard deviation of single repeats; NaN where missing
    n: Floats  # repeats behind the value; NaN or 0 where missing
    group: tuple[str, ...]  # physical set-up: the unit of hold-out
    unit: tuple[str, ...]
    conditions: Conditions  # NaN where a condition was not written down
    censored: Bools  # only limits of the true value are known
    limit: Floats  # below which ("no transport"), above which or about which it lies; NaN where not censored
    source: tuple[str, ...]
    table_units: TableUnits = field(default_factory=TableUnits)
    reach: Floats | None = None  # of censored values: -inf below `limit`, +inf above, h within; None: below
    condition_sd: Conditions = field(default_factory=dict)  # of stated conditions; NaN or left out: exact
    drawn: tuple[Drawn, ...] = ()  # in an earlier version of the table; empty: of no row
    heap: tuple[str, ...] = ()  # on which rows of several observables were measured; '': unknown
    line: tuple[int, ...] = ()  # row in the user's table, the heading being row 1; empty: in this order

    @property
    def size(self) -> int:
        return len(self.observable)

    @property
    def table_line_numbers(self) -> tuple[int, ...]:
        """Row of each measurement in the user's table."""
        return self.line or tuple(range(2, self.size + 2))

    def pick_rows_at(self, chosen: Integers | Bools) -> "Measurements":
        """The table restricted to some rows, in the order given."""
        return replace(self, **pick_rows(vars(self) | {"line": self.table_line_numbers}, chosen))


@dataclass(frozen=True)
class Observable:
    """How one measured quantity is compared: the scale on which its noise is near-normal, and known errors.

    identity: z = y        log: z = ln y        log_floor: z = ln(y + floor)
    """

    name: str
    transform: Transform = "identity"
    floor: float = 0.0  # in the unit of the observable
    sd_shared: float = 0.0  # systematic sd common to all rows of one instrument, in the observable's unit
    sd_numerical: float = 0.0  # deliberate tolerance for box, time step, coarse graining; 0 is reported as 0
    sd_shared_relative: float = 0.0  # systematic error that grows with the value, over the value [1]
    shared_over: str = ""  # condition at each value of which that error differs by half of its size


QueryRows = tuple[Observable, Conditions, Mapping[str, Floats]]  # rows, with the doses of a mechanism in them


class Uncertainty(Protocol):
    """Covariance (n, n) of a model's own errors over rows of some observables, one after the other.

    On the comparison scale, at one setting of the calibrated numbers and strengths.
    """

    def __call__(self, queries: Sequence[QueryRows], parameters: Numbers, effects: Numbers) -> Floats: ...


@dataclass(frozen=True)
class Replicates:
    """Scatter of single runs of a model on the comparison scales of its observables."""

    names: tuple[str, ...]
    sd: Floats  # (k,)
    correlation: Floats  # (k, k)


@dataclass(frozen=True)
class Parameter:
    """A number to be calibrated; ln(value / start) has the prior sd `prior_sd_log`, cut at [low, high]."""

    path: str
    start: float
    low: float
    high: float
    prior_sd_log: float = 0.5


@dataclass(frozen=True)
class Candidate:
    """An effect that may be missing; its strength has a half-normal prior on [0, maximum]."""

    name: str
    prior_scale: float = 1.5  # of the strength [1]
    maximum: float = 3.0
    trials: tuple[tuple[float, bool], ...] = ()  # strengths of its runs, and whether each has ended


@dataclass(frozen=True)
class Mechanism:
    """A place in the model where something can be missing, and the doses for which the model has values."""

    name: str
    low: float  # least dose [1]
    high: float  # largest dose [1]


def expected_strength(candidate: Candidate) -> float:
    """Strength at which power is judged: the prior's scale, within the allowed range."""
    return min(candidate.prior_scale, candidate.maximum)


REACH = 3.0  # times the largest strength of the list, up to which one beyond it is looked for


@dataclass(frozen=True)
class Laboratory:
    ranges: Mapping[str, tuple[float, float]] = field(default_factory=dict)  # of conditions; else as measured
    costs: Mapping[str, float] = field(default_factory=dict)  # of one measurement, by observable; else 1
    repeats: int = 3  # of one measurement


@dataclass(frozen=True)
class Vault:
    """Rows that only `adopt` may use, and how often they have been used."""

    rows: Integers = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    opened: int = 0


@dataclass(frozen=True)
class Problem:
    measurements: Measurements
    observables: Mapping[str, Observable]
    parameters: tuple[Parameter, ...]
    candidates: tuple[Candidate, ...]
    model: Model
    runs: int | None = None  # at most: set-ups with one seed each; None: MOST_SETTINGS of all rows
    vault: Vault = field(default_factory=Vault)
    adopted: tuple[Candidate, ...] = ()  # effects already in the model; their strengths are calibrated too
    uncertainty: Uncertainty | None = None  # of the model itself; None: it has no error
    dosed_by_row: bool = False  # whether the model takes a dose of its own for every row
    mechanisms: tuple[Mechanism, ...] = ()  # places that the model declares
    unread: Collection[str] = ()  # conditions that neither the model nor an effect reads
    replicates: Replicates | None = None  # of a model whose values have no scatter any more: an emulator

    @property
    def candidate_names(self) -> list[str]:
        return [candidate.name for candidate in self.candidates]

    def visible_rows(self) -> Measurements:
        rows = np.setdiff1d(np.arange(self.measurements.size), self.vault.rows)
        return self.measurements.pick_rows_at(rows)

    def measurements_in_vault(self) -> Measurements:
        return self.measurements.pick_rows_at(self.vault.rows)


RunFault = Literal["too_small", "not_converged", "no_value", "failed_runs"]
FaultKind = Literal[RunFault, "too_few_rows", "repeats", "source_changed", "unit", "scatter"]


@dataclass(frozen=True)
class SetUpFault:
    """Something about the set-up, not about physics, that has to be known before an answer is read."""

    kind: FaultKind
    place: str  # observable, or path of a calibrated number
    sentence: str
    blocks: bool  # the verdict on physics waits until this is settled
    rows: tuple[int, ...] = ()  # of the table, one of which is wrong
