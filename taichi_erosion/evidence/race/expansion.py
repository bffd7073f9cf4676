"""The model in standard coordinates, and its linear expansion about a setting.

    v = (calibrated numbers, strengths),   v ~ N(0, 1)

A calibrated number keeps its prior near the start and stays within its range, and a strength psi stays below
the largest that is allowed, so that neither end is a special case:

    x = low + (high - low) / (1 + exp(-(a + b v))),   x(0) = 0,   x'(0) = 1
    psi = m (1 - exp(-psi_0 e^(s v) / m))

with psi_0 the strength expected (`Priors.typical`) and s its spread. An effect that belongs to the model
already has a strength among the calibrated numbers.
"""

from dataclasses import dataclass, field, replace
from math import exp, log

import numpy as np

from taichi_erosion.evidence.data.problem import REACH, Candidate, Conditions, Floats, Integers, Progress
from taichi_erosion.evidence.data.transforms import Axis, effect_of_path, value_on_axis
from taichi_erosion.evidence.models.predictor import Predictor, mean_over_finite_seeds
from taichi_erosion.evidence.models.prepared_problem import PreparedProblem
from taichi_erosion.evidence.models.run_store import BudgetSpentError
from taichi_erosion.evidence.race.priors import PRIORS, Priors

Acting = tuple[str, ...]
EDGE = 0.02  # least share of a range that its start is taken to be away from an end


def parameter_axis_position(axis: Axis, v: float, priors: Priors) -> float:
    if effect_of_path(axis.name) is not None:
        return bounded_strength(Candidate("", 1.0, axis.high), v, axis.high, priors)
    if not np.isfinite(axis.high - axis.low):
        return float(np.clip(v, axis.low, axis.high))
    width = axis.high - axis.low
    share = float(np.clip(-axis.low / width, EDGE, 1.0 - EDGE))
    slope = 1.0 / (width * share * (1.0 - share))
    return axis.low + width / (1.0 + exp(-np.clip(log(share / (1 - share)) + slope * v, -60, 60)))


def bounded_strength(candidate: Candidate, v: float, largest: float, priors: Priors) -> float:
    typical = min(priors.typical * candidate.prior_scale, candidate.maximum)
    return float(-largest * np.expm1(-typical * np.exp(np.clip(priors.spread * v, -30.0, 10.0)) / largest))


@dataclass
class RaceModel:
    """The model of a study at settings v; counts them."""

    prepared: PreparedProblem
    most_settings: float = np.inf  # settings that may be evaluated
    progress: Progress = lambda _, __: None
    priors: Priors = PRIORS
    settings: int = 0
    past_settings: set[tuple] = field(default_factory=set)
    shift: Floats | float = 0.0  # of a mean over many seeds over that of the few that every setting has

    def __post_init__(self) -> None:
        p = self.prepared
        self.candidates = {each.name: each for each in p.problem.candidates}
        self.count = len(p.parameter_axes)
        names = {each.name for each in p.problem.mechanisms} - self.candidates.keys()
        wider = (*p.predictor.candidates, *(Candidate(name) for name in sorted(names)))
        self.predictor: Predictor = replace(p.predictor, candidates=wider)
        self.noisy = bool(np.any(p.seed_variance > 0.0))
        # an emulator knows nothing beyond the strengths of its list
        self.reach = REACH if p.problem.uncertainty is None else 1.0
        if self.noisy:
            start = np.zeros(self.count)
            many, few = (self.mean_over((), start, seeds) for seeds in (p.seeds.scoring, p.seeds.fitting))
            self.shift = np.nan_to_num(many - few)

    def largest_strength(self, name: str) -> float:
        return self.reach * self.candidates[name].maximum

    def axis_numbers(self, v: Floats) -> Floats:
        pairs = zip(self.prepared.parameter_axes, v, strict=True)
        return np.array([parameter_axis_position(axis, float(z), self.priors) for axis, z in pairs])

    def numbers_in_units(self, v: Floats) -> Floats:
        pairs = zip(self.prepared.parameter_axes, self.axis_numbers(v), strict=True)
        return np.array([value_on_axis(axis, float(x)) for axis, x in pairs])

    def strength(self, name: str, t: float) -> float:
        return bounded_strength(self.candidates[name], t, self.largest_strength(name), self.priors)

    def numbers_and_strengths(self, names: Acting, v: Floats) -> tuple[Floats, dict[str, float]]:
        """Calibrated numbers on their axes, and strengths of the acting effects."""
        pairs = zip(names, v[self.count :], strict=True)
        return self.axis_numbers(v[: self.count]), {name: self.strength(name, float(t)) for name, t in pairs}

    def mean_over(self, names: Acting, v: Floats, seeds: Integers) -> Floats:
        """Mean (n,) over some seeds. Raises BudgetSpentError."""
        x, acting = self.numbers_and_strengths(names, v)
        key = (x.tobytes(), tuple(sorted(acting.items())), seeds.size)
        if key not in self.past_settings:
            self.spend_one_setting()
            self.past_settings.add(key)
        return mean_over_finite_seeds(self.predictor.predict_on_scale(x, acting, seeds))

    def spend_one_setting(self) -> None:
        if self.settings >= self.most_settings:
            raise BudgetSpentError(f"the {self.most_settings:g} settings of an answer are used up")
        self.settings += 1
        self.progress(f"{self.settings} settings of the model", self.settings / self.most_settings)

    def predict_mean(self, names: Acting, v: Floats, doses: Conditions | None = None) -> Floats:
        """Mean (n,) as many seeds would have it; each row with its own doses, at the cost of one setting."""
        seeds = self.prepared.seeds.fitting
        if not doses:
            return self.mean_over(names, v, seeds) + self.shift
        self.spend_one_setting()
        (x, acting), p = self.numbers_and_strengths(names, v), self.predictor
        if self.prepared.problem.dosed_by_row:
            return mean_over_finite_seeds(p.predict_without_cache(x, acting, seeds, doses)) + self.shift
        total, table = np.zeros(p.which.size), np.array(list(doses.values()))
        for dose in np.unique(table, axis=1).T:
            rows = np.flatnonzero(np.all(table.T == dose, axis=1))
            predictor = p.at_rows(p.which[rows], {n: c[rows] for n, c in p.conditions.items()})
            there = {name: float(each) for name, each in zip(doses, dose, strict=True)}
            total[rows] = mean_over_finite_seeds(predictor.predict_without_cache(x, acting | there, seeds))
        return total + self.shift

    def precise_mean(self, names: Acting, v: Floats) -> Floats:
        """Mean (n,) over many seeds."""
        if not self.noisy:
            return self.predict_mean(names, v)
        return self.mean_over(names, v, self.prepared.seeds.scoring)

    def errors(self, names: Acting, v: Floats, doses: Conditions | None = None) -> Floats:
        """Errors of known size (n, q): shared by instruments, of the model itself, of stated conditions."""
        p = self.prepared
        return np.hstack([p.rows.shared, p.model_errors(*self.numbers_and_strengths(names, v), doses)])

    def jacobian(self, names: Acting, v: Floats, mean: Floats, doses: Conditions | None = None) -> Floats:
        """Slopes (n, d) by finite differences towards the prior, wide for a noisy model."""
        step = 0.7 if self.noisy else 0.1
        columns = np.zeros((mean.size, v.size))
        for j in range(v.size):
            for sign in (-1.0 if v[j] > 0.0 else 1.0, 1.0 if v[j] > 0.0 else -1.0):
                h = np.zeros(v.size)
                h[j] = sign * step
                slope = (self.predict_mean(names, v + h, doses) - mean) / h[j]
                if np.all(np.isfinite(slope)):
                    break
            columns[:, j] = np.nan_to_num(slope)
        return columns
