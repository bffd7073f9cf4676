"""Cost of an answer, told before it: runs of scenes or settings of a function, and their time here."""

from dataclasses import dataclass
from math import ceil
from time import perf_counter

import numpy as np

from taichi_erosion.campaign.execute import seconds_per_work
from taichi_erosion.campaign.ledger import finished_runs
from taichi_erosion.campaign.request import START
from taichi_erosion.core.setup import usable_cores
from taichi_erosion.evidence.emulator import training_runs
from taichi_erosion.evidence.emulator.training_runs import TrainingRuns
from taichi_erosion.evidence.models.load_study import Study
from taichi_erosion.evidence.models.prepared_problem import prepare_problem, usual_count_of_settings
from taichi_erosion.tables.number_words import count_noun

WORTH_TELLING = 5.0  # s of an answer, from which its cost is told before it
MORE = 4  # times as many settings: 9 of 10 of 480 sealed tables of doe/trials took fewer
SETTING = 0.01  # s of statistics for a setting of a function
ANSWER = 0.05  # s of statistics per run behind an answer
MINUTE, HOUR = 60.0, 3600.0  # s


@dataclass(frozen=True)
class PlanCost:
    """Runs of a plan, and seconds of wall time that they take here."""

    ledger_runs: int  # in the ledger
    first: int  # to be made at once
    later: int  # at most, in rounds about the answers
    rounds: int
    fresh: int  # at most, with which the answer ends
    workers: int
    phases: tuple[float, ...]  # expected seconds of runs and statistics in turn
    mechanisms: int  # runs of mechanisms, that may follow

    @property
    def seconds(self) -> float:
        return sum(self.phases)

    @property
    def cost_text(self) -> str:
        if not self.first + self.later + self.fresh:
            return f"No run is to be made: all {self.ledger_runs} are kept from before."
        stored = f"; {self.ledger_runs} more are kept from before" if self.ledger_runs else ""
        rounds = f"at most {self.later} in {count_noun(self.rounds, 'round')} about the answer"
        fresh = f"at most {self.fresh} that it ends with"
        later = " and ".join([rounds] * bool(self.later) + [fresh] * bool(self.fresh))
        later = f", then {later}" * bool(later)
        cores = "1 process" if self.workers == 1 else f"{self.workers} processes"
        more = f" Where no listed effect suffices, {self.mechanisms} more are made." * bool(self.mechanisms)
        time = f"at most about {span(self.seconds)} on {cores}"
        return f"{self.first} runs to make{later}: {time}{stored}.{more}"


def plan_cost(
    training: TrainingRuns, rounds: int, points: int, fresh: int = 0, missing: bool = False
) -> PlanCost:
    """Cost of the planned runs, of `rounds` more about so many points each, and of `fresh` at its end.

    `missing`: it is asked what is missing, and mechanisms may be simulated after these.
    """
    runs, requests, _ = training_runs.runs_to_make(training)
    effects = {request.key: tuple(run.effects) for run, request in zip(runs, requests, strict=True)}
    by_key = {request.key: request for request in requests}
    ledger = finished_runs(training.simulator.shared_ledger(), list(by_key))
    lacking = [request for key, request in by_key.items() if key not in ledger]
    workers = training.study.file.campaign.workers or usable_cores()
    if any(request.arch != "cpu" for request in lacking):
        workers = 1  # holds the device
    second, kinds = seconds_per_work(by_key, ledger) / workers, {effects[key] for key in ledger}
    done_of = {each: {key: ledger[key] for key in ledger if effects[key] == each} for each in kinds}
    seconds_of = {each: seconds_per_work(by_key, part) / workers for each, part in done_of.items()}
    room = max(training_runs.runs_left_by_cap(training), 0)
    ensembles = points * len(training.scenes)
    size = training.plan_size.round * ensembles
    rounds = min(rounds, room // size) if size else 0
    fresh = min(fresh, room - rounds * size)
    mean = sum(request.work for request in by_key.values()) / max(len(by_key), 1)
    groups, answer = len({request.group for request in lacking}), ANSWER * len(by_key)
    first = sum(seconds_of.get(effects[each.key], second) * each.work for each in lacking)
    first += START * ceil(groups / workers)
    round_s = second * mean * size + START * ceil(ensembles / workers)
    phases = [first, answer, *[round_s, answer] * rounds]
    phases += [second * mean * fresh + START] if fresh else []
    processes = min(workers, max(len(lacking), size, 1))
    wider = training_runs.add_dose_runs(training) if missing and not training.mechanisms else training
    counts = len(ledger), len(lacking), rounds * size, rounds, fresh, processes
    return PlanCost(*counts, tuple(phases), len(wider.runs) - len(training.runs))


def cost_in_words(study: Study, candidates: int) -> str:
    """What an answer costs where a function is the model; empty where it is not worth telling."""
    problem = study.problem
    prepared = prepare_problem(problem, problem.visible_rows(), study.file.study.seed)
    rows, seeds = prepared.rows.size, prepared.seeds.fitting
    start = np.array([min(max(0.0, axis.low), axis.high) for axis in prepared.parameter_axes])
    settings, begin = usual_count_of_settings(len(problem.parameters), candidates), perf_counter()
    prepared.predictor.predict_without_cache(start, {}, seeds)
    seconds = settings * (perf_counter() - begin + SETTING)
    if seconds < WORTH_TELLING:
        return ""
    more = f"; up to {MORE} times as many where something acts" * bool(candidates)
    runs = f"{settings} settings of {count_noun(rows, 'row')} ({settings * rows * seeds.size:,} runs)"
    return f"About {runs}, {span(seconds)}{more}."


def span(seconds: float) -> str:
    if seconds < 1.5 * MINUTE:
        return f"{max(seconds, 1.0):.0f} s"
    return f"{seconds / MINUTE:.0f} min" if seconds < 1.5 * HOUR else f"{seconds / HOUR:.1f} h"
