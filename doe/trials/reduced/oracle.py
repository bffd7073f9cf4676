"""How hard a sealed case is: what an observer with noise-free measurements could see.

The signal-to-noise ratio of an effect is the root of the misfit that the model without it keeps after its
best recalibration to noise-free measurements; the separation is the same for the model with the nearest other
candidate in its place. At a ratio of 5 an effect is at the line of being identifiable; at a separation of 3
two effects are told apart in 93 % of cases.
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from scipy import optimize

from doe.trials.reduced.clean import Case
from doe.trials.reduced.laboratory import CaseModel
from taichi_erosion.evidence.data.problem import Candidate, Floats
from taichi_erosion.evidence.data.transforms import axis_position, censored_score
from taichi_erosion.evidence.models.prepared_problem import PreparedProblem, prepare_problem
from taichi_erosion.evidence.models.reduced import EFFECTS

STEPS = (0.3, 1e-3)  # relative, of slopes: wide ones see past the kinks of a threshold
START = 1.0  # strength from which a rival is fitted
NO_VALUE = 1e6  # residual where the model has no value


def difficulty(case: Case, apart: bool = True) -> dict[str, float]:
    """Least `ratio` and `separation` [sd] over the effects that act; of a null 0 and infinite.

    Without `apart` rivals are not tried.
    """
    if not case.truth.effects:
        return {"ratio": 0.0, "separation": np.inf}
    prepared, x = noise_free(case)
    listed = [candidate.name for candidate in case.problem.candidates]
    truth = case.truth.effects
    floor = least_misfit(prepared, x, truth)
    ratios, separations = [], []
    for name in truth:
        others = {key: value for key, value in truth.items() if key != name}
        ratio = root(least_misfit(prepared, x, others) - floor)
        rivals = [
            root(least_misfit(prepared, x, {**others, rival: START}) - floor)
            for rival in listed
            if apart and rival not in truth
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
    prepared = prepare_problem(problem, problem.visible_rows(), 0)
    x = np.array([axis_position(axis, case.truth.parameters[axis.name]) for axis in prepared.parameter_axes])
    exact = prepared.predictor.mean(x, case.truth.effects, prepared.seeds.fitting)
    return replace(prepared, rows=replace(prepared.rows, z=exact)), x


def least_misfit(prepared: PreparedProblem, x: Floats, acting: Mapping[str, float]) -> float:
    """Misfit + prior of a hypothesis after recalibration, from the numbers x."""
    candidates = {each.name: each for each in prepared.problem.candidates}
    scale = np.array([1.0] * x.size + [candidates[name].prior_scale for name in acting])
    ends = [(axis.low, axis.high) for axis in prepared.parameter_axes]
    ends += [(0.0, candidates[name].maximum) for name in acting]
    low, high = np.reshape(ends, (-1, 2)).T / scale

    def residual(position: Floats) -> Floats:
        numbers, strengths = np.split(position * scale, [x.size])
        told = dict(zip(acting, map(float, strengths), strict=True))
        return np.append(whole_residual(prepared, numbers, told), position)

    start = np.clip(np.append(x, list(acting.values())) / scale, low, high)
    misfit = float(np.sum(residual(start) ** 2))
    for step in STEPS if start.size else ():
        found = optimize.least_squares(residual, start, bounds=(low, high), diff_step=step, ftol=1e-4)
        start, misfit = found.x, min(misfit, 2.0 * float(found.cost))
    return misfit


def whole_residual(prepared: PreparedProblem, x: Floats, acting: dict[str, float]) -> Floats:
    """Whitened residual; of a censored row the root of its deviance."""
    mean = prepared.predictor.mean(x, acting, prepared.seeds.fitting)
    found, reach = prepared.whiten(prepared.rows.z - mean), prepared.rows.reach / prepared.row_sd
    own = reach != 0.0
    if own.any():
        found[own] = np.sqrt(-2.0 * censored_score(found[own], reach[own])[0])
    return np.nan_to_num(found, nan=NO_VALUE, posinf=NO_VALUE, neginf=-NO_VALUE)


def root(misfit: float) -> float:
    """Square root, 0 below."""
    return float(np.sqrt(max(misfit, 0.0)))
