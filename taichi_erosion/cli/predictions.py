"""Predictions for a terminal, and as a CSV in the units of the study's table."""

from pathlib import Path
from typing import TYPE_CHECKING

import typer

from taichi_erosion.cli.output import print_table
from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.files import one_line_name
from taichi_erosion.evidence.data.number_words import heading

if TYPE_CHECKING:
    import pandas as pd

    from taichi_erosion.evidence.answers.predictions import PredictionReply

PREDICTED = ("model", "value", "low", "high", "measured_low", "measured_high")


def print_prediction(reply: "PredictionReply") -> None:
    """Print what is wrong with the set-up, what the intervals rest on, and the table."""
    answer = reply.answer()
    set_up = (f"set-up: {sentence}" for sentence in reply.about["set_up"])
    typer.echo("\n".join((*set_up, *answer.missing, *answer.holds)))
    if answer.table is not None:
        print_table(answer.table.title, answer.table.columns, answer.table.rows)
    for line in answer.following:
        typer.echo(line)


def prediction_table(reply: "PredictionReply") -> "pd.DataFrame":
    """Predictions in the units of the study's table: conditions, values and intervals, one row each."""
    import pandas as pd

    from taichi_erosion.evidence.words.prediction_words import outside_text

    units, rows = reply.units, reply.record.rows
    names = rows[0].condition_units if rows else {}
    columns = ["observable", *map(heading, names, names.values()), *PREDICTED, "unit", "outside"]
    cells = (
        (
            row.observable,
            *(row.conditions[name] for name in names),
            *(units.value(row.observable, getattr(row, key)) for key in PREDICTED),
            units.value_unit(row.observable) or "1",
            outside_text(row),
        )
        for row in rows
    )
    return pd.DataFrame(cells, columns=columns)


def prediction_csv(reply: "PredictionReply") -> str:
    """Predictions as CSV."""
    return prediction_table(reply).to_csv(index=False, float_format="%.6g", lineterminator="\n")


def refuse_other_table(path: Path) -> None:
    """Raise BadInput where a file exists that holds no predictions."""
    columns = ",".join((*PREDICTED, "unit", "outside")).encode()
    if path.exists() and not (path.is_file() and columns in path.read_bytes().partition(b"\n")[0]):
        raise BadInput(f"--out {one_line_name(path)}: exists, and holds no predictions; name another file")
