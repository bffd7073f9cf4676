"""Commands of the evidence loop: compare, discover, adopt, next, report."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Literal

import typer

from taichi_erosion.cli import evidence_output, output
from taichi_erosion.cli.output import AsJson
from taichi_erosion.cli.pages import help_of
from taichi_erosion.cli.progress import reporting

INTERRUPTED = 130  # exit code of a program ended by Ctrl-C, 128 + SIGINT

app = typer.Typer()

StudyFile = Annotated[Path, typer.Argument(metavar="STUDY", help="Evidence study (TOML).")]
ReportSource = Annotated[
    Path, typer.Argument(metavar="STUDY|RUN", help="Study (TOML), or the .json or .rrd that a run left.")
]
EffectName = Annotated[str, typer.Argument(metavar="EFFECT", help="Candidate of the study.")]
BudgetName = Annotated[
    Literal["quick", "full"] | None, typer.Option(help="quick: screen only; full: refit and verify too.")
]
PageFile = Annotated[
    Path | None, typer.Option("-o", "--output", metavar="FILE", help="Where the page goes (HTML).")
]


@contextmanager
def told(title: str) -> Iterator[Callable[[str, float], None]]:
    """Progress of a study on stderr; Ctrl-C ends the program, and what was run is kept."""
    try:
        with reporting(title) as report:
            yield lambda words, share: report(share, words)
    except KeyboardInterrupt:
        typer.echo("interrupted; the runs made so far are kept, the same command goes on from them", err=True)
        raise typer.Exit(INTERRUPTED) from None


@app.command(**help_of("compare"))
def compare(study: StudyFile, as_json: AsJson = False) -> None:
    """Where the model, calibrated as well as it can be, disagrees with the measurements."""
    from taichi_erosion.evidence.documents import without_rows
    from taichi_erosion.evidence.loop import compare_study

    with told("comparing") as progress:
        document = compare_study(study, progress)
    if as_json:
        output.print_json(without_rows(document))
    else:
        evidence_output.print_comparison(document)


@app.command(**help_of("discover"))
def discover(study: StudyFile, budget: BudgetName = None, as_json: AsJson = False) -> None:
    """Which effect is missing: present, excluded, not testable, or not in the list."""
    from taichi_erosion.evidence.documents import without_rows
    from taichi_erosion.evidence.loop import discover_study

    with told("discovering") as progress:
        document = discover_study(study, budget, progress)
    if as_json:
        output.print_json(without_rows(document))
    else:
        evidence_output.print_discovery(document)


@app.command(**help_of("adopt"))
def adopt(study: StudyFile, effect: EffectName, as_json: AsJson = False) -> None:
    """Add an effect, calibrate again, and show the error on measurements that no fit has seen."""
    from taichi_erosion.evidence.documents import without_rows
    from taichi_erosion.evidence.loop import adopt_study

    with told("adopting") as progress:
        document = adopt_study(study, effect, progress)
    if as_json:
        output.print_json(without_rows(document))
    else:
        evidence_output.print_adoption(document)


@app.command("next", **help_of("next"))
def next_(study: StudyFile, as_json: AsJson = False) -> None:
    """The cheapest experiments that would decide between the effects that are left."""
    from taichi_erosion.evidence.documents import without_rows
    from taichi_erosion.evidence.loop import next_study

    with told("planning") as progress:
        document = next_study(study, progress)
    if as_json:
        output.print_json(without_rows(document))
    else:
        evidence_output.print_experiments(document)


@app.command(**help_of("report"))
def report(source: ReportSource, to: PageFile = None, as_json: AsJson = False) -> None:
    """One self-contained HTML page: of a run, of a calibration, or of everything found about a study."""
    from taichi_erosion.report.any_page import write_report

    page = str(write_report(source, to))
    if as_json:
        output.print_json({"report": page})
    else:
        typer.echo(page)
