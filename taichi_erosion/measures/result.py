"""What a measure returns, and how repeats of it are pooled."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from itertools import chain
from math import isfinite, nan
from pathlib import Path
from typing import Any

import numpy as np


@dataclass(frozen=True)
class Shortfall:
    """What a set-up lacks for one of its measures: rows of grains on a flank, hops, beds.

    Where it `blocks`, the value says nothing; otherwise it has not converged and depends on the set-up.
    """

    flag: str
    sentence: str
    found: float
    needed: float
    blocks: bool
    grains: int | None = None  # that would suffice, where more grains help
    stated: bool = False  # by the scene: it asks for the value of this set-up, and nothing is amiss


@dataclass(frozen=True)
class Measurement:
    """One measured number.

    `value` is the mean over `n` repeats (fresh packings, fresh seeds) and `sd` the sample standard deviation
    of single repeats, so that the standard error is sd / sqrt(n). With n = 1 no spread was seen: `sd` is then
    what the measure can say from that one state alone (its docstring says what), or NaN.
    """

    name: str
    value: float  # in `unit`, NaN where the state holds no answer
    sd: float  # in `unit`
    unit: str
    n: int = 1
    notes: tuple[str, ...] = ()
    details: dict[str, Any] = field(default_factory=dict)
    shortfalls: tuple[Shortfall, ...] = ()


def no_measurement(name: str, unit: str, reason: str) -> Measurement:
    return Measurement(name, nan, nan, unit, n=0, notes=(reason,))


def pool_repeats(repeats: Sequence[Measurement]) -> Measurement:
    """Mean and sample standard deviation over repeats of one measure.

    Repeats without a value are left out and counted in the notes. A single repeat keeps its own sd.
    """
    ((name, unit),) = {(repeat.name, repeat.unit) for repeat in repeats}
    valid = [repeat for repeat in repeats if isfinite(repeat.value)]
    values = [repeat.value for repeat in valid]
    notes = tuple(dict.fromkeys(note for repeat in repeats for note in repeat.notes))
    if len(valid) < len(repeats):
        notes = (f"{len(repeats) - len(valid)} of {len(repeats)} repeats gave no value", *notes)
    flags = Counter(flag for repeat in valid for flag in repeat.details.get("flags", ()))
    details = {"values": values, "flags": dict(flags)}
    lacking = shortfalls_of_most([repeat.shortfalls for repeat in repeats])
    if not valid:
        return Measurement(name, nan, nan, unit, 0, notes, details, lacking)
    sd = float(np.std(values, ddof=1)) if len(values) > 1 else valid[0].sd
    return Measurement(name, float(np.mean(values)), sd, unit, len(values), notes, details, lacking)


def shortfalls_of_most(repeats: Sequence[Sequence[Shortfall]]) -> tuple[Shortfall, ...]:
    """Shortfalls that at least half of the repeats have, each as the repeat in the middle has it."""
    by_flag: dict[str, list[Shortfall]] = {}
    for lack in chain(*repeats):
        by_flag.setdefault(lack.flag, []).append(lack)
    common = [alike for alike in by_flag.values() if 2 * len(alike) >= len(repeats)]
    return tuple(sorted(each, key=lambda lack: lack.found)[(len(each) - 1) // 2] for each in common)


def as_record(measurement: Measurement) -> dict[str, Any]:
    """The measurement as plain JSON values; NaN, which JSON lacks, becomes None."""
    return {key: nan_to_none(value) for key, value in asdict(measurement).items()}


def nan_to_none(value: Any) -> Any:
    """The same nested value with every number that is not finite replaced by None, tuples by lists."""
    if isinstance(value, float):
        return value if isfinite(value) else None
    if isinstance(value, dict):
        return {key: nan_to_none(entry) for key, entry in value.items()}
    return list(map(nan_to_none, value)) if isinstance(value, (list, tuple)) else value


def json_value(value: Any) -> Any:
    """JSON value of a NumPy scalar or a path."""
    return str(value) if isinstance(value, Path) else value.item()
