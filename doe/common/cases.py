"""Cases of a study: one scene, some of its parameters changed, a few seeds; and the table of what came out.

Each case is simulated in a process of its own on one thread, by the command that stands in its rows, so that
any row can be repeated alone.
"""

import json
import shlex
import subprocess
import sys
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from math import nan
from pathlib import Path
from typing import Any

from doe.common.tables import read_table, update_table, write_table
from taichi_erosion.core.errors import BadInput

ROOT = Path(__file__).parents[2]  # where scenes/ and doe/ lie
MEASURED = ROOT / "taichi_erosion" / "effect_library" / "measured"  # tables that `effects NAME` prints
STOPPED = "stopped"  # observable of a case that gave no result; `note` says why
SIZES = {"median": 1.0, "low": 0.8, "high": 1.25}  # of nearly uniform sand, over its diameter [1]
DRAG_ALONE = "effects={}"  # setting of a scene that ships with the forces on a grain at rest
GUARDED = 3  # exit code of a run of which its guards stopped a seed; with a document where others ended


@dataclass(frozen=True)
class Case:
    """One row group of a study: `order` are the words after the scene, as typed on the command line."""

    group: str  # which question it answers
    label: str  # which answer to compare
    order: tuple[str, ...]
    replicas: int = 1


@dataclass(frozen=True)
class Row:
    """One observable of one case; `value` is the mean of `n` seeds and `sd` the spread of single seeds."""

    group: str
    label: str
    observable: str
    value: float
    sd: float
    n: int
    unit: str
    hash: str
    seed: int  # of the first replica
    time_step: float  # s
    time_step_over_rayleigh: float
    grains: int
    wall_s: float
    command: str
    versions: str
    note: str = ""

    @property
    def standard_error(self) -> float:
        """Of the mean, in the row's unit."""
        return self.sd / self.n**0.5 if self.n > 1 else nan


Found = dict[tuple[str, str], dict[str, Row]]  # rows by group and label, then by observable


def settings(*orders: str) -> tuple[str, ...]:
    """PATH=VALUE words as the command line wants them."""
    return tuple(word for order in orders for word in ("--set", order))


def size_order(diameter: float) -> str:
    """Setting of the sizes of nearly uniform sand about a median [m]."""
    sizes = ", ".join(f"{name} = {share * diameter:.6g}" for name, share in SIZES.items())
    return f'grains.size={{ law = "lognormal", sigma_log = 0.1, {sizes} }}'


def command(scene: str, case: Case) -> list[str]:
    """Words of `taichi-erosion` that simulate a case."""
    plain = ["--replicas", str(case.replicas), "--threads", "1", "--no-record", "--json"]
    return ["run", scene, *case.order, *plain]


def simulate(scene: str, case: Case) -> list[Row]:
    """Simulate one case in its own process; what a guard stops is a row, what is refused raises BadInput."""
    typed, document, reason = document_of(scene, case)
    return [stopped(case, typed, reason)] if document is None else rows_of(case, typed, document)


def document_of(scene: str, case: Case) -> tuple[str, dict[str, Any] | None, str]:
    """Command of a case, the document that it prints, if its guards left one, and its last word of error."""
    words = command(scene, case)
    program = [sys.executable, "-m", "taichi_erosion"]
    done = subprocess.run([*program, *words], cwd=ROOT, capture_output=True, text=True, check=False)
    typed = shlex.join(["./erosion", *words])
    reason = (done.stderr.strip().splitlines() or [""])[-1]
    if done.returncode not in (0, GUARDED):
        raise BadInput(f"{typed}: {reason}")
    return typed, json.loads(done.stdout) if done.stdout else None, reason


def stopped(case: Case, typed: str, reason: str) -> Row:
    """Row of a case without a result."""
    return Row(case.group, case.label, STOPPED, nan, nan, 0, "", "", 0, nan, nan, 0, nan, typed, "", reason)


def rows_of(case: Case, typed: str, document: dict[str, Any]) -> list[Row]:
    """Rows of the document that `run --json` prints."""
    limits = document["limits"]
    stops = [replica["stopped"] for replica in document["replicas"] if replica["stopped"]]
    notes = [f"{len(stops)} seeds stopped: {', '.join(sorted(set(stops)))}"] if stops else []
    return [
        Row(
            group=case.group,
            label=case.label,
            observable=name,
            value=number(found["value"]),
            sd=number(found["sd"]) if found["n"] > 1 else nan,
            n=found["n"],
            unit=found["unit"],
            hash=document["hash"],
            seed=document["seed"],
            time_step=limits["time_step"],
            time_step_over_rayleigh=limits["time_step_over_rayleigh"],
            grains=document["resolved"]["grains"]["count"],
            wall_s=round(document["wall_s"], 1),
            command=typed,
            versions="; ".join(f"{key} {version}" for key, version in document["versions"].items()),
            note="; ".join(
                notes + found["notes"] + [each["sentence"] for each in found.get("shortfalls", ())]
            ),
        )
        for name, found in document["measures"].items()
    ]


def number(value: float | None) -> float:
    """A number of a JSON document, where null stands for none."""
    return nan if value is None else value


def method_commit() -> str:
    """Commit that answers, with a mark where the tree differs from it in more than results of trials."""
    words = ["git", "describe", "--always", "--abbrev=10", "--exclude=*"]
    done = subprocess.run(words, cwd=ROOT, capture_output=True, text=True, check=True)
    differs = ["git", "diff", "--quiet", "HEAD", "--", ".", ":!doe/trials/results"]
    return done.stdout.strip() + "-dirty" * subprocess.run(differs, cwd=ROOT).returncode


def perform(scene: str, cases: Iterable[Case], table: Path) -> None:
    """Simulate cases one after the other; the table is written after each, in place of its earlier rows."""
    for case in cases:
        update_table(table, Row, simulate(scene, case), lambda row: (row.group, row.label))


def write_rows(table: Path, rows: Sequence[Row]) -> None:
    """Write rows as CSV."""
    write_table(table, Row, rows)


def read_rows(table: Path) -> list[Row]:
    """Rows of a table that `write_rows` wrote."""
    return read_table(table, Row)


def by_case(rows: Sequence[Row]) -> Found:
    """Rows of each case."""
    cases: Found = {}
    for row in rows:
        cases.setdefault((row.group, row.label), {})[row.observable] = row
    return cases
