"""Answers of a study from Python: sentences, tables, figures."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from math import nan
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pandas as pd

from taichi_erosion.api.notebook import WholeTable, result_html, table_of_rows
from taichi_erosion.evidence.data.table_units import TableUnits
from taichi_erosion.evidence.words import shell_command
from taichi_erosion.evidence.words.answer_lines import out_of_range_text
from taichi_erosion.evidence.words.part_words import acting_text
from taichi_erosion.tables.number_words import heading

if TYPE_CHECKING:
    import xarray as xr

    from taichi_erosion.evidence.answers.files import Reply
    from taichi_erosion.evidence.record import LawPart, Record
    from taichi_erosion.report.figure_style import Figure

DRAWS = 2000  # of a posterior
PREDICTED = ("model", "value", "low", "high", "measured_low", "measured_high", "unit", "outside")  # columns


def python_call(study_path: Path, command: str, file: str, *words: str) -> str:
    """A command of the evidence loop as a call in backquotes; `study_path` is the study that answers."""
    if command == "effects":
        return shell_command(command, file, *words)
    study = "study" if Path(file) == study_path else f"te.study({file!r})"
    return f"`{study}.{command}({', '.join(map(repr, words))})`"


@dataclass(frozen=True, repr=False)
class Result:
    """Answer to a command: sentences and a table."""

    study: Path
    reply: Any  # of the command: what it is about, its record, its answer in words

    @property
    def document(self) -> Mapping[str, Any]:
        """What `--json` prints."""
        return self.reply.document

    @property
    def found(self) -> list[str]:
        """What was found, in plain sentences with calls of Python; what is wrong with the set-up first."""
        return [*self.reply.about["set_up"], *self.reply.answer(call=partial(python_call, self.study)).lines]

    @property
    def table(self) -> pd.DataFrame:
        """Main table of the answer."""
        raise NotImplementedError

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.study}: {self.found[0]})"

    def _repr_html_(self) -> str:
        return result_html(self.document["title"] or str(self.study), self.found, [self.table])


@dataclass(frozen=True, repr=False)
class RaceResult(Result):
    """Answer to `compare`, `discover`, `adopt` or `next`."""

    reply: "Reply"

    @property
    def record(self) -> "Record":
        """All numbers of the answer, in the units of the model."""
        return self.reply.record

    @property
    def units(self) -> TableUnits:
        """Units in which the study's table has values and conditions."""
        return self.reply.units

    @property
    def rows(self) -> pd.DataFrame:
        """Fitted rows in the units of the table: measured mean, its error `sd`, model before and after."""
        rows, units = self.record.rows, self.units
        columns = {"observable": rows.observable, "unit": [unit_of(units, name) for name in rows.observable]}
        for key in ("measured", "sd", "before", "after"):
            columns[key] = list(map(units.value, rows.observable, getattr(rows, key)))
        for name, numbers in rows.conditions.items():
            title = heading(name, units.condition_unit(name))
            columns[title] = [units.condition(name, number) for number in numbers]
        return WholeTable(columns)

    @property
    def law(self) -> "LawPart | None":
        """Law of what is missing beyond one strength; None where there is none."""
        return self.record.law

    @property
    def posterior(self) -> "xr.Dataset":
        """Draws of calibrated numbers, and of strengths of effects [1], 0 where one does not act."""
        import xarray as xr

        assert self.reply.posterior is not None  # of a new answer
        draws = self.reply.posterior.draw_numbers_and_strengths(DRAWS).items()
        columns = {name: (("chain", "draw"), values[None]) for name, values in draws}
        return xr.Dataset(columns, {"chain": [0], "draw": range(DRAWS)})

    def figure(self) -> "Figure":
        """First figure of the study's page: measured values and the model before and after."""
        from taichi_erosion.report.study_page import worst_place_figure

        return worst_place_figure(self.reply)


@dataclass(frozen=True, repr=False)
class ComparisonResult(RaceResult):
    """Where the calibrated model fails."""

    @property
    def p(self) -> float:
        """Probability of so large a misfit if nothing is missing; NaN where the scatter is not known [1]."""
        return self.record.p_misfit

    @property
    def table(self) -> pd.DataFrame:
        """Misfit of every observable in its unit; `bias` is the mean of measured less predicted."""
        rows = self.rows
        gaps = rows.assign(gap=rows["measured"] - rows["before"]).groupby(["observable", "unit"], sort=False)
        errors = gaps["gap"].agg(n="size", rmse=lambda gap: (gap**2).mean() ** 0.5, bias="mean")
        return WholeTable(errors.reset_index("unit"))


@dataclass(frozen=True, repr=False)
class DiscoveryResult(RaceResult):
    """Which effect is missing."""

    @property
    def named(self) -> list[str]:
        """Effects that are missing; empty where none is sure."""
        return list(self.record.named)

    @property
    def probabilities(self) -> dict[str, float]:
        """Probability of each explanation: `none`, `each_set_up`, `outside_library`, `a`, `a+b` [1]."""
        return dict(self.record.probabilities)

    @property
    def table(self) -> pd.DataFrame:
        """Candidates, the likeliest first; strengths [1] where they act, with 90 % intervals.

        Excluded with 99 % above `limit`; not seen below `unseen_below`.
        """
        rows = (
            {"effect": name, "status": each.status, "probability": each.probability}
            | {"strength": each.strength, "low": each.strength_low, "high": each.strength_high}
            | {key: getattr(each, key) for key in ("limit", "unseen_below", "log_bayes_factor")}
            for name, each in self.record.effects.items()
        )
        table = table_of_rows(rows, columns=("effect", "status", "probability")).set_index("effect")
        return table.sort_values("probability", ascending=False)

    effects = table

    @property
    def sensitivity(self) -> pd.DataFrame:
        """Answers with a prior halved, and doubled."""
        columns = {prior: map(acting_text, answers) for prior, answers in self.record.sensitivity.items()}
        return pd.DataFrame.from_dict(columns, orient="index", columns=["halved", "doubled"])

    @property
    def curves(self) -> pd.DataFrame:
        """Effect of something unlisted along conditions, in table units."""
        rows = list[dict[str, Any]]()
        units = self.units
        for curve in self.record.curves:
            name, axis, is_offset = curve.observable, curve.condition, curve.kind == "offset"
            unit = unit_of(units, name) if is_offset else "factor"
            title = heading(axis, units.condition_unit(axis))
            labels = {"observable": name, "unit": unit, "condition": title}
            for point in curve.points:
                ends = {"value": point.value, "low": point.low, "high": point.high}
                sizes = {key: units.value(name, x) if is_offset else x for key, x in ends.items()}
                rows.append(labels | {"at": units.condition(axis, point.at)} | sizes)
        return table_of_rows(rows, columns=("observable", "unit", "condition", "at", "value", "low", "high"))


@dataclass(frozen=True, repr=False)
class AdoptionResult(RaceResult):
    """Error on fitted and held-out rows before and after effects are added, beside a control."""

    @property
    def table(self) -> pd.DataFrame:
        """Misfit per row, 1 is chance, of every model; NaN where it is not known [1]."""
        record, ends = self.record, ("before", "after", "wrong_effect")
        fitted = (record.chi2_per_row_before, record.chi2_per_row_after, nan)
        held_out = [getattr(record.vault, f"chi2_per_row_{end}", nan) for end in ends]
        return WholeTable({"fitted": fitted, "held_out": held_out}, ["before", "after", "control"])

    @property
    def files(self) -> list[Path]:
        """Files that were written, the new study first."""
        return [Path(file) for file in self.document["files"]]


@dataclass(frozen=True, repr=False)
class ExperimentsResult(RaceResult):
    """Experiments that would decide."""

    @property
    def table(self) -> pd.DataFrame:
        """Proposed experiments, the best first, with what each explanation expects, in units of the table."""
        rows = list[dict[str, Any]]()
        units = self.units
        for experiment in self.record.next_experiments:
            name = experiment.observable
            row: dict[str, Any] = {"observable": name, "unit": unit_of(units, name)}
            for axis, x in experiment.conditions.items():
                row[heading(axis, units.condition_unit(axis))] = units.condition(axis, x)
            for key, expected in experiment.predictions.items():
                ends = {key: expected.value, f"{key} low": expected.low, f"{key} high": expected.high}
                row |= {column: units.value(name, number) for column, number in ends.items()}
            rows.append(row | {"chance": experiment.chance, "cost": experiment.cost})
        return table_of_rows(rows, columns=("observable", "unit", "chance", "cost"))


@dataclass(frozen=True, repr=False)
class PredictionResult(Result):
    """What the calibrated, adopted model says at new conditions."""

    @property
    def table(self) -> pd.DataFrame:
        """Predictions in the units of the study's table, one row each, conditions as they were asked.

        `low` and `high` are the 90 % interval of what many repeats give on average, `measured_low` and
        `measured_high` that of one measurement; `model` is the calibrated model alone.
        """
        return prediction_table(self.reply)


def prediction_table(reply: "Reply") -> pd.DataFrame:
    """Predictions with their conditions, as `PredictionResult.table` and a CSV have them."""
    units = reply.units
    rows = (
        {"observable": row.observable, **({"group": row.group} if row.group else {})}
        | {heading(name, unit): row.conditions[name] for name, unit in row.condition_units.items()}
        | {key: units.value(row.observable, getattr(row, key)) for key in PREDICTED[:-2]}
        | {"unit": unit_of(units, row.observable), "outside": out_of_range_text(row)}
        for row in reply.record.rows
    )
    return table_of_rows(rows, columns=("observable", *PREDICTED))


def unit_of(units: TableUnits, observable: str) -> str:
    """Unit of an observable, `1` for a pure number."""
    return units.value_unit(observable) or "1"
