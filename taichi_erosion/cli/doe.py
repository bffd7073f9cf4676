"""Commands of designed experiments: `audit` of a published table, and `doe` with the steps of a calibration.

Each step first completes the steps before it. Runs in the study's ledger are not repeated.
"""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer
from typer import Argument, Option

from taichi_erosion.cli import output
from taichi_erosion.cli.options import Arch, AsJson, Decomposition, File, Force, Text, Whole, command_help
from taichi_erosion.cli.progress import KEPT, progress_report
from taichi_erosion.evidence.words import shell_command

if TYPE_CHECKING:
    from taichi_erosion.campaign.calibration import Calibration, Step

Show = Callable[["Calibration"], None]  # prints a step

doe = typer.Typer(help="Calibrate a scene by designed experiments.", no_args_is_help=True)

StudyPath = Annotated[Path, Argument(metavar="STUDY", help="Calibration study (TOML).")]


def audit(
    table: Annotated[Path, Argument(metavar="TABLE", help="Table of runs (text or workbook).")],
    response: Annotated[
        Text, Option(metavar="NAME", help="Column of the response; default: the last one of results.")
    ] = None,
    claims: Annotated[
        File,
        Option(
            metavar="FILE",
            help="Published statements about the table (TOML); default: TABLE.claims.toml beside it.",
        ),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Check a published design: orthogonality, cell that restores it, sums of squares, target."""
    from taichi_erosion.experiments.audit import audit_document
    from taichi_erosion.experiments.audit import audit_table as examine

    output.print_result(audit_document(examine(table, response, claims)), as_json, print_audit)


def print_audit(document: output.Record) -> None:
    """Print the design in one line, then the findings."""
    answer = {True: "yes", False: "no", None: "not judged"}
    head = f"{document['table']}: {document['runs']} runs, factors {', '.join(document['factors'])}"
    typer.echo(f"{head}; response {document['response']}")
    typer.echo(f"balanced: {answer[document['balanced']]}, orthogonal: {answer[document['orthogonal']]}")
    aside = [f"excluded: {', '.join(document['set_aside'])}"] if document["set_aside"] else []
    output.print_lines([*aside, *(f"assumed: {each}" for each in document["assumed"])])
    if (printed := document["printed_numbers"])["compared"]:
        typer.echo(f"published numbers reproduced: {printed['agree']} of {printed['compared']}")
    findings = [(f["kind"], str(f["row"] or ""), f["column"], f["sentence"]) for f in document["findings"]]
    if findings:
        output.print_table("findings", ("kind", "row", "column", "finding"), findings)
    if all(kind == "not judged" for kind, *_ in findings):
        typer.echo("no error found")


def run_and_print_steps(
    until: "Step", study: Path, entries: Mapping[str, Any], as_json: bool, force: bool, show: Show
) -> "Calibration":
    """Run a calibration up to a step and print its result; `entries` replace those of [campaign]."""
    from taichi_erosion.campaign.calibration import calibrate

    with progress_report("calibrating", KEPT) as progress:
        calibration = calibrate(study, until, entries, progress, force=force)
    if as_json:
        output.print_json(calibration.document)
    else:
        show(calibration)
        typer.echo(f"tables: {calibration.file.folder}")
    return calibration


def print_design(calibration: "Calibration", section: str) -> None:
    rows = calibration.document[section]["rows"]
    values = ((row["settings"] | row["responses"]).values() for row in rows)
    cells = ([str(number), *map(output.number_text, row)] for number, row in enumerate(values, start=1))
    output.print_table(section, ("run", *rows[0]["settings"], *rows[0]["responses"]), cells)


def print_analysis(calibration: "Calibration") -> None:
    """Print the effects on every response, largest first."""
    from taichi_erosion.report.calibration_page import effect_table

    for name in calibration.file.study.targets:
        output.print_table(f"effects on {name}", *effect_table(calibration, name))
    typer.echo(f"factors of the next steps: {', '.join(calibration.document['analyse']['kept'])}")


def print_path(calibration: "Calibration") -> None:
    """Print the points on the path of steepest ascent."""
    from taichi_erosion.report.calibration_page import climb_table

    output.print_table("climb", *climb_table(calibration))


def print_surface(calibration: "Calibration") -> None:
    """Print the analysis of variance and the equation of every response."""
    from taichi_erosion.report.calibration_page import variance_table

    for name, response in calibration.document["surface"]["responses"].items():
        output.print_table(f"response surface of {name}", *variance_table(calibration, name))
        typer.echo(response["natural_reduced"])
        fit = response["quality_reduced"]
        adjusted = f"adjusted {fit['r2_adjusted']:.3f}, predicted {fit['r2_predicted']:.3f}"
        output.print_lines(filter(None, (f"R2 {fit['r2']:.3f}, {adjusted}", response["warning"])))


def print_optimum(calibration: "Calibration") -> None:
    """Print the settings that reach the target, or the nearest ones."""
    from taichi_erosion.report.calibration_page import optimum_table

    output.print_table("optimum", *optimum_table(calibration))
    output.print_lines(calibration.document["optimise"]["sentences"])


def print_confirmation(calibration: "Calibration") -> None:
    """Print the optimum, and the confirmation runs with the measurement and the verdict."""
    from taichi_erosion.report.calibration_page import agreement_text, confirmation_mean_sd_texts

    print_optimum(calibration)
    for name, test in calibration.document["confirm"]["tests"].items():
        runs, repeats = confirmation_mean_sd_texts(test).values()
        typer.echo(f"{name}: {runs} simulated, {repeats} measured")
        unit = calibration.file.study.targets[name].unit
        typer.echo(agreement_text(test, name, unit).replace("**", ""))


@doe.command(**command_help("doe design"))
def design(study: StudyPath, force: Force = False, as_json: AsJson = False) -> None:
    """Write the table of the screening design, without running it."""
    run_and_print_steps("design", study, {}, as_json, force, lambda file: print_design(file, "design"))


def add_step(step: 'Step | Literal["calibrate"]', summary: str, show: Show) -> None:
    """Register the command `doe STEP`."""

    def command(
        study: StudyPath,
        workers: Annotated[Whole, Option(min=1, help="Local processes; default: one per core.")] = None,
        scheduler: Annotated[
            Text, Option(metavar="ADDRESS", help="Dask scheduler whose workers make the runs.")
        ] = None,
        arch: Arch = None,
        decomposition: Decomposition = None,
        force: Force = False,
        as_json: AsJson = False,
    ) -> None:
        options = {"workers": workers, "scheduler": scheduler, "arch": arch, "decomposition": decomposition}
        entries = {name: value for name, value in options.items() if value is not None}
        until = "confirm" if step == "calibrate" else step
        calibration = run_and_print_steps(until, study, entries, as_json, force, show)
        if step != "calibrate":
            return
        from taichi_erosion.report.calibration_page import write_page_and_pictures

        page = write_page_and_pictures(calibration)
        if not as_json:
            typer.echo(f"page: {page}")
            for scene in calibration.document.get("calibrated_scenes", ()):
                typer.echo(f"{shell_command('run', scene)} runs the calibrated scene.")

    doe.command(step, help=summary, **command_help(f"doe {step}"))(command)


add_step("run", "Make the runs of the screening design.", lambda file: print_design(file, "screen"))
add_step("analyse", "Show which parameters matter in the screening.", print_analysis)
add_step("climb", "Follow the path of steepest ascent towards the target.", print_path)
add_step("surface", "Fit a response surface around the best point of the path.", print_surface)
add_step("optimise", "Find the settings that reach the target, or report that none does.", print_optimum)
add_step("confirm", "Test the optimum with new seeds against the measurement.", print_confirmation)
add_step("calibrate", "Make all steps, and write a page with their tables and figures.", print_confirmation)
