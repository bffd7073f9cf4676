"""Terminal of a live session: commands are typed, or come from a pipe."""

import sys
from collections.abc import Iterator
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from math import inf
from pathlib import Path
from threading import Event
from time import monotonic
from typing import Any

import typer

from taichi_erosion.api.page import Page
from taichi_erosion.api.prompt import COMMANDS, execute_line
from taichi_erosion.core.errors import BadInput, SimulationStopped
from taichi_erosion.execution import session as live
from taichi_erosion.execution.recorder import Recorder, log_present_frame, open_recorder
from taichi_erosion.execution.scene_run import defer_signals, scene_text_with_overrides
from taichi_erosion.execution.session import Session
from taichi_erosion.execution.stages import count_whole_intervals
from taichi_erosion.recording import stream
from taichi_erosion.scene import resolve
from taichi_erosion.scene.paths import leaf_entries

PROMPT = "erosion> "
WATCH_INTERVAL = 1.0  # s of wall time between two lines of watched numbers


@dataclass
class Sampler:
    """Callback that prints the numbers that are watched."""

    latest_print: float = -inf  # s of the monotonic clock, at the latest print

    def __call__(self, session: Session) -> None:
        now = session.samples[-1]
        if session.watched and monotonic() - self.latest_print >= WATCH_INTERVAL:
            self.latest_print = monotonic()
            numbers = (f"{name} {now[name]:.5g} {unit}".rstrip() for name, unit in session.watched.items())
            typer.echo(f"{now['time_s']:.6g} s  {'  '.join(numbers)}")


@dataclass
class SessionRecorder:
    """Callback that writes a frame when one is due.

    A recording holds one history: where the session went back, it ends and a new one goes on.
    """

    path: Path  # of the first recording
    recorder: Recorder
    returns: int  # of the session to earlier states, when the present recording was begun
    latest: float = -inf  # s, time of the latest frame

    def __call__(self, session: Session) -> None:
        if self.returns != session.returns:
            before = stream.close(self.recorder.recording)
            new = open_session_recorder(session, after := live.unused_path(self.path))
            self.recorder, self.returns, self.latest = new.recorder, new.returns, new.latest
            typer.echo(f"{before} ends where the session went back; {after} goes on from there")
        due = count_whole_intervals(session.time, session.scene.record.every) + 1
        if due != self.recorder.frames:
            self.recorder.frames = due
            self.log_frame(session)

    def log_frame(self, session: Session) -> None:
        log_present_frame(self.recorder, session.sim, session.scene)
        self.latest = session.time

    def close(self, session: Session) -> Path:
        """Write the state at the end, unless it is there or of another history, and close the file."""
        if session.time > self.latest and self.returns == session.returns and session.state.failure is None:
            self.log_frame(session)
        return stream.close(self.recorder.recording)


def open_session_recorder(session: Session, path: Path) -> SessionRecorder:
    """Begin a recording of a session. Raises BadInput."""
    text = scene_text_with_overrides(session.path, session.overrides)
    title = f"{session.scene.scene.title or session.path.stem}, live"
    return SessionRecorder(
        path, open_recorder(path, title, text, session.sim, session.scene, 0), session.returns
    )


def input_lines(session: Session, stays: bool) -> Iterator[str]:
    """Lines of a terminal, with completion where readline is installed, or of a pipe, which are echoed.

    `stays`: the session is not at its end with a pipe.
    """
    if sys.stdin.isatty():
        enable_completion(session)
        while True:
            yield input(PROMPT)
    for line in sys.stdin:
        if line.strip():
            typer.echo(f"{PROMPT}{line.strip()}")
        yield line
    if stays:
        Event().wait()


def enable_completion(session: Session) -> None:
    """Complete commands, and dotted paths of the scene, by the tab key."""
    try:
        import readline
    except ImportError:
        return

    def nth_completion(text: str, state: int) -> str | None:
        paths = sorted(path for path, _ in leaf_entries(resolve(session.scene)))
        completions = [word for word in (*COMMANDS, *paths) if word.startswith(text)]
        return completions[state] if state < len(completions) else None

    readline.set_completer_delims(" ")
    readline.set_completer(nth_completion)
    readline.parse_and_bind("tab: complete")


def run_prompt(session: Session, path: Path, page: Page | None = None) -> None:
    """Run commands to the end of the input, with a growing recording, beside a page.

    An error ends a session of a pipe; in a terminal it is printed. A page stays until Ctrl-C.
    """
    recorder = open_session_recorder(session, path)
    session.callbacks += [recorder, Sampler()]
    for sentence in live.warnings_of_present_scene(session):
        typer.echo(f"warning: {sentence}")
    try:
        for line in input_lines(session, page is not None):
            try:
                text = run_interruptible_line(session, line, page.turn if page else nullcontext())
            except (BadInput, SimulationStopped) as error:
                if not sys.stdin.isatty():
                    raise
                text = str(error)
            except KeyboardInterrupt:
                text = "interrupted; the session is at its last check"
            if text:
                typer.echo(text)
    except EOFError:
        return
    finally:
        typer.echo(f"recording {recorder.close(session)}")


def run_interruptible_line(session: Session, line: str, turn: AbstractContextManager[Any]) -> str:
    """Text of a command; Ctrl-C ends a run between two advances, so that device and session agree."""
    with turn, defer_signals() as pending:
        session.callbacks.append(callback := lambda now: pending.raise_first_signal())
        try:
            return execute_line(session, line)
        finally:
            session.callbacks.remove(callback)
