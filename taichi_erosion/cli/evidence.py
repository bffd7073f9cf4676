"""What the evidence loop has to say to people: sentences first, a table, then what limits the finding.

Commands of the evidence loop: compare, discover, adopt, next, report.
"""

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from taichi_erosion.cli import output
from taichi_erosion.cli.help_pages import help_of
from taichi_erosion.cli.output import MARK_MISSING, AsJson, Record, empty_table, print_table
from taichi_erosion.cli.progress import reporting
from taichi_erosion.evidence.inference.levels import fails


def print_comparison(document: Record) -> None:
    """Whether the model agrees, where it fails, observable by observable."""
    typer.echo(agreement(document))
    failing = [place["sentence"] for place in document["where"] if fails(place["p"])]
    say(failing or ["No misfit is seen in any observable or along any condition."])
    table = empty_table(
        "calibrated model against measurement", "observable", "rows", "chi2", "rmse", "bias", "p"
    )
    for name, misfit in document["observables"].items():
        label = f"{name} [{document['units'].get(name, '1')}]"
        numbers = (figure(misfit[key]) for key in ("chi2", "rmse", "bias", "p"))
        table.add_row(label, str(misfit["n"]), *numbers)
    print_table(table)
    print_parameters(document["parameters"])
    say(document["noise"]["sentences"])
    say([*document["notes"], *document["warnings"]], "note: ")
    typer.echo(cost(document))


def agreement(document: Record) -> str:
    """One sentence on the whole."""
    p, among = document["p"], f"{document['rows_visible']} rows"
    if p is None:
        return f"The misfit cannot be judged: the scatter of the {among} is not known."
    freedom = f"{figure(document['dof'])} degrees of freedom"
    numbers = f"(chi2 = {figure(document['chi2'])} for {freedom}, p = {figure(p)})"
    if fails(p):
        return f"The model does not agree with the {among}, however it is calibrated {numbers}."
    if any(fails(place["p"]) for place in document["where"]):
        return f"The model agrees with the {among} as a whole {numbers}, but not everywhere."
    return f"The model is consistent with the {among} {numbers}."


def print_discovery(document: Record) -> None:
    """The verdict in sentences, every candidate with its numbers, and what limits them."""
    say(document["sentences"])
    print_table(effects_table(document))
    typer.echo("probabilities: " + probabilities(document["probabilities"]))
    print_parameters(document["parameters"])
    say((clue["sentence"] for clue in document["clues"]), "clue: ")
    say((experiment["sentence"] for experiment in document["next_experiments"]), "next: ")
    say(document["noise"]["sentences"])
    say([*document["notes"], *document["warnings"]], "note: ")
    typer.echo(cost(document))


def effects_table(document: Record) -> Any:
    """One row a candidate, the likeliest first."""
    table = empty_table(
        "candidates",
        "effect",
        "status",
        "strength",
        "90 % interval",
        "probability",
        "ln Bayes factor",
        "power",
        "absorbed",
    )
    effects = document["effects"]
    for name in sorted(effects, key=lambda effect: -(effects[effect]["probability"] or 0.0)):
        found = effects[name]
        table.add_row(
            name,
            found["status"].replace("_", " "),
            figure(found["strength"]),
            f"{figure(found['strength_low'])} to {figure(found['strength_high'])}",
            share(found["probability"]),
            figure(found["log_bayes_factor"]),
            share(found["power"]),
            share(found["absorption"]),
        )
    return table


def print_adoption(document: Record) -> None:
    """The error before and after, beside effects that should not help."""
    typer.echo(document["sentence"])
    table = empty_table("chi2 per row", "model", "fitted rows", "held-out rows")
    labels = {
        "base": "as it was",
        "added": f"with {document['effect']}",
        "best_wrong": "control: best other effect",
        "random_wrong": "control: an effect drawn at random",
    }
    for key, label in labels.items():
        fit = document[key]
        if fit is not None:
            effects = f" ({', '.join(fit['effects'])})" if key.endswith("wrong") else ""
            table.add_row(label + effects, figure(fit["chi2"]), figure(fit["vault_chi2"]))
    print_table(table)
    print_parameters(document["added"]["strengths"] | document["added"]["parameters"])
    opened = document["vault"]["opened"]
    if opened > 1:
        typer.echo(f"note: the vault has been opened {opened} times; it is not unseen any more.")
    say(document["notes"], "note: ")
    typer.echo(f"written: {document['written']}")
    typer.echo(cost(document))


def print_experiments(document: Record) -> None:
    """Experiments in the order in which they should be made."""
    experiments = document["next_experiments"]
    if not experiments:
        typer.echo("No experiment within the stated ranges would tell the remaining effects apart.")
    for number, experiment in enumerate(experiments, 1):
        typer.echo(f"{number}. {experiment['sentence']}")
    say(document["notes"], "note: ")


def print_parameters(parameters: Record) -> None:
    """Calibrated numbers with their intervals."""
    for name, fitted in parameters.items():
        bound = "; the calibration wants to leave the allowed range" if fitted["at_bound"] else ""
        interval = f"{figure(fitted['low'])} to {figure(fitted['high'])}"
        typer.echo(f"{name} = {figure(fitted['value'])} ({interval}, 90 %){bound}")


def probabilities(found: Record, shown: int = 6) -> str:
    """The likeliest answers."""
    ranked = sorted(found.items(), key=lambda item: -(item[1] or 0.0))[:shown]
    return ", ".join(f"{name.replace('_', ' ')} {share(p)}" for name, p in ranked)


def say(sentences: Iterable[str], lead: str = "") -> None:
    """One sentence a line, each once."""
    for sentence in dict.fromkeys(sentences):
        typer.echo(f"{lead}{sentence}")


def cost(document: Record) -> str:
    """What it took."""
    runs, seconds = document.get("runs"), document.get("wall_s")
    return f"{runs} runs in {seconds:.1f} s, seed {document['seed']}, results beside {document['study']}"


def figure(value: float | None) -> str:
    """A number to three significant digits."""
    return MARK_MISSING if value is None else f"{value:.3g}"


def share(value: float | None) -> str:
    """A share in percent."""
    return MARK_MISSING if value is None else f"{value:.1%}" if value < 0.1 else f"{value:.0%}"


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
    from taichi_erosion.evidence.answers.commands import compare_study
    from taichi_erosion.evidence.answers.documents import without_rows

    with told("comparing") as progress:
        document = compare_study(study, progress)
    if as_json:
        output.print_json(without_rows(document))
    else:
        print_comparison(document)


@app.command(**help_of("discover"))
def discover(study: StudyFile, budget: BudgetName = None, as_json: AsJson = False) -> None:
    """Which effect is missing: present, excluded, not testable, or not in the list."""
    from taichi_erosion.evidence.answers.commands import discover_study
    from taichi_erosion.evidence.answers.documents import without_rows

    with told("discovering") as progress:
        document = discover_study(study, budget, progress)
    if as_json:
        output.print_json(without_rows(document))
    else:
        print_discovery(document)


@app.command(**help_of("adopt"))
def adopt(study: StudyFile, effect: EffectName, as_json: AsJson = False) -> None:
    """Add an effect, calibrate again, and show the error on measurements that no fit has seen."""
    from taichi_erosion.evidence.answers.commands import adopt_study
    from taichi_erosion.evidence.answers.documents import without_rows

    with told("adopting") as progress:
        document = adopt_study(study, effect, progress)
    if as_json:
        output.print_json(without_rows(document))
    else:
        print_adoption(document)


@app.command("next", **help_of("next"))
def next_(study: StudyFile, as_json: AsJson = False) -> None:
    """The cheapest experiments that would decide between the effects that are left."""
    from taichi_erosion.evidence.answers.commands import next_study
    from taichi_erosion.evidence.answers.documents import without_rows

    with told("planning") as progress:
        document = next_study(study, progress)
    if as_json:
        output.print_json(without_rows(document))
    else:
        print_experiments(document)


@app.command(**help_of("report"))
def report(source: ReportSource, to: PageFile = None, as_json: AsJson = False) -> None:
    """One self-contained HTML page: of a run, of a calibration, or of everything found about a study."""
    from taichi_erosion.report import write_report

    page = str(write_report(source, to))
    if as_json:
        output.print_json({"report": page})
    else:
        typer.echo(page)
