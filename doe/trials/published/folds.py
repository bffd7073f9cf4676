"""Published series, each with a source left out as vault: error before and after.

    python -m doe.trials.published.folds solve      discover and adopt, by the commands; goes on
    python -m doe.trials.published.folds open       results/published.jsonl.gz

Every source is left out in turn. What is named is adopted; where a group is told, its first member; where
nothing is named, the likeliest candidate, so that its error shows whether the silence was right.
"""

import csv
import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from doe.common.cases import ROOT, method_commit
from doe.common.command import run_step
from doe.trials.answers import study_answer
from doe.trials.table import Row, add_rows
from taichi_erosion.campaign.study_file import read_evidence_study, with_entry
from taichi_erosion.core.files import write_atomic
from taichi_erosion.evidence.data.problem import Integers, Problem
from taichi_erosion.evidence.models.load_study import load_study

HERE = Path(__file__).parent
FOLDER = ROOT / "campaigns" / "trials" / "published"
OWN = "doe.trials.published.models:predict"
NAMES = (
    "impact_threshold",
    "field_thresholds",
    "threshold_by_activity",
    "flux_field",
    "flux_quarter_mm",
    "layer_height",
    "flux_profile",
)
SERIES: Mapping[str, tuple[Path, str]] = {  # study, and the module of its model as installed
    "impact_threshold_simulated": (ROOT / "doe" / "impact_threshold.toml", "doe.wind.answers:predict"),
    **{name: (HERE / f"{name}.toml", OWN) for name in NAMES},
}


@dataclass(frozen=True)
class Fold:
    """A series of which one source is left out."""

    series: str
    source: str
    number: int

    @property
    def study(self) -> Path:
        return FOLDER / f"{self.series}_{self.number}.toml"

    @property
    def answer(self) -> Path:
        """What the commands said of it."""
        return self.study.with_suffix(".json")


def measurements_of(study: Path) -> Path:
    """Table of a series."""
    return study.parent / read_evidence_study(study).study.measurements


def folds() -> Iterator[Fold]:
    """Every series with every source left out."""
    for name, (study, _) in SERIES.items():
        with measurements_of(study).open(encoding="utf-8", newline="") as file:
            sources = dict.fromkeys(row["source"] for row in csv.DictReader(file))
        yield from (Fold(name, source, number) for number, source in enumerate(sources))


def write_study(fold: Fold) -> None:
    """Study and table of a fold."""
    study, model = SERIES[fold.series]
    table, text = measurements_of(study), study.read_text("utf-8")
    entries: tuple[tuple[tuple[str, str], Any], ...] = (
        (("study", "measurements"), table.name),
        (("study", "model"), model),
        (("vault", "fraction"), 0.0),
        (("vault", "sources"), [fold.source]),
    )
    for path, value in entries:
        text = with_entry(text, path, value)
    FOLDER.mkdir(parents=True, exist_ok=True)
    (FOLDER / table.name).write_text(table.read_text("utf-8"), encoding="utf-8")
    fold.study.write_text(text, encoding="utf-8")


def comparable(problem: Problem) -> dict[str, tuple[Integers, int]]:
    """Held-out rows of every observable whose value is known, and how many have a value of the model.

    The error of a document counts censored rows too; they add nothing where the model keeps their limit.
    """
    held_out = problem.hidden()
    start = {each.path: each.start for each in problem.parameters}
    none = {each.name: 0.0 for each in problem.candidates}
    named, found = np.array(held_out.observable), {}
    for name in dict.fromkeys(held_out.observable):
        own = np.flatnonzero(named == name)
        at = {condition: column[own] for condition, column in held_out.conditions.items()}
        told = own[np.isfinite(problem.model(name, at, start, none, np.array([1]))[0])]
        found[name] = told[~held_out.censored[told]], told.size
    return found


def fit_error(fit: Mapping[str, Any], problem: Problem) -> float:
    """Root mean squared error of an adopted model over the mean of the held-out values [%].

    All observables together, each over its own mean.
    """
    value, known = problem.hidden().value, comparable(problem)
    sums = [
        fit["vault_rmse"][name] ** 2 * count / float(np.mean(value[own])) ** 2
        for name, (own, count) in known.items()
    ]
    return 100.0 * (sum(sums) / sum(own.size for own, _ in known.values())) ** 0.5


def row_of(fold: Fold) -> Row:
    """One row of the table of results."""
    found = json.loads(fold.answer.read_text(encoding="utf-8"))
    method, fits = found.pop("method"), found.pop("fits", {})
    problem = load_study(fold.study).problem
    told = {when: fit_error(fit, problem) for when, fit in fits.items()}
    strengths = fits["added"]["strengths"].values() if fits else ()
    found |= {
        "rows_fitted": found.pop("n"),
        "rows_held_out": found.pop("rows_hidden"),
        "p_held_out": [fit["vault_p"] for fit in fits.values()],
        "error_before": told.get("base"),
        "error_after": told.get("added"),
        "strength": " ".join(f"{each['value']:.2g}" for each in strengths),
    }
    return {"set": fold.series, "case": fold.source, "method": method, "answer": found}


def solve() -> None:
    """What the commands say; what has been solved is not solved again."""
    for fold in folds():
        if not fold.answer.exists():
            write_study(fold)
            found = {"method": method_commit(), **study_answer(fold.study, "full", likeliest=True)}
            write_atomic(fold.answer, json.dumps(found).encode())


def open_folds() -> None:
    """The rows of the folds that are solved."""
    add_rows("published", [row_of(fold) for fold in folds() if fold.answer.exists()])


if __name__ == "__main__":
    run_step(__doc__, {"solve": solve, "open": open_folds})
