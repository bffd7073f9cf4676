"""Studies from Python: compare, discover, adopt, next, predict, report."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from math import nan
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, Literal, TypedDict, TypeVar, Union, Unpack

from taichi_erosion.api.notebook import frame, html, progress
from taichi_erosion.api.runs import PathLike
from taichi_erosion.api.wording import all_in_python, in_python, python_words
from taichi_erosion.core.errors import BadInput
from taichi_erosion.evidence.data.number_words import heading

if TYPE_CHECKING:
    import pandas as pd

    from taichi_erosion.evidence.answers.files import Reply
    from taichi_erosion.evidence.data.table_units import TableUnits
    from taichi_erosion.evidence.models.load_study import StudyOptions
    from taichi_erosion.evidence.race.record import ExperimentPart, LawPart, Record
    from taichi_erosion.report.figure_style import Figure

Document = Mapping[str, Any]
Report = Callable[[str, float], None]  # (words, share done [1])
Kind = TypeVar("Kind", bound="ReplyResult")
TableLike = Union[PathLike, Mapping[str, Sequence[Any]], "pd.DataFrame"]


class StatedGrains(TypedDict, total=False):
    """What a new study is told of the grains beside its table."""

    diameter: str  # with its unit
    density: str  # with its unit
    grains: int  # of a run


@dataclass(frozen=True, repr=False)
class Result:
    """Answer to a command of the loop, with the document that `--json` prints."""

    study: Path
    document: Document

    @property
    def found(self) -> list[str]:
        """What was found, in plain sentences; what is wrong with the set-up comes first."""
        return [python_words(each) for each in (*self.document.get("set_up", ()), *self.lines())]

    def lines(self) -> Sequence[str]:
        """Sentences of this command, as the command line prints them."""
        raise NotImplementedError

    @property
    def table(self) -> "pd.DataFrame":
        """Main table of the answer."""
        raise NotImplementedError

    def __repr__(self) -> str:
        first = next(iter(self.found), "nothing found")
        return f"{type(self).__name__}({self.study}: {first})"

    def _repr_html_(self) -> str:
        return html(self.document["title"] or str(self.study), self.found, [self.table])


@dataclass(frozen=True, repr=False)
class ReplyResult(Result):
    """Answer with its record, from which tables and figures are made."""

    reply: "Reply"

    @property
    def record(self) -> "Record":
        """All numbers of the answer, in the units of the model."""
        return self.reply.record

    @property
    def units(self) -> "TableUnits":
        """Units in which the study's table has values and conditions."""
        from taichi_erosion.evidence.data.table_units import TableUnits

        return TableUnits.of(self.document)

    @property
    def rows(self) -> "pd.DataFrame":
        """Fitted rows in the units of the table: measured, and the model before and after."""
        import pandas as pd

        rows, units = self.record.rows, self.units
        columns = {"observable": rows.observable, "unit": [unit_of(units, name) for name in rows.observable]}
        for key in ("measured", "sd", "before", "after"):
            pairs = zip(rows.observable, getattr(rows, key), strict=True)
            columns[key] = [units.value(name, number) for name, number in pairs]
        for name, numbers in rows.conditions.items():
            columns[condition_heading(units, name)] = [units.condition(name, number) for number in numbers]
        return pd.DataFrame(columns)

    def lines(self) -> Sequence[str]:
        return self.reply.answer().lines

    def figure(self) -> "Figure":
        """First figure of the study's page: measured values and the model before and after."""
        from taichi_erosion.report.study_page import first_figure

        return first_figure(self.reply)


@dataclass(frozen=True, repr=False)
class ComparisonResult(ReplyResult):
    """Where the calibrated model fails."""

    @property
    def p(self) -> float:
        """Probability of so large a misfit if nothing is missing; NaN where the scatter is not known [1]."""
        return self.record.fit.p_before

    @property
    def table(self) -> "pd.DataFrame":
        """Misfit of every observable in its unit; `bias` is the mean of measured less predicted."""
        rows = self.rows
        gaps = rows.assign(gap=rows["measured"] - rows["before"]).groupby(["observable", "unit"], sort=False)
        found = gaps["gap"].agg(n="size", rmse=lambda gap: (gap**2).mean() ** 0.5, bias="mean")
        return found.reset_index("unit")


@dataclass(frozen=True, repr=False)
class DiscoveryResult(ReplyResult):
    """Which effect is missing."""

    @property
    def named(self) -> list[str]:
        """Effects that are missing; empty where none is sure."""
        return list(self.record.decided.named)

    @property
    def probabilities(self) -> dict[str, float]:
        """Probability of every explanation: `none`, `outside_library`, an effect, or a set `a+b` [1]."""
        return dict(self.record.decided.probabilities)

    @property
    def law(self) -> "LawPart | None":
        """Law of what is missing beyond one strength; None where there is none."""
        return self.record.law

    @property
    def table(self) -> "pd.DataFrame":
        """Candidates, the likeliest first; strengths [1] where they act, with 90 % intervals.

        A strength above `limit` is excluded with 95 %; one below `unseen_below` could act and not be seen.
        """
        rows = (
            {"effect": name, "status": each.status, "probability": each.probability}
            | {"strength": each.strength.value, "low": each.strength.low, "high": each.strength.high}
            | {key: getattr(each, key) for key in ("limit", "unseen_below", "log_bayes_factor")}
            for name, each in self.record.effects.items()
        )
        table = frame(rows, columns=("effect", "status", "probability")).set_index("effect")
        return table.sort_values("probability", ascending=False)

    effects = table


@dataclass(frozen=True, repr=False)
class AdoptionResult(ReplyResult):
    """Error on fitted and held-out rows before and after effects are added, beside a control."""

    @property
    def table(self) -> "pd.DataFrame":
        """Misfit per row, 1 is chance, of every model; NaN where it is not known [1]."""
        import pandas as pd

        fit, held = self.record.fit, self.record.held_out
        unseen = (held.before, held.after, held.wrong) if held else (nan, nan, nan)
        fitted = (fit.chi2_before / fit.n, fit.chi2_after / fit.n, nan)
        return pd.DataFrame({"fitted": fitted, "held_out": unseen}, ["before", "after", "control"])

    @property
    def files(self) -> list[Path]:
        """Files that were written, the new study first."""
        return [Path(file) for file in self.document["files"]]


@dataclass(frozen=True, repr=False)
class ExperimentsResult(ReplyResult):
    """Experiments that would decide."""

    @property
    def table(self) -> "pd.DataFrame":
        """Proposed experiments, the best first, with what each explanation expects, in units of the table."""
        return frame(
            (experiment_row(each, self.units) for each in self.record.experiments),
            columns=("observable", "unit", "chance", "cost"),
        )


def experiment_row(found: "ExperimentPart", units: "TableUnits") -> dict[str, Any]:
    """An experiment in the units of the table; columns of what is expected are named by the explanation."""
    name, at = found.observable, found.conditions.items()
    row: dict[str, Any] = {"observable": name, "unit": unit_of(units, name)}
    row |= {condition_heading(units, condition): units.condition(condition, x) for condition, x in at}
    for key, expected in found.predictions.items():
        ends = {key: expected.value, f"{key} low": expected.low, f"{key} high": expected.high}
        row |= {column: units.value(name, number) for column, number in ends.items()}
    return row | {"chance": found.chance, "cost": found.cost}


def unit_of(units: "TableUnits", observable: str) -> str:
    """Unit of an observable, `1` for a pure number."""
    return units.value_unit(observable) or "1"


def condition_heading(units: "TableUnits", name: str) -> str:
    """`diameter [mm]`."""
    return heading(name, units.condition_unit(name))


@dataclass(frozen=True, repr=False)
class PredictionResult(Result):
    """What the calibrated, adopted model says at new conditions."""

    def lines(self) -> Sequence[str]:
        return self.document["sentences"]

    @property
    def table(self) -> "pd.DataFrame":
        """Predictions in the units of the observables, one row each, conditions as the table had them.

        `low` and `high` are the 90 % interval of what many repeats give on average, `measured_low` and
        `measured_high` that of one measurement; `model` is the calibrated model alone.
        """
        keys = ("model", "value", "low", "high", "measured_low", "measured_high", "unit")
        return frame(
            {"observable": row["observable"], **row["conditions"], **{key: row[key] for key in keys}}
            | {"outside": "; ".join(row["outside"])}
            for row in self.document["rows"]
        )


@all_in_python
@dataclass(frozen=True)
class Study:
    """An evidence study: its file, and what its runs may cost."""

    path: Path
    budget: Literal["quick", "full"] | int | None = None  # a number: at most so many runs
    workers: int | None = None
    seed: int | None = None
    effect_files: tuple[Path, ...] = ()
    arch: Literal["auto", "cpu", "cuda", "vulkan"] | None = None
    decomposition: Literal["partitions", "grains"] | None = None

    @property
    def options(self) -> "StudyOptions":
        """What the commands take beside the file."""
        from taichi_erosion.evidence.models.load_study import StudyOptions, stated_budget

        stated = {name: getattr(self, name) for name in ("workers", "seed", "effect_files")}
        stated |= {"arch": self.arch, "decomposition": self.decomposition}
        return StudyOptions(*stated_budget(self.budget), **stated)

    def check(self) -> Document:
        """Validate study, table, scenes and model; run nothing. Raises BadInput with all faults."""
        from taichi_erosion.evidence.answers.study_files.check_study import check_study

        return check_study(self.path, self.options)

    def compare(self) -> ComparisonResult:
        """Calibrate the model, and find where it still fails."""
        from taichi_erosion.evidence.answers.commands import compare_study

        return self.answered(ComparisonResult, "comparing", compare_study)

    def discover(self) -> DiscoveryResult:
        """Find the missing effect."""
        from taichi_erosion.evidence.answers.commands import discover_study

        return self.answered(DiscoveryResult, "discovering", discover_study)

    def adopt(self, *effects: str | Sequence[str], force: bool = False) -> AdoptionResult:
        """Add effects, by names or lists of names; calibrate again, open the vault.

        Raises BadInput for what is no candidate.
        """
        from taichi_erosion.evidence.answers.commands import adopt_study

        names = [name for each in effects for name in ([each] if isinstance(each, str) else each)]
        if not names:
            raise BadInput("adopt: name the effects to add")

        def adopt(path: Path, report: Report, options: "StudyOptions") -> "Reply":
            return adopt_study(path, names, report, options, force)

        return self.answered(AdoptionResult, "adopting", adopt)

    def next(self) -> ExperimentsResult:
        """Find the cheapest experiments that tell the named explanation from its rivals."""
        from taichi_erosion.evidence.answers.commands import next_study

        return self.answered(ExperimentsResult, "planning", next_study)

    def predict(self, table: TableLike, *, bare: bool = False) -> PredictionResult:
        """What the calibrated model says at the conditions of a table, with 90 % intervals.

        `table` is a file (.csv, .xlsx), or a DataFrame or dict with a column for each condition. The adopted
        model answers where effects have been adopted, unless `bare`. Raises BadInput with all faults of
        the table.
        """
        from taichi_erosion.evidence.prediction.commands import predict_study

        with TemporaryDirectory() as folder:
            file = table_file(table, Path(folder) / "conditions")

            with progress("predicting") as report:
                document = predict_study(
                    self.path, file, lambda words, share: report(share, words), self.options, bare
                )
            return PredictionResult(self.path, document)

    def report(self, to: PathLike | None = None) -> Path:
        """Write the page of all answers (HTML). Raises BadInput before the first answer."""
        from taichi_erosion.report import write_report

        return write_report(self.path, None if to is None else Path(to), True)

    def answered(
        self, kind: type[Kind], title: str, command: Callable[[Path, Report, "StudyOptions"], "Reply"]
    ) -> Kind:
        """Result of a command, with a progress bar."""
        with progress(title) as report:
            reply = command(self.path, lambda words, share: report(share, words), self.options)
        return kind(self.path, reply.document, reply)


@in_python
def study(
    path: PathLike,
    *,
    budget: Literal["quick", "full"] | int | None = None,
    workers: int | None = None,
    seed: int | None = None,
    effect_files: Sequence[PathLike] = (),
    arch: Literal["auto", "cpu", "cuda", "vulkan"] | None = None,
    decomposition: Literal["partitions", "grains"] | None = None,
) -> Study:
    """A study by its file; None leaves a choice to the file.

    Raises BadInput for a file that is none and for a budget that is none; its commands do for faults in it.
    """
    from taichi_erosion.evidence.models.load_study import stated_budget
    from taichi_erosion.scene.file_kind import refuse_other_kind

    refuse_other_kind(Path(path), "study")
    if not Path(path).is_file():
        raise BadInput(f"{path}: there is no such file")
    stated_budget(budget)
    files = tuple(Path(file) for file in effect_files)
    return Study(Path(path), budget, workers, seed, files, arch, decomposition)


@in_python
def new_study(
    table: TableLike,
    out: PathLike | None = None,
    *,
    observables: Mapping[str, str] | None = None,
    conditions: Mapping[str, str] | None = None,
    units: Mapping[str, str] | None = None,
    apparatus: str | None = None,
    closed_form: bool = False,
    **grains: Unpack[StatedGrains],
) -> Study:
    """A study, its tidy table and its scene from a laboratory's table; every guess is taken.

    `table` is a file (.csv, .xlsx), or a DataFrame or dict whose column names carry units; `out` is the
    folder to write, which columns in memory need. `units` are those of columns. What no column states of
    the grains: `diameter="0.4 mm"`, `density="2650 kg/m3"`, `grains=5000` in a run. Raises BadInput with
    all faults of the table.
    """
    from taichi_erosion.evidence.answers.study_files.new_study import Wishes
    from taichi_erosion.evidence.answers.study_files.new_study import new_study as write_study
    from taichi_erosion.evidence.data.tables.column_roles import Told

    wishes = Wishes(
        Told(dict(observables or {}), dict(conditions or {}), dict(units or {})),
        None if out is None else Path(out),
        apparatus,
        closed_form,
        **grains,
    )
    document = write_study(table_file(table, out), wishes, lambda question, guess: guess)
    return study(document["written"][0])


def table_file(table: TableLike, out: PathLike | None) -> Path:
    """File of a table; columns in memory are written beside the folder of the study. Raises BadInput."""
    if isinstance(table, (str, Path)):
        return Path(table)
    import pandas as pd

    try:
        columns = pd.DataFrame(table) if isinstance(table, Mapping) else table
    except ValueError as error:
        raise BadInput(
            f"the columns of the table: {error}; give a list for each, all of one length"
        ) from None
    if not isinstance(columns, pd.DataFrame):
        given = type(table).__name__
        raise BadInput(f"a table is a file (.csv, .xlsx), a DataFrame or a dict of columns, not a {given}")
    if out is None:
        raise BadInput("new_study: name the folder to write for a DataFrame, out=FOLDER")
    folder = Path(out)
    folder.parent.mkdir(parents=True, exist_ok=True)
    file = folder.with_name(f"{folder.name}.csv")
    columns.to_csv(file, index=False)
    return file
