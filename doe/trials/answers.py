"""What the program says of one case, without the truth: of a problem file, or of a study by the commands.

Both give the same entries: verdict, named, group, probabilities (above 1e-4), p_misfit, strengths and
parameters (value, low, high), vault (misfit a held-out row bare, with what is named, with a random effect),
mechanisms where they were asked for, runs and seconds.
"""

import json
import os
import pickle
import subprocess
import sys
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, replace
from itertools import repeat
from multiprocessing import get_context
from pathlib import Path
from time import process_time
from types import SimpleNamespace
from typing import Any

from doe.common.cases import method_commit
from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.files import write_atomic
from taichi_erosion.evidence.answers.adopt import adopt
from taichi_erosion.evidence.answers.compare import SEED, calibrated_base, no_progress
from taichi_erosion.evidence.answers.discover import discover
from taichi_erosion.evidence.data.findings import Discovery
from taichi_erosion.evidence.data.mechanism_findings import BeyondList
from taichi_erosion.evidence.data.problem import Candidate, Problem
from taichi_erosion.evidence.inference import verdict_levels as levels
from taichi_erosion.evidence.inference.intervals.estimates import estimates_alone
from taichi_erosion.evidence.inference.posterior import parameter_estimates
from taichi_erosion.evidence.models.new_conditions import NewConditions
from taichi_erosion.evidence.models.own_effects import DosedModel
from taichi_erosion.evidence.prediction.predict import predict

PROGRAM = (sys.executable, "-m", "taichi_erosion")
LEAST = 1e-4  # of a probability that is kept
FOUND = "found_law"
TOLD = 4  # mechanisms whose evidence is kept
Answer = dict[str, Any]


def answer_all(tasks: Sequence[Path], processes: int = 1) -> None:
    """Answer every file that has no answer yet, beside it; each process is given nothing but files."""
    os.environ["OPENBLAS_NUM_THREADS"] = "1"  # read by the processes when they start
    answers = [task.with_suffix(".json") for task in tasks]
    with ProcessPoolExecutor(processes, mp_context=get_context("spawn")) as pool:
        list(pool.map(answer_file, tasks, answers, repeat(method_commit())))


def answer_file(task: Path, answer: Path, method: str) -> None:
    """Answer of one file, which is all that the solver is given; an answer that is there already is kept."""
    if not answer.exists():
        found = study_answer(task) if task.suffix == ".toml" else problem_answer(task)
        write_atomic(answer, json.dumps({"method": method, **found}, default=float).encode())


def problem_answer(file: Path) -> Answer:
    """Answer of a problem, or of a problem with conditions at which values are asked."""
    problem, asked = pickle.loads(file.read_bytes())
    return answered(int(file.stem[5:]), problem) if asked is None else predicted(problem, asked)


def answered(number: int, problem: Problem) -> Answer:
    """Discover, and adopt what is named alone or the law of a mechanism."""
    start = process_time()
    found = discover(problem, number, problem.budget, no_progress)
    answer = {"p": found.p, "seconds": process_time() - start, **parts_of(found)}
    if len(found.named) == 1 and found.verdict == "present" and problem.vault.rows.size:
        proof = adopt(problem, found.named, number, no_progress)
        fits = (proof.base, proof.added, proof.random_wrong)
        answer["vault"] = [fit.vault_chi2_per_row if fit else None for fit in fits]
    if found.trend is not None:
        answer["trend"] = asdict(found.trend)
    if found.beyond is not None:
        answer |= mechanisms_of(found.beyond) | {"held_out": held_out(problem, found.beyond, number)}
    return answer


def parts_of(found: Discovery) -> Answer:
    """What is kept of any answer."""
    return {
        "verdict": found.verdict,
        "named": found.named,
        "group": found.group,
        "dropped": [e.name for e in found.members if e.name not in (*found.named, *found.group)],
        "probabilities": {name: p for name, p in found.probabilities.items() if p > LEAST},
        "p_misfit": found.p_misfit,
        "strengths": {
            name: (effect.strength, effect.strength_low, effect.strength_high)
            for name, effect in found.effects.items()
            if name in found.named
        },
        "parameters": {path: (fit.value, fit.low, fit.high) for path, fit in found.parameters.items()},
        "runs": found.runs,
    }


def mechanisms_of(beyond: BeyondList) -> Answer:
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


def predicted(problem: Problem, asked: NewConditions) -> Answer:
    """Intervals at new conditions, and of calibrated numbers by the calibrated model alone and averaged."""
    found = predict(problem, asked)
    prepared, base, _ = calibrated_base(problem, SEED, no_progress)
    averaged = estimates_alone(prepared, base)[1]
    told = [path for path, each in averaged.items() if each.prior_share < levels.UNIDENTIFIED]
    tables = {"plain": parameter_estimates(prepared, base), "averaged": averaged}
    return {
        "rows": [(row.low, row.high, row.measured_low, row.measured_high) for row in found.rows],
        "fitted": found.fitted.inside / found.fitted.n,
        "numbers": {
            name: {path: (table[path].low, table[path].high) for path in told}
            for name, table in tables.items()
        },
    }


def study_answer(study: Path, budget: str = "quick", likeliest: bool = False) -> Answer:
    """The same by the commands, as a user would ask; where nothing is told, the likeliest may be adopted.

    Its error shows whether silence was right. `adopt` refuses a table without a scatter.
    """
    found = command("discover", study, "--budget", budget)
    words = {"named": found["named"], "group": found["group"][:1]}
    words |= {"likeliest": likeliest_of(found) if likeliest else [], "nothing acts": []}
    reason, names = next((word, names) for word, names in words.items() if names or word == "nothing acts")
    answer = document_parts(found) | {"adopted_as": reason, "effect": "+".join(names)}
    try:
        adopted = command("adopt", study, *names) if names else None
    except BadInput as refusal:
        return answer | {"adopted_as": str(refusal)}
    vault = adopted["vault"] if adopted else {}
    told = [vault.get(f"chi2_per_row_{when}") for when in ("before", "after", "wrong_effect")]
    fits = {key: adopted[key] for key in ("base", "added")} if adopted else {}
    return answer | {"vault": told, "fits": fits}


def likeliest_of(found: Mapping[str, Any]) -> list[str]:
    """The single candidate with the largest probability."""
    known = {name: found["probabilities"].get(name, 0.0) for name in found["effects"]}
    return [max(known, key=lambda name: known[name])] if any(known.values()) else []


def document_parts(found: Mapping[str, Any]) -> Answer:
    """What is kept of the document of `discover`."""
    kept = ("verdict", "named", "group", "p_misfit", "p_misfit_after", "runs", "n", "rows_hidden")
    kept += ("chi2_before", "chi2_after", "mechanisms")
    return {
        **{key: found[key] for key in kept if key in found},
        "probabilities": {name: p for name, p in found["probabilities"].items() if p > LEAST},
        "strengths": {
            name: [each[key] for key in ("strength", "strength_low", "strength_high")]
            for name, each in found["effects"].items()
        },
        "parameters": {
            path: [fit[key] for key in ("value", "low", "high")] for path, fit in found["parameters"].items()
        },
        "seconds": found["wall_s"],
    }


def command(word: str, study: Path, *rest: str) -> dict[str, Any]:
    """One command of the program, with its document; raises BadInput where it fails."""
    told = subprocess.run([*PROGRAM, word, str(study), *rest, "--json"], capture_output=True, text=True)
    if told.returncode:
        raise BadInput(f"{study}: {word} ended with {told.returncode}: {told.stderr[-500:]}")
    return json.loads(told.stdout)
