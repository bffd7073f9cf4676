"""The race beside the former method, on stored cases drawn again from their seeds and on new ones.

    python -m doe.trials.race again clean first --cases 200     adds the set `first, race`
    python -m doe.trials.race beside disturbed 777 --cases 150  adds `beside` and `beside, race`
    python -m doe.trials.score clean                            scores both

Only sets that keep their seeds can be drawn again (README).
"""

import os
from collections.abc import Mapping
from concurrent.futures import ProcessPoolExecutor
from itertools import repeat
from multiprocessing import get_context
from time import process_time
from typing import Any

import typer

from doe.common.cases import method_commit
from doe.trials.answers import LEAST, Answer, answered
from doe.trials.reduced.families import FAMILIES
from doe.trials.table import Row, add_rows, read_rows, table_of
from taichi_erosion.evidence.data.problem import Problem
from taichi_erosion.evidence.race.decision import decide
from taichi_erosion.evidence.race.posterior import raced
from taichi_erosion.evidence.race.record import Interval
from taichi_erosion.evidence.race.summary import summary

app = typer.Typer(add_completion=False)
ANEW = ", race"  # end of the name of a set that was answered by the race


def race_answer(problem: Problem, seed: int) -> Answer:
    """What is kept of a race, with the entries of every other answer."""
    start = process_time()
    posterior = raced(problem, seed)
    found = decide(posterior)
    record = summary(posterior, found)
    answer = {
        "verdict": found.verdict,
        "named": found.named,
        "group": found.group,
        "probabilities": {key: p for key, p in record.decided.probabilities.items() if p > LEAST},
        "p": found.familywise,
        "p_misfit": record.fit.p_before,
        "strengths": {name: numbers(record.effects[name].strength) for name in found.named},
        "parameters": {path: numbers(part.now) for path, part in record.numbers.items()},
        "settings": posterior.race.model.settings,
        "runs": record.cost.runs,
        "vault": [None, None, None],
        "seconds": process_time() - start,
    }
    if problem.mechanisms:
        answer |= {"mechanisms": found.mechanisms, "beyond": found.beyond}
    return answer


def numbers(interval: Interval) -> tuple[float, float, float]:
    """Value, low, high."""
    return interval.value, interval.low, interval.high


def answered_anew(trial: str, row: Row, method: str) -> Row:
    """A stored case drawn again and answered by the race."""
    case = FAMILIES[trial](int(row["seed"], 16), row["case"])
    same = plain(case.truth) == plain(row["truth"])
    answer: dict[str, Any] = race_answer(case.problem, row["case"]) if same else {}
    return row | {"set": f"{row['set']}{ANEW}", "method": method, "answer": answer}


def plain(truth: Mapping[str, Any]) -> tuple[Any, ...]:
    """What two draws of one case have in common."""
    return truth.get("kind"), truth.get("name"), tuple(truth.get("effects") or ())


def drawn_and_answered(trial: str, seed: int, number: int, method: str) -> list[Row]:
    """A new case answered by the former method, and by the race."""
    case = FAMILIES[trial](seed, number)
    head = {"set": "beside", "case": number, "method": method, "seed": f"{seed:x}"}
    told = {"truth": case.truth, "difficulty": case.difficulty()}
    answers = answered(number, case.problem), race_answer(case.problem, number)
    rows = [head | told | {"answer": answer} for answer in answers]
    return [rows[0], rows[1] | {"set": f"beside{ANEW}"}]


@app.command()
def again(trial: str, name: str, cases: int = 300, first: int = 0, processes: int = 2) -> None:
    """Draw stored cases again and answer them by the race."""
    os.environ["OPENBLAS_NUM_THREADS"] = "1"
    stored = [row for row in read_rows(table_of(trial)) if row["set"] == name and "seed" in row]
    wanted = stored[first : first + cases]
    with ProcessPoolExecutor(processes, mp_context=get_context("spawn")) as pool:
        found = list(pool.map(answered_anew, repeat(trial), wanted, repeat(method_commit())))
    rows = [row for row in found if row["answer"]]
    if len(rows) < len(found):
        raise ValueError(f"{len(found) - len(rows)} of {len(found)} cases were drawn otherwise")
    add_rows(trial, rows)


@app.command()
def beside(trial: str, seed: int, cases: int = 150, processes: int = 2) -> None:
    """Draw new cases and answer them by both."""
    os.environ["OPENBLAS_NUM_THREADS"] = "1"
    method = method_commit()
    with ProcessPoolExecutor(processes, mp_context=get_context("spawn")) as pool:
        found = pool.map(drawn_and_answered, repeat(trial), repeat(seed), range(cases), repeat(method))
        add_rows(trial, [row for rows in found for row in rows])


if __name__ == "__main__":
    app()
