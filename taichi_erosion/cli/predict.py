"""Command `predict`: what the calibrated model says at new conditions, as a table, CSV or JSON."""

import csv
import io
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from taichi_erosion.cli import output
from taichi_erosion.cli.evidence import (
    Budget,
    Seed,
    StudyFile,
    Workers,
    cost,
    number,
    options_of,
    print_lines,
)
from taichi_erosion.cli.help import help_of
from taichi_erosion.cli.output import (
    MARK_MISSING,
    Arch,
    AsJson,
    Decomposition,
    EffectFiles,
    Record,
    print_table,
)
from taichi_erosion.cli.progress import KEPT, interruptible
from taichi_erosion.evidence.data.number_words import heading

if TYPE_CHECKING:
    from taichi_erosion.evidence.data.table_units import TableUnits

COLUMNS = ("model", "value", "low", "high", "measured_low", "measured_high")
HEADINGS = ("model", "value", "90 % interval", "of one measurement", "note")

app = typer.Typer()

AtTable = Annotated[
    Path,
    typer.Option(
        "--at",
        metavar="TABLE",
        help="New conditions (.csv, .xlsx): one column for each condition, in any unit; a column without "
        "a unit is in that of the study's table. A column 'observable' says what is wanted.",
    ),
]
OutFile = Annotated[Path | None, typer.Option("--out", metavar="FILE", help="Table to write (CSV).")]
Bare = Annotated[bool, typer.Option("--bare", help="The model of STUDY itself, adopted effects left out.")]


@app.command(**help_of("predict"))
def predict(
    study: StudyFile,
    at: AtTable,
    out: OutFile = None,
    bare: Bare = False,
    budget: Budget = None,
    workers: Workers = None,
    arch: Arch = None,
    decomposition: Decomposition = None,
    seed: Seed = None,
    own: EffectFiles = None,
    as_json: AsJson = False,
) -> None:
    """Predict values at new conditions by the calibrated or adopted model, with 90 % intervals."""
    from taichi_erosion.core.files import write_atomic
    from taichi_erosion.evidence.prediction.commands import predict_study

    options = options_of(budget, seed, own, workers, arch, decomposition)
    with interruptible("predicting", KEPT) as progress:
        document = predict_study(study, at, lambda text, share: progress(share, text), options, bare)
    if out is not None:
        write_atomic(out, csv_text(document).encode())
    output.print_result(document, as_json, print_prediction)
    if out is not None and not as_json:
        typer.echo(f"written: {out}")


def scales_of(document: Record) -> "TableUnits":
    """Units of the study's table, in which predictions are told."""
    from taichi_erosion.evidence.data.table_units import TableUnits

    return TableUnits.of(document)


def csv_text(document: Record) -> str:
    """Predictions as CSV: a column for each condition, then those of the intervals."""
    units = document["rows"][0]["condition_units"] if document["rows"] else {}
    scales = scales_of(document)
    conditions = [f"{name} [{unit}]" if unit else name for name, unit in units.items()]
    page = io.StringIO()
    writer = csv.writer(page, lineterminator="\n")
    writer.writerow(["observable", *conditions, *COLUMNS, "unit", "outside"])
    for row in document["rows"]:
        name = row["observable"]
        numbers = [row["conditions"][each] for each in units] + [
            scales.value(name, row[key]) for key in COLUMNS
        ]
        cells = ["" if value is None else f"{value:.6g}" for value in numbers]
        writer.writerow([name, *cells, scales.value_unit(name) or "1", "; ".join(row["outside"])])
    return page.getvalue()


def print_prediction(document: Record) -> None:
    """Print predictions with their intervals, then what the intervals rest on."""
    print_lines(document["set_up"], "set-up: ")
    for observable in dict.fromkeys(row["observable"] for row in document["rows"]):
        rows = [row for row in document["rows"] if row["observable"] == observable]
        units = rows[0]["condition_units"]
        conditions = [f"{name} [{unit}]" if unit else name for name, unit in units.items()]
        scales = scales_of(document)
        title = heading(observable, scales.value_unit(observable))
        print_table(title, (*conditions, *HEADINGS), table_rows(rows, scales))
    print_lines(document["sentences"])
    print_lines([*document["notes"], *document["warnings"]], "note: ")
    typer.echo(cost(document))


def table_rows(rows: list[dict[str, Any]], scales: "TableUnits") -> Iterator[tuple[str, ...]]:
    """Cells of one observable, in the units of the study's table."""
    for stored in rows:
        name = stored["observable"]
        row = {**stored, **{key: scales.value(name, stored[key]) for key in COLUMNS}}
        conditions = [f"{value:.4g}" for value in row["conditions"].values()]
        outside = f"extrapolates: {', '.join(row['outside'])}" if row["outside"] else ""
        single = interval(row["measured_low"], row["measured_high"])
        yield (
            *conditions,
            number(row["model"]),
            number(row["value"]),
            interval(row["low"], row["high"]),
            single,
            outside,
        )


def interval(low: float | None, high: float | None) -> str:
    """Both ends of an interval."""
    return MARK_MISSING if low is None else f"{number(low)} to {number(high)}"
