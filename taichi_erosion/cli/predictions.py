"""Predictions for a terminal, and as a CSV in the units of the study's table."""

from pathlib import Path
from typing import TYPE_CHECKING

import typer

from taichi_erosion.cli.output import print_table
from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.files import one_line_name

if TYPE_CHECKING:
    from taichi_erosion.evidence.answers.predictions import PredictionReply


def print_prediction(reply: "PredictionReply") -> None:
    """Print what is wrong with the set-up, what the intervals rest on, and the table."""
    answer = reply.answer()
    typer.echo("\n".join((*reply.about["set_up"], *answer.missing, *answer.holds)))
    if answer.table is not None:
        print_table(answer.table.title, answer.table.columns, answer.table.rows)
    for line in answer.following:
        typer.echo(line)


def prediction_csv(reply: "PredictionReply") -> str:
    """Predictions as CSV."""
    from taichi_erosion.api.results import prediction_table

    return prediction_table(reply).to_csv(index=False, float_format="%.6g", lineterminator="\n")


def refuse_other_table(path: Path) -> None:
    """Raise BadInput where a file exists that holds no predictions."""
    from taichi_erosion.api.results import PREDICTED

    columns = ",".join(PREDICTED).encode()
    if path.exists() and not (path.is_file() and columns in path.read_bytes().partition(b"\n")[0]):
        raise BadInput(f"--out {one_line_name(path)}: exists, and holds no predictions; name another file")
