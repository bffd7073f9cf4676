"""Commands of designed experiments: `audit` of a published table, and `doe` with the steps of a calibration.

Each step first completes the steps before it. Runs in the study's ledger are not repeated.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from taichi_erosion.cli import output
from taichi_erosion.cli.help import help_of
from taichi_erosion.cli.output import Arch, AsJson, Decomposition, Force
from taichi_erosion.cli.progress import KEPT, interruptible
from taichi_erosion.evidence.words import shell_command

if TYPE_CHECKING:
    from taichi_erosion.campaign.calibration import Calibration, Step

Record = Mapping[str, Any]

STEPS: 'dict[Step | Literal["calibrate"], str]' = {
    "run": "Make the runs of the screening design.",
    "analyse": "Show which parameters matter in the screening.",
    "climb": "Follow the path of steepest ascent towards the target.",
    "surface": "Fit a response surface around the best point of the path.",
    "optimise": "Find the settings that reach the target, or report that none does.",
    "confirm": "Test the optimum with new seeds against the measurement.",
    "calibrate": "Make all steps, and write a page with their tables and figures.",
}

doe = typer.Typer(help="Calibrate a scene by designed experiments.", no_args_is_help=True)

TablePath = Annotated[Path, typer.Argument(metavar="TABLE", help="Table of runs (CSV).")]
Response = Annotated[
    str | None, typer.Option(metavar="NAME", help="Column of the response; default: the last one.")
]
ClaimsFile = Annotated[
    Path | None,
    typer.Option(
        "--claims",
        metavar="FILE",
        help="Published statements about the table (TOML); default: TABLE.claims.toml beside it.",
    ),
]
StudyPath = Annotated[Path, typer.Argument(metavar="STUDY", help="Calibration study (TOML).")]
Workers = Annotated[int | None, typer.Option(min=1, help="Local processes; default: one per core.")]
Scheduler = Annotated[
    str | None, typer.Option(metavar="ADDRESS", help="Dask scheduler whose workers make the runs.")
]


def audit(
    table: TablePath, response: Response = None, claims: ClaimsFile = None, as_json: AsJson = False
) -> None:
    """Check a published design: orthogonality, cell that restores it, sums of squares, target."""
    from taichi_erosion.experiments.audit.examine import as_document
    from taichi_erosion.experiments.audit.examine import audit as examine

    document = as_document(examine(table, response, claims))
    output.print_result(document, as_json, print_audit)


def print_audit(document: Record) -> None:
    """Print the design in one line, then the findings."""
    design = document["design"] or "no named design"
    answer = {True: "yes", False: "NO"}
    typer.echo(f"{document['table']}: {document['runs']} runs, {len(document['factors'])} factors, {design}")
    typer.echo(f"balanced: {answer[document['balanced']]}, orthogonal: {answer[document['orthogonal']]}")
    if document["set_aside"]:
        typer.echo(f"excluded: {', '.join(document['set_aside'])}")
    printed = document["printed_numbers"]
    if printed["compared"]:
        typer.echo(f"published numbers reproduced: {printed['agree']} of {printed['compared']}")
        if document["cell"] is not None:
            typer.echo(f"with the cell as published: {printed['agree_as_printed']}")
    findings = [(f["kind"], str(f["row"] or ""), f["column"], f["sentence"]) for f in document["findings"]]
    if findings:
        output.print_table("findings", ("kind", "row", "column", "finding"), findings)
    else:
        typer.echo("no error found")


@doe.command(**help_of("doe design"))
def design(study: StudyPath, force: Force = False, as_json: AsJson = False) -> None:
    """Write the table of the screening design, without running it."""
    run_steps("design", study, {}, as_json, force)


def add_step(step: 'Step | Literal["calibrate"]', summary: str) -> None:
    """Register the command `doe STEP`."""

    def command(
        study: StudyPath,
        workers: Workers = None,
        scheduler: Scheduler = None,
        arch: Arch = None,
        decomposition: Decomposition = None,
        force: Force = False,
        as_json: AsJson = False,
    ) -> None:
        where = {"workers": workers, "scheduler": scheduler, "arch": arch, "decomposition": decomposition}
        found = run_steps("confirm" if step == "calibrate" else step, study, where, as_json, force)
        if step == "calibrate":
            publish_page(found, as_json)

    doe.command(step, help=summary, **help_of(f"doe {step}"))(command)


for _step, _summary in STEPS.items():
    add_step(_step, _summary)


def publish_page(found: "Calibration", as_json: bool) -> None:
    """Write the page of a whole calibration; print where it is and what may come next."""
    from taichi_erosion.report.calibration_page import publish

    page = publish(found)
    if not as_json:
        typer.echo(f"page: {page}")
        for scene in found.document.get("calibrated_scenes", ()):
            typer.echo(f"{shell_command('run', scene)} runs the calibrated scene.")


def run_steps(
    until: "Step", study: Path, where: Mapping[str, Any], as_json: bool, force: bool
) -> "Calibration":
    """Run a calibration up to a step and print the result of that step.

    `where` are entries of [campaign]; None leaves that of the file. `force` replaces files of others.
    """
    from taichi_erosion.campaign.calibration import calibrate

    with interruptible("calibrating", KEPT) as progress:
        stated = {name: value for name, value in where.items() if value is not None}
        found = calibrate(study, until, stated, progress, force=force)
    if as_json:
        output.print_json(found.document)
    else:
        PRINT[until](found)
        typer.echo(f"tables: {found.file.folder}")
    return found


def print_design(found: "Calibration", section: str = "design") -> None:
    """Print runs with their settings and responses."""
    rows = found.document[section]["rows"]
    values = ((row["settings"] | row["responses"]).values() for row in rows)
    cells = ([str(number), *map(output.significant, row)] for number, row in enumerate(values, start=1))
    output.print_table(section, ("run", *rows[0]["settings"], *rows[0]["responses"]), cells)


def print_analysis(found: "Calibration") -> None:
    """Print the effects on every response, largest first."""
    from taichi_erosion.report.calibration_page import effect_table

    for name in found.file.study.targets:
        output.print_table(f"effects on {name}", *effect_table(found, name))
    typer.echo(f"factors of the next steps: {', '.join(found.document['analyse']['kept'])}")


def print_climb(found: "Calibration") -> None:
    """Print the path of steepest ascent; its best run is marked."""
    from taichi_erosion.report.calibration_page import climb_table

    output.print_table("climb", *climb_table(found))


def print_surface(found: "Calibration") -> None:
    """Print the analysis of variance and the equation of every response."""
    from taichi_erosion.report.calibration_page import variance_table

    for name, response in found.document["surface"]["responses"].items():
        output.print_table(f"response surface of {name}", *variance_table(found, name))
        typer.echo(response["natural_reduced"])
        fit = response["quality_reduced"]
        typer.echo(
            f"R2 {fit['r2']:.3f}, adjusted {fit['r2_adjusted']:.3f}, predicted {fit['r2_predicted']:.3f}"
        )
        if response["warning"]:
            typer.echo(response["warning"])


def print_optimum(found: "Calibration") -> None:
    """Print the settings that reach the target, or the nearest ones."""
    from taichi_erosion.report.calibration_page import optimum_table

    output.print_table("optimum", *optimum_table(found))
    for sentence in found.document["optimise"]["sentences"]:
        typer.echo(sentence)


def print_confirmation(found: "Calibration") -> None:
    """Print the optimum, and the confirmation runs with the measurement and the verdict."""
    from taichi_erosion.report.calibration_page import samples, verdict

    print_optimum(found)
    for name, test in found.document["confirm"]["tests"].items():
        runs, wanted = samples(test).values()
        typer.echo(f"{name}: {runs} simulated, {wanted} measured")
        typer.echo(verdict(test, name, found.file.study.targets[name].unit).replace("**", ""))


PRINT = {
    "design": print_design,
    "run": lambda found: print_design(found, "screen"),
    "analyse": print_analysis,
    "climb": print_climb,
    "surface": print_surface,
    "optimise": print_optimum,
    "confirm": print_confirmation,
}
