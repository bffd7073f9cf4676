"""Six proposed experiments against six random ones on sealed clean cases whose tables state every condition.

    python -m doe.trials.proposals draw SET SECRET     truths into SECRET, their digest into seals/
    python -m doe.trials.proposals solve SET SECRET    asks, measures, asks again; goes on
    python -m doe.trials.proposals open SET SECRET     results/proposals.jsonl.gz

A case is answered; where no name stands, six measurements are made as `next` proposes them, and, beside
these, six at random: an observable that the laboratory has, conditions drawn over the same ranges, three
repeats each. Both tables are answered. Answers are made in processes that are given problems only.
"""

import json
import os
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, replace
from multiprocessing import get_context
from pathlib import Path
from secrets import randbits
from typing import Any

import numpy as np
import typer

from doe.trials.answers import method_commit
from doe.trials.reduced.clean import TWIN, Case, case_generator, draw_case, kind_of
from doe.trials.reduced.laboratory import RANGES, Readings, Truth, read, table_of
from doe.trials.run import SealedSet, Secret, digest, truth_text
from doe.trials.table import add_rows
from taichi_erosion.core.files import write_atomic
from taichi_erosion.evidence.answers.compare import no_progress
from taichi_erosion.evidence.answers.discover import discovery_of
from taichi_erosion.evidence.answers.next_experiments import next_experiments
from taichi_erosion.evidence.data.findings import Experiment
from taichi_erosion.evidence.data.problem import Budget, Laboratory, Measurements, Problem
from taichi_erosion.evidence.inference.pipeline import Analysis, confirmed_analysis
from taichi_erosion.evidence.inference.prepared_problem import prepare
from taichi_erosion.evidence.models.reduced import DEFAULTS

ARMS = ("proposed", "random")
SILENT = ("none_detected", "not_testable", "group", "unstable")  # after which a user would ask `next`
app = typer.Typer(add_completion=False)

COUNTS = {"single": 130, "pair": 50, "impossible": 20, "null": 30}  # cases that are drawn
SLOTS = 6  # measurements that a laboratory can make
Request = tuple[str, dict[str, float]]  # observable and conditions of one measurement


def drawn_cases(salt: int) -> list[Case]:
    """The first cases of every kind out of one salt, their tables with every condition."""
    found: dict[str, list[Case]] = {kind: [] for kind in COUNTS}
    number = 0
    while any(len(found[kind]) < count for kind, count in COUNTS.items()):
        kind = kind_of(case_generator(salt, number))
        if kind in COUNTS and len(found[kind]) < COUNTS[kind]:
            case = draw_case(salt, number)
            if not has_twin(case):
                problem = replace(with_constants(case.problem), budget=Budget("quick"))
                found[kind].append(replace(case, problem=problem))
        number += 1
    return [case for cases in found.values() for case in cases]


def has_twin(case: Case) -> bool:
    """Whether a copy of what acts is listed under another name: no measurement tells the two apart."""
    return any(each.name.startswith(TWIN) for each in case.problem.candidates)


def with_constants(problem: Problem) -> Problem:
    """The study with a column for every condition, also for those that were held constant."""
    table, flux = problem.measurements, "flux" in problem.observables
    held = {
        name: np.full(table.size, value)
        for name, value in DEFAULTS.items()
        if name not in table.conditions and (flux or name != "u_star")
    }
    return replace(problem, measurements=replace(table, conditions={**table.conditions, **held}))


def laboratory(problem: Problem) -> Laboratory:
    """What could be measured next: every condition within the range of doe/t0."""
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


def analysed(problem: Problem, number: int) -> Analysis:
    """The inference of `discover`, without what only its sentences need."""
    return confirmed_analysis(prepare(problem, problem.visible(), number), number, no_progress)


def parts_of(found: Analysis) -> dict[str, Any]:
    """What is kept of an answer."""
    decision = found.decision
    return {
        "verdict": decision.verdict,
        "named": list(decision.named),
        "group": list(decision.group),
        "probabilities": dict(found.posterior.probability),
    }


def asked_first(problem: Problem, number: int) -> tuple[dict[str, Any], dict[str, list[Request]]]:
    """Answer before, and what to measure by either way where no name stands."""
    found = analysed(problem, number)
    answer = {"before": parts_of(found)}
    if found.decision.verdict not in SILENT:
        return answer, {}
    spare = random_requests(np.random.default_rng(number), problem)
    proposed = next_experiments(problem, discovery_of(found, number), laboratory(problem))
    chance = proposed.experiments[-1].chance if proposed.experiments else 0.0
    answer |= {"proposals": len(proposed.experiments), "chance": chance}
    return answer, {"proposed": proposed_requests(proposed.experiments, spare), "random": spare}


def asked_again(problem: Problem, number: int) -> dict[str, Any]:
    """Answer with more measurements."""
    return parts_of(analysed(problem, number))


def cases_of(place: SealedSet, secret: Path) -> tuple[int, list[Case]]:
    """Salt and cases; raises ValueError where a truth is not the one that was sealed."""
    salt = int(json.loads((secret / f"{place.trial}_{place.name}.json").read_text(encoding="utf-8")), 16)
    cases = drawn_cases(salt)
    if place.seals.read_text(encoding="utf-8") != seals_of(salt, cases):
        raise ValueError(f"{place.name}: the truths are not those that were sealed")
    return salt, cases


def seals_of(salt: int, cases: list[Case]) -> str:
    """Digests of all truths."""
    lines = [f"{k},{digest(truth_text(salt, k, asdict(case.truth)))}" for k, case in enumerate(cases)]
    return "\n".join(["case,sha256", *lines, ""])


@app.command()
def draw(name: str, secret: Secret) -> None:
    """A salt of the operating system; commit the digests before solving."""
    place, salt = SealedSet("proposals", name), randbits(128)
    for folder in (secret, place.tables):
        folder.mkdir(parents=True, exist_ok=True)
    write_atomic(secret / f"{place.trial}_{name}.json", json.dumps(f"{salt:x}").encode())
    write_atomic(place.seals, seals_of(salt, drawn_cases(salt)).encode())


@app.command()
def solve(name: str, secret: Secret, processes: int = 1) -> None:
    """Answers before and after either kind of measurements; the laboratory alone knows the truths."""
    place, method = SealedSet("proposals", name), method_commit()
    salt, cases = cases_of(place, secret)
    place.folder.mkdir(parents=True, exist_ok=True)
    os.environ["OPENBLAS_NUM_THREADS"] = "1"  # read by the processes when they start
    with ProcessPoolExecutor(processes, mp_context=get_context("spawn")) as pool:
        for number, case in enumerate(cases):
            file = place.folder / f"{number:03d}.json"
            if file.exists():
                continue
            answer, requests = pool.submit(asked_first, case.problem, number).result()
            for arm, asked in requests.items():
                generator = np.random.default_rng([salt, number, ARMS.index(arm)])
                more = measured_too(generator, case.problem, case.truth, case.level, asked)
                answer[arm] = pool.submit(asked_again, more, number).result()
            write_atomic(file, json.dumps({"method": method, **answer}).encode())


@app.command("open")
def open_command(name: str, secret: Secret) -> None:
    """The rows of the cases that are answered."""
    place, rows = SealedSet("proposals", name), []
    salt, cases = cases_of(place, secret)
    for number, case in enumerate(cases):
        file = place.folder / f"{number:03d}.json"
        if file.exists():
            answer, truth = json.loads(file.read_text(encoding="utf-8")), asdict(case.truth)
            head = {"set": name, "case": number, "sha256": digest(truth_text(salt, number, truth))}
            head |= {"method": answer.pop("method"), "seed": f"{salt:x}"}
            rows.append({**head, "truth": truth, "answer": answer})
    add_rows("proposals", rows)


if __name__ == "__main__":
    app()
