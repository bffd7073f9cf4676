"""What the program says of one case, without the truth: of a problem file, or of a study by the commands.

Both give the same entries: verdict, named, group, mechanisms, probabilities (above LEAST), strengths,
parameters and powers of the law (value, low, high), vault (misfit a held-out row before, after, with a random
other effect), settings, runs and seconds.
"""

import json
import os
import pickle
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from itertools import repeat
from math import isfinite
from multiprocessing import get_context
from pathlib import Path
from time import process_time
from typing import Any

from doe.common.cases import method_commit
from doe.trials.tables.solve import table_answer
from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.files import write_atomic
from taichi_erosion.evidence.answers.commands import adopt_study, discover_record, discover_study
from taichi_erosion.evidence.answers.rounds import StudyInference
from taichi_erosion.evidence.data.problem import Problem
from taichi_erosion.evidence.models.load_study import BudgetName, StudyOptions
from taichi_erosion.evidence.models.table_columns import NewConditions
from taichi_erosion.evidence.race.decision import decide_cause
from taichi_erosion.evidence.race.outlook import forecast, held_out_part, joint_rows, new_rows
from taichi_erosion.evidence.race.posterior import Posterior, condition_on_effects, infer
from taichi_erosion.evidence.record import DecisionPart, HeldOutPart, Interval, Record

LEAST = 1e-3  # of a probability that is kept
Answer = dict[str, Any]
REFUSED: Answer = {"verdict": "refused", "named": [], "group": [], "mechanisms": [], "vault": [None] * 3}


def answer_all(tasks: Sequence[Path], processes: int = 1) -> None:
    """Answer every file that has no answer yet, beside it; each process is given nothing but files."""
    os.environ["OPENBLAS_NUM_THREADS"] = "1"  # read by the processes when they start
    answers = [task.with_suffix(".json") for task in tasks]
    with ProcessPoolExecutor(processes, mp_context=get_context("spawn")) as pool:
        list(pool.map(answer_file, tasks, answers, repeat(method_commit())))


def answer_file(task: Path, answer: Path, method: str) -> None:
    """Answer of one file, which is all that the solver is given; an answer that is there already is kept."""
    if not answer.exists():
        solve = table_answer if task.is_dir() else study_answer if task.suffix == ".toml" else problem_answer
        found = solve(task)
        write_atomic(answer, json.dumps({"method": method, **found}, default=float).encode())


def problem_answer(file: Path) -> Answer:
    """Answer of a problem, or of a problem with conditions at which values are asked."""
    problem, asked = pickle.loads(file.read_bytes())
    return answered(problem, int(file.stem[5:]), asked)


def answered(problem: Problem, seed: int, asked: NewConditions | None = None) -> Answer:
    """Discover, adopt what is named or the likeliest mechanism, and predict where that is asked."""
    start = process_time()
    posterior = infer(problem, seed)
    record = discover_record(StudyInference(posterior, decide_cause(posterior)))
    seconds = process_time() - start
    answer = kept(record, held_out(posterior, record, seed)) | {"seconds": seconds}
    return answer | ({"rows": predicted(posterior, asked)} if asked else {})


def held_out(posterior: Posterior, decided: DecisionPart, seed: int) -> HeldOutPart | None:
    """Held-out rows with what is named, or with the mechanism that is told; None where nothing is."""
    if decided.named:
        return held_out_part(condition_on_effects(posterior, decided.named), decided.named, seed)
    mechanisms = decided.acting_mechanisms
    return held_out_part(posterior, mechanisms, seed) if mechanisms else None


def predicted(posterior: Posterior, asked: NewConditions) -> list[tuple[float, ...]]:
    """Ends of the intervals at new conditions, of the mean and of one more measurement."""
    found = forecast(posterior, joint_rows(posterior.race, new_rows(posterior.race.prepared, asked)))
    pairs = zip(found.forecast_intervals(found.mean), found.forecast_intervals(found.new_value), strict=True)
    return [(mean.low, mean.high, one.low, one.high) for mean, one in pairs]


def study_answer(study: Path, budget: BudgetName | None = None) -> Answer:
    """The same by the commands, as a user would ask; of a group its first member is adopted.

    A study that the program refuses, as one whose scatter is unknown, has that verdict and says nothing.
    """
    options = StudyOptions(budget=budget)
    try:
        record = discover_study(study, lambda *_: None, options).record
    except BadInput as refusal:
        return REFUSED | {"refusal": str(refusal)}
    names = record.named or record.group[:1]
    adopted = adopt_study(study, names, lambda *_: None, options).record if names else None
    answer = kept(record, adopted and adopted.vault)
    return answer | {"adopted": names, "n": record.n, "seconds": record.wall_s}


def kept(record: Record, held: HeldOutPart | None) -> Answer:
    """What is kept of an answer."""
    ends = ("before", "after", "wrong_effect")
    return {
        "verdict": record.verdict,
        "named": record.named,
        "group": record.group,
        "mechanisms": record.acting_mechanisms,
        "probabilities": {key: p for key, p in record.probabilities.items() if p > LEAST},
        "p": record.p,
        "p_misfit": record.p_misfit,
        "strengths": intervals({name: record.effects[name].strength_range for name in record.named}),
        "parameters": intervals(record.parameters),
        "law": record.law.mechanism if record.law else "",
        "powers": intervals(record.law.powers) if record.law else {},
        "vault": [getattr(held, f"chi2_per_row_{end}", None) for end in ends],
        "settings": record.settings,
        "runs": record.runs,
    }


def intervals(found: Mapping[str, Interval]) -> dict[str, tuple[float, float, float]]:
    """Value, low, high of every name; a strength that varies has none."""
    known = {name: each for name, each in found.items() if isfinite(each.value)}
    return {name: (each.value, each.low, each.high) for name, each in known.items()}
