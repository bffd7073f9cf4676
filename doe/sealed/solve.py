"""Solving sealed problems: the same entry points as a user's, and only what scoring needs is kept.

A problem comes as a file that holds what a user would hand in and nothing else; the answer goes into another.
"""

import json
import pickle
from dataclasses import asdict, dataclass
from pathlib import Path
from time import process_time
from typing import Any

from taichi_erosion.core.files import write_atomic
from taichi_erosion.evidence.answers.adopt import adopt
from taichi_erosion.evidence.answers.compare import no_progress
from taichi_erosion.evidence.answers.discover import discover
from taichi_erosion.evidence.data.findings import Discovery
from taichi_erosion.evidence.data.problem import Problem


@dataclass(frozen=True)
class Outcome:
    """What the program said about one sealed problem."""

    number: int
    verdict: str
    named: tuple[str, ...]
    group: tuple[str, ...]
    probabilities: dict[str, float]
    p: float
    strengths: dict[str, tuple[float, float, float]]  # named effect -> value, low, high
    parameters: dict[str, tuple[float, float, float]]
    vault: tuple[float, ...]  # misfit per held-out row: bare, with the named effect, with a random one
    runs: int
    seconds: float  # of one core
    dropped: tuple[str, ...] = ()  # members of a set that are told as not needed


def solve_file(problem: Path, answer: Path, with_vault: bool = True) -> None:
    """Answer of one problem file; an answer that is there already is kept."""
    if not answer.exists():
        outcome = solve(int(problem.stem), pickle.loads(problem.read_bytes()), with_vault)
        write_atomic(answer, json.dumps(asdict(outcome)).encode())


def answer_of(path: Path) -> Outcome:
    """An answer as it was written."""
    return outcome_of(json.loads(path.read_text(encoding="utf-8")))


def outcome_of(found: dict[str, Any]) -> Outcome:
    """An answer out of plain tables."""
    lists: dict[str, Any] = {
        name: tuple(found[name]) for name in ("named", "group", "vault", "dropped") if name in found
    }
    return Outcome(**{**found, **lists})


def solve(number: int, problem: Problem, with_vault: bool) -> Outcome:
    """Discover, and adopt what was named alone."""
    start = process_time()
    found = discover(problem, number, problem.budget, no_progress)
    spent = process_time() - start
    vault: tuple[float, ...] = (float("nan"),) * 3
    if with_vault and found.verdict == "present" and len(found.named) == 1 and problem.vault.rows.size:
        vault = vault_errors(number, problem, found)
    return Outcome(
        number=number,
        verdict=found.verdict,
        named=found.named,
        group=found.group,
        probabilities=dict(found.probabilities),
        p=found.p,
        strengths={
            name: (effect.strength, effect.strength_low, effect.strength_high)
            for name, effect in found.effects.items()
            if name in found.named
        },
        parameters={path: (fit.value, fit.low, fit.high) for path, fit in found.parameters.items()},
        vault=vault,
        runs=found.runs,
        seconds=spent,
        dropped=tuple(e.name for e in found.members if e.name not in (*found.named, *found.group)),
    )


def vault_errors(number: int, problem: Problem, found: Discovery) -> tuple[float, float, float]:
    """Held-out misfit of the bare model, of the adopted effect, of a random wrong one."""
    proof = adopt(problem, found.named[:1], number, no_progress)
    wrong = proof.random_wrong.vault_chi2_per_row if proof.random_wrong is not None else float("nan")
    return proof.base.vault_chi2_per_row, proof.added.vault_chi2_per_row, wrong
