"""Published series, each with a source left out as vault: misfit before and after.

    python -m doe.trials.published.folds solve      discover and adopt, by the commands; goes on
    python -m doe.trials.published.folds open       results/published.jsonl.gz

Every source is left out in turn. What is named is adopted; where a group is told, its first member.
"""

import csv
import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from doe.common.cases import ROOT
from doe.common.command import run_step
from doe.trials.answers import answer_all
from doe.trials.table import add_rows
from taichi_erosion.campaign.study_file import read_evidence_study, with_entry

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


def solve() -> None:
    """What the commands say; what has been solved is not solved again."""
    every = list(folds())
    for fold in every:
        write_study(fold)
    answer_all([fold.study for fold in every])


def open_folds() -> None:
    """The rows of the folds that are solved."""
    rows = []
    for fold in folds():
        if fold.answer.exists():
            found = json.loads(fold.answer.read_text(encoding="utf-8"))
            head = {"set": "all", "case": f"{fold.series}: {fold.source}", "method": found.pop("method")}
            rows.append(head | {"answer": found})
    add_rows("published", rows)


if __name__ == "__main__":
    run_step(__doc__, {"solve": solve, "open": open_folds})
