"""How hard a sealed case is: what an observer with noise-free measurements could see.

The signal-to-noise ratio of an effect is the root of the misfit that the model without it keeps after its
best recalibration to noise-free measurements; the separation is the same for the model with the nearest other
candidate in its place. At a ratio of 5 an effect is at the line of being identifiable; at a separation of 3
two effects are told apart in 93 % of cases.
"""

from dataclasses import replace

import numpy as np

from doe.trials.reduced.clean import Case
from doe.trials.reduced.laboratory import CaseModel
from taichi_erosion.evidence.data.problem import Candidate, Floats
from taichi_erosion.evidence.data.transforms import position_of
from taichi_erosion.evidence.inference.map_fit import STEPS, fit
from taichi_erosion.evidence.models.prepared_problem import PreparedProblem, prepare
from taichi_erosion.evidence.models.reduced import EFFECTS

START = 1.0  # strength from which a rival is fitted


def difficulty(case: Case) -> dict[str, float]:
    """Least `ratio` and `separation` [sd] over the effects that act; of a null 0 and infinite."""
    if not case.truth.effects:
        return {"ratio": 0.0, "separation": np.inf}
    prepared, x = noise_free(case)
    listed = [candidate.name for candidate in case.problem.candidates]
    truth = case.truth.effects
    floor = least_misfit(prepared, x, dict(truth))
    ratios, separations = [], []
    for name in truth:
        others = {key: value for key, value in truth.items() if key != name}
        ratio = root(least_misfit(prepared, x, others) - floor)
        rivals = [
            root(least_misfit(prepared, x, {**others, rival: START}) - floor)
            for rival in listed
            if rival not in truth
        ]
        ratios.append(ratio)
        separations.append(min([ratio, *rivals]))
    wrong = case.truth.understated
    return {"ratio": min(ratios) / wrong, "separation": min(separations) / wrong}


def noise_free(case: Case) -> tuple[PreparedProblem, Floats]:
    """The case as it would be measured without noise, by a model without scatter; and the true numbers."""
    listed = [candidate.name for candidate in case.problem.candidates]
    names = list(dict.fromkeys([*listed, *case.truth.effects]))
    model = case.problem.model
    assert isinstance(model, CaseModel)
    problem = replace(
        case.problem,
        model=CaseModel(0.0, 0.0, {**model.aliases, **{name: name for name in EFFECTS}}),
        candidates=tuple(
            Candidate(name, maximum=max(Candidate(name).maximum, case.truth.effects.get(name, 0.0)))
            for name in names
        ),
    )
    prepared = prepare(problem, problem.visible(), 0)
    x = position_of(prepared.axes, case.truth.parameters, {})
    exact = prepared.predictor.mean(x, case.truth.effects, prepared.seeds.fitting)
    return replace(prepared, rows=replace(prepared.rows, z=exact)), x


def least_misfit(prepared: PreparedProblem, x: Floats, acting: dict[str, float]) -> float:
    """Misfit + prior of a hypothesis after recalibration, from the true numbers."""
    names = tuple(acting)
    psi = np.array([acting[name] for name in names])
    return fit(prepared, names, [np.concatenate([x, psi])], STEPS).misfit


def root(misfit: float) -> float:
    """Square root, 0 below."""
    return float(np.sqrt(max(misfit, 0.0)))
