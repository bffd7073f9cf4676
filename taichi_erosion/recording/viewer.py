"""The rerun viewer: window, page for a browser, and pictures without a display."""

import gzip
import os
import shlex
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import quote
from urllib.request import urlopen

from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.files import mark_png, write_atomic
from taichi_erosion.recording.blueprint import TIMELINE
from taichi_erosion.recording.readback import NANOSECOND, open_whole_messages

if TYPE_CHECKING:
    from rerun.experimental import ViewerClient

LOOPBACK = "127.0.0.1"
START_LIMIT = 120.0  # s until a viewer answers
LOAD_LIMIT = 300.0  # s until a recording is loaded
POLL = 0.1  # s between two questions
DRAW_TIME = 1.5  # s for the software renderer to finish a view after the time was set
NOTICE_TIME = 6.0  # s after its start, in which the whole viewer shows a notice on its connection
SHOTS = 5  # calls for a picture before it is given up
ROUNDING = 1e-6  # of a time that the viewer counts in nanoseconds [1]
END_LIMIT = 5.0  # s in which a viewer that has lost its connection ends
NO_RENDERER = "no software renderer, no viewer: on Debian install mesa-vulkan-drivers and libvulkan1"


def viewer_command(port: int, *options: str | Path) -> list[str | Path]:
    """Command of the viewer that comes with rerun-sdk; its Python wrapper would outlive being ended."""
    import rerun_cli

    binary = Path(rerun_cli.__file__).parent / "rerun"
    return [binary, "--bind", LOOPBACK, "--port", str(port), *options]


def quiet_environment() -> dict[str, str]:
    """Environment of a viewer that sends no telemetry and leaves the user's settings alone."""
    return {**os.environ, "CI": "true", "RUST_LOG": "error"}


@contextmanager
def background_viewer(port: int, *options: str | Path) -> Iterator[subprocess.Popen[bytes]]:
    """A viewer that starts in the background and ends with the context."""
    silent, command = subprocess.DEVNULL, viewer_command(port, *options)
    process = subprocess.Popen(command, env=quiet_environment(), stdout=silent, stderr=silent)
    try:
        yield process
    finally:
        process.kill()  # it has nothing to put away
        process.wait()


def open_viewer(path: Path) -> int:
    """Show a recording in a window until the user closes it; returns the viewer's exit code.

    Raises BadInput without a screen.
    """
    with open_whole_messages(path) as whole:
        if sys.platform == "linux" and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
            named = shlex.quote(str(path))
            others = f"`view {named} --web` serves it to a browser, `snapshot {named} -o PNG` draws it"
            raise BadInput(f"{path}: no screen here; {others}")
        command = viewer_command(free_port(), whole.resolve())
        return subprocess.run(command, env=quiet_environment(), check=False).returncode


@dataclass(frozen=True)
class WebViewer:
    """A viewer for a browser on this machine."""

    page: int  # port of its page
    port: int  # receives recordings

    @property
    def sink(self) -> str:
        """Address for a recording that the viewer follows."""
        return f"rerun+http://{LOOPBACK}:{self.port}/proxy"

    @property
    def instructions(self) -> str:
        """How to open it, from this machine or from another one."""
        tunnel = " ".join(f"-L {port}:{LOOPBACK}:{port}" for port in (self.page, self.port))
        address = f"http://{LOOPBACK}:{self.page}/?url={quote(self.sink, safe='')}"
        return f"viewer: {address}\nfrom another machine: ssh {tunnel} THIS_MACHINE, then the same address"


@contextmanager
def serve_web_viewer(path: Path | None = None) -> Iterator[WebViewer]:
    """Serve the viewer on the loopback interface, with a recording or waiting for one."""
    with open_whole_messages(path) if path else nullcontext() as whole:
        page, sink = free_port(), free_port()
        files = [whole.resolve()] if whole else []
        with background_viewer(sink, "--serve-web", "--web-viewer-port", str(page), *files):
            poll_until(
                lambda: is_listening(page) and is_listening(sink), START_LIMIT, "the web viewer did not start"
            )
            yield WebViewer(page, sink)


def viewer_files() -> dict[str, bytes]:
    """Script and compiled program of the viewer for a page of one's own, compressed by gzip."""
    names = ("re_viewer.js", "re_viewer_bg.wasm")
    with serve_web_viewer() as served:
        addresses = {name: f"http://{LOOPBACK}:{served.page}/{name}" for name in names}
        return {name: gzip.compress(urlopen(address).read(), 1) for name, address in addresses.items()}


def is_listening(port: int) -> bool:
    """Whether a process listens on a port of the loopback interface."""
    with socket.socket() as probe:
        return probe.connect_ex((LOOPBACK, port)) == 0


def render_picture(
    path: Path,
    moment: float | None,
    out: Path,
    size: tuple[int, int] = (1280, 800),
    view: str | None = None,
    source: Path | None = None,
) -> Path:
    """PNG of the viewer at `moment` [s] of simulated time, None for the end; needs no display.

    `view` names the one view to draw alone, such as Grains; `source` is what the recording was made from, by
    which the picture is marked.
    """
    with headless_viewer(path, size) as client:
        end = last_moment(client)
        seconds = end if moment is None else moment
        if not 0.0 <= seconds <= end * (1.0 + ROUNDING):
            raise BadInput(f"--time {seconds:g}: {path} runs from 0 to {end:.6g} s")
        client.set_time(TIMELINE, duration=seconds, play_state="paused")
        time.sleep(DRAW_TIME if view else NOTICE_TIME)
        views = {each.name: each.view_id for each in client.get_state().views}
        if view is not None and view not in views:
            raise BadInput(f"{path}: no view '{view}', only {', '.join(sorted(views))}")
        picture = screenshot(client, views[view] if view else None)
        return write_atomic(out, mark_png(out, source or path, picture))


def screenshot(client: "ViewerClient", view_id: str | None = None) -> bytes:
    """PNG of the viewer or of one view; on a busy machine the software renderer may need several calls."""
    for _ in range(SHOTS):
        try:
            return client.take_screenshot(view_id)
        except TimeoutError:  # the client waits for some seconds only
            continue
    raise BadInput("the viewer draws nothing: the machine is too busy, or its renderer too slow")


def last_moment(client: "ViewerClient") -> float:
    """End of the simulated time of the recording on screen [s]."""
    timelines = [timeline for recording in client.get_state().recordings for timeline in recording.timelines]
    return NANOSECOND * max(timeline.end or 0 for timeline in timelines if timeline.name == TIMELINE)


@contextmanager
def headless_viewer(path: Path, size: tuple[int, int]) -> Iterator["ViewerClient"]:
    """A viewer without a window that has loaded a recording."""
    port = free_port()
    options = ("--headless", "--window-size", f"{size[0]}x{size[1]}", "--hide-welcome-screen")
    with open_whole_messages(path) as whole, background_viewer(port, *options) as process:
        client = connect_to_viewer(process, port)
        try:
            client.open(str(whole.resolve()))
            poll_until(lambda: has_loaded(client), LOAD_LIMIT, f"{path}: the viewer found no frame in it")
        except ConnectionError:  # without a renderer the viewer may answer once before it ends
            with suppress(subprocess.TimeoutExpired):
                process.wait(END_LIMIT)
                raise BadInput(NO_RENDERER) from None
            raise
        yield client


def connect_to_viewer(process: subprocess.Popen[bytes], port: int) -> "ViewerClient":
    """Client of a viewer that is starting; without a renderer the viewer ends at once or never answers."""
    from rerun.experimental import ViewerClient

    deadline = time.monotonic() + START_LIMIT
    while process.poll() is None and time.monotonic() < deadline:
        try:
            client = ViewerClient.connect(f"rerun+http://{LOOPBACK}:{port}/proxy")
            client.get_state()
        except Exception:  # the client has no error class for a viewer that is not there yet
            time.sleep(POLL)
        else:
            return client
    raise BadInput(NO_RENDERER)


def has_loaded(client: "ViewerClient") -> bool:
    state = client.get_state()
    return not state.loading and any(recording.timelines for recording in state.recordings)


def poll_until(condition: Callable[[], bool], limit: float, message: str) -> None:
    """Poll until a condition holds; BadInput with the message after `limit` [s]."""
    deadline = time.monotonic() + limit
    while not condition():
        if time.monotonic() > deadline:
            raise BadInput(message)
        time.sleep(POLL)


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind((LOOPBACK, 0))
        return probe.getsockname()[1]
