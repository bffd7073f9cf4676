"""Studies from Python: compare, discover, adopt, next, predict, report."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, Literal, TypedDict, Union, Unpack

from taichi_erosion.api.notebook import frame, html, progress
from taichi_erosion.api.predictions import PredictionResult
from taichi_erosion.api.runs import PathLike
from taichi_erosion.api.wording import all_in_python, in_python, python_words
from taichi_erosion.core.errors import BadInput
from taichi_erosion.evidence.data.number_words import heading

if TYPE_CHECKING:
    import pandas as pd

    from taichi_erosion.evidence.data.table_units import TableUnits
    from taichi_erosion.evidence.models.load_study import StudyOptions
    from taichi_erosion.report.figure_style import Figure

Document = Mapping[str, Any]
Progress = Callable[[str, float], None]  # (words, share done [1])
TableLike = Union[PathLike, Mapping[str, Sequence[Any]], "pd.DataFrame"]


class StatedGrains(TypedDict, total=False):
    """What a new study is told of the grains beside its table."""

    diameter: str  # with its unit
    density: str  # with its unit
    grains: int  # of a run


def row_frame(rows: Document | None, units: "TableUnits") -> "pd.DataFrame":
    """Measured and modelled values in the units of the table, one row of measurements a row.

    The headings of conditions have their units; without rows the table is empty.
    """
    if not rows:
        return frame([])
    names = rows["observable"]
    columns = {"observable": names, "unit": [units.value_unit(name) or "1" for name in names]}
    for key in ("measured", "measured_sd", "predicted", "predicted_sd"):
        columns[key] = [units.value(name, number) for name, number in zip(names, rows[key], strict=True)]
    for name, numbers in rows["conditions"].items():
        columns[heading(name, units.condition_unit(name))] = [
            None if number is None else units.condition(name, number) for number in numbers
        ]
    return frame(dict(zip(columns, values, strict=True)) for values in zip(*columns.values(), strict=True))


@dataclass(frozen=True, repr=False)
class Result:
    """Answer to a command of the loop: its document as `--json` prints it, with the rows of its figures."""

    study: Path
    document: Document

    @property
    def sentences(self) -> list[str]:
        """What was found, in plain sentences."""
        return [python_words(each) for each in (*self.document.get("set_up", ()), *self.found)]

    @property
    def found(self) -> list[str]:
        """Sentences of this command."""
        return []

    @property
    def table(self) -> "pd.DataFrame":
        """Main table of the answer."""
        return row_frame(self.document.get("rows"), self.units)

    @property
    def units(self) -> "TableUnits":
        """Units in which the study's table has values and conditions."""
        from taichi_erosion.evidence.data.table_units import TableUnits

        return TableUnits.of(self.document)

    def figure(self) -> "Figure":
        """First figure of the study's page: measured values and the model before and after."""
        from taichi_erosion.report.evidence_page import first_figure

        return first_figure(self.study)

    def __repr__(self) -> str:
        first = next(iter(self.sentences), "nothing found")
        return f"{type(self).__name__}({self.study}: {first})"

    def _repr_html_(self) -> str:
        return html(self.document["title"] or str(self.study), self.sentences, [self.table])


@dataclass(frozen=True, repr=False)
class ComparisonResult(Result):
    """Where the calibrated model fails."""

    @property
    def found(self) -> list[str]:
        from taichi_erosion.evidence.answers.agreement_words import comparison_sentences

        return comparison_sentences(self.document)

    @property
    def p(self) -> float | None:
        """Probability of so large a misfit if nothing is missing; None where the scatter is not known [1]."""
        return self.document["p"]

    @property
    def misfit(self) -> "pd.DataFrame":
        """Misfit of every observable; `rmse` and `bias` in the unit of the table."""
        units = self.units
        rows = (
            {
                **{"observable": name, "unit": units.value_unit(name) or "1", **each},
                **{key: units.value(name, each[key]) for key in ("rmse", "bias")},
            }
            for name, each in self.document["observables"].items()
        )
        return frame(rows).set_index("observable")


@dataclass(frozen=True, repr=False)
class DiscoveryResult(Result):
    """Which effect is missing."""

    @property
    def found(self) -> list[str]:
        return list(self.document["sentences"])

    @property
    def named(self) -> list[str]:
        """Effects that are missing; empty where none is sure."""
        return list(self.document["named"])

    @property
    def table(self) -> "pd.DataFrame":
        """Candidates, the likeliest first: status, strength [1] with its 90 % interval, probability [1]."""
        strength = ("strength", "strength_low", "strength_high")
        keys = ("status", *strength, "probability", "log_bayes_factor", "power")
        found = self.document["effects"].items()
        rows = ({"effect": name, **{key: each.get(key) for key in keys}} for name, each in found)
        table = frame(rows, dict.fromkeys(keys[1:], "1")).set_index("effect")
        return table.sort_values("probability", ascending=False)

    effects = table


@dataclass(frozen=True, repr=False)
class AdoptionResult(Result):
    """Error on fitted and held-out rows before and after effects are added, beside controls."""

    @property
    def found(self) -> list[str]:
        return [self.document["sentence"]]

    @property
    def table(self) -> "pd.DataFrame":
        """chi2 per row of every model, and the error of the held-out rows in the units of the table."""
        units = self.units
        labels = {"base": "before", "added": "after", "with_all": "with all that was named"}
        labels |= {"best_wrong": "control: best other effect", "random_wrong": "control: drawn at random"}
        rows = (
            {"model": label, "fitted": fit["chi2_per_row"], "held_out": fit["vault_chi2_per_row"]}
            | {
                f"rmse of held-out {heading(name, units.value_unit(name))}": units.value(name, error)
                for name, error in (fit["vault_rmse"] or {}).items()
            }
            for key, label in labels.items()
            if (fit := self.document.get(key))
        )
        return frame(rows, {"fitted": "1", "held_out": "1"}).set_index("model")

    @property
    def files(self) -> list[Path]:
        """Files that were written, the new study first."""
        return [Path(file) for file in self.document["files"]]


@dataclass(frozen=True, repr=False)
class ExperimentsResult(Result):
    """Experiments that would decide."""

    @property
    def found(self) -> list[str]:
        return [self.document["sentence"]] if self.document["sentence"] else []

    @property
    def table(self) -> "pd.DataFrame":
        """Proposed experiments, the best first."""
        return frame(dict(each) for each in self.document["next_experiments"])


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

        return ComparisonResult(self.path, self.answered("comparing", compare_study))

    def discover(self) -> DiscoveryResult:
        """Find the missing effect."""
        from taichi_erosion.evidence.answers.commands import discover_study

        return DiscoveryResult(self.path, self.answered("discovering", discover_study))

    def adopt(self, *effects: str | Sequence[str], force: bool = False) -> AdoptionResult:
        """Add effects, by names or lists of names; calibrate again, open the vault.

        Raises BadInput for what is no candidate.
        """
        from taichi_erosion.evidence.answers.commands import adopt_study

        names = [name for each in effects for name in ([each] if isinstance(each, str) else each)]
        if not names:
            raise BadInput("adopt: name the effects to add")

        document = self.answered(
            "adopting", lambda path, report, options: adopt_study(path, names, report, options, force)
        )
        return AdoptionResult(self.path, document)

    def next(self) -> ExperimentsResult:
        """Find the cheapest experiments that tell the named explanation from its rivals."""
        from taichi_erosion.evidence.answers.commands import next_study

        return ExperimentsResult(self.path, self.answered("planning", next_study))

    def predict(self, table: TableLike, *, bare: bool = False) -> PredictionResult:
        """What the calibrated model says at the conditions of a table, with 90 % intervals.

        `table` is a file (.csv, .xlsx), or a DataFrame or dict with a column for each condition. The adopted
        model answers where effects have been adopted, unless `bare`. Raises BadInput with all faults of
        the table.
        """
        from taichi_erosion.evidence.answers.predictions import predict_study

        with TemporaryDirectory() as folder, progress("predicting") as report:
            file = table_file(table, Path(folder) / "conditions")

            def told(words: str, share: float) -> None:
                report(share, words)

            return PredictionResult(self.path, predict_study(self.path, file, told, self.options, bare))

    def report(self, to: PathLike | None = None) -> Path:
        """Write the page of all answers (HTML). Raises BadInput before the first answer."""
        from taichi_erosion.report import write_report

        return write_report(self.path, None if to is None else Path(to), True)

    def answered(self, title: str, command: Callable[[Path, Progress, "StudyOptions"], Document]) -> Document:
        """Document of a command, with a progress bar."""
        with progress(title) as report:
            return command(self.path, lambda words, share: report(share, words), self.options)


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
