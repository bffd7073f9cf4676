"""`audit`: what is wrong with a published table of runs.

`doe`: calibration by designed experiments, as a whole or step by step.

Each step does what the steps before it have left undone; runs that stand in the study's ledger are not
repeated.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from taichi_erosion.cli import output
from taichi_erosion.cli.help_pages import help_of
from taichi_erosion.cli.output import AsJson
from taichi_erosion.cli.progress import reporting

TablePath = Annotated[Path, typer.Argument(metavar="TABLE", help="Table of runs (CSV).")]
Response = Annotated[
    str | None, typer.Option(metavar="NAME", help="Column of the results; the last one if left out.")
]
ClaimsFile = Annotated[
    Path | None,
    typer.Option(
        "--claims",
        metavar="FILE",
        help="What is printed about the table (TOML); TABLE.claims.toml beside it if left out.",
    ),
]


def audit(
    table: TablePath, response: Response = None, claims: ClaimsFile = None, as_json: AsJson = False
) -> None:
    """Check a published design: orthogonality, the cell that restores it, sums of squares, target."""
    from taichi_erosion.experiments.audit.examine import as_document
    from taichi_erosion.experiments.audit.examine import audit as examine

    document = as_document(examine(table, response, claims))
    if as_json:
        output.print_json(document)
    else:
        print_audit(document)


def print_audit(document: Mapping[str, Any]) -> None:
    """The design in one line, then every finding."""
    design = document["design"] or "no named design"
    sound = {True: "yes", False: "NO"}
    typer.echo(f"{document['table']}: {document['runs']} runs, {len(document['factors'])} factors, {design}")
    typer.echo(f"balanced: {sound[document['balanced']]}, orthogonal: {sound[document['orthogonal']]}")
    if document["set_aside"]:
        typer.echo(f"set aside: {', '.join(document['set_aside'])}")
    printed = document["printed_numbers"]
    if printed["compared"]:
        typer.echo(f"printed numbers that come out: {printed['agree']} of {printed['compared']}")
        if document["cell"] is not None:
            typer.echo(f"with the cell as printed: {printed['agree_as_printed']}")
    table = output.empty_table("findings", "kind", "row", "column", "what")
    for finding in document["findings"]:
        table.add_row(finding["kind"], str(finding["row"] or ""), finding["column"], finding["sentence"])
    if document["findings"]:
        output.print_table(table)
    else:
        typer.echo("nothing found that is wrong")


if TYPE_CHECKING:
    from taichi_erosion.campaign.calibration import Calibration, Step

INTERRUPTED = 130  # exit code of a program ended by Ctrl-C, 128 + SIGINT
FEW = 3  # optima that are printed
SHOWN = 5  # digits of a number in a table

doe = typer.Typer(help="Calibrate a scene by designed experiments.", no_args_is_help=True)

StudyPath = Annotated[Path, typer.Argument(metavar="STUDY", help="Calibration study (TOML).")]
Workers = Annotated[int | None, typer.Option(min=1, help="Local processes; one a core if left out.")]
Scheduler = Annotated[
    str | None, typer.Option(metavar="ADDRESS", help="Dask scheduler whose workers do the runs.")
]


@doe.command(**help_of("doe design"))
def design(study: StudyPath, as_json: AsJson = False) -> None:
    """Write the table of the screening: which runs would be made."""
    go("design", study, None, None, as_json)


@doe.command(**help_of("doe run"))
def run(
    study: StudyPath, workers: Workers = None, scheduler: Scheduler = None, as_json: AsJson = False
) -> None:
    """Make the runs of the screening."""
    go("run", study, workers, scheduler, as_json)


@doe.command(**help_of("doe analyse"))
def analyse(
    study: StudyPath, workers: Workers = None, scheduler: Scheduler = None, as_json: AsJson = False
) -> None:
    """Say which parameters matter, by the screening."""
    go("analyse", study, workers, scheduler, as_json)


@doe.command(**help_of("doe climb"))
def climb(
    study: StudyPath, workers: Workers = None, scheduler: Scheduler = None, as_json: AsJson = False
) -> None:
    """Walk the steepest path towards the target."""
    go("climb", study, workers, scheduler, as_json)


@doe.command(**help_of("doe surface"))
def surface(
    study: StudyPath, workers: Workers = None, scheduler: Scheduler = None, as_json: AsJson = False
) -> None:
    """Fit a response surface around the best point of the path."""
    go("surface", study, workers, scheduler, as_json)


@doe.command(**help_of("doe optimise"))
def optimise(
    study: StudyPath, workers: Workers = None, scheduler: Scheduler = None, as_json: AsJson = False
) -> None:
    """Find the settings that meet the target, or say that none does."""
    go("optimise", study, workers, scheduler, as_json)


@doe.command(**help_of("doe confirm"))
def confirm(
    study: StudyPath, workers: Workers = None, scheduler: Scheduler = None, as_json: AsJson = False
) -> None:
    """Test the optimum with fresh seeds against the measurement."""
    go("confirm", study, workers, scheduler, as_json)


@doe.command(**help_of("doe calibrate"))
def calibrate(
    study: StudyPath, workers: Workers = None, scheduler: Scheduler = None, as_json: AsJson = False
) -> None:
    """All steps, and a page with tables and figures of what they found."""
    found = go("confirm", study, workers, scheduler, as_json)
    from taichi_erosion.report.calibration_page import publish

    page = publish(found)
    if not as_json:
        typer.echo(f"page: {page}")


def go(
    until: "Step", study: Path, workers: int | None, scheduler: str | None, as_json: bool
) -> "Calibration":
    """Carry the study out up to a step and print what that step found."""
    from taichi_erosion.campaign.calibration import calibrate

    try:
        with reporting("calibrating") as progress:
            found = calibrate(study, until, workers, scheduler, progress)
    except KeyboardInterrupt:
        typer.echo("interrupted; finished runs are kept, the same command goes on", err=True)
        raise typer.Exit(INTERRUPTED) from None
    if as_json:
        output.print_json(found.document)
    else:
        PRINT[until](found.document)
        typer.echo(f"tables: {found.file.folder}")
    return found


def print_design(document: Mapping[str, Any], section: str = "design") -> None:
    """Runs with their settings and responses."""
    rows = document[section]["rows"]
    names = [*rows[0]["settings"], *rows[0]["responses"]]
    table = output.empty_table(section, "run", *names)
    for number, row in enumerate(rows, start=1):
        table.add_row(str(number), *(shown(value) for value in (row["settings"] | row["responses"]).values()))
    output.print_table(table)


def print_analysis(document: Mapping[str, Any]) -> None:
    """Effects of every response, largest first."""
    for response, found in document["analyse"]["responses"].items():
        table = output.empty_table(f"effects on {response}", "factor", "effect", "share", "p")
        for effect in found["effects"]:
            table.add_row(effect["name"], *(shown(effect[key]) for key in ("value", "share", "p")))
        output.print_table(table)
    typer.echo(f"these go on: {', '.join(document['analyse']['kept'])}")


def print_climb(document: Mapping[str, Any]) -> None:
    """The path and its best run."""
    print_design(document, "climb")
    typer.echo(f"nearest to the target: run {document['climb']['best']}")


def print_surface(document: Mapping[str, Any]) -> None:
    """Analysis of variance and equation of every response."""
    keys = ("sum_of_squares", "df", "mean_square", "f", "p")
    for response, found in document["surface"]["responses"].items():
        table = output.empty_table(f"surface of {response}", "source", *keys)
        for row in found["anova"]:
            table.add_row(row["source"], *(shown(row[key]) for key in keys))
        output.print_table(table)
        typer.echo(found["natural_reduced"])


def print_optimum(document: Mapping[str, Any]) -> None:
    """Settings that meet the target, or the nearest."""
    for optimum in document["optimise"]["optima"][:FEW]:
        settings = ", ".join(f"{path} = {shown(value)}" for path, value in optimum["settings"].items())
        said = ", ".join(f"{name} {shown(one['value'])}" for name, one in optimum["predicted"].items())
        typer.echo(f"{settings}: {said}")
    for sentence in document["optimise"]["sentences"]:
        typer.echo(sentence)


def print_confirmation(document: Mapping[str, Any]) -> None:
    """Fresh runs beside the measurement."""
    print_optimum(document)
    for name, test in document["confirm"]["tests"].items():
        typer.echo(
            f"{name}: {output.spread(as_record(test['runs']))} simulated, "
            f"{output.spread(as_record(test['wanted']))} measured, p = {test['p']:.3g}; "
            f"a difference of {test['resolve']:.3g} is noticed with a power of {test['power']:.2f}"
        )


def as_record(sample: Mapping[str, Any]) -> dict[str, Any]:
    """A sample as tables of results hold it."""
    return {"value": sample["mean"], "sd": sample["sd"], "n": int(sample["n"])}


def shown(value: Any) -> str:
    """A number in few digits."""
    return f"{value:.{SHOWN}g}" if isinstance(value, float) else output.significant(value)


PRINT = {
    "design": print_design,
    "run": lambda document: print_design(document, "screen"),
    "analyse": print_analysis,
    "climb": print_climb,
    "surface": print_surface,
    "optimise": print_optimum,
    "confirm": print_confirmation,
}
