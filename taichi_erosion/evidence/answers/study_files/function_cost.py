"""What an answer costs where a function is the model, told before anything is calibrated."""

from time import perf_counter

import numpy as np

from taichi_erosion.evidence.answers.study_files.study_text import MODEL
from taichi_erosion.evidence.data.number_words import counted
from taichi_erosion.evidence.emulator.plan_cost import span
from taichi_erosion.evidence.models.load_study import Study
from taichi_erosion.evidence.models.prepared_problem import prepare, usual_settings

DOSE = 100  # settings for each mechanism
MORE = 4  # times as many: 9 of 10 of 480 sealed tables of doe/trials took fewer
OVERHEAD = 0.01  # time that the inference takes for a setting [s]


def evaluations_sentence(study: Study, candidates: int, least: float = 0.0) -> str:
    """What an answer costs where a function is the model; empty below `least` seconds."""
    problem = study.problem
    prepared = prepare(problem, problem.visible(), study.file.study.seed)
    rows, seeds = prepared.rows.size, prepared.seeds.fitting
    start = np.array([min(max(0.0, axis.low), axis.high) for axis in prepared.axes])
    settings, begin = usual_settings(len(problem.parameters), candidates), perf_counter()
    prepared.predictor.compute(start, {}, seeds)
    seconds = settings * (perf_counter() - begin + OVERHEAD)
    if seconds < least:
        return ""
    more = f"up to {MORE} times as many where something acts, " if candidates else ""
    if candidates and problem.mechanisms:
        more += f"{DOSE * len(problem.mechanisms):,} more where mechanisms are tried, "
    return (
        f"{answering(study)} answers: about {settings} settings of {counted(rows, 'row')} "
        f"({settings * rows * seeds.size:,} runs), {span(seconds)}; {more}fewer where they are stored."
    )


def answering(study: Study) -> str:
    """The function that answers a study, in words where it is the program's own."""
    name = study.model.partition(" ")[0]
    return "The closed-form model" if name == MODEL else name
