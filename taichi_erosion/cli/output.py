"""Standard output of commands: one JSON document, or tables."""

import json
import logging
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from math import floor, isfinite, log10
from pathlib import Path
from typing import Annotated, Any, Literal

import typer
from rich.console import Console
from rich.table import Table

from taichi_erosion.cli.next_steps import after_run
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
WIDEST = 1000  # width of a table in a file or pipe [characters]


def print_json(document: Record) -> None:
    """Print one JSON document; numbers that are not finite become null."""
    from taichi_erosion.measures.result import without_nan

    typer.echo(json.dumps(without_nan(document), default=json_value, allow_nan=False))


def print_result(document: Record, as_json: bool, print_text: Callable[[Any], None]) -> None:
    """Print a document as JSON, or as text by a function."""
    (print_json if as_json else print_text)(document)


def json_value(value: Any) -> Any:
    """JSON value of a NumPy scalar or a path."""
    return str(value) if isinstance(value, Path) else value.item()


def print_run(document: Record) -> None:
    """Print simulated and measured values, warnings, recording and speed."""
    columns = ("measure", "simulated", "measured", "difference", "source")
    print_table(document["scene"], columns, run_rows(document))
    for sentence in (*consequences(document), *remarks(document)):
        typer.echo(sentence)
    if document.get("recording"):
        typer.echo(f"recording: {document['recording']}")
    replicas, seconds = len(document["replicas"]), document["wall_s"]
    kind = "cell" if "cell_steps" in document else "grain"
    speed = document[f"{kind}_steps"] / seconds if seconds else 0.0
    typer.echo(
        f"{replicas} replica(s) in {seconds:.1f} s, {speed:.3g} {kind}-steps/s, scene {document['hash']}"
    )
    for sentence in after_run(document):
        typer.echo(sentence)


def log_run(document: Record) -> None:
    """Write measures, warnings and recording of a run to the log."""
    for name, found in document["measures"].items():
        LOG.info("%s = %s %s", name, spread(found), found["unit"])
    for sentence in remarks(document):
        LOG.log(logging.WARNING if sentence.startswith(WARNING) else logging.INFO, sentence)
    if document.get("recording"):
        LOG.info("recording: %s", document["recording"])


def run_rows(document: Record) -> Iterator[tuple[str, ...]]:
    """Simulated and measured values with their difference, one row per observable."""
    simulated, measured = document["measures"], document["measured"]
    for name in dict.fromkeys((*simulated, *measured)):
        found, wanted = simulated.get(name, {}), measured.get(name, {})
        unit = found.get("unit") or wanted.get("unit") or ""
        label = f"{name} [{unit}]" if unit else name
        yield label, spread(found), spread(wanted), difference(found, wanted), wanted.get("source", "")


def consequences(document: Record) -> Iterator[str]:
    """What reduced stiffness, adhesion, rolling friction and the time step of a scene imply."""
    limits = document.get("limits", {})
    yield from (f"stiffness: {line}" for line in limits.get("softening", ()))
    yield from (f"rolling: {line}" for line in limits.get("rolling", ()))
    if adhesion := limits.get("adhesion"):
        force, speed = adhesion["pull_off_force"], adhesion["sticking_speed"]
        weights = adhesion["bond_number"]
        yield f"adhesion: pull-off force {force:.3g} N, {weights:.3g} weights; sticking speed {speed:.3g} m/s"
    yield from (f"{WARNING}{line}" for line in limits.get("warnings", ()))


def examined_effects(found: Sequence[Record]) -> Iterator[str]:
    """Sentences on the check of effect files."""
    if not found:
        return
    from taichi_erosion.verification.effect_contract import examined_words

    yield from ((WARNING if each["breaches"] else "") + examined_words(each) for each in found)


def remarks(document: Record) -> list[str]:
    """What measures lack, warnings with their number of replicas, limits that the scene states, notes."""
    measures = document["measures"].items()
    lacking = [(name, each) for name, found in measures for each in found.get("shortfalls", ())]
    counts = Counter(sentence for replica in document["replicas"] for sentence in replica["warnings"])
    among = len(document["replicas"])
    return [
        *(f"{WARNING}{name}: {each['sentence']}" for name, each in lacking if not each["stated"]),
        *(f"{WARNING}{sentence} ({count} of {among} replicas)" for sentence, count in counts.items()),
        *(f"limit: {name}: {each['sentence']}" for name, each in lacking if each["stated"]),
        *(f"note: {name}: {note}" for name, found in measures for note in found.get("notes", ())),
    ]


def print_measurement(record: Record) -> None:
    """Print one measured value and its notes."""
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
    """Print a table at the width of the terminal, or at its own width to a file or pipe."""
    table = Table(title=title, title_justify="left")
    for column in columns:
        table.add_column(column, overflow="fold")
    for row in rows:
        table.add_row(*row)
    console = Console(highlight=False, markup=False)
    if not console.is_terminal:
        console.width = console.measure(table, options=console.options.update(max_width=WIDEST)).maximum
    console.print(table)


def spread(record: Record) -> str:
    """Mean, standard deviation and number of repeats, rounded to two digits of the deviation."""
    value, sd, n = record.get("value"), record.get("sd"), record.get("n")
    if value is None or not isfinite(value):
        return MARK_MISSING
    if sd is None or not isfinite(sd) or sd <= 0.0:
        text = significant(value)
    else:
        digits = max(0, 1 - floor(log10(sd)))
        text = f"{value:.{digits}f} \N{PLUS-MINUS SIGN} {sd:.{digits}f}"
    return text if n is None else f"{text} (n = {n})"


def difference(found: Record, wanted: Record) -> str:
    """Simulated minus measured value, absolute and relative to the measured one."""
    got, want = found.get("value"), wanted.get("value")
    if got is None or want is None or not isfinite(got):
        return MARK_MISSING
    share = f" ({(got - want) / want:+.1%})" if want else ""
    return f"{got - want:+.3g}{share}"


def significant(value: Any) -> str:
    """Number in six significant digits; any other value as text."""
    if value is None:
        return MARK_MISSING
    return f"{value:.6g}" if isinstance(value, float) else str(value)
