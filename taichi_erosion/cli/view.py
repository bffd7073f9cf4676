"""Looking at a recording: a window, a page in a browser, a picture, files for ParaView."""

import threading
from pathlib import Path
from typing import Annotated

import typer

RecordingFile = Annotated[
    Path, typer.Argument(metavar="FILE", help="Recording (.rrd).", exists=True, dir_okay=False)
]
RecordingOrStudy = Annotated[
    Path,
    typer.Argument(
        metavar="FILE|STUDY",
        help="Recording (.rrd), or study (TOML) that has been worked on.",
        exists=True,
        dir_okay=False,
    ),
]


def recording_of(file: Path) -> Path:
    """The recording itself; that of a study is put together from what the study has left."""
    if file.suffix != ".toml":
        return file
    from taichi_erosion.report import write_recording

    return write_recording(file)


def view(
    file: RecordingOrStudy,
    web: Annotated[bool, typer.Option("--web", help="Serve a page for a browser of this machine.")] = False,
) -> None:
    """Open a run or a study in the rerun viewer: a window, or a page in a browser."""
    if not web:
        from taichi_erosion.recording.viewer import open_viewer

        raise typer.Exit(open_viewer(recording_of(file)))
    from taichi_erosion.recording.viewer import web_viewer

    with web_viewer(recording_of(file)) as served:
        typer.echo(f"{served.words}\nCtrl-C ends it", err=True)
        wait_for_interrupt()


def wait_for_interrupt() -> None:
    """Wait until the user has seen enough."""
    try:
        threading.Event().wait()
    except KeyboardInterrupt:
        return


def snapshot(
    file: RecordingOrStudy,
    time: Annotated[
        float | None, typer.Option(metavar="T", help="Simulated time in seconds; the end if left out.")
    ] = None,
    to: Annotated[
        Path | None,
        typer.Option("-o", "--output", metavar="PNG", help="The picture; FILE.snapshot.png if left out."),
    ] = None,
    only: Annotated[
        str | None, typer.Option("--view", metavar="NAME", help="One view alone, such as Grains.")
    ] = None,
) -> None:
    """Draw one moment of a run, or a study, without a screen."""
    from taichi_erosion.recording.viewer import picture

    picture_file = to or file.with_suffix(".snapshot.png")
    typer.echo(str(picture(recording_of(file), time, picture_file, view=only)))


def export(
    file: RecordingFile,
    vtk: Annotated[Path, typer.Option("--vtk", metavar="DIR", help="Folder for the VTK files.")],
) -> None:
    """Write the grains of a recording for ParaView."""
    from taichi_erosion.recording.export import export_vtk

    typer.echo(str(export_vtk(file, vtk)))
