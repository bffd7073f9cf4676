"""Answer of one problem file: what `discover` and `adopt` say, without the truth."""

import json
import pickle
from collections.abc import Mapping
from dataclasses import asdict, replace
from pathlib import Path
from time import process_time
from types import SimpleNamespace
from typing import Any

from taichi_erosion.core.files import write_atomic
from taichi_erosion.evidence.answers.adopt import adopt
from taichi_erosion.evidence.answers.compare import no_progress
from taichi_erosion.evidence.answers.discover import discover
from taichi_erosion.evidence.data.mechanism_findings import BeyondList
from taichi_erosion.evidence.data.problem import Candidate, Problem
from taichi_erosion.evidence.models.own_effects import DosedModel

FOUND = "found_law"
TOLD = 4  # mechanisms whose evidence is kept


def solve_file(problem_file: Path, answer_file: Path, method: str) -> None:
    """Answer of one problem file, which is all that the solver is given."""
    problem: Problem = pickle.loads(problem_file.read_bytes())
    number, start = int(problem_file.stem), process_time()
    found = discover(problem, number, problem.budget, no_progress)
    answer: dict[str, Any] = {
        "method": method,
        "verdict": found.verdict,
        "named": found.named,
        "group": found.group,
        "p_misfit": found.p_misfit,
        "seconds": process_time() - start,
    }
    if found.trend is not None:
        answer |= {"trend": asdict(found.trend)}
    if found.beyond is not None:
        answer |= beyond_fields(found.beyond)
        answer |= {"held_out": held_out(problem, found.beyond, number)}
    write_atomic(answer_file, json.dumps(answer, default=float).encode())


def beyond_fields(beyond: BeyondList) -> dict[str, Any]:
    """What is told of mechanisms."""
    return {
        "beyond": beyond.verdict,
        "mechanisms": beyond.group,
        "against": beyond.named,
        "named_odds": beyond.named_odds,
        "withdrawn": beyond.withdrawn,
        "best": [[m.name, m.log_bayes_factor, m.p_left, m.p_one_dose] for m in beyond.mechanisms[:TOLD]],
        "free": beyond.log_bayes_discrepancy,
        "law": None if beyond.law is None else asdict(beyond.law),
    }


def held_out(problem: Problem, beyond: BeyondList, seed: int) -> list[float]:
    """Misfit per held-out row before and after the law is adopted; empty for an instrument or no law."""
    law, name = beyond.law, beyond.group[0] if beyond.group else ""
    if law is None or ":" in name:
        return []
    known = {tuple(at[name] for name in law.conditions): dose for at, dose in law.table}

    def dose(_params: Any, conditions: Mapping[str, float]) -> float:
        return known[tuple(conditions[name] for name in law.conditions)]

    effect: Any = SimpleNamespace(mechanism=name, params=lambda: None, dose=dose, name=FOUND)
    with_law = replace(
        problem,
        model=DosedModel(problem.model, {FOUND: effect}),
        candidates=(*problem.candidates, Candidate(FOUND)),
    )
    proof = adopt(with_law, (FOUND,), seed, no_progress)
    return [proof.base.vault_chi2_per_row, proof.added.vault_chi2_per_row]
