"""Published series, each with a source left out as vault: error before and after, beside a closed form.

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

from doe.common.cases import ROOT
from doe.common.command import run_step
from doe.trials.answers import method_commit, study_answer
from doe.trials.published import closed_forms
from doe.trials.published.closed_forms import ClosedForm
from doe.trials.table import Row, add_rows
from taichi_erosion.campaign.study_file import read_evidence_study, with_entry
from taichi_erosion.core.files import write_atomic
from taichi_erosion.evidence.data.problem import Integers, Problem
from taichi_erosion.evidence.models.load_study import load_study

HERE = Path(__file__).parent
FOLDER = ROOT / "campaigns" / "trials" / "published"
THRESHOLDS = (
    ClosedForm("Bagnold 1941", closed_forms.bagnold),
    ClosedForm("Shao & Lu 2000", closed_forms.shao_lu),
)
FLUXES = (ClosedForm("Kok et al. 2012", closed_forms.kok), ClosedForm("Kawamura 1951", closed_forms.kawamura))
HEIGHTS = (
    ClosedForm("constant (Martin & Kok 2017)", closed_forms.constant_height, level=True),
    ClosedForm("u*^2 (Owen 1964)", closed_forms.owen_height, level=True),
)


@dataclass(frozen=True)
class Series:
    """A study, the module of its model as installed, and forms of the literature."""

    study: Path
    model: str
    forms: tuple[ClosedForm, ...]


OWN = "doe.trials.published.models:predict"
SERIES: Mapping[str, Series] = {
    "impact_threshold": Series(HERE / "impact_threshold.toml", OWN, THRESHOLDS),
    "impact_threshold_simulated": Series(
        ROOT / "doe" / "impact_threshold.toml", "doe.wind.answers:predict", THRESHOLDS
    ),
    "field_thresholds": Series(HERE / "field_thresholds.toml", OWN, THRESHOLDS[1:]),
    "threshold_by_activity": Series(
        HERE / "threshold_by_activity.toml",
        OWN,
        (ClosedForm("Martin & Kok 2018", closed_forms.falling_threshold, level=True),),
    ),
    "flux_field": Series(HERE / "flux_field.toml", OWN, FLUXES),
    "flux_quarter_mm": Series(HERE / "flux_quarter_mm.toml", OWN, FLUXES),
    "layer_height": Series(HERE / "layer_height.toml", OWN, HEIGHTS),
    "flux_profile": Series(
        HERE / "flux_profile.toml",
        OWN,
        (ClosedForm("exponential, height of each interval", closed_forms.exponential_profile),),
    ),
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


def table_of(series: Series) -> Path:
    """Measurements of a series."""
    return series.study.parent / read_evidence_study(series.study).study.measurements


def folds() -> Iterator[Fold]:
    """Every series with every source left out."""
    for name, series in SERIES.items():
        with table_of(series).open(encoding="utf-8", newline="") as file:
            sources = dict.fromkeys(row["source"] for row in csv.DictReader(file))
        yield from (Fold(name, source, number) for number, source in enumerate(sources))


def write_study(fold: Fold) -> None:
    """Study and table of a fold."""
    series = SERIES[fold.series]
    table, text = table_of(series), series.study.read_text("utf-8")
    entries: tuple[tuple[tuple[str, str], Any], ...] = (
        (("study", "measurements"), table.name),
        (("study", "model"), series.model),
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


def relative(squares: Mapping[str, float], problem: Problem) -> float:
    """Root mean squared error over the mean of the held-out values, all observables together [%].

    Of sums of squared errors by observable.
    """
    value, rows = problem.hidden().value, {name: own for name, (own, _) in comparable(problem).items()}
    sums = [squares[name] / float(np.mean(value[own])) ** 2 for name, own in rows.items()]
    return 100.0 * (sum(sums) / sum(own.size for own in rows.values())) ** 0.5


def form_error(form: ClosedForm, problem: Problem) -> str:
    """Relative error of a closed form at the held-out rows."""
    held_out = problem.hidden()
    gap = (held_out.value - form.at(problem.visible(), held_out)) ** 2
    squares = {name: float(np.sum(gap[own])) for name, (own, _) in comparable(problem).items()}
    return f"{form.name}: {relative(squares, problem):.3g}"


def fit_error(fit: Mapping[str, Any], problem: Problem) -> float:
    """Relative error of an adopted model at the held-out rows."""
    counts = {name: count for name, (_, count) in comparable(problem).items()}
    squares = {name: rmse**2 * counts[name] for name, rmse in fit["vault_rmse"].items()}
    return relative(squares, problem)


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
        "closed_forms": "; ".join(form_error(form, problem) for form in SERIES[fold.series].forms),
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
