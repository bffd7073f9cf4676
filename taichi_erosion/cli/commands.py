"""Commands on one scene, recording or photograph, and the checks: each is one call and prints its result.

Imports stand inside the commands: help appears at once, and validation needs no device. An option that is
not given is not passed on: its default is defined where it is used.
"""

import os
import platform
import shlex
import threading
from contextlib import nullcontext
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from taichi_erosion import __version__
from taichi_erosion.cli import output
from taichi_erosion.cli.doe import audit, doe
from taichi_erosion.cli.evidence import study_commands
from taichi_erosion.cli.help import EXPLAIN, SIMULATE, help_of
from taichi_erosion.cli.output import Arch, AsJson, Decomposition, EffectFiles, Force, Verbose
from taichi_erosion.cli.progress import LOG, interruptible, open_log, reporting
from taichi_erosion.cli.source_tree import source_module
from taichi_erosion.core.engine import SWITCH, engine_name, engine_version
from taichi_erosion.core.errors import BadInput, ExitCode
from taichi_erosion.core.files import check_writable, refuse_foreign

if TYPE_CHECKING:
    from taichi_erosion.core.foreign_code import EffectFile
    from taichi_erosion.verification.claims import Claim

app = typer.Typer(
    help="Wind erosion of soil, grain by grain: simulate a scene, measure it, compare it with experiments.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)
measure = typer.Typer(help="Measure a photograph in the same way as a simulation.", no_args_is_help=True)
app.add_typer(measure, name="measure", rich_help_panel=SIMULATE)
app.add_typer(doe, name="doe", rich_help_panel=EXPLAIN)
app.add_typer(study_commands, name="study", rich_help_panel=EXPLAIN)

SceneFile = Annotated[Path, typer.Argument(metavar="SCENE", help="Scene file (TOML).")]
Override = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="PATH=VALUE", help="Change one entry of the scene; may be repeated."),
]
Seed = Annotated[int | None, typer.Option(min=0, help="Seed of the first replica.")]
Replicas = Annotated[int | None, typer.Option(min=1, help="Number of repeats; default: that of the scene.")]
Threads = Annotated[
    int | None, typer.Option(min=1, max=1024, help="CPU threads at most; default: all cores.")
]
Precision = Annotated[Literal["f32", "f64"] | None, typer.Option(help="Floating-point type.")]
RecordTo = Annotated[Path | None, typer.Option("--record", metavar="FILE", help="Recording to write (.rrd).")]
NoRecord = Annotated[bool, typer.Option("--no-record", help="Write no recording.")]
CheckpointTo = Annotated[
    Path | None, typer.Option("--checkpoint", metavar="FILE", help="File for the saved state.")
]
Every = Annotated[float | None, typer.Option("--every", metavar="T", help="Simulated seconds between saves.")]
ResumeFrom = Annotated[
    Path | None,
    typer.Option("--resume", metavar="FILE", help="Continue from a checkpoint.", exists=True, dir_okay=False),
]
RecordingOrStudy = Annotated[
    Path,
    typer.Argument(
        metavar="FILE|STUDY", help="Recording (.rrd), or study with results.", exists=True, dir_okay=False
    ),
]
CheckOnly = Annotated[bool, typer.Option("--check", help="Validate the scene; simulate nothing.")]


def given(**options: Any) -> dict[str, Any]:
    """Options that were typed, without those left at None."""
    return {name: value for name, value in options.items() if value is not None}


def print_version(wanted: bool) -> None:
    """Print the version, then those of the engine and of Python, and exit."""
    if wanted:
        typer.echo(__version__)
        typer.echo(f"engine {engine_name()} {engine_version()}, Python {platform.python_version()}")
        raise typer.Exit


def take_engine(name: str | None) -> str | None:
    """Compile with this engine, here and in workers."""
    if name:
        os.environ[SWITCH] = name
        engine_name.cache_clear()
    return name


@app.callback()
def program(
    context: typer.Context,
    version: Annotated[
        bool, typer.Option("--version", callback=print_version, is_eager=True, help="Print the versions.")
    ] = False,
    engine: Annotated[
        Literal["taichi", "quadrants"] | None,
        typer.Option(
            callback=take_engine, is_eager=True, help="Compiler of the kernels, if installed; before COMMAND."
        ),
    ] = None,
    log: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE", help="Append command, progress, warnings and exit code to a log; before COMMAND."
        ),
    ] = None,
) -> None:
    """Options before the command."""
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
    decomposition: Decomposition = None,
    threads: Threads = None,
    precision: Precision = None,
    record: RecordTo = None,
    no_record: NoRecord = False,
    checkpoint: CheckpointTo = None,
    every: Every = None,
    resume: ResumeFrom = None,
    effect: EffectFiles = None,
    check: CheckOnly = False,
    force: Force = False,
    verbose: Verbose = False,
    as_json: AsJson = False,
) -> None:
    """Simulate a scene, measure and record it; print the measured value beside the simulated one."""
    overrides, effects = tuple(override or ()), tuple(effect or ())
    if check:
        return print_check(scene, overrides, effects, as_json)
    check_options(record, no_record, checkpoint, every)
    from taichi_erosion.run import RunOptions, run_scene

    options = given(seed=seed, replicas=replicas, arch=arch, threads=threads, precision=precision)
    options |= given(decomposition=decomposition)
    options |= given(record=record, checkpoint=checkpoint, checkpoint_interval=every, resume=resume)
    options |= {"overrides": overrides, "effect_files": effects} | ({"force": True} if force else {})
    with interruptible("simulating") as progress:
        document = run_scene(scene, RunOptions(no_record=no_record, progress=progress, **options))
    output.log_run(document)
    output.print_result(document, as_json, lambda found: output.print_run(found, verbose))
    if any(replica.get("stopped") for replica in document["replicas"]):
        raise typer.Exit(ExitCode.STOPPED)


def print_check(scene: Path, overrides: tuple[str, ...], effects: tuple[Path, ...], as_json: bool) -> None:
    """Validate a scene and print its hash."""
    from taichi_erosion.evidence.words.run_words import consequences
    from taichi_erosion.run import check_scene

    document = check_scene(scene, overrides, effects, examine_effect)

    def print_text(found: output.Record) -> None:
        typer.echo(f"{scene}: valid, hash {found['hash']}")
        for sentence in output.examined_effects(found["effects"]):
            typer.echo(sentence)
        warnings = (f"{output.WARNING}{line}" for line in found.get("limits", {}).get("warnings", ()))
        for sentence in (*warnings, *consequences(found)):
            typer.echo(sentence)

    output.print_result(document, as_json, print_text)


def examine_effect(file: "EffectFile") -> dict[str, Any]:
    """Check of the effect of a file; imports the device."""
    from taichi_erosion.verification.effect_contract import examined_file

    return examined_file(file)


def check_options(record: Path | None, no_record: bool, checkpoint: Path | None, every: float | None) -> None:
    """Raise BadInput for options that exclude or need each other."""
    if record and no_record:
        raise BadInput("--record and --no-record exclude each other")
    if every is not None and checkpoint is None:
        raise BadInput("--every needs --checkpoint FILE")
    if every is not None and not every > 0.0:
        raise BadInput(f"--every {every}: must be greater than 0 s")


@app.command(**help_of("live"))
def live(
    scene: SceneFile,
    override: Override = None,
    seed: Annotated[int | None, typer.Option(min=0, help="Seed of the grains.")] = None,
    record: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Recording to write during the session.")
    ] = None,
    viewer: Annotated[
        str | None,
        typer.Option(metavar="URL", help="Viewer to stream to, such as rerun+http://127.0.0.1:9876/proxy."),
    ] = None,
    web: Annotated[bool, typer.Option("--web", help="Serve a live viewer for a browser.")] = False,
    effect: EffectFiles = None,
) -> None:
    """Run a scene interactively: type `help` at the prompt, or pipe commands in."""
    from taichi_erosion.cli.live import run_prompt
    from taichi_erosion.recording.outputs import unused_name
    from taichi_erosion.recording.viewer import web_viewer
    from taichi_erosion.run.session import open_session

    if web and viewer:
        raise BadInput("--web and --viewer exclude each other")
    if effect:
        from taichi_erosion.verification.effect_contract import refuse_unusable

        for sentence in output.examined_effects(refuse_unusable(effect)):
            typer.echo(sentence, err=True)
    session = open_session(scene, tuple(override or ()), seed, effect or ())
    path = record or unused_name(Path("recordings") / f"{scene.stem}-live-{session.seed}.rrd")
    if record and record.exists():
        raise BadInput(f"{record}: exists; name another file, for a session cannot be repeated")
    with web_viewer() if web else nullcontext() as served:
        if served:
            typer.echo(served.instructions, err=True)
        run_prompt(session, path, served.sink if served else viewer)


def recording_of(file: Path) -> Path:
    """Recording file; the recording of a study is written from its results."""
    from taichi_erosion.scene.load import refuse_other_kind

    refuse_other_kind(file, "study", "recording")
    if file.suffix != ".toml":
        return file
    from taichi_erosion.report import write_recording

    return write_recording(file)


@app.command(**help_of("view"))
def view(
    file: RecordingOrStudy,
    web: Annotated[bool, typer.Option("--web", help="Serve a page for a browser on this machine.")] = False,
) -> None:
    """Open a run or a study in the rerun viewer: a window, or a page in a browser."""
    if not web:
        from taichi_erosion.recording.viewer import open_viewer

        raise typer.Exit(open_viewer(recording_of(file)))
    from taichi_erosion.recording.viewer import web_viewer

    with web_viewer(recording_of(file)) as served:
        typer.echo(f"{served.instructions}\nCtrl-C ends it", err=True)
        try:
            threading.Event().wait()
        except KeyboardInterrupt:
            return


@app.command(**help_of("snapshot"))
def snapshot(
    file: RecordingOrStudy,
    time: Annotated[
        float | None, typer.Option(metavar="T", help="Simulated time in seconds; default: the end.")
    ] = None,
    to: Annotated[
        Path | None,
        typer.Option("-o", "--output", metavar="PNG", help="Picture file; default: FILE.snapshot.png."),
    ] = None,
    only: Annotated[
        str | None, typer.Option("--view", metavar="NAME", help="One view alone, such as Grains.")
    ] = None,
    force: Force = False,
) -> None:
    """Draw one moment of a run, or a study, without a screen."""
    from taichi_erosion.recording.viewer import render_picture

    picture_file = to or file.with_suffix(".snapshot.png")
    refuse_foreign(picture_file, file, force)
    typer.echo(str(render_picture(recording_of(file), time, picture_file, view=only, source=file)))


@app.command(**help_of("export"))
def export(
    file: Annotated[
        Path, typer.Argument(metavar="FILE", help="Recording (.rrd).", exists=True, dir_okay=False)
    ],
    vtk: Annotated[Path, typer.Option("--vtk", metavar="DIR", help="Folder for the VTK files.")],
    force: Force = False,
) -> None:
    """Write the grains of a recording for ParaView."""
    from taichi_erosion.recording.export import export_vtk

    typer.echo(str(export_vtk(file, vtk, force)))


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
        Literal["auto", "dark", "light"] | None, typer.Option(help="Brightness behind the heap.")
    ] = None,
    to: Annotated[
        Path | None,
        typer.Option(
            "-o", "--output", metavar="PNG", help="Picture of the detection; default: IMAGE.detected.png."
        ),
    ] = None,
    force: Force = False,
    as_json: AsJson = False,
) -> None:
    """Measure the angle of repose of a heap in a photograph, and draw what was detected over it."""
    from taichi_erosion.measures.photograph import measure_photograph

    picture = to or image.with_suffix(".detected.png")
    refuse_foreign(picture, image, force)
    check_writable(picture)
    options = given(crop=None if crop is None else rectangle(crop), background=background)
    record = measure_photograph(image, **options)
    from taichi_erosion.report.pictures.photograph import draw_detection

    record |= {"picture": str(draw_detection(image, record, picture))}
    output.print_result(record, as_json, output.print_measurement)


def rectangle(text: str) -> tuple[int, int, int, int]:
    """Corners of a rectangle [pixels], from "x0,y0,x1,y1"."""
    try:
        left, top, right, bottom = (int(word) for word in text.split(","))
    except ValueError:
        raise BadInput(f"--crop {text}: give four whole numbers X0,Y0,X1,Y1 in pixels") from None
    return left, top, right, bottom


@app.command(**help_of("verify"))
def verify(
    ids: Annotated[
        list[str] | None, typer.Argument(metavar="ID", help="Claims such as V02; default: all.")
    ] = None,
    strict: Annotated[bool, typer.Option("--strict", help="Exit code 1 for known failures too.")] = False,
    as_json: AsJson = False,
) -> None:
    """Check the verification table: claim, got, want, tolerance; exit code 1 for an unknown failure."""
    from taichi_erosion.verification import closed_forms
    from taichi_erosion.verification.claims import verify as verify_claims

    full = source_module("tests.verification.ladder")
    ladder = full.LADDER if full else closed_forms.LADDER
    if full is None:
        typer.echo(f"short list {', '.join(ladder.checks)}; a source tree runs all claims", err=True)
    claims = verify_claims(ladder, tuple(ids or ()), on_claim=print_claim)
    document = {"claims": [asdict(claim) | {"known_failure": ladder.is_known(claim)} for claim in claims]}
    output.print_result(document, as_json, output.print_claims)
    if any(not claim.passed and (strict or not ladder.is_known(claim)) for claim in claims):
        raise typer.Exit(ExitCode.FAILURE)


def print_claim(claim: "Claim") -> None:
    """Print the outcome of one claim on stderr; the whole table takes minutes."""
    typer.echo(f"{claim.id} {output.verdict(claim.passed)}: {claim.claim}", err=True)


@app.command(**help_of("bench"))
def bench(
    arch: Annotated[
        Literal["cpu", "cuda", "vulkan"] | None, typer.Option(help="Device; default: cpu.")
    ] = None,
    large: Annotated[
        bool, typer.Option("--large", help="Also what fills a graphics processor; not for a CPU.")
    ] = False,
    quick: Annotated[
        bool, typer.Option("--quick", help="Small cases, for a driver in software; not for a CPU.")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Measure the speed: grain-steps per second and per core, and the time of each stage."""
    if large and quick:
        raise BadInput("--quick or --large, not both")
    if (large or quick) and arch in (None, "cpu"):
        raise BadInput(f"--{'large' if large else 'quick'}: for --arch cuda or vulkan")
    size = "large" if large else "quick" if quick else "usual"
    cases = source_module("benchmarks.cases")
    if cases is None:
        raise BadInput("bench: the timed cases are in the source tree, not in the installed program")
    with reporting("timing") as progress:
        document = cases.run_benchmarks(progress, **given(arch=arch, size=size))
    output.print_result(document, as_json, output.print_cases)


@app.command(**help_of("schema"))
def schema(
    to: Annotated[
        Path | None, typer.Option("-o", "--output", metavar="FILE", help="Default: scenes/scene.schema.json.")
    ] = None,
    study: Annotated[
        bool, typer.Option("--study", help="Of study files; default: doe/study.schema.json.")
    ] = False,
    entry: Annotated[
        str | None,
        typer.Option("--entry", metavar="PATH", help="Print an entry or a section of scene files instead."),
    ] = None,
) -> None:
    """Write the JSON schema of scene or study files, for completion and checks in editors."""
    from taichi_erosion.campaign.study_file import write_study_schema
    from taichi_erosion.scene import write_schema
    from taichi_erosion.scene.paths import meaning_of

    if entry is not None:
        typer.echo(meaning_of(entry))
        return
    target = to or Path("doe/study.schema.json" if study else "scenes/scene.schema.json")
    if not target.parent.is_dir():
        raise BadInput(f"{target}: no folder {target.parent}; name the file with -o")
    (write_study_schema if study else write_schema)(target)
    typer.echo(str(target))
