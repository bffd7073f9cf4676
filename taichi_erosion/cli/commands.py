"""The commands: each translates its words into one call and shows what comes back.

The rooms below are imported inside the commands, so that help appears at once and validation needs no device.
A word that is left out is not passed on: its default lives where it is used.
"""

import shlex
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from taichi_erosion import __version__
from taichi_erosion.cli import output
from taichi_erosion.cli.doe import audit, doe
from taichi_erosion.cli.help_pages import EXPLAIN, PLAY, help_of
from taichi_erosion.cli.live import live
from taichi_erosion.cli.output import AsJson
from taichi_erosion.cli.progress import LOG, open_log, reporting
from taichi_erosion.cli.view import export, snapshot, view
from taichi_erosion.core.errors import BadInput, ExitCode

if TYPE_CHECKING:
    from taichi_erosion.verification.claim import Claim

INTERRUPTED = 130  # exit code of a program ended by Ctrl-C, 128 + SIGINT
STOPPED = 3  # exit code where the simulation of a replica failed; the others are printed

app = typer.Typer(
    help="Wind erosion of soil, grain by grain: simulate a scene, measure it, compare it with experiments.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)
measure = typer.Typer(help="Measure a photograph as a simulation is measured.", no_args_is_help=True)
app.add_typer(measure, name="measure", rich_help_panel=PLAY)
app.add_typer(doe, name="doe", rich_help_panel=EXPLAIN)

SceneFile = Annotated[Path, typer.Argument(metavar="SCENE", help="Scene file (TOML).")]
Override = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="PATH=VALUE", help="Change one entry of the scene; may be repeated."),
]
Seed = Annotated[int | None, typer.Option(min=0, help="Seed of the first replica.")]
Replicas = Annotated[
    int | None, typer.Option(min=1, help="Number of repeats; those of the scene if left out.")
]
Arch = Annotated[Literal["cpu", "cuda"] | None, typer.Option(help="Device; cpu if left out.")]
Threads = Annotated[int | None, typer.Option(min=1, max=1024, help="CPU threads; all cores if left out.")]
Precision = Annotated[Literal["f32", "f64"] | None, typer.Option(help="Floating-point type.")]
RecordTo = Annotated[Path | None, typer.Option("--record", metavar="FILE", help="Where the recording goes.")]
NoRecord = Annotated[bool, typer.Option("--no-record", help="Write no recording.")]
CheckpointTo = Annotated[
    Path | None, typer.Option("--checkpoint", metavar="FILE", help="Where to save the state.")
]
Every = Annotated[float | None, typer.Option("--every", metavar="T", help="Simulated seconds between saves.")]
ResumeFrom = Annotated[
    Path | None,
    typer.Option("--resume", metavar="FILE", help="Go on from a checkpoint.", exists=True, dir_okay=False),
]
EffectFiles = Annotated[
    list[Path] | None,
    typer.Option("--effect", metavar="FILE", help="Python file with an effect of your own; may be repeated."),
]
CheckOnly = Annotated[bool, typer.Option("--check", help="Validate the scene; simulate nothing.")]


def given(**words: Any) -> dict[str, Any]:
    """The words that were typed; the others keep the default of what is called."""
    return {name: word for name, word in words.items() if word is not None}


def print_version(wanted: bool) -> None:
    """Print the version and leave."""
    if wanted:
        typer.echo(__version__)
        raise typer.Exit


@app.callback()
def program(
    context: typer.Context,
    version: Annotated[
        bool, typer.Option("--version", callback=print_version, is_eager=True, help="Print the version.")
    ] = False,
    log: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE", help="Add command, progress, warnings and end to a log; goes before COMMAND."
        ),
    ] = None,
) -> None:
    """Options of the program itself."""
    if log is not None:
        open_log(log)
        LOG.info("taichi-erosion %s: %s", __version__, shlex.join(context.obj))


@app.command(**help_of("run"))
def run(
    scene: SceneFile,
    override: Override = None,
    seed: Seed = None,
    replicas: Replicas = None,
    arch: Arch = None,
    threads: Threads = None,
    precision: Precision = None,
    record: RecordTo = None,
    no_record: NoRecord = False,
    checkpoint: CheckpointTo = None,
    every: Every = None,
    resume: ResumeFrom = None,
    effect: EffectFiles = None,
    check: CheckOnly = False,
    as_json: AsJson = False,
) -> None:
    """Simulate a scene, measure and record it; print the measured value beside the simulated one."""
    overrides, effects = tuple(override or ()), tuple(effect or ())
    if check:
        return check_only(scene, overrides, effects, as_json)
    refuse_contradictions(record, no_record, checkpoint, every)
    words = given(
        seed=seed, replicas=replicas, arch=arch, threads=threads, precision=precision, record=record
    )
    words |= given(checkpoint=checkpoint, checkpoint_interval=every, resume=resume)
    words |= {"overrides": overrides, "effect_files": effects}
    document = simulate(scene, no_record=no_record, **words)
    output.log_run(document)
    (output.print_json if as_json else output.print_run)(document)
    if any(replica.get("stopped") for replica in document["replicas"]):
        raise typer.Exit(STOPPED)


def check_only(scene: Path, overrides: tuple[str, ...], effects: tuple[Path, ...], as_json: bool) -> None:
    """Validate a scene and say so."""
    from taichi_erosion.run import check_scene

    document = check_scene(scene, overrides, effects)
    if as_json:
        output.print_json(document)
    else:
        typer.echo(f"{scene}: valid, hash {document['hash']}")


def refuse_contradictions(
    record: Path | None, no_record: bool, checkpoint: Path | None, every: float | None
) -> None:
    """Raise BadInput for words that exclude or need each other."""
    if record and no_record:
        raise BadInput("--record and --no-record exclude each other")
    if every is not None and checkpoint is None:
        raise BadInput("--every needs --checkpoint FILE")
    if every is not None and not every > 0.0:
        raise BadInput(f"--every {every}: must be longer than 0 s")


def simulate(scene: Path, **words: Any) -> dict[str, Any]:
    """Run a scene with a progress report; Ctrl-C ends the program with a line that says what was kept."""
    from taichi_erosion.run import RunOptions, run_scene

    try:
        with reporting("simulating") as progress:
            return run_scene(scene, RunOptions(**words, progress=progress))
    except KeyboardInterrupt as interrupt:
        typer.echo(f"interrupted; {interrupt}" if str(interrupt) else "interrupted", err=True)
        raise typer.Exit(INTERRUPTED) from None


app.command(**help_of("live"))(live)
app.command(**help_of("view"))(view)
app.command(**help_of("snapshot"))(snapshot)
app.command(**help_of("export"))(export)
app.command(**help_of("audit"))(audit)


@measure.command(**help_of("measure repose"))
def repose(
    image: Annotated[
        Path,
        typer.Argument(
            metavar="IMAGE", help="Side view of a heap, PNG or JPEG.", exists=True, dir_okay=False
        ),
    ],
    crop: Annotated[
        str | None, typer.Option(metavar="X0,Y0,X1,Y1", help="Part of the picture, in pixels.")
    ] = None,
    background: Annotated[
        Literal["auto", "dark", "light"] | None, typer.Option(help="Behind the heap.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Angle of repose of a heap on a photograph."""
    from taichi_erosion.measures.photograph import measure_photograph

    words = given(crop=None if crop is None else rectangle(crop), background=background)
    record = measure_photograph(image, **words)
    (output.print_json if as_json else output.print_measurement)(record)


def rectangle(text: str) -> tuple[int, int, int, int]:
    """Corners of a part of a picture [pixels], from "x0,y0,x1,y1"."""
    try:
        left, top, right, bottom = (int(word) for word in text.split(","))
    except ValueError:
        raise BadInput(f"--crop {text}: give four whole numbers X0,Y0,X1,Y1 in pixels") from None
    if not (0 <= left < right and 0 <= top < bottom):
        raise BadInput(
            f"--crop {text}: needs 0 <= X0 < X1 and 0 <= Y0 < Y1, counted from the upper left corner"
        )
    return left, top, right, bottom


@app.command(**help_of("verify"))
def verify(
    ids: Annotated[
        list[str] | None, typer.Argument(metavar="ID", help="Claims such as V02; all if left out.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Climb the verification ladder: claim, got, want, tolerance; exit code 1 if a claim fails."""
    from taichi_erosion.verification.claims import verify as verify_claims

    claims = [asdict(claim) for claim in verify_claims(tuple(ids or ()), on_claim=announce)]
    if as_json:
        output.print_json({"claims": claims})
    else:
        output.print_claims(claims)
    if not all(claim["passed"] for claim in claims):
        raise typer.Exit(ExitCode.FAILURE)


def announce(claim: "Claim") -> None:
    """Say on stderr how one claim fared, for the ladder takes minutes."""
    typer.echo(f"{claim.id} {'ok' if claim.passed else 'FAILED'}: {claim.claim}", err=True)


@app.command(**help_of("bench"))
def bench(as_json: AsJson = False) -> None:
    """Grain-steps per second, per core, with the time split by stage."""
    from taichi_erosion.benchmark import run_benchmarks

    with reporting("timing") as progress:
        document = run_benchmarks(progress=progress)
    if as_json:
        output.print_json(document)
    else:
        output.print_cases(document["cases"])


@app.command(**help_of("schema"))
def schema(
    to: Annotated[Path, typer.Option("-o", "--output", metavar="FILE")] = Path("scenes/scene.schema.json"),
) -> None:
    """Write the JSON schema of scene files, which editors use for completion and checks."""
    from taichi_erosion.scene import write_schema

    if not to.parent.is_dir():
        raise BadInput(f"{to}: no folder {to.parent}; name the file with -o")
    write_schema(to)
    typer.echo(str(to))
