"""Commands on studies themselves: `study new` from a laboratory's table, `study check` without a run."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Annotated

import typer

from taichi_erosion.cli import output
from taichi_erosion.cli.help import help_of
from taichi_erosion.cli.next_steps import TIDY
from taichi_erosion.cli.output import AsJson, EffectFiles, Record, print_table
from taichi_erosion.core.errors import BadInput
from taichi_erosion.evidence.data.number_words import plain

study = typer.Typer(help="Make a study of a table, or validate one.", no_args_is_help=True)

Pairs = list[str] | None
TableFile = Annotated[Path, typer.Argument(metavar="TABLE", help="Table of measurements (.csv or .xlsx).")]
StudyPath = Annotated[Path, typer.Argument(metavar="STUDY", help="Study (TOML).")]
Observables = Annotated[
    Pairs,
    typer.Option("--observable", metavar="COLUMN=NAME", help="What a column measures; may be repeated."),
]
Conditions = Annotated[
    Pairs,
    typer.Option("--condition", metavar="COLUMN=PATH", help="Place that a column sets; may be repeated."),
]
Folder = Annotated[
    Path | None,
    typer.Option("--out", metavar="FOLDER", help="Folder to write; default: beside TABLE, its name."),
]
Apparatus = Annotated[
    str | None,
    typer.Option(metavar="NAME", help="cylinder, collapse, funnel, drum, threshold, impact or saltation."),
]
Units = Annotated[
    Pairs, typer.Option("--unit", metavar="COLUMN=UNIT", help="Unit of a column; may be repeated.")
]
Roughness = Annotated[
    str | None,
    typer.Option(metavar="LENGTH", help="Roughness length of the bed under winds measured at a height."),
]
Diameter = Annotated[
    str | None, typer.Option(metavar="LENGTH", help="Grain diameter where no column states it: '0.4 mm'.")
]
Density = Annotated[str | None, typer.Option(metavar="DENSITY", help="Density of the grains: '2650 kg/m3'.")]
Grains = Annotated[
    int | None, typer.Option(min=1, help="Grains of a run; default: as many as its measure needs.")
]
ClosedForm = Annotated[
    bool, typer.Option("--closed-form", help="A formula answers in place of simulations: seconds, not hours.")
]
Yes = Annotated[bool, typer.Option("--yes", help="Take every guess; ask nothing.")]
Anew = Annotated[
    bool,
    typer.Option("--anew", help="Write a study that is there anew; changes in it are lost, its vault stays."),
]
MOST_CHANGES = 5  # of one column, told one by one


@study.command("new", **help_of("study new"))
def new(
    table: TableFile,
    out: Folder = None,
    yes: Yes = False,
    observable: Observables = None,
    condition: Conditions = None,
    unit: Units = None,
    roughness: Roughness = None,
    apparatus: Apparatus = None,
    diameter: Diameter = None,
    density: Density = None,
    grains: Grains = None,
    closed_form: ClosedForm = False,
    anew: Anew = False,
    as_json: AsJson = False,
) -> None:
    """Read a table as a spreadsheet exports it; write a study and a scene for it, or correct its table."""
    from taichi_erosion.evidence.answers.study_files.new_study import Wishes, new_study
    from taichi_erosion.evidence.data.tables.column_roles import Told

    told = Told(pairs(observable, "--observable"), pairs(condition, "--condition"), pairs(unit, "--unit"))
    own = (diameter, density, grains)
    wishes = Wishes(told, out, apparatus, closed_form, roughness, anew, *own)
    document = new_study(table, wishes, guessed if yes or as_json else asked)
    output.print_result(document, as_json, print_new_study)


@study.command("check", **help_of("study check"))
def check(study: StudyPath, effect: EffectFiles = None, as_json: AsJson = False) -> None:
    """Validate a study, its table, scenes, model and effect files; run nothing."""
    from taichi_erosion.evidence.answers.study_files.check_study import check_study
    from taichi_erosion.evidence.models.load_study import StudyOptions

    options = StudyOptions(effect_files=tuple(effect or ()))
    output.print_result(check_study(study, options), as_json, print_check)


def pairs(stated: Pairs, option: str) -> Mapping[str, str]:
    """Columns with what they are, from COLUMN=NAME."""
    found = {}
    for pair in stated or ():
        column, equals, name = pair.rpartition("=")
        if not equals or not column.strip() or not name.strip():
            raise BadInput(f"{option} {pair}: write it as COLUMN=NAME, in quotes where it has spaces")
        found[column.strip()] = name.strip()
    return found


def asked(question: str, guess: str) -> str:
    """Answer of the user; Enter takes the guess."""
    try:
        return str(typer.prompt(question, default=guess, err=True))
    except typer.Abort:
        raise BadInput(f"no answer to: {question} (--yes takes every guess)") from None


def guessed(_question: str, guess: str) -> str:
    """The guess."""
    return guess


def print_new_study(document: Record) -> None:
    """Print what was understood, what was assumed, what was written, and what an answer costs."""
    typer.echo(f"{document['table']}: {document['form']}")
    if document["columns"]:
        rows = ((c["column"], c["unit"], c["told"]) for c in document["columns"])
        print_table("columns", ("column", "unit", "understood as"), rows)
    for words in document["assumed"]:
        typer.echo(f"assumed: {words}")
    if "changes" in document:
        for words in told_changes(document):
            typer.echo(words)
    print_content(document)
    for path in document["written"]:
        typer.echo(f"written: {path}")
    if document["written"]:
        typer.echo(f"next: ./erosion compare {document['study']}")


def told_changes(document: Record) -> Iterator[str]:
    """What a corrected table says otherwise, and what stays."""
    changes, study = document["changes"], document["study"]
    if not any(changes.values()):
        yield f"{study} is there already, and its table has not changed"
    yield from told_corrections(changes)
    if changes["added"]:
        yield f"added: row {', '.join(map(str, dict.fromkeys(changes['added'])))}"
    yield from (f"no longer there: {row}" for row in changes["removed"])
    if any(path.endswith(TIDY) for path in document["written"]):
        yield "the rows of before stay held out or fitted, and openings of the vault go on being counted"
        yield "answers given before rest on the earlier table: ask again"
    yield from (f"kept: {words}" for words in document["kept"])
    if document["kept"]:
        yield f"{study} stays as it is, with your changes; --anew writes it as a new study would be"


def told_corrections(changes: Record) -> Iterator[str]:
    """Units and cells that say something else."""
    for name, before, after in changes["units"]:
        yield f"corrected: column {name}: unit {before or 'none'} -> {after or 'none'}"
    columns: dict[str, list[Record]] = {}
    for change in changes["cells"]:
        columns.setdefault(change["column"], []).append(change)
    for name, cells in columns.items():
        for cell in cells[:MOST_CHANGES]:
            yield f"corrected: row {cell['line']}, {name}: {shown(cell['before'])} -> {shown(cell['after'])}"
        if len(cells) > MOST_CHANGES:
            yield f"corrected: {name} in {len(cells) - MOST_CHANGES} rows more"


def shown(text: str) -> str:
    """A cell of a table; an empty one in words."""
    return text or "empty"


def print_check(document: Record) -> None:
    """Print that a study is valid, what it holds, and what an answer costs."""
    typer.echo(f"{document['study']}: valid; nothing was run")
    if document["kind"] == "evidence":
        for sentence in output.examined_effects(document["effects"]):
            typer.echo(sentence)
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
    for note in document["notes"]:
        typer.echo(f"note: {note}")
    for name, cost in document["cost"].items():
        typer.echo(cost_line(name, cost))


def cost_line(name: str, cost: Record) -> str:
    """What an answer costs, in one line."""
    minutes = cost.get("core_minutes")
    cores = "" if minutes is None else f" ({plain(minutes)} core-minutes)"
    return f"cost with --budget {name}: {cost['sentence'].rstrip('.')}{cores}"
