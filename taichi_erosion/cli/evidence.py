"""Commands of the evidence loop: compare, discover, adopt, next, report.

Each prints its sentences first, then a table, then the limits of the result.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from taichi_erosion.cli import next_steps, output
from taichi_erosion.cli.help import help_of
from taichi_erosion.cli.output import (
    MARK_MISSING,
    Arch,
    AsJson,
    Decomposition,
    EffectFiles,
    Force,
    Record,
    print_table,
)
from taichi_erosion.cli.progress import KEPT, announce, interruptible
from taichi_erosion.evidence.answers.words.agreement import comparison_sentences
from taichi_erosion.evidence.answers.words.held_out import FITTED_ERRORS, HELD_OUT_ERRORS
from taichi_erosion.evidence.data.number_words import heading, plain
from taichi_erosion.evidence.inference.verdict_levels import CORRELATED, p_number

if TYPE_CHECKING:
    from taichi_erosion.evidence.models.load_study import StudyOptions

Progress = Callable[[str, float], None]  # (text, share done [1])

ANSWERS = 6  # printed probabilities
CANDIDATE_COLUMNS = ("effect", "status", "strength", "90 % interval", "probability")
CANDIDATE_COLUMNS += ("ln Bayes factor", "power", "absorbed")
MOST_ERRORS = 2  # observables whose errors are printed beside chi2
ERRORS = ("rmse", "bias")  # columns in the unit of the observable
CONTROLS = {
    "with_all": "with all that was named",
    "best_wrong": "control: best other effect",
    "random_wrong": "control: effect drawn at random",
}

app = typer.Typer()

StudyFile = Annotated[Path, typer.Argument(metavar="STUDY", help="Evidence study (TOML).")]
ReportSource = Annotated[
    Path, typer.Argument(metavar="STUDY|RUN", help="Study (TOML), or the .json or .rrd file of a run.")
]
EffectNames = Annotated[
    list[str],
    typer.Argument(metavar="EFFECT...", help="Candidates of the study; a named pair is adopted as one."),
]
Budget = Annotated[
    str | None,
    typer.Option(
        metavar="quick|full|RUNS",
        help="quick: fewer runs and fewer refits; what it finds is checked with all refits. full: all of "
        "them. A number: at most so many runs. One run is one set-up, simulated with one seed.",
    ),
]
Workers = Annotated[int | None, typer.Option(min=1, help="Local processes; default: one a core.")]
Seed = Annotated[
    int | None, typer.Option(min=0, help="Seed of the runs in place of the study's; another one: fresh runs.")
]
PageFile = Annotated[
    Path | None, typer.Option("-o", "--output", metavar="FILE", help="Page to write (HTML).")
]


@app.command(**help_of("compare"))
def compare(
    study: StudyFile,
    budget: Budget = None,
    workers: Workers = None,
    arch: Arch = None,
    decomposition: Decomposition = None,
    seed: Seed = None,
    own: EffectFiles = None,
    as_json: AsJson = False,
) -> None:
    """Calibrate the model, and show where it still disagrees with the measurements."""
    from taichi_erosion.evidence.answers.commands import compare_study

    options = options_of(budget, seed, own, workers, arch, decomposition)
    answer(
        "comparing",
        lambda progress: compare_study(study, progress, options),
        partial(print_comparison, own=own),
        as_json,
    )


@app.command(**help_of("discover"))
def discover(
    study: StudyFile,
    budget: Budget = None,
    workers: Workers = None,
    arch: Arch = None,
    decomposition: Decomposition = None,
    seed: Seed = None,
    own: EffectFiles = None,
    as_json: AsJson = False,
) -> None:
    """Find the missing effect: present, excluded, not testable, or not in the list."""
    from taichi_erosion.evidence.answers.commands import discover_study

    options = options_of(budget, seed, own, workers, arch, decomposition)
    answer(
        "discovering",
        lambda progress: discover_study(study, progress, options),
        partial(print_discovery, own=own),
        as_json,
    )


@app.command(**help_of("adopt"))
def adopt(
    study: StudyFile,
    effects: EffectNames,
    budget: Budget = None,
    workers: Workers = None,
    arch: Arch = None,
    decomposition: Decomposition = None,
    seed: Seed = None,
    own: EffectFiles = None,
    force: Force = False,
    as_json: AsJson = False,
) -> None:
    """Add one or more effects, calibrate again, and show the error on held-out measurements."""
    from taichi_erosion.evidence.answers.commands import adopt_study

    options = options_of(budget, seed, own, workers, arch, decomposition)

    def compute(progress: Progress) -> dict[str, Any]:
        return adopt_study(study, effects, progress, options, force)

    answer("adopting", compute, partial(print_adoption, own=own), as_json)


@app.command("next", **help_of("next"))
def next_(
    study: StudyFile,
    budget: Budget = None,
    workers: Workers = None,
    arch: Arch = None,
    decomposition: Decomposition = None,
    seed: Seed = None,
    own: EffectFiles = None,
    as_json: AsJson = False,
) -> None:
    """Find the cheapest experiments that tell the named explanation from its rivals."""
    from taichi_erosion.evidence.answers.commands import next_study

    options = options_of(budget, seed, own, workers, arch, decomposition)
    answer(
        "planning",
        lambda progress: next_study(study, progress, options),
        partial(print_experiments, own=own),
        as_json,
    )


@app.command(**help_of("report"))
def report(source: ReportSource, to: PageFile = None, force: Force = False, as_json: AsJson = False) -> None:
    """Write one self-contained HTML page: on a run, a calibration, or all results of a study."""
    from taichi_erosion.report import write_report
    from taichi_erosion.scene.file_kind import refuse_neither

    refuse_neither(source)
    page = str(write_report(source, to, force))
    output.print_result({"report": page}, as_json, lambda _: typer.echo(page))
    if not as_json:
        typer.echo(next_steps.after_report(page), err=True)


def options_of(
    budget: Budget, seed: Seed, own: EffectFiles, workers: Workers, arch: Arch, decomposition: Decomposition
) -> "StudyOptions":
    """What the command line states of a study; raises BadInput for a budget that is none."""
    from taichi_erosion.evidence.models.load_study import StudyOptions, stated_budget

    named, runs = stated_budget(budget)
    stated: dict[str, Any] = {
        "seed": seed,
        "effect_files": tuple(own or ()),
        "announce": announce,
        "workers": workers,
        "arch": arch,
        "decomposition": decomposition,
    }
    return StudyOptions(budget=named, runs=runs, **stated)


def answer(
    title: str,
    compute: Callable[[Progress], dict[str, Any]],
    print_text: Callable[[Record], None],
    as_json: bool,
) -> None:
    """Run a command with progress on stderr and print its result; finished runs survive Ctrl-C."""
    from taichi_erosion.evidence.answers.documents import without_rows

    with interruptible(title, KEPT) as progress:
        document = compute(lambda text, share: progress(share, text))
    output.print_result(without_rows(document) if as_json else document, as_json, print_text)


def print_comparison(document: Record, own: Sequence[Path] | None = None) -> None:
    """Print whether the model agrees, where it fails, and the misfit of every observable."""
    print_lines(document["set_up"], "set-up: ")
    print_lines(comparison_sentences(document))
    from taichi_erosion.evidence.data.table_units import TableUnits

    units = TableUnits.of(document)
    rows = (
        (
            heading(name, units.value_unit(name)),
            str(misfit["n"]),
            number(misfit["chi2"]),
            *(number(units.value(name, misfit[key])) for key in ERRORS),
            chance(misfit["p"]),
        )
        for name, misfit in document["observables"].items()
    )
    print_table("calibrated model against measurement", ("observable", "rows", "chi2", *ERRORS, "p"), rows)
    typer.echo(FITTED_ERRORS)
    print_parameters(document["parameters"])
    print_correlations(document["correlations"])
    print_limits(document)
    print_lines(next_steps.after_comparison(document, next_steps.effect_options(own)))


def print_discovery(document: Record, own: Sequence[Path] | None = None) -> None:
    """Print the verdict, the table of candidates, and the limits of the result."""
    print_lines(document["set_up"], "set-up: ")
    print_lines(document["sentences"])
    if not next_steps.waits(document):
        print_table("candidates", CANDIDATE_COLUMNS, candidate_rows(document["effects"]))
        typer.echo("probabilities: " + probabilities(document["probabilities"]))
    print_parameters(document["parameters"])
    print_correlations(document["correlations"])
    print_lines((clue["sentence"] for clue in document["clues"]), "clue: ")
    print_lines((experiment["sentence"] for experiment in document["next_experiments"]), "next: ")
    print_limits(document)
    print_lines(next_steps.after_discovery(document, next_steps.effect_options(own)))


def candidate_rows(effects: Record) -> Iterator[tuple[str, ...]]:
    """Rows of the table of candidates, in order of probability."""
    for name, found in sorted(effects.items(), key=lambda item: -(item[1]["probability"] or 0.0)):
        interval = f"{number(found['strength_low'])} to {number(found['strength_high'])}"
        if found["strength"] is None:  # nothing was weighed
            yield name, found["status"].replace("_", " "), *[MARK_MISSING] * (len(CANDIDATE_COLUMNS) - 2)
            continue
        status, strength = found["status"].replace("_", " "), number(found["strength"])
        evidence = percent(found["probability"]), number(found["log_bayes_factor"])
        yield (
            name,
            status,
            strength,
            interval,
            *evidence,
            percent(found["power"]),
            percent(found["absorption"]),
        )


def print_adoption(document: Record, own: Sequence[Path] | None = None) -> None:
    """Print the error before and after adoption, with two control effects."""
    print_lines(document["set_up"], "set-up: ")
    typer.echo(document["sentence"])
    print_errors(document)
    print_parameters(document["added"]["strengths"] | document["added"]["parameters"])
    print_correlations(document["added"]["correlations"])
    opened = document["vault"]["opened"]
    if opened > 1:
        typer.echo(f"note: the vault has been opened {opened} times; its rows are no longer unseen data.")
    print_lines(document["notes"], "note: ")
    for file in document["files"]:
        typer.echo(f"written: {file}")
    typer.echo(cost(document))
    print_lines(next_steps.after_adoption(document, next_steps.effect_options(own)))


def print_errors(document: Record) -> None:
    """Print chi2 per row and the error of the held-out rows of every fit of an adoption."""
    from taichi_erosion.evidence.data.table_units import TableUnits

    units, rows = TableUnits.of(document), []
    names = list(document["base"]["vault_rmse"])
    names = names if len(names) <= MOST_ERRORS else []

    def errors(fit: Record, key: str) -> tuple[str, ...]:
        return tuple(number(units.value(name, (fit.get(key) or {}).get(name))) for name in names)

    rungs = document.get("ladder") or []
    if rungs and rungs[0]["effects"] != document["adopted"]:
        chi2 = number(rungs[0]["chi2_per_row_fitted"]), number(rungs[0]["chi2_per_row_held_out"])
        rows.append(("as it was", *chi2, *errors(rungs[0], "rmse_held_out")))
    labels = {"base": "before", "added": f"with {listed(document['added'])}", **CONTROLS}
    for key, label in labels.items():
        fit = document.get(key)
        if fit is not None:
            effects = f" ({listed(fit)})" if key in CONTROLS else ""
            chi2 = number(fit["chi2_per_row"]), number(fit["vault_chi2_per_row"])
            rows.append((label + effects, *chi2, *errors(fit, "vault_rmse")))
    columns = [heading("rmse" if len(names) == 1 else name, units.value_unit(name)) for name in names]
    title = "chi2 per row; rmse of held-out rows" if names else "chi2 per row"
    print_table(title, ("model", "fitted rows", "held-out rows", *columns), rows)
    typer.echo(HELD_OUT_ERRORS)


def listed(fit: Record) -> str:
    """Effects of a fitted model."""
    return ", ".join(fit["effects"])


def print_experiments(document: Record, own: Sequence[Path] | None = None) -> None:
    """Print experiments in order of information per cost."""
    print_lines(document["set_up"], "set-up: ")
    experiments = document["next_experiments"]
    typer.echo(document["sentence"])
    for rank, experiment in enumerate(experiments, 1):
        typer.echo(f"{rank}. {experiment['sentence']}")
    print_lines(document["notes"], "note: ")
    print_lines(next_steps.after_next(document, next_steps.effect_options(own)))


def print_parameters(parameters: Record) -> None:
    """Print calibrated parameters with their intervals."""
    for name, fitted in parameters.items():
        bound = "; at the limit of its allowed range" if fitted["at_bound"] else ""
        interval = f"{number(fitted['low'])} to {number(fitted['high'])}"
        remark = f"; {fitted['remark']}" if fitted.get("remark") else ""
        typer.echo(f"{name} = {number(fitted['value'])} ({interval}, 90 %){bound}{remark}")


def print_correlations(pairs: Sequence[Record]) -> None:
    """Print pairs of calibrated numbers of which the measurements know little but a combination."""
    for pair in pairs:
        if abs(pair["value"]) >= CORRELATED:
            words = f"{pair['first']} and {pair['second']}: correlation {pair['value']:.2f}"
            typer.echo(f"{words}; a combination of them is known better than either")


def print_limits(document: Record) -> None:
    """Print noise, notes, warnings and cost of a result."""
    print_lines(document["noise"]["sentences"])
    print_lines([*document["notes"], *document["warnings"]], "note: ")
    typer.echo(cost(document))


def probabilities(found: Record) -> str:
    """The most probable answers."""
    ranked = sorted(found.items(), key=lambda item: -(item[1] or 0.0))[:ANSWERS]
    return ", ".join(f"{name.replace('_', ' ')} {percent(p)}" for name, p in ranked)


def print_lines(sentences: Iterable[str], lead: str = "") -> None:
    """Print one sentence per line, without repetitions."""
    for sentence in dict.fromkeys(sentences):
        typer.echo(f"{lead}{sentence}")


def cost(document: Record) -> str:
    """Runs, wall time, seed, and the place of the results."""
    runs, seconds = document.get("runs"), document.get("wall_s")
    return f"{runs} runs in {seconds:.1f} s, seed {document['seed']}, results beside {document['study']}"


def number(value: float | None) -> str:
    """Number in three significant digits."""
    return MARK_MISSING if value is None else plain(value)


def chance(p: float | None) -> str:
    """Probability of a misfit; one too small to be computed is not called zero."""
    return MARK_MISSING if p is None else p_number(p)


def percent(value: float | None) -> str:
    """Share in percent."""
    return MARK_MISSING if value is None else f"{value:.1%}" if value < 0.1 else f"{value:.0%}"
