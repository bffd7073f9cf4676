"""Standard output of commands: one JSON document, or sentences and tables."""

import json
import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import typer
from rich import box
from rich.console import Console
from rich.table import Table

from taichi_erosion.evidence.words import shell_command
from taichi_erosion.tables.number_words import count_noun, plain

if TYPE_CHECKING:
    from taichi_erosion.evidence.answers.files import Reply
    from taichi_erosion.evidence.words.answer_lines import Answer

Record = Mapping[str, Any]

WARNING = "warning: "
WIDEST = 1000  # width of a table in a file or pipe, where COLUMNS does not state another [characters]
MOST_TOLD = 6  # comparisons and warnings of a run
MOST_LINES = 8  # of an answer, the set-up included: a screen with its table
CLAIM = ("id", "claim", "got", "want", "tolerance", "precision")
LIMITS = ("candidate", "excluded above (99 %)", "could act unseen below", "imitated by calibration")
NUMBERS = ("number", "start", "if nothing is missing", "now", "width over prior width")


def print_json(document: Record) -> None:
    """Print one JSON document; numbers that are not finite become null."""
    from taichi_erosion.measures.result import json_value, nan_to_none

    typer.echo(json.dumps(nan_to_none(document), default=json_value, allow_nan=False))


def print_result(document: Record, as_json: bool, print_text: Callable[[Any], None]) -> None:
    """Print a document as JSON, or as text by a function."""
    (print_json if as_json else print_text)(document)


def print_lines(sentences: Iterable[str], lead: str = "") -> None:
    """Print one sentence per line, without repetitions."""
    for sentence in dict.fromkeys(sentences):
        typer.echo(f"{lead}{sentence}")


def print_sweep(document: Record) -> None:
    """Print measures along the values of an entry, and the files that were written."""
    rows, notes = [], dict[str, list[str]]()
    for row in document["points"]:
        numbers = ("-" if row[key] is None else f"{row[key]:.4g}" for key in ("value", "sd"))
        rows.append((row["measure"], row["entry"], *numbers, row["unit"], str(row["n"])))
        notes.setdefault(row["note"], []).append(row["entry"])
    print_table("", ("measure", document["path"], "value", "sd", "unit", "n"), rows)
    print_lines(f"{', '.join(dict.fromkeys(entries))}: {note}" for note, entries in notes.items() if note)
    print_lines(document["files"])


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


def number_text(value: Any) -> str:
    """Number in six significant digits, "-" for None and NaN, any other value as text."""
    if value is None or value != value:
        return "-"
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def print_run(document: Record, verbose: bool) -> None:
    """Print simulated beside measured values, what they say, warnings, and what follows."""
    from taichi_erosion.evidence.words import run_words as words

    repeats = count_noun(len(document["replicas"]), "repeat")
    typer.echo(f"{document['scene']}: {repeats} in {document['wall_s']:.1f} s")
    table = words.run_table(document)
    print_table("", table.columns, table.rows)
    warnings = [*words.measured_value_texts(document), *dict.fromkeys(words.steady_window_texts(document))]
    warnings += (f"{WARNING}{line}" for line in words.run_warnings(document))
    if not verbose and len(warnings) > MOST_TOLD:
        warnings = [*warnings[:MOST_TOLD], f"{len(warnings) - MOST_TOLD} more: --verbose"]
    print_lines(warnings)
    if verbose:
        print_lines(words.run_notes(document), "note: ")
        typer.echo(words.cost_and_origin_text(document))
    print_lines(words.step_texts(document))


def effect_check_lines(checks: Sequence[Record]) -> Iterator[str]:
    if checks:
        from taichi_erosion.verification.effect_contract import check_sentence

        yield from ((WARNING if each["breaches"] else "") + check_sentence(each) for each in checks)


def print_measurement(record: Record) -> None:
    """Print a value measured in a photograph, its notes, and where it shows what was detected."""
    from taichi_erosion.evidence.words.run_words import with_sd_text

    typer.echo(f"{record['name']} = {with_sd_text(record)} {record['unit']}")
    print_lines(record["notes"], "note: ")
    typer.echo(f"what was detected: {record['picture']}")


def print_claims(document: Record) -> None:
    claims = document["claims"]
    rows = (
        (*(number_text(claim[key]) for key in CLAIM), claim_mark(claim["passed"]), f"{claim['wall_s']:.1f}")
        for claim in claims
    )
    print_table("verification", (*CLAIM, "", "s"), rows)
    typer.echo(f"{sum(claim['passed'] for claim in claims)} of {len(claims)} claims hold")
    if known_failures := sum(claim["known_failure"] for claim in claims):
        typer.echo(f"note: {known_failures} of those that fail are known to; docs/trust.md says why")


def claim_mark(holds: bool) -> str:
    return "ok" if holds else "FAILED"


def print_benchmark(document: Record) -> None:
    """Print measured speeds: one row per case, one column per key, one line per stage."""
    cases = document["cases"]
    keys = tuple(dict.fromkeys(key for case in cases for key in case))

    def cell_text(value: Any) -> str:
        if isinstance(value, Mapping):
            return "\n".join(f"{name} {number_text(share)}" for name, share in value.items())
        return number_text(value)

    print_table("speed", keys, ([cell_text(case.get(key)) for key in keys] for case in cases))
    count = f"{document['engine']} for {document['target']}; {document['cores']} cores"
    typer.echo(f"Kernels compiled by {count}.")


def print_answer(reply: "Reply", options: Sequence[str], verbose: bool) -> None:
    """Print the set-up, and the sentences with the table.

    `verbose` adds limits of the candidates, calibrated numbers, notes and cost. `options` are those that the
    following commands need too.
    """
    answer = reply.answer(*options)
    set_up = reply.about["set_up"]
    room = max(MOST_LINES - len(answer.lines), 1)
    if not verbose and len(set_up) > room:
        set_up = [*set_up[: room - 1], f"{count_noun(len(set_up) - room + 1, 'sentence')} more: --verbose"]
    print_fault_and_answer(set_up, answer)
    if not verbose:
        return
    from taichi_erosion.evidence.words.answer_lines import sensitivity_table
    from taichi_erosion.evidence.words.vocabulary import interval

    about, record = reply.about, reply.record
    limits = []
    for name, part in record.effects.items():
        ends = (f"{x:.3g}".replace("inf", "no limit") for x in (part.limit, part.unseen_below))
        limits.append((name, *ends, f"{part.absorption:.0%}"))
    numbers = (
        (path, plain(part.start), interval(part.before, 3), interval(part, 3), f"{part.prior_share:.0%}")
        for path, part in record.parameters.items()
    )
    if limits:
        print_table("limits of the strengths", LIMITS, limits)
    if (stable := sensitivity_table(record)) is not None:
        print_table(stable.title, stable.columns, stable.rows)
    if record.parameters:
        print_table("calibrated numbers (90 %)", NUMBERS, numbers)
    print_lines([*about["notes"], *about["warnings"]], "note: ")
    print_lines(about.get("files", ()), "written: ")
    settings, runs = count_noun(record.settings, "setting"), count_noun(record.runs, "run")
    typer.echo(f"{settings} of the model, {runs}, {record.wall_s:.1f} s, seed {record.seed}")
    typer.echo(f"results in {about['results']}; {', '.join(map(' '.join, about['versions'].items()))}")


def print_fault_and_answer(set_up: Iterable[str], answer: "Answer") -> None:
    """Print what is wrong with the set-up, and the sentences of an answer with its table between them."""
    print_lines((*set_up, *answer.missing, *answer.holds))
    if answer.table is not None:
        print_table(answer.table.title, answer.table.columns, answer.table.rows)
    print_lines(answer.following)


def print_new_study(document: Record) -> None:
    """Print what was understood, assumed, corrected and written, and what an answer costs."""
    typer.echo(f"{document['table']}: {document['form']}")
    if document["columns"]:
        rows = ((c["column"], c["unit"], c["told"]) for c in document["columns"])
        print_table("columns", ("column", "unit", "understood as"), rows)
    print_lines(document["assumed"], "assumed: ")
    if "changes" in document:
        changed = ", ".join(map(str, document["changes"]["lines"])) or "none"
        removal = f"{document['changes']['removed']} gone, the others stay held out or fitted"
        typer.echo(f"{document['study']} was there already; new or corrected rows: {changed}; {removal}")
        typer.echo("Its other entries stay as they are; --anew writes the whole study again.")
    print_study_content(document)
    print_lines(document["written"], "written: ")
    typer.echo(f"next: {shell_command('compare', document['study'])}")


def print_check(document: Record) -> None:
    """Print that a study is valid, what it holds, and what an answer costs."""
    typer.echo(f"{document['study']}: valid; nothing was run")
    if document["kind"] == "evidence":
        print_lines(effect_check_lines(document["effects"]))
        print_study_content(document)
        if document["held_out"]:
            typer.echo(f"held-out rows: drawn_from = {document['drawn_from']}")


def print_study_content(document: Record) -> None:
    """Print rows, conditions, candidates and cost."""
    rows = ", ".join(f"{name} ({count} rows)" for name, count in document["observables"].items())
    typer.echo(f"measured: {rows}; {document['held_out']} rows are held out until an effect is adopted")
    for name, text in document["conditions"].items():
        typer.echo(f"condition {name}: {text}")
    typer.echo(f"calibrated: {', '.join(document['parameters']) or 'nothing'}")
    typer.echo(f"candidates: {', '.join(document['candidates']) or 'none'}")
    print_lines(document["notes"], "note: ")
    for name, content in document["cost"].items():
        typer.echo(cost_line(name, content))


def cost_line(name: str, record: Record) -> str:
    minutes = record.get("core_minutes")
    cores = "" if minutes is None else f" ({plain(minutes)} core-minutes)"
    return f"cost with --budget {name}: {record['sentence'].rstrip('.')}{cores}"
