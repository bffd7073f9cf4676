"""Commands on one scene, recording or photograph, and the checks: each is one call and prints its result.

Imports stand inside the commands: help appears at once, and validation needs no device. An option that is
not given is not passed on: its default is defined where it is used.
"""

import os
import platform
import shlex
import sys
import threading
from dataclasses import asdict
from functools import partial
from importlib import import_module
from math import isfinite
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer
from typer import Argument, Option

from taichi_erosion import __version__
from taichi_erosion.cli import output
from taichi_erosion.cli.doe import audit, doe
from taichi_erosion.cli.evidence import study_commands
from taichi_erosion.cli.options import (
    CHECK,
    EXPLAIN,
    SIMULATE,
    Arch,
    AsJson,
    Decomposition,
    EffectFiles,
    File,
    Force,
    MeasureFiles,
    Text,
    Verbose,
    Whole,
    command_help,
    flag,
    value,
)
from taichi_erosion.cli.progress import LOG, open_log, progress_report
from taichi_erosion.core.engine import SWITCH, engine_name, engine_version
from taichi_erosion.core.errors import BadInput, ExitCode
from taichi_erosion.core.files import refuse_foreign_file, require_writable
from taichi_erosion.evidence.words import shell_command

if TYPE_CHECKING:
    from taichi_erosion.core.effect_file import EffectFile
    from taichi_erosion.verification.claims import Claim

ROOT = Path(__file__).parents[2]  # of the source tree, with all claims and the timed cases

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

existing = partial(Argument, exists=True, dir_okay=False)  # a file that must be there

SceneFile = Annotated[Path, Argument(metavar="SCENE", help="Scene file (TOML).")]
Override = Annotated[
    list[str] | None, value("PATH=VALUE", "Change one entry of the scene; may be repeated.", "--set")
]
RecordingOrStudy = Annotated[
    Path, existing(metavar="FILE|STUDY", help="Recording (.rrd), or study with results.")
]


def typed_options(**options: Any) -> dict[str, Any]:
    """Options that were typed, without those left at None."""
    return {name: value for name, value in options.items() if value is not None}


def print_version(asked: bool) -> None:
    """Print the version, then those of the engine and of Python, and exit."""
    if asked:
        typer.echo(__version__)
        typer.echo(f"engine {engine_name()} {engine_version()}, Python {platform.python_version()}")
        raise typer.Exit


def use_engine(name: str | None) -> str | None:
    """Compile with this engine, here and in workers."""
    if name:
        os.environ[SWITCH] = name
        engine_name.cache_clear()
    return name


@app.callback()
def set_global_options(
    context: typer.Context,
    version: Annotated[
        bool, Option("--version", callback=print_version, is_eager=True, help="Print the versions.")
    ] = False,
    engine: Annotated[
        Literal["taichi", "quadrants"] | None,
        Option(
            callback=use_engine, is_eager=True, help="Compiler of the kernels, if installed; before COMMAND."
        ),
    ] = None,
    log: Annotated[
        File, value("FILE", "Append command, progress, warnings and exit code to a log; before COMMAND.")
    ] = None,
) -> None:
    """Options before the command."""
    if log is not None:
        open_log(log)
        LOG.info("taichi-erosion %s: %s", __version__, shlex.join(context.obj))


@app.command(**command_help("run", SIMULATE))
def run(
    scene: SceneFile,
    override: Override = None,
    seed: Annotated[Whole, Option(min=0, help="Seed of the first replica.")] = None,
    replicas: Annotated[Whole, Option(min=1, help="Number of repeats; default: that of the scene.")] = None,
    arch: Arch = None,
    decomposition: Decomposition = None,
    threads: Annotated[
        Whole, Option(min=1, max=1024, help="CPU threads at most; default: all cores.")
    ] = None,
    precision: Annotated[Literal["f32", "f64"] | None, Option(help="Floating-point type.")] = None,
    record: Annotated[File, value("FILE", "Recording to write (.rrd).")] = None,
    no_record: Annotated[bool, flag("--no-record", "Write no recording.")] = False,
    checkpoint: Annotated[File, value("FILE", "File for the saved state.")] = None,
    every: Annotated[float | None, value("T", "Simulated seconds between saves.")] = None,
    resume: Annotated[File, value("FILE", "Continue from a checkpoint.", exists=True, dir_okay=False)] = None,
    effect: EffectFiles = None,
    measure: MeasureFiles = None,
    check: Annotated[bool, flag("--check", "Validate the scene; simulate nothing.")] = False,
    force: Force = False,
    verbose: Verbose = False,
    as_json: AsJson = False,
) -> None:
    """Simulate a scene, measure and record it; print the measured value beside the simulated one."""
    measure_entries = (f"measure.{file.stem}.file='{file.resolve()}'" for file in measure or ())
    overrides, effects = (*(override or ()), *measure_entries), tuple(effect or ())
    if check:
        return print_check(scene, overrides, effects, as_json)
    if record and no_record:
        raise BadInput("--record and --no-record exclude each other")
    if every is not None and not (checkpoint and every > 0.0):
        raise BadInput(f"--every {every}: needs --checkpoint FILE, and a time greater than 0 s")
    from taichi_erosion.evidence.words.run_words import run_warnings
    from taichi_erosion.execution import RunOptions, run_scene

    options = typed_options(seed=seed, replicas=replicas, arch=arch, threads=threads, precision=precision)
    options |= typed_options(decomposition=decomposition, checkpoint_interval=every, record=record)
    options |= typed_options(checkpoint=checkpoint, resume=resume, overrides=overrides, effect_files=effects)
    with progress_report("simulating") as progress:
        run_options = RunOptions(no_record=no_record, force=force, progress=progress, **options)
        document = run_scene(scene, run_options)
    for line in run_warnings(document):
        LOG.warning(line)
    output.print_result(document, as_json, lambda result: output.print_run(result, verbose))
    if any(replica.get("stopped") for replica in document["replicas"]):
        raise typer.Exit(ExitCode.STOPPED)


@app.command(**command_help("sweep", SIMULATE))
def sweep(
    scene: SceneFile,
    over: Annotated[str, value("PATH=A,B,C", "Entry of the scene and its values.")],
    override: Override = None,
    replicas: Annotated[Whole, Option(min=1, help="Repeats at each value; default: the scene's.")] = None,
    workers: Annotated[Whole, Option(min=1, help="Local processes; default: one per core.")] = None,
    scheduler: Annotated[Text, value("ADDRESS", "Dask scheduler.")] = None,
    effect: EffectFiles = None,
    out: Annotated[File, value("DIR", "Folder of table and picture.")] = None,
    force: Force = False,
    as_json: AsJson = False,
) -> None:
    """Run a scene along values of one entry; write the measures with their scatter, and a picture."""
    from taichi_erosion.campaign import sweep as sweeps
    from taichi_erosion.core.files import ListedFolder
    from taichi_erosion.measures.result import nan_to_none
    from taichi_erosion.report.figure_style import as_png, sweep_figure

    path, _ = sweeps.parse_sweep_values(over)
    folder = out or Path("recordings") / f"{scene.stem}-{path}"
    ListedFolder(folder).refuse_foreign_files((sweeps.TABLE, sweeps.FIGURE), force)
    options = typed_options(replicas=replicas, effect_files=effect)
    with progress_report("sweeping") as progress:
        where = folder, workers, scheduler
        points = sweeps.sweep_entry(scene, over, override or (), **options, where=where, progress=progress)
    curves: dict[str, list[tuple[str, float, float]]] = {}
    for one in [point for point in points if isfinite(point.value)] or points:
        curves.setdefault(f"{one.measure} [{one.unit}]", []).append((one.entry, one.value, one.sd))
    files = sweeps.write_sweep(folder, over, points, as_png(sweep_figure(path, curves)))
    rows = [asdict(one) for one in points]
    document = {"path": path, "points": rows, "files": [str(file) for file in files]}
    output.print_result(nan_to_none(document), as_json, output.print_sweep)


def print_check(scene: Path, overrides: tuple[str, ...], effects: tuple[Path, ...], as_json: bool) -> None:
    """Validate a scene and print its hash."""
    from taichi_erosion.evidence.words.run_words import set_up_consequences
    from taichi_erosion.execution import check_scene

    document = check_scene(scene, overrides, effects, check_effect_file)

    def print_text(record: output.Record) -> None:
        typer.echo(f"{scene}: valid, hash {record['hash']}")
        if (limits := record.get("limits", {})) and "steps_most" in limits:
            typer.echo(f"time step {limits['time_step']:.3g} s, at most {limits['steps_most']:,} steps")
        output.print_lines(output.effect_check_lines(record["effects"]))
        output.print_lines(limits.get("warnings", ()), output.WARNING)
        output.print_lines(set_up_consequences(record))

    output.print_result(document, as_json, print_text)


def check_effect_file(file: "EffectFile") -> dict[str, Any]:
    """Check of the effect of a file; imports the device."""
    from taichi_erosion.verification.effect_contract import examine_file

    return examine_file(file)


@app.command(**command_help("live", SIMULATE))
def live(
    scene: SceneFile,
    override: Override = None,
    seed: Annotated[Whole, Option(min=0, help="Seed of the grains.")] = None,
    record: Annotated[File, value("FILE", "Recording to write during the session.")] = None,
    web: Annotated[bool, flag("--web", "Serve a page that steers and shows the session.")] = False,
    port: Annotated[int, Option(min=0, max=65535, help="Port of the page; 0: a free one.")] = 0,
    effect: EffectFiles = None,
) -> None:
    """Run a scene interactively: type `help` at the prompt, or pipe commands in."""
    from taichi_erosion.api.page import serve_page
    from taichi_erosion.cli.live import run_prompt
    from taichi_erosion.execution.session import open_session, unused_path

    if effect:
        from taichi_erosion.verification.effect_contract import examine_effect_files

        for sentence in output.effect_check_lines(examine_effect_files(effect)):
            typer.echo(sentence, err=True)
    session = open_session(scene, tuple(override or ()), seed, effect or ())
    path = record or unused_path(Path("recordings") / f"{scene.stem}-live-{session.seed}.rrd")
    if record and record.exists():
        raise BadInput(f"{record}: exists; name another file, for a session cannot be repeated")
    page = serve_page(session, path.with_suffix(".txt"), threading.Lock(), port) if web else None
    if page:
        typer.echo(f"page: {page.address}\n{page.tunnel_hint}", err=True)
    run_prompt(session, path, page)


def recording_to_view(file: Path) -> Path:
    """Recording file; the recording of a study is written from its results."""
    from taichi_erosion.scene.load import refuse_other_kind

    refuse_other_kind(file, "study", "recording")
    if file.suffix != ".toml":
        return file
    from taichi_erosion.report import write_recording

    return write_recording(file)


@app.command(**command_help("view", SIMULATE))
def view(
    file: RecordingOrStudy,
    web: Annotated[bool, flag("--web", "Serve a page for a browser on this machine.")] = False,
) -> None:
    """Open a run or a study in the rerun viewer: a window, or a page in a browser."""
    if not web:
        from taichi_erosion.recording.viewer import open_viewer

        raise typer.Exit(open_viewer(recording_to_view(file)))
    from taichi_erosion.recording.viewer import serve_web_viewer

    with serve_web_viewer(recording_to_view(file)) as served:
        typer.echo(f"{served.instructions}\nCtrl-C ends it", err=True)
        try:
            threading.Event().wait()
        except KeyboardInterrupt:
            return


@app.command(**command_help("snapshot", SIMULATE))
def snapshot(
    file: RecordingOrStudy,
    time: Annotated[float | None, value("T", "Simulated time in seconds; default: the end.")] = None,
    to: Annotated[File, value("PNG", "Picture file; default: FILE.snapshot.png.", "-o", "--output")] = None,
    only: Annotated[Text, value("NAME", "One view alone, such as Grains.", "--view")] = None,
    force: Force = False,
) -> None:
    """Draw one moment of a run, or a study, without a screen."""
    from taichi_erosion.recording.viewer import render_picture

    picture_file = to or file.with_suffix(".snapshot.png")
    refuse_foreign_file(picture_file, file, force)
    typer.echo(str(render_picture(recording_to_view(file), time, picture_file, view=only, source=file)))


@app.command(**command_help("export", SIMULATE))
def export(
    file: Annotated[Path, existing(metavar="FILE", help="Recording (.rrd).")],
    vtk: Annotated[File, value("DIR", "Folder for the VTK files.")] = None,
    netcdf: Annotated[File, value("DIR", "Folder for tables.")] = None,
    chains: Annotated[File, value("PNG", "Picture of force chains.")] = None,
    time: Annotated[float | None, value("T", "Its time in seconds; default: the end.")] = None,
    force: Force = False,
) -> None:
    """Write grains, contacts and walls of a recording: for ParaView, as tables, as a picture."""
    from taichi_erosion.recording import export as door

    if not (vtk or netcdf or chains):
        raise BadInput("export: name at least one of --vtk DIR, --netcdf DIR, --chains PNG")
    if time is not None and not chains:
        raise BadInput(f"--time {time:g}: is the time of the picture; needs --chains PNG")
    if vtk:
        typer.echo(str(door.export_vtk(file, vtk, force)))
    if netcdf:
        typer.echo(str(door.export_netcdf(file, netcdf, force)))
    if chains:
        typer.echo(str(door.export_chains(file, chains, time, force)))


app.command(**command_help("audit", CHECK))(audit)


@measure.command(**command_help("measure repose"))
def repose(
    image: Annotated[Path, existing(metavar="IMAGE", help="Side view of a heap, PNG or JPEG.")],
    crop: Annotated[Text, value("X0,Y0,X1,Y1", "Part of the picture, in pixels.")] = None,
    background: Annotated[
        Literal["auto", "dark", "light"] | None, Option(help="Brightness behind the heap.")
    ] = None,
    to: Annotated[
        File, value("PNG", "Picture of the detection; default: IMAGE.detected.png.", "-o", "--output")
    ] = None,
    force: Force = False,
    as_json: AsJson = False,
) -> None:
    """Measure the angle of repose of a heap in a photograph, and draw what was detected over it."""
    from taichi_erosion.measures.photograph import measure_photograph

    picture = to or image.with_suffix(".detected.png")
    refuse_foreign_file(picture, image, force)
    require_writable(picture)
    options = typed_options(background=background)
    if crop is not None:
        try:
            left, top, right, bottom = map(int, crop.split(","))
        except ValueError:
            raise BadInput(f"--crop {crop}: give four whole numbers X0,Y0,X1,Y1 in pixels") from None
        options["crop"] = left, top, right, bottom
    record = measure_photograph(image, **options)
    from taichi_erosion.report.pictures import draw_detection

    record |= {"picture": str(draw_detection(image, record, picture))}
    output.print_result(record, as_json, output.print_measurement)


@measure.command(**command_help("measure profile"))
def profile(
    table: Annotated[Path, existing(metavar="TABLE", help="Heights of heaps along a radius or a line.")],
    place: Annotated[Text, value("HEADING", "Column of the radius, or along the line.")] = None,
    height: Annotated[Text, value("HEADING", "Column of heights above the plate.")] = None,
    diameter: Annotated[Text, value("LENGTH", "Of the grains; their last layer is no flank.")] = None,
    to: Annotated[File, value("CSV", "Default: TABLE_heaps.csv.", "-o", "--output")] = None,
    force: Force = False,
    as_json: AsJson = False,
) -> None:
    """Measure angle, height and radius of scanned heaps; write a table with a row a heap for `study new`."""
    from taichi_erosion.measures.profile import measure_heap_table, write_heap_table
    from taichi_erosion.tables.cell_numbers import stated_number

    csv_file = to or table.with_name(f"{table.stem}_heaps.csv")
    refuse_foreign_file(csv_file, table, force)
    grain = stated_number(diameter, "m", "--diameter", "2mm") if diameter else 0.0
    columns, rows = measure_heap_table(table, place, height, grain)
    write_heap_table(csv_file, table, columns, rows)
    record = {"heaps": [dict(zip(columns, row, strict=True)) for row in rows], "table": str(csv_file)}
    if as_json:
        return output.print_json(record)
    output.print_table("heaps", columns, rows)
    typer.echo(f"next: {shell_command('study', 'new', csv_file)}")


def import_source_module(name: str) -> ModuleType | None:
    """Module beside the package by its dotted name; None where the program is installed without its tree."""
    if not (ROOT / name.replace(".", "/")).with_suffix(".py").is_file():
        return None
    sys.path.insert(0, str(ROOT))
    return import_module(name)


@app.command(**command_help("verify", CHECK))
def verify(
    ids: Annotated[list[str] | None, Argument(metavar="ID", help="Claims such as V02; default: all.")] = None,
    strict: Annotated[bool, flag("--strict", "Exit code 1 for known failures too.")] = False,
    as_json: AsJson = False,
) -> None:
    """Check the verification table: claim, got, want, tolerance; exit code 1 for an unknown failure."""
    from taichi_erosion.verification import closed_forms
    from taichi_erosion.verification.claims import verify_claims

    def print_verdict(claim: "Claim") -> None:
        typer.echo(f"{claim.id} {output.claim_mark(claim.passed)}: {claim.claim}", err=True)

    full = import_source_module("tests.verification.ladder")
    ladder = full.LADDER if full else closed_forms.LADDER
    if full is None:
        typer.echo(f"short list {', '.join(ladder.checks)}; a source tree runs all claims", err=True)
    claims = verify_claims(ladder, tuple(ids or ()), on_claim=print_verdict)
    document = {"claims": [asdict(claim) | {"known_failure": ladder.is_known(claim)} for claim in claims]}
    output.print_result(document, as_json, output.print_claims)
    if any(not claim.passed and (strict or not ladder.is_known(claim)) for claim in claims):
        raise typer.Exit(ExitCode.FAILURE)


@app.command(**command_help("bench", CHECK))
def bench(
    arch: Annotated[Literal["cpu", "cuda"] | None, Option(help="Device; default: cpu.")] = None,
    large: Annotated[bool, flag("--large", "Also what fills a graphics processor; not for a CPU.")] = False,
    quick: Annotated[
        bool, flag("--quick", "Small cases, for a first try of a device; not for a CPU.")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Measure the speed: grain-steps per second and per core, and the time of each stage."""
    if (large and quick) or ((large or quick) and arch in (None, "cpu")):
        raise BadInput("--large or --quick, not both, is for --arch cuda")
    size = "large" if large else "quick" if quick else "usual"
    cases = import_source_module("benchmarks.cases")
    if cases is None:
        raise BadInput("bench: the timed cases are in the source tree, not in the installed program")
    with progress_report("timing") as progress:
        document = cases.run_benchmarks(progress, **typed_options(arch=arch, size=size))
    output.print_result(document, as_json, output.print_benchmark)


@app.command(**command_help("schema", CHECK))
def schema(
    to: Annotated[File, value("FILE", "Default: scenes/scene.schema.json.", "-o", "--output")] = None,
    study: Annotated[bool, flag("--study", "Of study files; default: doe/study.schema.json.")] = False,
    entry: Annotated[Text, value("PATH", "Print an entry or a section of scene files instead.")] = None,
) -> None:
    """Write the JSON schema of scene or study files, for completion and checks in editors."""
    from taichi_erosion.campaign.study_file import write_study_schema
    from taichi_erosion.scene import write_schema
    from taichi_erosion.scene.paths import describe_entry_at_path

    if entry is not None:
        typer.echo(describe_entry_at_path(entry))
        return
    target = to or Path("doe/study.schema.json" if study else "scenes/scene.schema.json")
    if not target.parent.is_dir():
        raise BadInput(f"{target}: no folder {target.parent}; name the file with -o")
    (write_study_schema if study else write_schema)(target)
    typer.echo(str(target))
