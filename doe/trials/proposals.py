"""Six proposed experiments against six random ones on clean cases whose tables state every condition.

    python -m doe.trials.proposals SET SECRET     between `seal` and `open` of doe.trials.run; goes on

A case is answered; where no name stands, six measurements are made as `next` proposes them, and, beside
these, six at random: an observable that the laboratory has, conditions drawn over the same ranges, three
repeats each. Both tables are answered. Answers are made in processes that are given problems only.
"""

import json
import os
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from multiprocessing import get_context
from typing import Any

import numpy as np
import typer

from doe.common.cases import method_commit
from doe.trials.answers import parts_of
from doe.trials.reduced.families import stated_case
from doe.trials.reduced.laboratory import RANGES, Readings, Truth, read, table_of
from doe.trials.run import SealedSet, Secret, opened
from taichi_erosion.core.files import write_atomic
from taichi_erosion.evidence.answers.compare import no_progress
from taichi_erosion.evidence.answers.discover import discover
from taichi_erosion.evidence.answers.next_experiments import next_experiments
from taichi_erosion.evidence.data.findings import Experiment
from taichi_erosion.evidence.data.problem import Laboratory, Measurements, Problem

ARMS = ("proposed", "random")
SILENT = ("none_detected", "not_testable", "group", "unstable")  # after which a user would ask `next`
SLOTS = 6  # measurements that a laboratory can make
Request = tuple[str, dict[str, float]]  # observable and conditions of one measurement


def laboratory(problem: Problem) -> Laboratory:
    """What could be measured next: every condition within the range of clean cases."""
    return Laboratory({name: RANGES[name][:2] for name in problem.measurements.conditions})


def random_requests(generator: np.random.Generator, problem: Problem) -> list[Request]:
    """Measurements of observables at conditions drawn over the same ranges that proposals have."""
    found = []
    for _ in range(SLOTS):
        observable = str(generator.choice(list(problem.observables)))
        setting = {}
        for name, (low, high) in laboratory(problem).ranges.items():
            share = float(generator.random())
            setting[name] = low * (high / low) ** share if low > 0.0 else low + share * (high - low)
        found.append((observable, setting))
    return found


def proposed_requests(experiments: tuple[Experiment, ...], spare: list[Request]) -> list[Request]:
    """What is proposed; slots that are left over go to random measurements."""
    asked = [(each.observable, dict(each.conditions)) for each in experiments]
    return [*asked, *spare][:SLOTS]


def measured_too(
    generator: np.random.Generator, problem: Problem, truth: Truth, level: float, requests: list[Request]
) -> Problem:
    """The study with new rows: as many repeats of every request as the laboratory makes."""
    repeats, table = laboratory(problem).repeats, problem.measurements
    for number, (observable, setting) in enumerate(requests):
        at = {name: np.full(repeats, setting[name]) for name in table.conditions}
        group = (f"new-{number}",) * repeats
        table = joined(table, read(generator, truth, observable, at, level, group))
    return replace(problem, measurements=table)


def joined(table: Measurements, new: Readings) -> Measurements:
    """The table with readings of one observable below its own rows."""
    size, rows = new.value.size, table_of([new])
    return replace(
        table,
        observable=table.observable + rows.observable,
        value=np.append(table.value, rows.value),
        sd=np.append(table.sd, rows.sd),
        n=np.append(table.n, rows.n),
        group=table.group + rows.group,
        unit=table.unit + rows.unit,
        conditions={name: np.append(column, new.at[name]) for name, column in table.conditions.items()},
        censored=np.append(table.censored, rows.censored),
        limit=np.append(table.limit, rows.limit),
        source=table.source + rows.source,
        reach=None if table.reach is None else np.append(table.reach, np.zeros(size)),
    )


def asked_first(problem: Problem, number: int) -> tuple[dict[str, Any], dict[str, list[Request]]]:
    """Answer before, and what to measure by either way where no name stands."""
    found = discover(problem, number, problem.budget, no_progress)
    answer: dict[str, Any] = {"before": parts_of(found)}
    if found.verdict not in SILENT:
        return answer, {}
    spare = random_requests(np.random.default_rng(number), problem)
    proposed = next_experiments(problem, found, laboratory(problem))
    chance = proposed.experiments[-1].chance if proposed.experiments else 0.0
    answer |= {"proposals": len(proposed.experiments), "chance": chance}
    return answer, {"proposed": proposed_requests(proposed.experiments, spare), "random": spare}


def asked_again(problem: Problem, number: int) -> dict[str, Any]:
    """Answer with more measurements."""
    return parts_of(discover(problem, number, problem.budget, no_progress))


def main(name: str, secret: Secret, processes: int = 1) -> None:
    """Answers before and after either kind of measurements; the laboratory alone knows the truths."""
    place, method = SealedSet("proposals", name), method_commit()
    os.environ["OPENBLAS_NUM_THREADS"] = "1"  # read by the processes when they start
    with ProcessPoolExecutor(processes, mp_context=get_context("spawn")) as pool:
        for number, (seed, _, drawn) in enumerate(opened(place, secret)):
            file = place.folder / f"{number:05d}.json"
            if file.exists():
                continue
            case = stated_case(seed)
            answer, requests = pool.submit(asked_first, drawn.problem, number).result()
            for arm, asked in requests.items():
                generator = np.random.default_rng([seed, number, ARMS.index(arm)])
                more = measured_too(generator, case.problem, case.truth, case.level, asked)
                answer[arm] = pool.submit(asked_again, more, number).result()
            write_atomic(file, json.dumps({"method": method, **answer}).encode())


if __name__ == "__main__":
    typer.run(main)
