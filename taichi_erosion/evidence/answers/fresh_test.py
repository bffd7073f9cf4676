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

Where that leaves the answer and one mechanism open, twice the seeds go where they add most to the squared
difference of the two over its joint error, until one is LEAD times as likely, or the cap is reached.

Reference: Bastos & O'Hagan (2009), Technometrics 51, 425 (diagnostics of emulators).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from taichi_erosion.evidence.data.comparison_rows import condition_groups
from taichi_erosion.evidence.data.problem import Bools, Floats, Integers, Numbers, Progress
from taichi_erosion.evidence.emulator.design import Setting
from taichi_erosion.evidence.emulator.fresh_runs import MOST_SETS, FreshCampaign, FreshRuns, FreshSimulator
from taichi_erosion.evidence.models.plugin import NameMapping
from taichi_erosion.evidence.models.predictor import Predictor
from taichi_erosion.evidence.models.simulator import row_at
from taichi_erosion.evidence.race.decision import MOST_TOLD, Decision
from taichi_erosion.evidence.race.fit import UNLISTED, Fit, Hypothesis, Race, log_joint
from taichi_erosion.evidence.race.outlook import JointRows
from taichi_erosion.evidence.race.posterior import Posterior
from taichi_erosion.evidence.race.priors import DRAWS, SEED, SURE
from taichi_erosion.evidence.record import FreshPart, GapPart, Outcome, Verdict
from taichi_erosion.tables.number_words import round_number

Simulate = Callable[..., FreshCampaign]  # settings, requests, weights of rows, progress, times the seeds
OFF = 0.01  # chance below which an emulator is off: a right answer is lost one time in a hundred
CLOSER = 4  # times the runs of a test, that may tell two mechanisms apart
LEAD = 20.0  # odds of two mechanisms from which no more seeds are spent on them
MOST_FAILED = 0.5  # share of the runs, above which those with a value are no fair sample


@dataclass(frozen=True)
class Kind:
    """Explanations that say the same of an answer, and a set of effects that stands for them."""

    race: Race
    log_weight: float  # ln of prior times evidence of all
    fits: tuple[Fit, ...]  # of the set, alone and beside what no list holds; the first is simulated

    @property
    def acting(self) -> tuple[str, ...]:
        return tuple(sorted(self.fits[0].hypothesis.acting - UNLISTED))

    def refit_with_runs(self, mean: Floats, columns: Floats) -> list[Fit]:
        """The fits with a simulated mean and its errors in rows that have one, the emulator's in others."""
        at, has_run = self.fits[0], np.isfinite(mean)[:, np.newaxis]
        errors = self.race.model.errors(at.hypothesis.names, at.v, at.row_doses_of)
        emulator = self.emulator_errors
        before = self.race.prepared.rows.shared.shape[1]
        errors[:, before : before + emulator.shape[1]] = np.where(has_run, 0.0, emulator)
        mean, columns = np.where(has_run[:, 0], mean, at.mean), np.where(has_run, columns, 0.0)
        share = self.simulated_share_of_change(mean, columns)
        jacobian = at.jacobian * np.where(np.arange(at.v.size) < self.race.model.count, 1.0, share)
        change: dict[str, Any] = {"v": at.v, "mean": mean, "jacobian": jacobian}
        if at.dose is not None:
            *blocks, dosed = at.blocks
            change["blocks"] = (*blocks, replace(dosed, columns=share * dosed.columns))
            change["dose"] = replace(at.dose, slope=share * at.dose.slope)
        about = [replace(fit, **change, errors=np.hstack([errors, columns])) for fit in self.fits]
        return [self.race.fit_at_scales(fit, start=fit.scales, fresh=True) for fit in about]

    def simulated_share_of_change(self, mean: Floats, columns: Floats) -> float:
        """Share a of what effects and mechanisms do that a simulated mean with errors shows."""
        at, model, prepared = self.fits[0], self.race.model, self.race.prepared
        x, seeds = model.axis_numbers(at.v[: model.count]), prepared.seeds.fitting
        base = prepared.predictor.mean(x, {}, seeds) + model.shift
        action, white = prepared.whiten(at.mean - base), prepared.whiten(columns)
        along = np.linalg.solve(np.eye(action.size) + white @ white.T, action)
        return float(1.0 + along @ prepared.whiten(mean - at.mean) / (1.0 + along @ action))

    @property
    def emulator_errors(self) -> Floats:
        at = self.fits[0]
        setting = self.race.model.numbers_and_strengths(at.hypothesis.names, at.v)
        return self.race.prepared.predictor.error_factor(*setting, at.row_doses_of)

    def null_evidence_draws(self, runs: FreshRuns, random: np.random.Generator) -> Floats:
        """Draws of ln of prior times evidence by as many runs of a right emulator."""
        has_run = np.isfinite(runs.row_means)
        mean, prepared = np.where(has_run, self.fits[0].mean, np.nan), self.race.prepared
        columns = prepared.whiten(np.hstack([runs.columns, self.emulator_errors]))
        columns[~has_run | prepared.rows.censored] = 0.0
        s = random.standard_normal((DRAWS, columns.shape[1]))
        logs = []
        for fit in self.refit_with_runs(mean, runs.columns):
            along, gram = fit.evidence.solution.project(columns)
            logs.append(log_joint(fit) + s @ along - 0.5 * np.sum(s @ gram * s, axis=1))
        return np.logaddexp.reduce(logs, axis=0)


def run_setting(race: Race, fit: Fit) -> Setting:
    """What a fit has the simulator do, without meaningless digits, which would make it another run."""
    x, strengths = race.model.numbers_and_strengths(fit.hypothesis.names, fit.v)
    setting = race.prepared.predictor.parameters_and_strengths(x, strengths)
    numbers, acting = ({key: round_number(x) for key, x in each.items()} for each in setting)
    if fit.dose is None:
        return Setting(numbers, acting)
    model, conditions = race.prepared.problem.model, race.prepared.rows.conditions
    columns = model.model_conditions(conditions) if isinstance(model, NameMapping) else conditions
    doses = []
    for row in range(fit.mean.size):
        at = {path: x for path, x in row_at(columns, row).items() if np.isfinite(x)}
        doses.append((at, {name: round_number(column[row]) for name, column in fit.row_doses_of.items()}))
    top = {name: round_number(column[np.argmax(np.abs(column))]) for name, column in fit.row_doses_of.items()}
    unique = {repr(each): each for each in doses}
    return Setting(numbers, {**acting, **top}, [*unique.values()], fit.hypothesis.along)


def log_sum(fits: Sequence[Fit]) -> float:
    """Ln of prior times evidence of all of some explanations."""
    return float(np.logaddexp.reduce([log_joint(fit) for fit in fits]))


def confirms(decision: Decision, hypothesis: Hypothesis) -> bool:
    """Whether all that is named acts in an explanation, and one of the group; of mechanisms the first."""
    acting, group = hypothesis.acting, set(decision.group)
    return decision.core <= acting and (not group or bool(group & acting))


def answer_and_rivals(race: Race, decision: Decision) -> list[Kind]:
    """The answer, what contradicts it, and nothing of the list: each with the likeliest."""
    kinds: dict[str, list[Fit]] = {"answer": [], "rival": [], "bare": []}
    for hypothesis, fit in race.fits.items():
        bare = not hypothesis.names and fit.dose is None
        kinds["answer" if confirms(decision, hypothesis) else "bare" if bare else "rival"].append(fit)
    classes = []
    for fits in kinds.values():
        able = sorted((each for each in fits if each.is_optimum), key=log_joint, reverse=True)
        if able:
            names = able[0].hypothesis.names
            alike = tuple(f for f in able if f.hypothesis.names == names and f.dose is None)
            alike = alike if able[0].dose is None else (able[0],)
            classes.append(Kind(race, log_sum(fits), alike))
    return classes


def run_fresh_test(
    posterior: Posterior, decision: Decision, simulate: Simulate, progress: Progress
) -> tuple[FreshPart, frozenset[str]]:
    """What fresh runs say of an answer that names effects or mechanisms, and the keys of these runs."""
    race = posterior.race
    kinds, requests = answer_and_rivals(race, decision), race.prepared.predictor.row_requests
    settings, part = [run_setting(race, kind.fits[0]) for kind in kinds], race.prepared.predictor
    means = np.array([kind.fits[0].mean for kind in kinds])
    distance = np.sum(np.abs(means - means[0]), axis=0) / race.prepared.row_sd  # of the rivals
    campaign = first = simulate(settings, requests, distance, progress)
    if not campaign.runs:
        return FreshPart("not_made", kinds[0].acting, needed=len(campaign.keys)), frozenset()
    outcome_part, times = fresh_test_record(kinds, campaign), np.ones(race.prepared.rows.size, dtype=int)
    while decision.acting_mechanisms and leaves_mechanisms_open(outcome_part):
        nearest = most_discriminating_rows(race, campaign)
        times[nearest] *= 2
        if len(campaign.keys) + 2 * times[nearest[0]] * first.seeds > CLOSER * len(first.keys):
            break
        some = race.prepared.rows.select_rows(nearest)
        rows = part.at_rows(some.which, some.conditions).row_requests
        more = simulate(settings[:2], rows, np.ones(nearest.size), progress, int(times[nearest[0]]))
        if more.seeds < times[nearest[0]] * first.seeds:
            break
        pairs = zip(campaign.runs[:2], more.runs, strict=True)
        runs = (*(one.merge_fresh_runs(other, nearest) for one, other in pairs), *campaign.runs[2:])
        failures = campaign.failures + more.failures
        campaign = FreshCampaign(runs, campaign.keys | more.keys, len(runs[0].values), failures)
        outcome_part = fresh_test_record(kinds, campaign)
    return outcome_part, campaign.keys


def fresh_test_record(kinds: Sequence[Kind], campaign: FreshCampaign) -> FreshPart:
    race = kinds[0].race
    each, none = list(zip(kinds, campaign.runs, strict=True)), np.full(race.prepared.rows.size, np.nan)
    evidence = np.array([log_sum(kind.refit_with_runs(none, run.columns)) for kind, run in each])
    simulated = np.array([log_sum(kind.refit_with_runs(run.row_means, run.columns)) for kind, run in each])
    random = np.random.default_rng(SEED)
    right = np.transpose([kind.null_evidence_draws(run, random) for kind, run in each])
    before, after = (float(kind_chance(kinds, logs - evidence)) for logs in (evidence, simulated))
    rival = next((k for k, kind in enumerate(kinds) if k and kind.acting), 0)
    other = float(kind_chance(kinds, simulated - evidence, rival)) if rival else 0.0
    p, gap = float(np.mean(kind_chance(kinds, right - evidence) <= after)), gap_of(kinds, campaign.runs)
    few = campaign.failures > MOST_FAILED * len(campaign.keys) or not campaign.runs[0].tests
    outcome: Outcome = "confirmed" if after >= SURE and not few else "undecided"
    if not few and min(1.0 if after >= SURE else p, 1.0 if gap is None else gap.p) < OFF:
        outcome = "contradicted"
    part = FreshPart(outcome, kinds[0].acting, before, after, p, gap, len(campaign.keys), campaign.seeds)
    return replace(part, failed=campaign.failures, rival=kinds[rival].acting * bool(rival), rivals=other)


def leaves_mechanisms_open(part: FreshPart) -> bool:
    """Whether fresh runs leave two mechanisms open, neither of which leads by LEAD."""
    less, more = sorted((part.simulated, part.rivals))
    return part.outcome == "undecided" and len(part.rival) == 1 and more < LEAD * less


def most_discriminating_rows(race: Race, campaign: FreshCampaign) -> Integers:
    """Rows of the set of conditions at which twice the seeds tell the first two explanations best."""
    one, other = campaign.runs[:2]
    error = np.sum(one.columns**2, axis=1) + np.sum(other.columns**2, axis=1)
    gap, measured = (one.row_means - other.row_means) ** 2, race.prepared.row_sd**2
    gain = np.nan_to_num(gap / (measured + 0.5 * error) - gap / (measured + error))
    cells = condition_groups(race.prepared.rows)
    return np.flatnonzero(cells == cells[int(np.argmax([gain[cells == cell].sum() for cell in cells]))])


def after_runs(decision: Decision, part: FreshPart) -> Decision:
    """The decision with mechanisms as runs show them: one that they do not confirm, beside its runner-up.

    None where they contradict it and leave more than chance to the model without effects, and none where the
    runner-up is a set.
    """
    if not decision.acting_mechanisms or part.outcome == "confirmed":
        return decision
    tested, neither = [*part.effects, *part.rival], 1.0 - part.simulated - part.rivals
    if (part.outcome == "contradicted" and neither > 1.0 - SURE) or len(part.rival) > 1:
        verdict: Verdict = "outside_library" if decision.unlisted >= SURE else "none_detected"
        return replace(decision, verdict=verdict, acting_mechanisms=(), together=False)
    order = tested[::-1] if part.rivals > part.simulated else tested
    ranking = (*order, *decision.acting_mechanisms)
    group = dict.fromkeys(name for name in ranking if name not in decision.named)
    return replace(decision, acting_mechanisms=tuple(group)[:MOST_TOLD], together=False)


def simulate_untrained_rows(
    place: JointRows, simulator: FreshSimulator, progress: Progress
) -> tuple[JointRows, frozenset[str]]:
    """Rows with runs of the calibrated model where conditions are new to its emulator, and the runs' keys.

    Between the conditions of its training and beyond them an emulator may be steep. Each set of conditions
    tells its own scatter, so that what is said of it does not depend on the others.
    """
    race, rows, predictor = place.race, place.rows, place.model.prepared.predictor
    point, keys, cells = run_setting(race, race.bare), frozenset[str](), condition_groups(rows)
    new = untrained_rows(simulator, predictor, point)[race.prepared.rows.size :]
    sets = [np.flatnonzero(new & (cells == cell)) for cell in np.unique(cells[new])]
    mean, columns = np.full(rows.size, np.nan), [np.zeros((rows.size, 0))]

    def simulate_rows(row_numbers: Integers) -> FreshCampaign:
        some = rows.select_rows(row_numbers)
        requests = predictor.at_rows(some.which, some.conditions).row_requests
        spent = simulator.training.other_runs + len(keys - simulator.stored_keys)
        counting = replace(simulator, training=replace(simulator.training, other_runs=spent))
        return counting.simulate_settings([point], requests, np.ones(row_numbers.size), progress)

    for first in range(0, len(sets), MOST_SETS):  # together; what follows finds them in the ledger
        simulate_rows(np.concatenate(sets[first : first + MOST_SETS]))
    for cell_rows in sets:
        if runs := (campaign := simulate_rows(cell_rows)).runs:
            mean[cell_rows], keys = runs[0].row_means, keys | campaign.keys
            columns.append(np.zeros((rows.size, runs[0].columns.shape[1])))
            columns[-1][cell_rows] = runs[0].columns
    gap = np.where(new, mean - place.model.precise_mean((), race.bare.v)[race.prepared.rows.size :], 0.0)
    return replace(place, runs=(new, gap, np.hstack(columns))), keys


def untrained_rows(simulator: FreshSimulator, predictor: Predictor, point: Setting) -> Bools:
    """Rows of a predictor at conditions of which no run trained the emulator, if these can change a run."""
    is_new, training, mapping = np.zeros(predictor.which.size, bool), simulator.training, simulator.mapping
    measures = {scene.measure.scene: scene.measure for scene in training.scenes}

    def overrides_of(scene: Path, at: Numbers) -> tuple[str, ...]:
        return training.simulator.overrides(measures[scene], at, {}, point.effects)

    pairs = {(run.scene, overrides_of(run.scene, run.at)) for run in training.runs}
    for observable, rows, conditions_of in predictor.row_requests:
        scene = training.simulator.measures[mapping.observables[observable.name]].scene
        table = mapping.model_conditions(conditions_of)
        is_new[rows] = [(scene, overrides_of(scene, row_at(table, k))) not in pairs for k in range(rows.size)]
    return is_new


def kind_chance(kinds: Sequence[Kind], change: Floats, of: int = 0) -> Floats:
    """Probability of one kind, by default the answer, after a change (..., kinds) of the evidence of each."""
    weights = np.array([kind.log_weight for kind in kinds]) + change
    return np.exp(weights[..., of] - np.logaddexp.reduce(weights, axis=-1))


def gap_of(kinds: Sequence[Kind], runs: Sequence[FreshRuns]) -> GapPart | None:
    """The least likely gap of all observables under all explanations."""
    pairs = zip(kinds, runs, strict=True)
    tests = [replace(test, effects=kind.acting) for kind, run in pairs for test in run.tests.values()]
    worst = min(tests, key=lambda each: each.p, default=None)
    return worst and replace(worst, p=min(1.0, len(tests) * worst.p))
