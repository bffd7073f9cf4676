"""The model of a study at its start values, before anything is calibrated."""

from time import perf_counter

import numpy as np

from taichi_erosion.evidence.answers.study_files.study_text import MODEL
from taichi_erosion.evidence.data.number_words import counted
from taichi_erosion.evidence.data.problem import Conditions, Floats, Integers
from taichi_erosion.evidence.emulator.plan_cost import span
from taichi_erosion.evidence.models.load_study import Study
from taichi_erosion.evidence.models.prepared_problem import prepare

BARE, EACH, DOSE = 25, 9, 100  # settings: without candidates; each candidate and number; each mechanism
MORE = 3  # times as many, below which 9 of 10 answers stay (80 tables of doe/trials, clean and disturbed)
OVERHEAD = 0.01  # time that the inference takes for a setting [s]


def model_at_start(study: Study, name: str, conditions: Conditions, seeds: Integers) -> Floats:
    """Values [seed, row] of an observable at the start values, with none of the candidates."""
    problem, file = study.problem, study.file
    parameters = {parameter.path: parameter.start for parameter in problem.parameters}
    effects = {candidate.name: 0.0 for candidate in problem.candidates}
    effects |= {candidate.name: file.adopted[candidate.name].strength for candidate in problem.adopted}
    return np.asarray(problem.model(name, conditions, parameters, effects, seeds))


def usual_settings(numbers: int, candidates: int) -> int:
    """Settings of the model that an answer usually takes."""
    return BARE + EACH * max(numbers, 1) * candidates


def evaluations_sentence(study: Study, candidates: int) -> str:
    """What an answer costs where a function is the model, from the time that one setting takes."""
    problem, table = study.problem, study.problem.visible()
    seeds = prepare(problem, table, study.file.study.seed).seeds.fitting
    settings, begin = usual_settings(len(problem.parameters), candidates), perf_counter()
    for name in dict.fromkeys(table.observable):
        chosen = np.array([each == name for each in table.observable])
        conditions = {key: column[chosen] for key, column in table.conditions.items()}
        model_at_start(study, name, conditions, seeds)
    seconds = settings * (perf_counter() - begin + OVERHEAD)
    more = f"up to {MORE} times as many where something acts, " if candidates else ""
    if candidates and problem.mechanisms:
        more += f"{DOSE * len(problem.mechanisms):,} more where mechanisms are tried, "
    return (
        f"{answering(study)} answers: about {settings} settings of {counted(table.size, 'row')} "
        f"({settings * table.size * seeds.size:,} runs), {span(seconds)}; {more}fewer where they are stored."
    )


def answering(study: Study) -> str:
    """The function that answers a study, in words where it is the program's own."""
    name = study.model.partition(" ")[0]
    return "The closed-form model" if name == MODEL else name
