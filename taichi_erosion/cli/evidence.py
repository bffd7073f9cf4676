"""Commands on studies: `study new`, `study check`, compare, discover, adopt, next, predict, report."""

import sys
from collections.abc import Callable, Mapping
from functools import wraps
from importlib import import_module
from inspect import Parameter, Signature, signature
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer import Argument, Option

from taichi_erosion.cli import output
from taichi_erosion.cli.options import (
    EXPLAIN,
    Arch,
    AsJson,
    Decomposition,
    EffectFiles,
    File,
    Force,
    Text,
    Verbose,
    Whole,
    command_help,
    flag,
    value,
)
from taichi_erosion.cli.progress import KEPT, announce, progress_report
from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.files import one_line_name, write_atomic

if TYPE_CHECKING:
    from taichi_erosion.evidence.answers.files import Reply
    from taichi_erosion.evidence.models.load_study import StudyOptions

Command = Callable[..., None]
Progress = Callable[[str, float], None]  # (text, share done [1])
Pairs = list[str] | None

app = typer.Typer()
study_commands = typer.Typer(help="Make a study of a table, or validate one.", no_args_is_help=True)

StudyFile = Annotated[Path, Argument(metavar="STUDY", help="Evidence study (TOML).")]


def study_options(
    budget: Annotated[
        Text,
        value(
            "quick|full|RUNS",
            "quick: fewer runs and fewer rounds about the answer. full: all of them. A number: at most "
            "so many runs. One run is one set-up, simulated with one seed.",
        ),
    ] = None,
    workers: Annotated[Whole, Option(min=1, help="Local processes; default: one a core.")] = None,
    arch: Arch = None,
    decomposition: Decomposition = None,
    seed: Annotated[
        Whole, Option(min=0, help="Seed of the runs in place of the study's; another one: fresh runs.")
    ] = None,
    effect: EffectFiles = None,
    force: Annotated[
        bool, flag("--force", "Go on with an error in the set-up; replace files of others.")
    ] = False,
) -> "StudyOptions":
    """What the command line states of a study; raises BadInput for a budget that is none."""
    from taichi_erosion.evidence.models.load_study import StudyOptions, plan_and_run_limit

    named, runs = plan_and_run_limit(budget)
    return StudyOptions(named, runs, workers, seed, tuple(effect or ()), announce, arch, decomposition, force)


def with_study_options(command: Command) -> Command:
    """A command of the loop, with the options of `study_options` typed in place of its argument `options`."""
    shared = signature(study_options).parameters
    own_parameters = [each for name, each in signature(command).parameters.items() if name != "options"]

    @wraps(command)
    def wrapper(**words: Any) -> None:
        options = {name: words.pop(name) for name in shared}
        command(options=study_options(**options), **words)

    joined = (*own_parameters[:-1], *shared.values(), own_parameters[-1])
    every = [each.replace(kind=Parameter.KEYWORD_ONLY) for each in joined]
    wrapper.__signature__ = Signature(every)  # type: ignore[attr-defined]
    wrapper.__annotations__ = {each.name: each.annotation for each in every}
    return wrapper


def run_and_print_reply(
    title: str, compute: "Callable[[Progress], Reply]", options: "StudyOptions", as_json: bool, verbose: bool
) -> None:
    """Run a command with progress on stderr and print its reply; finished runs survive Ctrl-C."""
    with progress_report(title, KEPT) as progress:
        reply = compute(lambda text, share: progress(share, text))
    if as_json:
        return output.print_json(reply.document)
    needed = [word for file in options.effect_files for word in ("--effect", str(file))]
    output.print_answer(reply, needed, verbose)


def ask(name: str, title: str, summary: str) -> None:
    """Register a command that asks a study one question."""

    def command(
        study: StudyFile, options: "StudyOptions", verbose: Verbose = False, as_json: AsJson = False
    ) -> None:
        compute = getattr(import_module("taichi_erosion.evidence.answers.commands"), f"{name}_study")
        run_and_print_reply(title, lambda report: compute(study, report, options), options, as_json, verbose)

    app.command(name, help=summary, **command_help(name, EXPLAIN))(with_study_options(command))


ask("compare", "comparing", "Calibrate the model, and show where it still disagrees with the measurements.")
ask("discover", "discovering", "Find the missing effect: present, excluded, not testable, or not listed.")


@app.command(**command_help("adopt", EXPLAIN))
@with_study_options
def adopt(
    study: StudyFile,
    effects: Annotated[
        list[str],
        Argument(metavar="EFFECT...", help="Candidates of the study; a named pair is adopted as one."),
    ],
    options: "StudyOptions",
    verbose: Verbose = False,
    as_json: AsJson = False,
) -> None:
    """Add one or more effects, calibrate again, and show the error on held-out measurements."""
    from taichi_erosion.evidence.answers.commands import adopt_study

    run_and_print_reply(
        "adopting", lambda r: adopt_study(study, effects, r, options), options, as_json, verbose
    )


ask("next", "planning", "Find the cheapest experiments that tell the named explanation from its rivals.")


@app.command(**command_help("predict", EXPLAIN))
@with_study_options
def predict(
    study: StudyFile,
    at: Annotated[
        Path,
        value(
            "TABLE",
            "New conditions (.csv, .xlsx): one column for each condition, in any unit; a column without "
            "a unit is in that of the study's table. A column 'observable' says what is wanted.",
        ),
    ],
    options: "StudyOptions",
    out: Annotated[File, value("FILE", "Table to write (CSV).")] = None,
    bare: Annotated[bool, flag("--bare", "The model of STUDY itself, adopted effects left out.")] = False,
    as_json: AsJson = False,
) -> None:
    """Predict values at new conditions by the calibrated or adopted model, with 90 % intervals."""
    from taichi_erosion.api.results import PREDICTED, prediction_table
    from taichi_erosion.evidence.answers.predictions import predict_study

    columns = ",".join(PREDICTED).encode()
    if out and out.exists() and not (out.is_file() and columns in out.read_bytes().partition(b"\n")[0]):
        raise BadInput(f"--out {one_line_name(out)}: exists, and holds no predictions; name another file")
    with progress_report("predicting", KEPT) as progress:
        reply = predict_study(study, at, lambda text, share: progress(share, text), options, bare)
    fault = reply.about["set_up"]
    output.print_result(
        reply.document, as_json, lambda _: output.print_fault_and_answer(fault, reply.answer())
    )
    if out:
        table = prediction_table(reply).to_csv(index=False, float_format="%.6g", lineterminator="\n")
        write_atomic(out, table.encode())
        typer.echo(f"written: {out}", err=as_json)


@app.command(**command_help("report", EXPLAIN))
def report(
    source: Annotated[
        Path, Argument(metavar="STUDY|RUN", help="Study (TOML), or the .json or .rrd file of a run.")
    ],
    to: Annotated[File, value("FILE", "Page to write.", "-o", "--output", "--out")] = None,
    force: Force = False,
    as_json: AsJson = False,
) -> None:
    """Write one self-contained HTML page: on a run, a calibration, or all results of a study."""
    from taichi_erosion.report import write_report
    from taichi_erosion.scene.load import refuse_other_kind

    refuse_other_kind(source, "study", "recording")
    page = str(write_report(source, to, force))
    output.print_result({"report": page}, as_json, lambda _: typer.echo(page))


@study_commands.command("new", **command_help("study new"))
def new(
    table: Annotated[Path, Argument(metavar="TABLE", help="Table of measurements (.csv or .xlsx).")],
    out: Annotated[File, value("FOLDER", "Folder to write; default: beside TABLE, its name.")] = None,
    yes: Annotated[bool, flag("--yes", "Take every guess; ask nothing.")] = False,
    observable: Annotated[Pairs, value("COLUMN=NAME", "What a column measures; may be repeated.")] = None,
    condition: Annotated[
        Pairs,
        value(
            "COLUMN=PATH|UNIT",
            "Place that a column sets; or the unit of a condition of your own. May be repeated.",
        ),
    ] = None,
    unit: Annotated[Pairs, value("COLUMN=UNIT", "Unit of a column; may be repeated.")] = None,
    roughness: Annotated[
        Text, value("LENGTH", "Roughness length of the bed under winds measured at a height.")
    ] = None,
    apparatus: Annotated[
        Text, value("NAME", "cylinder, collapse, funnel, drum, threshold, impact or saltation.")
    ] = None,
    diameter: Annotated[Text, value("LENGTH", "Grain diameter where no column states it: '0.4 mm'.")] = None,
    density: Annotated[Text, value("DENSITY", "Density of the grains: '2650 kg/m3'.")] = None,
    grains: Annotated[
        Whole, Option(min=1, help="Grains of a run; default: as many as its measure needs.")
    ] = None,
    scene: Annotated[File, value("FILE", "Scene of your own, in place of a ready one.")] = None,
    sd: Annotated[
        Pairs,
        value(
            "COLUMN=SD",
            "Scatter of single measurements where no column states it: 'angle=0.8 deg', 'flux=8 %'.",
        ),
    ] = None,
    between_codes: Annotated[Pairs, value("NAME=SD", "Error of a level: 'radius_90=5 %'.")] = None,
    measured: Annotated[Pairs, value("NUMBER=VALUE", "'sliding_friction=0.5 ± 0.05', of grains.")] = None,
    fill_down: Annotated[
        bool, flag("--fill-down", "A blank cell of a condition repeats the one above it.")
    ] = False,
    effect: EffectFiles = None,
    closed_form: Annotated[
        bool, flag("--closed-form", "A formula answers in place of simulations: seconds, not hours.")
    ] = False,
    anew: Annotated[
        bool, flag("--anew", "Write a study that is there anew; changes in it are lost, its vault stays.")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Read a table as a spreadsheet exports it; write a study and a scene for it, or correct its table."""
    from taichi_erosion.evidence.answers.new_study import NewStudyOptions, write_new_study
    from taichi_erosion.evidence.data.tables.column_roles import TableOptions

    of_columns = pairs(observable, "--observable"), pairs(condition, "--condition"), pairs(unit, "--unit")
    more = pairs(between_codes, "--between-codes"), pairs(measured, "--measured")
    grain_options = diameter, density, grains, scene, tuple(effect or ()), pairs(sd, "--sd"), fill_down, *more
    table_options = TableOptions(*of_columns)
    wishes = NewStudyOptions(table_options, out, apparatus, closed_form, roughness, anew, *grain_options)
    answer = (lambda _, guess: guess) if yes or as_json else ask_user
    document = write_new_study(table, wishes, answer, sys.stdin.isatty())
    output.print_result(document, as_json, output.print_new_study)


@study_commands.command("check", **command_help("study check"))
def check(study: StudyFile, effect: EffectFiles = None, as_json: AsJson = False) -> None:
    """Validate a study, its table, scenes, model and effect files; run nothing."""
    from taichi_erosion.evidence.answers.check_study import check_study

    output.print_result(check_study(study, study_options(effect=effect)), as_json, output.print_check)


def pairs(entries: Pairs, option: str) -> Mapping[str, str]:
    values = {}
    for pair in entries or ():
        column, equals, name = pair.rpartition("=")
        if not equals or not column.strip() or not name.strip():
            raise BadInput(f"{option} {pair}: write it as COLUMN=NAME, in quotes where it has spaces")
        values[column.strip()] = name.strip()
    return values


def ask_user(question: str, guess: str) -> str:
    """Answer of the user; Enter takes the guess."""
    try:
        return str(typer.prompt(question, default=guess, err=True))
    except typer.Abort:
        raise BadInput(f"no answer to: {question} (--yes takes every guess)") from None
