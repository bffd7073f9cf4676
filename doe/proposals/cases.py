"""Cases of doe/t0 whose tables state every condition, and new measurements of the same laboratories."""

from dataclasses import replace

import numpy as np

from doe.sealed.cases import Case, case_generator, draw_case, kind_of
from doe.sealed.laboratory import RANGES, Readings, Truth, read
from taichi_erosion.evidence.data.findings import Experiment
from taichi_erosion.evidence.data.problem import Budget, Laboratory, Measurements, Problem
from taichi_erosion.evidence.models.reduced import DEFAULTS

COUNTS = {"single": 130, "pair": 50, "impossible": 20, "null": 30}  # cases that are drawn
TWIN = "twin_of_"  # before the name of a copy
SLOTS = 6  # measurements that a laboratory can make
Request = tuple[str, dict[str, float]]  # observable and conditions of one measurement


def drawn_cases(salt: int, share: float = 1.0) -> list[Case]:
    """The first cases of every kind out of one salt, their tables with every condition; a share of COUNTS."""
    wanted = {kind: round(share * count) for kind, count in COUNTS.items()}
    found: dict[str, list[Case]] = {kind: [] for kind in COUNTS}
    number = 0
    while any(len(found[kind]) < count for kind, count in wanted.items()):
        kind = kind_of(case_generator(salt, number))
        if kind in COUNTS and len(found[kind]) < wanted[kind]:
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
    count = new.value.size
    return replace(
        table,
        observable=(*table.observable, *[new.observable] * count),
        value=np.append(table.value, new.value),
        sd=np.append(table.sd, new.sd),
        n=np.append(table.n, np.ones(count)),
        group=(*table.group, *new.group),
        unit=(*table.unit, *[""] * count),
        conditions={name: np.append(column, new.at[name]) for name, column in table.conditions.items()},
        censored=np.append(table.censored, np.zeros(count, dtype=np.bool_)),
        limit=np.append(table.limit, np.full(count, np.nan)),
        source=(*table.source, *["sealed case"] * count),
        reach=None if table.reach is None else np.append(table.reach, np.zeros(count)),
    )
