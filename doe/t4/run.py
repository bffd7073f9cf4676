"""Published series, each with a source left out as vault: error before and after, beside a closed form.

    python -m doe.t4.run solve      discover and adopt, by the commands; goes on where it was stopped
    python -m doe.t4.run score      write results.csv

Every source is left out in turn. What is named is adopted; where a group is told, its first member; where
nothing is named, the likeliest candidate, so that its error shows whether the silence was right.
"""

import csv
import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np
import typer

from doe.common.command import run_step
from doe.common.method import method_commit
from doe.sealed.studies import command
from doe.t4 import closed_forms
from doe.t4.closed_forms import ClosedForm
from taichi_erosion.campaign.study_file import read_evidence_study, with_entry
from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.files import write_atomic
from taichi_erosion.evidence.data.problem import Integers, Problem
from taichi_erosion.evidence.models.load_study import load_study

HERE = Path(__file__).parent
FOLDER = HERE.parents[1] / "campaigns" / "t4"
TABLE = HERE / "results.csv"
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


OWN = "doe.t4.models:predict"
SERIES: Mapping[str, Series] = {
    "impact_threshold": Series(HERE / "impact_threshold.toml", OWN, THRESHOLDS),
    "impact_threshold_simulated": Series(
        HERE.with_name("impact_threshold.toml"), "doe.wind.answers:predict", THRESHOLDS
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
        return self.study.with_suffix(".solved.json")


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


def likeliest(found: Mapping[str, Any]) -> list[str]:
    """The single candidate with the largest probability."""
    known = {name: found["probabilities"].get(name, 0.0) for name in found["effects"]}
    return [max(known, key=lambda name: known[name])] if any(known.values()) else []


def solve() -> None:
    """What the commands say; what has been solved is not solved again."""
    for fold in folds():
        if fold.answer.exists():
            continue
        write_study(fold)
        found = command("discover", fold.study)
        told = (("named", found["named"]), ("group", found["group"][:1]), ("likeliest", likeliest(found)))
        reason, names = next(((word, chosen) for word, chosen in told if chosen), ("nothing acts", []))
        answer = {"method": method_commit(), "found": found, "reason": reason} | adoption(fold, names)
        write_atomic(fold.answer, json.dumps(answer).encode())
        typer.echo(f"{fold.series} without {fold.source}: {found['verdict']}, {reason} {' '.join(names)}")


def adoption(fold: Fold, names: list[str]) -> dict[str, Any]:
    """The document of `adopt`, or what it refuses: it needs a scatter."""
    if not names:
        return {"adopted": None}
    try:
        return {"adopted": command("adopt", fold.study, *names)}
    except BadInput as error:
        return {"adopted": None, "refused": str(error).splitlines()[-1]}


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


def relative(squares: Mapping[str, float], problem: Problem) -> str:
    """Root mean squared error over the mean of the held-out values, all observables together [%].

    Of sums of squared errors by observable.
    """
    value, rows = problem.hidden().value, {name: own for name, (own, _) in comparable(problem).items()}
    sums = [squares[name] / float(np.mean(value[own])) ** 2 for name, own in rows.items()]
    return f"{100.0 * (sum(sums) / sum(own.size for own in rows.values())) ** 0.5:.3g}"


def form_error(form: ClosedForm, problem: Problem) -> str:
    """Relative error of a closed form at the held-out rows."""
    held_out = problem.hidden()
    gap = (held_out.value - form.at(problem.visible(), held_out)) ** 2
    squares = {name: float(np.sum(gap[own])) for name, (own, _) in comparable(problem).items()}
    return f"{form.name}: {relative(squares, problem)}"


def fit_error(fit: Mapping[str, Any], problem: Problem) -> str:
    """Relative error of an adopted model at the held-out rows."""
    counts = {name: count for name, (_, count) in comparable(problem).items()}
    squares = {name: rmse**2 * counts[name] for name, rmse in fit["vault_rmse"].items()}
    return relative(squares, problem)


def scored_row(fold: Fold) -> dict[str, Any]:
    """One row of the table of results."""
    answer = json.loads(fold.answer.read_text(encoding="utf-8"))
    found, adopted = answer["found"], answer["adopted"]
    problem = load_study(fold.study).problem
    return {
        "series": fold.series,
        "held_out": fold.source,
        "rows_fitted": found["n"],
        "rows_held_out": found["rows_hidden"],
        "verdict": found["verdict"],
        "named": "+".join(sorted(found["named"])),
        "group": "+".join(sorted(found["group"])),
        "p_misfit": number(found["p_misfit"]),
        "p_misfit_after": number(found["p_misfit_after"]),
        "none": number(found["probabilities"].get("none", 0.0)),
        "outside_library": number(found["probabilities"].get("outside_library", 0.0)),
        "adopted_as": answer.get("refused", answer["reason"]),
        **(adopted_cells(adopted, problem) if adopted else dict.fromkeys(ADOPTED, "")),
        "closed_forms": "; ".join(form_error(form, problem) for form in SERIES[fold.series].forms),
        "answer": found["sentences"][0],
        "runs": found["runs"],
        "method": answer["method"],
    }


ADOPTED = (
    "effect",
    "strength",
    "chi2_before",
    "chi2_after",
    "chi2_wrong",
    "p_held_out_before",
    "p_held_out_after",
    "error_before",
    "error_after",
)


def adopted_cells(adopted: Mapping[str, Any], problem: Problem) -> dict[str, str]:
    """What adopting did to the held-out rows: misfit a row, its probability, and relative error [%]."""
    base, added, vault = adopted["base"], adopted["added"], adopted["vault"]
    strengths = (
        f"{one['value']:.2g} ({one['low']:.2g} to {one['high']:.2g})" for one in added["strengths"].values()
    )
    cells = (
        adopted["effect"],
        " ".join(strengths),
        number(vault["chi2_per_row_before"]),
        number(vault["chi2_per_row_after"]),
        number(vault["chi2_per_row_wrong_effect"]),
        number(base["vault_p"]),
        number(added["vault_p"]),
        fit_error(base, problem),
        fit_error(added, problem),
    )
    return dict(zip(ADOPTED, cells, strict=True))


def number(value: float | None) -> str:
    """A number of a document, empty where there is none."""
    return "" if value is None else f"{value:.3g}"


def score() -> None:
    """The table of the folds that are solved."""
    done = [scored_row(fold) for fold in folds() if fold.answer.exists()]
    page = StringIO(newline="")
    writer = csv.DictWriter(page, list(done[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(done)
    write_atomic(TABLE, page.getvalue().encode())


if __name__ == "__main__":
    run_step(__doc__, {"solve": solve, "score": score})
