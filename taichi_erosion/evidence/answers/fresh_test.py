"""Test of an answer by fresh runs: does it stand where simulations take the place of their emulator?

Three explanations are simulated at their settings: the likeliest of those of which the answer is true, of
those that contradict it, and the bare model. Each stands for all of its kind k,

    P'(k) ~ P(k) Z'_k / Z_k

Z_k its evidence by the emulator, Z'_k with the mean of fresh runs and their scatter in place of the mean of
the emulator and its errors. Slopes J along strengths follow what runs show of the effects: with S what these
do by the emulator, g what runs add to it and G the scatter of g, all whitened,

    J' = a J,   a = 1 + S^T C^-1 g / (1 + S^T C^-1 S),   C = 1 + G G^T

From a right emulator runs differ by n = H s, s ~ N(0, 1), H the errors of both, so that with P = V^-1

    ln Z'_k = const + n^T P y - 1/2 n^T P n

An answer with P' below SURE is contradicted where a right emulator leaves as little with a chance below OFF,
any answer where an emulator is farther off than its errors allow (Bonferroni).

Reference: Bastos & O'Hagan (2009), Technometrics 51, 425 (diagnostics of emulators).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from math import sqrt
from pathlib import Path

import numpy as np

from taichi_erosion.evidence.data.comparison_rows import condition_numbers
from taichi_erosion.evidence.data.problem import Bools, Floats, Integers, Numbers, Progress
from taichi_erosion.evidence.emulator.design import Setting
from taichi_erosion.evidence.emulator.fresh_runs import (
    MOST_CONDITIONS,
    FreshCampaign,
    FreshRuns,
    FreshSimulator,
    Request,
)
from taichi_erosion.evidence.models.predictor import Predictor
from taichi_erosion.evidence.models.simulator import row_at
from taichi_erosion.evidence.race.decision import Decision
from taichi_erosion.evidence.race.expansion import Acting
from taichi_erosion.evidence.race.fit import Fit, Hypothesis, Race
from taichi_erosion.evidence.race.outlook import Elsewhere
from taichi_erosion.evidence.race.posterior import Posterior
from taichi_erosion.evidence.race.priors import DRAWS, SEED, SURE
from taichi_erosion.evidence.race.record import FreshPart, GapPart, Outcome

Simulate = Callable[[Sequence[Setting], Sequence[Request], Floats, Progress], FreshCampaign]
OFF = 0.01  # chance below which an emulator is off: a right answer is lost one time in a hundred
MOST_FAILED = 0.5  # share of the runs, above which those with a value are no fair sample


@dataclass(frozen=True)
class Kind:
    """Explanations that say the same of an answer, and a set of effects that stands for them."""

    race: Race
    log_weight: float  # ln of prior times evidence of all
    fits: tuple[Fit, ...]  # of the set, alone and beside what no list holds; the first is simulated

    @property
    def names(self) -> Acting:
        """Effects that act."""
        return self.fits[0].hypothesis.names

    def judged(self, mean: Floats, columns: Floats) -> list[Fit]:
        """The fits with a simulated mean and its errors in rows that have one, the emulator's in others."""
        at, known = self.fits[0], np.isfinite(mean)[:, np.newaxis]
        errors, own = self.race.model.errors(self.names, at.v), self.emulator
        before = self.race.prepared.rows.shared.shape[1]
        errors[:, before : before + own.shape[1]] = np.where(known, 0.0, own)
        mean, columns = np.where(known[:, 0], mean, at.mean), np.where(known, columns, 0.0)
        errors = np.hstack([errors, columns])
        jacobian = self.slopes(mean, columns)
        about = [replace(fit, v=at.v, mean=mean, jacobian=jacobian, errors=errors) for fit in self.fits]
        return [self.race.solved(fit, start=fit.scales, fresh=True) for fit in about]

    def slopes(self, mean: Floats, columns: Floats) -> Floats:
        """Slopes (n, d) about a simulated mean with errors."""
        at, model, prepared = self.fits[0], self.race.model, self.race.prepared
        without = prepared.predictor.mean(where(self.race, at)[0], {}, prepared.seeds.fitting) + model.shift
        action, white = prepared.white(at.mean - without), prepared.white(columns)
        along = np.linalg.solve(np.eye(action.size) + white @ white.T, action)
        shown = 1.0 + along @ prepared.white(mean - at.mean) / (1.0 + along @ action)
        return at.jacobian * np.where(np.arange(at.v.size) < model.count, 1.0, shown)

    @property
    def emulator(self) -> Floats:
        """Errors of the emulator (n, q)."""
        return self.race.prepared.predictor.model_errors(*where(self.race, self.fits[0]))

    def if_right(self, runs: FreshRuns, random: np.random.Generator) -> Floats:
        """Draws of ln of prior times evidence by as many runs of a right emulator."""
        known = np.isfinite(runs.mean)
        mean, prepared = np.where(known, self.fits[0].mean, np.nan), self.race.prepared
        columns = prepared.white(np.hstack([runs.columns, self.emulator]))
        columns[~known | prepared.rows.censored] = 0.0
        s = random.standard_normal((DRAWS, columns.shape[1]))
        found = []
        for fit in self.judged(mean, runs.columns):
            along, gram = fit.evidence.solved.against(columns)
            found.append(score(fit) + s @ along - 0.5 * np.sum(s @ gram * s, axis=1))
        return np.logaddexp.reduce(found, axis=0)


def where(race: Race, fit: Fit) -> tuple[Floats, dict[str, float]]:
    """Calibrated numbers on their axes, and strengths."""
    model = race.model
    return model.numbers(fit.v[: model.count]), model.strengths(fit.hypothesis.names, fit.v)


def setting_of(race: Race, fit: Fit) -> Setting:
    """What a fit has the simulator do."""
    return Setting(*race.prepared.predictor.setting(*where(race, fit)))


def score(fit: Fit) -> float:
    """Ln of prior times evidence."""
    return fit.log_evidence + fit.log_prior


def total(fits: Sequence[Fit]) -> float:
    """Ln of prior times evidence of all of some explanations."""
    return float(np.logaddexp.reduce([score(fit) for fit in fits]))


def is_true(decision: Decision, hypothesis: Hypothesis) -> bool:
    """Whether all that is named acts in an explanation, and one of the group."""
    acting, group = hypothesis.acting, set(decision.group)
    return set(decision.named) <= acting and (not group or bool(group & acting))


def kinds_of(race: Race, decision: Decision) -> list[Kind]:
    """The answer, what contradicts it, and no effect at all: each with the likeliest of constant strength."""
    kinds: dict[str, list[Fit]] = {"answer": [], "rival": [], "bare": []}
    for hypothesis, fit in race.fits.items():
        bare = not hypothesis.names and fit.dose is None
        kinds["answer" if is_true(decision, hypothesis) else "bare" if bare else "rival"].append(fit)
    found = []
    for fits in kinds.values():
        able = sorted((each for each in fits if each.refined and each.dose is None), key=score, reverse=True)
        if able:
            own = tuple(each for each in able if each.hypothesis.names == able[0].hypothesis.names)
            found.append(Kind(race, total(fits), own))
    return found


def fresh_test(
    posterior: Posterior, decision: Decision, simulate: Simulate, progress: Progress
) -> tuple[FreshPart, frozenset[str]]:
    """What fresh runs say of an answer that names effects, and the keys of these runs."""
    race = posterior.race
    kinds, asked = kinds_of(race, decision), race.prepared.predictor.requests
    made = simulate([setting_of(race, kind.fits[0]) for kind in kinds], asked, apart(race, kinds), progress)
    if not made.runs:
        return FreshPart("not_made", needed=len(made.keys)), frozenset()
    each, none = list(zip(kinds, made.runs, strict=True)), np.full(race.prepared.rows.size, np.nan)
    known = np.array([total(kind.judged(none, run.columns)) for kind, run in each])
    simulated = np.array([total(kind.judged(run.mean, run.columns)) for kind, run in each])
    wider = [(kind, run.values, sqrt(made.seeds) * run.columns) for kind, run in each]
    alone = [[total(kind.judged(own[k], errors)) for kind, own, errors in wider] for k in range(made.seeds)]
    random = np.random.default_rng(SEED)
    right = np.transpose([kind.if_right(run, random) for kind, run in each])
    before, after = (float(chance(kinds, found - known)) for found in (known, simulated))
    p, gap = float(np.mean(chance(kinds, right - known) <= after)), gap_of(race, kinds, made.runs)
    few = made.failed > MOST_FAILED * len(made.keys) or not made.runs[0].tests
    outcome = "undecided" if few else outcome_of(after, p, gap)
    agreement = float(np.mean(chance(kinds, np.array(alone) - known) > 0.5))
    cost = (len(made.keys), made.seeds, made.failed)
    return FreshPart(outcome, kinds[0].names, before, after, p, agreement, gap, *cost), made.keys


def runs_at(
    place: Elsewhere, simulator: FreshSimulator, progress: Progress
) -> tuple[Elsewhere, frozenset[str]]:
    """Rows with runs of the calibrated model where conditions are new to its emulator, and the runs' keys.

    Between the conditions of its training and beyond them an emulator may be steep. Each set of conditions
    tells its own scatter, so that what is said of it does not depend on the others.
    """
    race, rows, predictor = place.race, place.rows, place.model.prepared.predictor
    point, used, cells = setting_of(race, race.bare), frozenset[str](), condition_numbers(rows)
    new = untrained(simulator, predictor, point)[race.prepared.rows.size :]
    sets = [np.flatnonzero(new & (cells == cell)) for cell in np.unique(cells[new])]
    mean, columns = np.full(rows.size, np.nan), [np.zeros((rows.size, 0))]

    def made(own: Integers) -> FreshCampaign:
        some = rows.rows(own)
        asked = predictor.over(some.observables, some.which, some.conditions).requests
        spent = simulator.training.elsewhere + len(used - simulator.known)
        known = replace(simulator, training=replace(simulator.training, elsewhere=spent))
        return known.simulate([point], asked, np.ones(own.size), progress)

    for first in range(0, len(sets), MOST_CONDITIONS):  # together; what follows finds them in the ledger
        made(np.concatenate(sets[first : first + MOST_CONDITIONS]))
    for own in sets:
        if runs := (campaign := made(own)).runs:
            mean[own], used = runs[0].mean, used | campaign.keys
            columns.append(np.zeros((rows.size, runs[0].columns.shape[1])))
            columns[-1][own] = runs[0].columns
    gap = np.where(new, mean - place.model.sure_mean((), race.bare.v)[race.prepared.rows.size :], 0.0)
    return replace(place, runs=(new, gap, np.hstack(columns))), used


def untrained(simulator: FreshSimulator, predictor: Predictor, point: Setting) -> Bools:
    """Rows of a predictor at conditions of which no run trained the emulator, if these can change a run."""
    found, training, mapping = np.zeros(predictor.which.size, bool), simulator.training, simulator.mapping
    measures = {scene.measure.scene: scene.measure for scene in training.scenes}

    def conditions(scene: Path, at: Numbers) -> tuple[str, ...]:
        return training.simulator.overrides(measures[scene], at, {}, point.effects)

    made = {(run.scene, conditions(run.scene, run.at)) for run in training.runs}
    for observable, rows, stated in predictor.requests:
        scene = training.simulator.measures[mapping.observables[observable.name]].scene
        known = mapping.known(stated)
        found[rows] = [(scene, conditions(scene, row_at(known, k))) not in made for k in range(rows.size)]
    return found


def outcome_of(simulated: float, p: float, gap: GapPart | None) -> Outcome:
    """The verdict on an answer."""
    if gap is not None and gap.p < OFF:
        return "contradicted"
    if simulated >= SURE:
        return "confirmed"
    return "contradicted" if p < OFF else "undecided"


def chance(kinds: Sequence[Kind], change: Floats) -> Floats:
    """Probability of the answer, the first kind, after a change (..., kinds) of the evidence of each."""
    weights = np.array([kind.log_weight for kind in kinds]) + change
    return np.exp(weights[..., 0] - np.logaddexp.reduce(weights, axis=-1))


def apart(race: Race, kinds: Sequence[Kind]) -> Floats:
    """How far the explanations lie from the answer in every row, in sd of the measurement."""
    means = np.array([kind.fits[0].mean for kind in kinds])
    return np.sum(np.abs(means - means[0]), axis=0) / race.prepared.sd


def gap_of(race: Race, kinds: Sequence[Kind], runs: Sequence[FreshRuns]) -> GapPart | None:
    """The least likely gap of all observables under all explanations."""
    tests = [(t, name, k.names) for k, run in zip(kinds, runs, strict=True) for name, t in run.tests.items()]
    if not tests:
        return None
    worst, name, effects = min(tests, key=lambda each: each[0].p)
    place = race.prepared.rows.conditions_at(worst.row)
    at = {key: value for key, value in place.items() if np.isfinite(value)}
    told = (worst.emulated, worst.emulated_sd, worst.simulated, worst.simulated_sd)
    return GapPart(effects, name, at, *told, p=min(1.0, len(tests) * worst.p))
