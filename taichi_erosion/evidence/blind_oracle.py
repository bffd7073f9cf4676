"""How hard a sealed case is: what an observer who knows the truth could see.

The signal-to-noise ratio is |M g| at the true calibrated numbers and strength, M removing what calibration can
imitate; the separation is the distance to the nearest other candidate at its best strength. At a ratio of 5 an
effect is at the line of being identifiable; at a separation of 3 two effects are told apart in 93 % of cases.
"""

from dataclasses import dataclass, replace

import numpy as np

from taichi_erosion.evidence.algebra import projection
from taichi_erosion.evidence.blind_cases import Case, CaseModel
from taichi_erosion.evidence.calibrate import Objective
from taichi_erosion.evidence.examination import Examination, examine
from taichi_erosion.evidence.problem import Candidate, Floats
from taichi_erosion.evidence.reduced_effects import EFFECTS
from taichi_erosion.evidence.scales import position_of

STRENGTHS = 13  # of a rival, over its allowed range


@dataclass(frozen=True)
class Difficulty:
    """What could be seen in a case."""

    ratio: float  # least signal-to-noise ratio of the effects that act; 0 for a null
    separation: float  # sd to the nearest other candidate; infinite if there is none


def difficulty(case: Case) -> Difficulty:
    """Ratio and separation at the truth, without the model's own scatter."""
    if not case.truth.effects:
        return Difficulty(0.0, np.inf)
    listed = [candidate.name for candidate in case.problem.candidates]
    names = list(dict.fromkeys([*listed, *case.truth.effects]))
    model = case.problem.model
    assert isinstance(model, CaseModel)
    problem = replace(
        case.problem,
        model=CaseModel(0.0, 0.0, {**model.aliases, **{name: name for name in EFFECTS}}),
        candidates=tuple(Candidate(name) for name in names),
    )
    exam = examine(problem, problem.visible(), 0)
    x = position_of(exam.axes, case.truth.parameters, {})
    ratios, separations = [], []
    for name in case.truth.effects:
        ratio, separation = seen_effect(exam, x, case.truth.effects, name, listed)
        ratios.append(ratio / case.truth.understated)
        separations.append(separation / case.truth.understated)
    return Difficulty(float(min(ratios)), float(min(separations)))


def seen_effect(
    exam: Examination, x: Floats, effects: dict[str, float], name: str, listed: list[str]
) -> tuple[float, float]:
    """Ratio and separation of one effect, the others acting and free in strength."""
    others = {key: value for key, value in effects.items() if key != name}
    rest = tuple(others)
    objective = Objective(exam, rest, exam.seeds.fitting)
    position = np.concatenate([x, [others[key] for key in rest]])
    centre = objective.mean(position)
    slopes = objective.jacobian(position, centre, central=True)
    part = projection(slopes, exam.rows.shared / exam.sd[:, np.newaxis])
    own = free_change(exam, part.basis, x, centre, {**others, name: effects[name]})
    nearest = np.inf
    for rival in listed:
        if rival in effects:
            continue
        for strength in np.linspace(0.0, exam.candidate(rival).maximum, STRENGTHS)[1:]:
            gap = own - free_change(exam, part.basis, x, centre, {**others, rival: float(strength)})
            nearest = min(nearest, float(np.linalg.norm(gap)))
    ratio = float(np.linalg.norm(own))
    return ratio, min(nearest, ratio)


def free_change(
    exam: Examination, basis: Floats, x: Floats, centre: Floats, acting: dict[str, float]
) -> Floats:
    """Change of the mean that calibration cannot imitate, in sd."""
    white = (exam.predictor.mean(x, acting, exam.seeds.fitting) - centre) / exam.sd
    stacked = np.concatenate([white, np.zeros(basis.shape[0] - white.size)])
    return stacked - basis @ (basis.T @ stacked)
