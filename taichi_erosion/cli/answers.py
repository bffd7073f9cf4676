"""Answers about studies for a terminal: lines and table of an answer, and what was read of a table."""

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from taichi_erosion.cli import output
from taichi_erosion.cli.output import MARK_MISSING, Record, print_table
from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.files import one_line_name
from taichi_erosion.evidence.data.number_words import counted, plain
from taichi_erosion.evidence.words import shell_command

if TYPE_CHECKING:
    from taichi_erosion.evidence.answers.files import Reply
    from taichi_erosion.evidence.answers.predictions import PredictionReply
    from taichi_erosion.evidence.words.answer_lines import Answer

MOST_LINES = 8  # of an answer, the set-up included: a screen with its table
MOST_CHANGES = 12  # rows or entries that are told one by one
NUMBERS = ("number", "start", "if nothing is missing", "now", "of its prior left")
LIMITS = ("candidate", "excluded above (95 %)", "could act unseen below", "imitated by calibration")


def print_answer(reply: "Reply", options: Sequence[str], verbose: bool) -> None:
    """Print the set-up, the sentences with the table, and where asked all that the record has beyond.

    `options` are those that the following commands need too.
    """
    answer = reply.answer(*options)
    set_up, room = reply.about["set_up"], max(MOST_LINES - len(answer.lines), 1)
    if not verbose and len(set_up) > room:
        set_up = [*set_up[: room - 1], f"{counted(len(set_up) - room + 1, 'sentence')} more: --verbose"]
    print_lines(set_up)
    print_parts(answer)
    if verbose:
        print_details(reply)


def print_parts(answer: "Answer") -> None:
    """Print the sentences of an answer with its table between them."""
    print_lines((*answer.missing, *answer.holds))
    if answer.table is not None:
        print_table(answer.table.title, answer.table.columns, answer.table.rows)
    print_lines(answer.following)


def print_details(reply: "Reply") -> None:
    """Print limits of the candidates, calibrated numbers, notes, warnings and cost."""
    from taichi_erosion.evidence.words.vocabulary import interval as told

    about, found = reply.about, reply.record
    limits = (
        (name, number(part.limit), number(part.unseen_below), share(part.absorption))
        for name, part in found.effects.items()
    )
    numbers = (
        (path, plain(part.start), told(part.before, 3), told(part.now, 3), share(part.prior_share))
        for path, part in found.numbers.items()
    )
    if found.effects:
        print_table("limits of the strengths", LIMITS, limits)
    if found.numbers:
        print_table("calibrated numbers (90 %)", NUMBERS, numbers)
    print_lines([*about["notes"], *about["warnings"]], "note: ")
    print_lines(about.get("files", ()), "written: ")
    settings, runs = counted(found.cost.settings, "setting"), counted(found.cost.runs, "run")
    typer.echo(f"{settings} of the model, {runs}, {found.cost.seconds:.1f} s, seed {found.cost.seed}")
    typer.echo(f"results in {about['results']}; {', '.join(map(' '.join, about['versions'].items()))}")


def print_prediction(reply: "PredictionReply") -> None:
    """Print what is wrong with the set-up, what the intervals rest on, and the table."""
    print_lines(reply.about["set_up"])
    print_parts(reply.answer())


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


def print_new_study(document: Record) -> None:
    """Print what was understood, what was assumed, what was written, and what an answer costs."""
    typer.echo(f"{document['table']}: {document['form']}")
    if document["columns"]:
        rows = ((c["column"], c["unit"], c["told"]) for c in document["columns"])
        print_table("columns", ("column", "unit", "understood as"), rows)
    print_lines(document["assumed"], "assumed: ")
    print_lines(told_changes(document) if "changes" in document else ())
    print_content(document)
    print_lines(document["written"], "written: ")
    typer.echo(f"next: {shell_command('compare', document['study'])}")


def told_changes(document: Record) -> Iterator[str]:
    """What a corrected table says otherwise."""
    changes, study = document["changes"], document["study"]
    lines, removed = changes["lines"], changes["removed"]
    if not lines and not removed:
        yield f"{study} is there already, and its table has not changed"
    else:
        rows = f"new or corrected: {counted(len(lines), 'row')} ({some(lines)}); " if lines else ""
        yield f"{rows}{removed} gone; the others stay held out or fitted. Ask again: the table is another one"


def some(entries: Sequence[object]) -> str:
    """Up to MOST_CHANGES entries, and `...` for more."""
    return ", ".join([*map(str, entries[:MOST_CHANGES]), *(["..."] if len(entries) > MOST_CHANGES else [])])


def print_check(document: Record) -> None:
    """Print that a study is valid, what it holds, and what an answer costs."""
    typer.echo(f"{document['study']}: valid; nothing was run")
    if document["kind"] == "evidence":
        print_lines(output.examined_effects(document["effects"]))
        print_content(document)
        if document["held_out"]:
            typer.echo(f"held-out rows: drawn_from = {document['drawn_from']}")


def print_content(document: Record) -> None:
    """Print rows, conditions, candidates and cost."""
    rows = ", ".join(f"{name} ({count} rows)" for name, count in document["observables"].items())
    typer.echo(f"measured: {rows}; {document['held_out']} rows are held out until an effect is adopted")
    for name, told in document["conditions"].items():
        typer.echo(f"condition {name}: {told}")
    typer.echo(f"calibrated: {', '.join(document['parameters']) or 'nothing'}")
    typer.echo(f"candidates: {', '.join(document['candidates']) or 'none'}")
    print_lines(document["notes"], "note: ")
    for name, found in document["cost"].items():
        typer.echo(cost_line(name, found))


def cost_line(name: str, found: Record) -> str:
    """What an answer costs, in one line."""
    minutes = found.get("core_minutes")
    cores = "" if minutes is None else f" ({plain(minutes)} core-minutes)"
    return f"cost with --budget {name}: {found['sentence'].rstrip('.')}{cores}"


def print_lines(sentences: Iterable[str], lead: str = "") -> None:
    """Print one sentence per line, without repetitions."""
    for sentence in dict.fromkeys(sentences):
        typer.echo(f"{lead}{sentence}")


def number(value: float | None) -> str:
    """Number in three significant digits."""
    return MARK_MISSING if value is None or value != value else plain(value)


def share(value: float) -> str:
    """Share in percent."""
    return MARK_MISSING if value != value else f"{value:.0%}"
