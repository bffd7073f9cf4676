"""Studies from Python: compare, discover, adopt, next, predict, report."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from importlib import import_module
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, Literal, TypeVar

import pandas as pd

from taichi_erosion.api import results
from taichi_erosion.api.notebook import progress_bar
from taichi_erosion.api.runs import PathLike
from taichi_erosion.core.errors import BadInput

if TYPE_CHECKING:
    from taichi_erosion.evidence.models.load_study import StudyOptions

Document = Mapping[str, Any]
Kind = TypeVar("Kind", bound=results.Result)
TableLike = PathLike | Mapping[str, Sequence[Any]] | pd.DataFrame


@dataclass(frozen=True)
class Study:
    """An evidence study: its file, and what its runs may cost."""

    path: Path
    options: "StudyOptions"

    def check(self) -> Document:
        """Validate study, table, scenes and model; run nothing. Raises BadInput with all faults."""
        from taichi_erosion.evidence.answers.check_study import check_study

        return check_study(self.path, self.options)

    def ignore_faults(self) -> "Study":
        """The same study, whose commands go on where a fault of its set-up would keep an answer waiting."""
        return replace(self, options=replace(self.options, force=True))

    def compare(self) -> results.ComparisonResult:
        """Calibrate the model, and find where it still fails."""
        return run_study_command(self, results.ComparisonResult, "comparing", "compare")

    def discover(self) -> results.DiscoveryResult:
        """Find the missing effect."""
        return run_study_command(self, results.DiscoveryResult, "discovering", "discover")

    def adopt(self, *effects: str | Sequence[str], force: bool = False) -> results.AdoptionResult:
        """Add effects, by names or lists of names; calibrate again, open the vault.

        Raises BadInput for what is no candidate.
        """
        names = [name for each in effects for name in ([each] if isinstance(each, str) else each)]
        if not names:
            raise BadInput("adopt: name the effects to add")
        forced = replace(self, options=replace(self.options, force=force or self.options.force))
        return run_study_command(forced, results.AdoptionResult, "adopting", "adopt", names)

    def next(self) -> results.ExperimentsResult:
        """Find the cheapest experiments that tell the named explanation from its rivals."""
        return run_study_command(self, results.ExperimentsResult, "planning", "next")

    def predict(self, table: TableLike, *, bare: bool = False) -> results.PredictionResult:
        """What the calibrated model says at the conditions of a table, with 90 % intervals.

        `table` is a file (.csv, .xlsx), or a DataFrame or dict with a column for each condition. The adopted
        model answers where effects have been adopted, unless `bare`. Raises BadInput with all faults of
        the table.
        """
        with TemporaryDirectory() as folder:
            file = path_of_table(table, Path(folder) / "conditions")
            kind = results.PredictionResult
            return run_study_command(self, kind, "predicting", "predict", file, bare=bare)

    def report(self, to: PathLike | None = None) -> Path:
        """Write the page of all answers (HTML). Raises BadInput before the first answer."""
        from taichi_erosion.report import write_report

        return write_report(self.path, None if to is None else Path(to), True)


def run_study_command(
    study: Study, kind: type[Kind], title: str, command: str, *words: Any, **choices: Any
) -> Kind:
    """Result of a command, with a progress bar."""
    module = "predictions" if command == "predict" else "commands"  # imported now: it takes a second
    ask = getattr(import_module(f"taichi_erosion.evidence.answers.{module}"), f"{command}_study")
    with progress_bar(title) as bar:
        reply = ask(study.path, *words, lambda text, share: bar(share, text), study.options, **choices)
    return kind(study.path, reply)


def study(
    path: PathLike,
    *,
    budget: Literal["quick", "full"] | int | None = None,
    workers: int | None = None,
    seed: int | None = None,
    effect_files: Sequence[PathLike] = (),
    arch: Literal["auto", "cpu", "cuda"] | None = None,
    decomposition: Literal["partitions", "grains"] | None = None,
) -> Study:
    """A study by its file; None leaves a choice to the file.

    Raises BadInput for a file that is none and for a budget that is none; its commands do for faults in it.
    """
    from taichi_erosion.evidence.models.load_study import StudyOptions, plan_and_run_limit
    from taichi_erosion.scene.load import refuse_other_kind

    refuse_other_kind(Path(path), "study")
    if not Path(path).is_file():
        raise BadInput(f"{path}: there is no such file")
    size = plan_and_run_limit(budget)
    files = tuple(map(Path, effect_files))
    options = StudyOptions(*size, workers, seed, files, arch=arch, decomposition=decomposition)
    return Study(Path(path), options)


def new_study(
    table: TableLike,
    out: PathLike | None = None,
    *,
    observables: Mapping[str, str] | None = None,
    conditions: Mapping[str, str] | None = None,
    units: Mapping[str, str] | None = None,
    apparatus: str | None = None,
    closed_form: bool = False,
    **grains: Any,
) -> Study:
    """A study, its tidy table and its scene from a laboratory's table; every guess is taken.

    `anew` writes a study that is there again.

    `table` is a file (.csv, .xlsx), or a DataFrame or dict whose column names carry units; `out` is the
    folder to write, which columns in memory need. `units` are those of columns. What no column states:
    `diameter="0.4 mm"`, `density="2650 kg/m3"`, `sd={"flux": "8 %"}` of single values, `grains=5000` in a
    run. `fill_down=True` fills blank cells from above. `scene` and `effects` are files of one's own, and a
    unit in `conditions` makes a column a condition of one's own: `conditions={"pore volume": "cm3/g"}`.
    Raises BadInput with all faults of the table.
    """
    from taichi_erosion.evidence.answers.new_study import NewStudyOptions
    from taichi_erosion.evidence.answers.new_study import write_new_study as write_study
    from taichi_erosion.evidence.data.tables.column_roles import TableOptions

    if "scene" in grains:
        grains["scene"] = Path(grains["scene"])
    grains["effects"] = tuple(map(Path, grains.get("effects", ())))
    of_table = TableOptions(dict(observables or {}), dict(conditions or {}), dict(units or {}))
    wishes = NewStudyOptions(of_table, None if out is None else Path(out), apparatus, closed_form, **grains)
    return study(write_study(path_of_table(table, out), wishes, lambda question, guess: guess)["study"])


def path_of_table(table: TableLike, out: PathLike | None) -> Path:
    """File of a table; columns in memory are written beside the folder of the study. Raises BadInput."""
    if isinstance(table, str | Path):
        return Path(table)
    if out is None:
        raise BadInput("new_study: name the folder to write for a DataFrame, out=FOLDER")
    try:
        columns = pd.DataFrame(table)
    except ValueError as error:
        kinds = "a file (.csv, .xlsx), a DataFrame, or a dict of columns of one length"
        raise BadInput(f"the table is not {kinds}: {error}") from None
    folder = Path(out)
    folder.parent.mkdir(parents=True, exist_ok=True)
    file = folder.with_name(f"{folder.name}.csv")
    columns.to_csv(file, index=columns.index.names != [None])  # one with a name is a column
    return file
