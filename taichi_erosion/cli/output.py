"""Standard output of commands: one JSON document, or tables."""

import json
import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

import typer
from rich import box
from rich.console import Console
from rich.table import Table

from taichi_erosion.cli.progress import LOG

Record = Mapping[str, Any]
AsJson = Annotated[bool, typer.Option("--json", help="Print one JSON document and nothing else.")]
EffectFiles = Annotated[
    list[Path] | None,
    typer.Option("--effect", metavar="FILE", help="Python file with an effect of your own; may be repeated."),
]
Force = Annotated[
    bool, typer.Option("--force", help="Replace files of this name that this command did not write.")
]
Verbose = Annotated[bool, typer.Option("--verbose", help="Print notes, numbers and cost too.")]
Arch = Annotated[
    Literal["auto", "cpu", "cuda", "vulkan"] | None,
    typer.Option(help="Device; default: cpu. auto: a graphics processor for large runs, if there is one."),
]
Decomposition = Annotated[
    Literal["partitions", "grains"] | None,
    typer.Option(help="What one thread advances; default: partitions on cpu, grains elsewhere."),
]

MARK_MISSING = "-"
WARNING = "warning: "
WIDEST = 1000  # width of a table in a file or pipe, where COLUMNS does not state another [characters]
MOST_TOLD = 6  # comparisons and warnings of a run


def print_json(document: Record) -> None:
    """Print one JSON document; numbers that are not finite become null."""
    from taichi_erosion.measures.result import json_value, without_nan

    typer.echo(json.dumps(without_nan(document), default=json_value, allow_nan=False))


def print_result(document: Record, as_json: bool, print_text: Callable[[Any], None]) -> None:
    """Print a document as JSON, or as text by a function."""
    (print_json if as_json else print_text)(document)


def print_run(document: Record, verbose: bool = False) -> None:
    """Print simulated beside measured values, what they say, warnings, and what follows."""
    from taichi_erosion.evidence.words import run_words as words

    repeats = len(document["replicas"])
    typer.echo(f"{document['scene']}: {repeats} repeat{'s' * (repeats > 1)} in {document['wall_s']:.1f} s")
    table = words.run_table(document)
    print_table("", table.columns, table.rows)
    told = [*words.comparisons(document), *(f"{WARNING}{line}" for line in words.run_warnings(document))]
    if not verbose and len(told) > MOST_TOLD:
        told = [*told[:MOST_TOLD], f"{len(told) - MOST_TOLD} more: --verbose"]
    more = [f"note: {line}" for line in words.run_notes(document)] + [words.run_cost(document)]
    for line in (*told, *(more if verbose else ()), *words.after_run(document)):
        typer.echo(line)


def log_run(document: Record) -> None:
    """Write measures, warnings and recording of a run to the log."""
    from taichi_erosion.evidence.words import run_words as words

    for name, found in document["measures"].items():
        LOG.info("%s = %s %s", name, words.spread(found), found["unit"])
    for line in words.run_warnings(document):
        LOG.warning(line)
    if document.get("recording"):
        LOG.info("recording: %s", document["recording"])


def examined_effects(found: Sequence[Record]) -> Iterator[str]:
    """Sentences on the check of effect files."""
    if not found:
        return
    from taichi_erosion.verification.effect_contract import examined_words

    yield from ((WARNING if each["breaches"] else "") + examined_words(each) for each in found)


def print_measurement(record: Record) -> None:
    """Print one measured value and its notes."""
    from taichi_erosion.evidence.words.run_words import spread

    typer.echo(f"{record['name']} = {spread(record)} {record['unit']}")
    for note in record["notes"]:
        typer.echo(f"note: {note}")
    if "picture" in record:
        typer.echo(f"what was detected: {record['picture']}")


def print_claims(document: Record) -> None:
    """Print the verification table."""
    claims = document["claims"]
    keys = ("id", "claim", "got", "want", "tolerance", "precision")
    rows = (
        (*(significant(claim[key]) for key in keys), verdict(claim["passed"]), f"{claim['wall_s']:.1f}")
        for claim in claims
    )
    print_table("verification", (*keys, "", "s"), rows)
    failed = sum(not claim["passed"] for claim in claims)
    typer.echo(f"{len(claims) - failed} of {len(claims)} claims hold")
    known = sum(claim["known_failure"] for claim in claims)
    if known:
        typer.echo(f"note: {known} of those that fail are known to; docs/trust.md says why")


def verdict(passed: bool) -> str:
    """Mark of a claim that holds, or of one that does not."""
    return "ok" if passed else "FAILED"


def print_cases(document: Record) -> None:
    """Print measured speeds: one row per case, one column per key."""
    cases = document["cases"]
    keys = tuple(dict.fromkeys(key for case in cases for key in case))
    print_table("speed", keys, ([cell(case.get(key)) for key in keys] for case in cases))
    typer.echo(
        f"Kernels compiled by {document['engine']} for {document['target']}; {document['cores']} cores."
    )


def cell(value: Any) -> str:
    """Text of a number, a text, or a mapping (one line per entry)."""
    if isinstance(value, Mapping):
        return "\n".join(f"{name} {significant(share)}" for name, share in value.items())
    return significant(value)


def print_table(title: str, columns: Iterable[str], rows: Iterable[Iterable[str]]) -> None:
    """Print a table at its own width, and at most at that of the terminal or of COLUMNS."""
    table = Table(title=title, title_justify="left", box=box.SIMPLE_HEAD, show_edge=False, pad_edge=False)
    for column in columns:
        table.add_column(column, overflow="fold")
    for row in rows:
        table.add_row(*row)
    console = Console(highlight=False, markup=False)
    if not console.is_terminal:
        most = int(os.environ.get("COLUMNS") or WIDEST)
        console.width = console.measure(table, options=console.options.update(max_width=most)).maximum
    console.print(table)


def significant(value: Any) -> str:
    """Number in six significant digits, a mark for None and NaN, any other value as text."""
    if value is None or value != value:
        return MARK_MISSING
    return f"{value:.6g}" if isinstance(value, float) else str(value)
