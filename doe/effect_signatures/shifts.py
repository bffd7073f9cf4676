"""What each effect moves: the shift of every observable of a scene when one effect is switched on.

    shift = mean over seeds of (y_with - y_bare),    standard error = sd of the differences / sqrt(n)

Both runs of a pair have the same seed, hence the same grains at the same places, so that what the seed does
to both cancels as far as the motion remembers it; `correlation` says how far that was.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import isfinite, nan, sqrt
from operator import attrgetter
from pathlib import Path
from typing import Any, TextIO

import numpy as np

from doe.common.cases import number
from doe.common.tables import update_table
from taichi_erosion.core.setup import Floats, Numerics
from taichi_erosion.execution.checks import compatibility_key, read_scene
from taichi_erosion.execution.ensemble import ReplicaRequest, run_replicas
from taichi_erosion.scene import Scene

Values = dict[int, dict[str, float]]  # seed -> observable -> value
Orders = tuple[str, ...]  # PATH=VALUE, as after --set
KEY = attrgetter("effect", "label", "scene")  # of a row
LEAST_PAIRS = 3  # fewer give no standard error worth the name


@dataclass(frozen=True)
class Case:
    """One effect in the circumstances in which it acts: `circumstances` are set in the bare run too."""

    effect: str
    strength: float = 1.0
    label: str = ""  # what is special, for people; empty: the case that stands for the effect
    circumstances: Orders = ()
    parameters: Orders = ()  # NAME=VALUE of the effect

    @property
    def switched_on(self) -> Orders:
        """Settings that switch the effect on."""
        path = f"effects.{self.effect}"
        return (f"{path}.strength={self.strength:g}", *(f"{path}.{order}" for order in self.parameters))


@dataclass(frozen=True)
class Shift:
    """One row of the table: how far an effect moves one observable."""

    effect: str
    label: str  # empty for the case that stands for the effect
    strength: float
    observable: str
    unit: str
    bare: float  # mean without the effect
    shift: float
    standard_error: float
    correlation: float  # of both runs over the seeds [1]
    n: int  # pairs
    scene: str
    settings: str
    note: str = ""


def measure_shifts(
    scene: Path, common: Orders, cases: Sequence[Case], seeds: Sequence[int], numerics: Numerics
) -> Iterator[list[Shift]]:
    """Shifts of every case in turn; a bare run that several cases share is made once."""
    bare: dict[Orders, tuple[Values, dict[str, str], str]] = {}
    for case in cases:
        orders = (*common, *case.circumstances)
        if orders not in bare:
            bare[orders] = simulate(read_scene(scene, orders), seeds, numerics)
        before, units, _ = bare[orders]
        after, _, reason = simulate(read_scene(scene, (*orders, *case.switched_on)), seeds, numerics)
        settings = " ".join((*orders, *case.switched_on))
        head = {
            "effect": case.effect,
            "label": case.label,
            "strength": case.strength,
            "scene": scene.name,
            "settings": settings,
        }
        yield [
            paired(head | {"observable": name, "unit": units[name]}, before, after, reason) for name in units
        ]


def tabulate(table: Path, measured: Iterator[list[Shift]], to: TextIO) -> None:
    """Write the shifts of case after case into a table, telling each as it is done."""
    for rows in measured:
        update_table(table, Shift, rows, KEY, digits=6, none="nan")
        for row in rows:
            told = f"{row.effect} {row.observable} {row.shift:+.4g} +- {row.standard_error:.2g} {row.unit}"
            to.write(f"{told} (bare {row.bare:.4g}, r {row.correlation:.2f}, n {row.n}) {row.note}\n")


def simulate(scene: Scene, seeds: Sequence[int], numerics: Numerics) -> tuple[Values, dict[str, str], str]:
    """Values by seed, units by observable, and why seeds without values have none."""
    found: dict[int, dict[str, Any]] = {}
    parts = [ReplicaRequest(scene, seed) for seed in seeds]
    assert len({compatibility_key(part.scene) for part in parts}) == 1
    run_replicas(parts, numerics, lambda place, record: found.update({seeds[place]: record}))
    values = {
        seed: {name: number(m["value"]) for name, m in record["measures"].items()}
        for seed, record in found.items()
    }
    units = {name: m["unit"] for record in found.values() for name, m in record["measures"].items()}
    reasons = {record["failure"] for record in found.values() if record["failure"]}
    return values, units, "; ".join(sorted(reasons))


def paired(head: Mapping[str, Any], before: Values, after: Values, reason: str) -> Shift:
    """Mean difference of one observable over the seeds that gave both values."""
    name = str(head["observable"])
    pairs = [(before[s].get(name, nan), after[s].get(name, nan)) for s in before if s in after]
    both: Floats = np.array([pair for pair in pairs if all(map(isfinite, pair))]).reshape(-1, 2)
    if len(both) < LEAST_PAIRS:
        note = reason or "too few states held a value"
        return Shift(**head, bare=nan, shift=nan, standard_error=nan, correlation=nan, n=len(both), note=note)
    shifts: Floats = both[:, 1] - both[:, 0]
    error = float(shifts.std(ddof=1) / sqrt(len(shifts)))
    spread = both.std(axis=0)
    tied = float(np.asarray(np.corrcoef(both.T))[0, 1]) if spread.min() > 0.0 else nan
    mean = float(both[:, 0].mean())
    return Shift(
        **head, bare=mean, shift=float(shifts.mean()), standard_error=error, correlation=tied, n=len(both)
    )
