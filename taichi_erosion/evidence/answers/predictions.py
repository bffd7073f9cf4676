"""Command `predict`: a study and a table of conditions in, values with 90 % intervals out.

The race answers without candidates: what is adopted belongs to the model. Every fitted row is predicted from
the others to check the intervals, and so are held-out rows where an adoption has opened the vault. Scenes are
simulated at conditions that are new to their emulator.
"""

from collections.abc import Iterator
from dataclasses import asdict, replace
from math import nan
from pathlib import Path
from time import perf_counter

import numpy as np
from scipy import special

from taichi_erosion.evidence.answers import files
from taichi_erosion.evidence.answers.commands import bare as without_candidates
from taichi_erosion.evidence.answers.commands import common_answer_fields, open_study
from taichi_erosion.evidence.answers.files import Reply
from taichi_erosion.evidence.answers.rounds import Question, answer_question, plans_to_try
from taichi_erosion.evidence.data.held_out_rows import COUNTER, count_opening, read_openings, vault_openings
from taichi_erosion.evidence.data.problem import Bools, Floats, Measurements, Progress, pick_rows
from taichi_erosion.evidence.data.transforms import from_scale
from taichi_erosion.evidence.models.load_study import LONGEST_CHAIN, NO_OPTIONS, StudyOptions, load_study
from taichi_erosion.evidence.models.table_columns import NewConditions, condition_units, read_new_conditions
from taichi_erosion.evidence.race import outlook as outlooks
from taichi_erosion.evidence.race.blocks import EACH_SET_UP
from taichi_erosion.evidence.race.fit import Race
from taichi_erosion.evidence.race.posterior import Posterior
from taichi_erosion.evidence.record import CheckPart, PredictedPart, PredictionPart
from taichi_erosion.evidence.words.part_words import naming_lowers_misfit
from taichi_erosion.scene.schema.units import Scale

SHARE = 0.9  # of the probability that an interval holds
ROW_WISE = ("observable", "conditions", "group")  # of new conditions, as the race takes them


def predict_study(
    path: Path, at: Path, progress: Progress, options: StudyOptions = NO_OPTIONS, bare: bool = False
) -> Reply:
    """What the calibrated model of a study says at the conditions of a table.

    Where effects have been adopted, the adopted model answers, unless `bare`. Rows of a vault that has been
    opened for it check the intervals; that is one opening more for each adopted model. Raises BadInput.
    """
    start = perf_counter()
    chosen, outdated = (path, ()) if bare else latest_adopted_study(path, options)
    with open_study(chosen, options) as study:
        places = condition_units(study.file, study.path, study.effect_files)
        new = read_new_conditions(at, study.file, places, study.problem.measurements, study.path.parent)
        at_rows = zip(new.observable, *new.conditions.values(), strict=True)
        sets = {(study.file.observables[name].scene, *values) for name, *values in at_rows}
        question = replace(
            Question("predict", without_candidates, lambda inference: [inference.bare_point], most_points=1),
            query=lambda inference: rows_to_predict(inference.posterior.race, new),
            query_sets=len(sets),
        )
        inference, ready = answer_question(study, plans_to_try(study), question, progress)
        opened = bool(study.file.adopted) and len(study.problem.vault.rows) > 0
        record = predict_new_rows(inference.posterior, new, opened, inference.query)
        record = replace(record, new_runs=inference.query_runs, outdated=outdated)
        model = inference.posterior.race.prepared.predictor
        name, count = f"predict {study.path.stem}", vault_openings(study.results, study.vault_digest)
        if opened and name not in read_openings(study.results / COUNTER).get(study.vault_digest, []):
            count = count_opening(study.results, study.vault_digest, name)
        about = common_answer_fields(ready, inference) | {"at": new.file, "vault_opened": count}
        about |= {"seed": study.file.study.seed, "runs": ready.simulations or model.cost.runs}
        reply = Reply("predict", about | {"wall_s": perf_counter() - start}, record)
        return files.write_reply(study.results, study.path.stem, reply)


def latest_adopted_study(path: Path, options: StudyOptions = NO_OPTIONS) -> tuple[Path, tuple[str, ...]]:
    """The study that the last of several adoptions wrote, or the study itself.

    Comes with the effects of an adoption that does not answer: advised against, or of another table or study.
    """
    for _ in range(LONGEST_CHAIN):
        study = load_study(path, options)
        last = files.read_reply(study.results, path.stem, "adopt")
        if last is None:
            return path, ()
        if not naming_lowers_misfit(last.record) or last.about["digest"] != study.digest[:12]:
            return path, last.record.named
        following = path.with_name(Path(last.about["written"]).name)
        if following == path or not following.is_file():
            return path, ()
        path = following
    return path, ()


def rows_to_predict(race: Race, new: NewConditions) -> outlooks.JointRows:
    """Wanted rows of the fitted observables, with the model there."""
    finite = np.isin(new.observable, race.prepared.rows.names)
    chosen = NewConditions(**pick_rows({key: getattr(new, key) for key in ROW_WISE}, finite))
    return outlooks.joint_rows(race, outlooks.new_rows(race.prepared, chosen))


def predict_new_rows(
    posterior: Posterior, wanted: NewConditions, opened: bool = False, query: outlooks.JointRows | None = None
) -> PredictionPart:
    """Predictions at new rows, and checks of their intervals.

    `opened`: the vault may be compared with; `query`: the new rows with runs there.
    """
    fitted = posterior.race.prepared.rows
    lost = [name for name in wanted.observable if name not in fitted.names]
    held_out = None
    if opened and (vault := outlooks.held_out_rows(posterior.race.prepared)) is not None:
        below = outlooks.forecast(posterior, outlooks.joint_rows(posterior.race, vault)).share_below()
        held_out = interval_coverage(below, ~vault.censored)
    return PredictionPart(
        rows=tuple(predicted_rows(posterior, wanted, query)),
        fitted=interval_coverage(outlooks.leave_one_out_shares(posterior), ~fitted.censored),
        held_out=held_out,
        unlisted=sum(p for h, p in posterior.probability.items() if {*h.extra} - {EACH_SET_UP}),
        outdated=(),
        lost=tuple(dict.fromkeys(lost)),
        constant=wanted.constant,
    )


def predicted_rows(
    posterior: Posterior, wanted: NewConditions, new: outlooks.JointRows | None
) -> Iterator[PredictedPart]:
    """Predictions of the wanted rows of fitted observables, in the units of the observables."""
    race, table = posterior.race, posterior.race.prepared.problem.measurements
    place = new or rows_to_predict(race, wanted)
    names, groups = place.rows.names, place.rows.group
    chosen = np.flatnonzero(np.isin(wanted.observable, race.prepared.rows.names)).tolist()
    labels = race.prepared.rows.group if any(block.kind == "group" for block in race.blocks) else groups
    outlook, fit = outlooks.forecast(posterior, place), race.bare
    model, runs = place.model.precise_mean((), fit.v)[fit.mean.size :], place.runs
    model = model if runs is None else model + runs[1]
    units = dict(zip(table.observable, table.unit, strict=True))
    means, single = outlook.forecast_intervals(outlook.mean), outlook.forecast_intervals(outlook.new_value)
    for k, (i, mean, measured) in enumerate(zip(chosen, means, single, strict=True)):
        observable = place.rows.observables[place.rows.which[k]]
        yield PredictedPart(
            line=wanted.lines[i] if wanted.lines else i + 1,
            observable=names[k],
            conditions=dict(wanted.table_values[i]) if wanted.table_values else place.rows.conditions_at(k),
            condition_units={name: scale.unit for name, scale in wanted.scales.items()},
            unit=units[names[k]],
            **asdict(mean),
            model=float(from_scale(observable, model[k : k + 1])[0]),
            measured_low=min(mean.low, measured.low),  # of mixtures
            measured_high=max(mean.high, measured.high),
            outside=dict(conditions_out_of_range(table, names[k], wanted, i)),
            group=groups[k],
            unseen=groups[k] not in labels,
            simulated=runs is not None and bool(runs[0][k] and np.isfinite(model[k])),
        )


def conditions_out_of_range(
    table: Measurements, observable: str, wanted: NewConditions, row: int
) -> Iterator[tuple[str, float]]:
    """Conditions of a new row outside the range in which its observable was measured, with its end."""
    of_observable = np.array(table.observable) == observable
    for name, column in wanted.conditions.items():
        measured = table.conditions[name][of_observable]
        measured, value = measured[np.isfinite(measured)], float(column[row])
        if not measured.size or not np.isfinite(value):
            continue
        end = float(np.clip(value, measured.min(), measured.max()))
        if abs(value - end) > 1e-9 * np.abs(measured).max():
            scale = wanted.scales.get(name, table.table_units.conditions.get(name, Scale()))
            yield name, scale.to_unit_of_table(end)


def interval_coverage(below: Floats, counted: Bools) -> CheckPart:
    """Count of measured values inside their intervals, from the share of the prediction below each."""
    shares = below[counted & np.isfinite(below)]
    inside = int(np.sum(np.abs(shares - 0.5) <= 0.5 * SHARE))
    p = float(special.bdtr(inside, shares.size, SHARE)) if shares.size else nan
    return CheckPart(shares.size, inside, p, int(np.sum(~counted)))
