"""Prompt of a live session: one line is one command, from a terminal, a pipe or a file."""

import os
import shlex
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from inspect import signature
from math import inf, isfinite
from pathlib import Path
from time import monotonic

import numpy as np
import typer

from taichi_erosion.core.errors import BadInput, SimulationStopped, did_you_mean
from taichi_erosion.recording import stream
from taichi_erosion.recording.pictures import terminal_colours, terminal_shades
from taichi_erosion.run import session as live
from taichi_erosion.run.session import Session
from taichi_erosion.scene import resolved
from taichi_erosion.scene.paths import leaves

PROMPT = "erosion> "
PICTURE_COLUMNS = 72
WATCH_INTERVAL = 1.0  # s of wall time between two lines of watched numbers
WIDTH, HEIGHT = 64, 12  # characters of the curve
MARK, EMPTY = "*", " "

HELP = """\
step [N]                   run N time steps
run TIME | run until rest  run for a simulated time, such as 0.5s
run to TIME                run to a simulated time
stage                      begin the next stage of the scene
set PATH VALUE             change an entry of the scene during the run
get PATH                   show an entry of the scene
measure                    evaluate the scene's measures now
plot NAME [FILE]           curve of a number so far, here or as PNG
watch NAME... | watch off  print numbers once a second while it runs
diff [NAME [NAME]]         entries changed since the scene file or a saved state, or between two
status                     time, grains, energies
show                       a small picture and the numbers
snapshot FILE              write the picture as PNG
save [NAME]                save the state
back [NAME]                return to a saved state
history                    commands that lead to the present state
script FILE                run the commands in a file
help [PATH]                this list; or meaning, unit and range of an entry
quit                       end the session"""


def step(session: Session, count: str = "1") -> str:
    if not count.isdigit():
        raise BadInput(f"'{count}' is not a number of steps")
    live.step(session, int(count))
    return status(session)


def run(session: Session, *time: str) -> str:
    if time == ("until", "rest"):
        is_at_rest = live.run_until_rest(session)
        return status(session) + ("" if is_at_rest else "  (time limit of the stage, not at rest)")
    start = 0.0 if time[:1] == ("to",) else session.time
    try:
        seconds = float(" ".join(time).removeprefix("to").removesuffix("s"))
    except ValueError:
        raise BadInput(f"'{' '.join(time)}' is not a duration; write for example 0.5s") from None
    live.run_to(session, start + seconds)
    return status(session)


def set_entry(session: Session, path: str, value: str) -> str:
    before = live.warnings_now(session)
    done = live.set_entry(session, path, value)
    new = [f"\nwarning: {each}" for each in live.warnings_now(session) if each not in before]
    return f"{path} = {value} {done}{''.join(new)}"


def measure(session: Session) -> str:
    lines, faults = [], []
    for name, found in live.measure_now(session).items():
        reason = ", ".join(found.notes[:1]) or "the state holds none"
        value = f"{name} = {found.value:.5g} {found.unit}"
        lines.append(value if isfinite(found.value) else f"{name}: no value, {reason}")
        for lack in found.shortfalls:
            faults.append(f"{'limit' if lack.stated else 'warning'}: {name}: {lack.sentence}")
    return "\n".join([*lines, *faults]) or "the scene has no measures"


def plot(session: Session, name: str, file: str = "") -> str:
    time, value = live.curve(session, name)
    if not file:
        return text_plot(time, value, name)
    from taichi_erosion.report.figure_style import curve_figure, raster

    return str(live.write_file(session, Path(file), raster(curve_figure(time, value, name))))


def text_plot(time: Sequence[float], value: Sequence[float], name: str) -> str:
    """Curve with its range on the left and the time [s] below; values that are not finite leave gaps."""
    known = np.isfinite(value)
    if not known.any():
        return f"{name}: no value yet"
    t, y = np.asarray(time)[known], np.asarray(value)[known]
    columns = np.interp(t, (t[0], t[-1]), (0, WIDTH - 1)).round().astype(int)
    rows = np.interp(y, (y.min(), y.max()), (HEIGHT - 1, 0)).round().astype(int)
    cells = np.full((HEIGHT, WIDTH), EMPTY)
    cells[rows, columns] = MARK
    labels = [f"{y.max():.4g}", *[""] * (HEIGHT - 2), f"{y.min():.4g}"]
    margin = max(map(len, labels))
    lines = [f"{label:>{margin}} |{''.join(row).rstrip()}" for label, row in zip(labels, cells, strict=True)]
    begin, end = f"{t[0]:.4g}", f"{t[-1]:.4g} s"
    lines += [f"{'':>{margin}} +{'-' * WIDTH}", f"{'':>{margin}}  {begin}{end:>{WIDTH - len(begin)}}"]
    return "\n".join([name, *lines])


def watch(session: Session, *names: str) -> str:
    if names == ("off",):
        session.watched.clear()
    else:
        live.watch(session, *names)
    return f"watching {', '.join(session.watched) or 'nothing'}"


@dataclass
class Sampler:
    """Callback that keeps the numbers of every check for `plot`, and prints those that are watched."""

    printed: float = -inf  # s of the monotonic clock, at the latest print

    def __call__(self, session: Session) -> None:
        now = live.keep_sample(session)
        if session.watched and monotonic() - self.printed >= WATCH_INTERVAL:
            self.printed = monotonic()
            told = (f"{name} {now[name]:.5g} {unit}".rstrip() for name, unit in session.watched.items())
            typer.echo(f"{now['time_s']:.6g} s  {'  '.join(told)}")


def diff(session: Session, before: str | None = None, after: str | None = None) -> str:
    found = live.differences(session, before, after).items()
    return "\n".join(f"{path}: {old} -> {new}" for path, (old, new) in found) or "no entry differs"


def status(session: Session) -> str:
    return "  ".join(
        f"{name} {value:.5g}" if isinstance(value, float) else f"{name} {value}"
        for name, value in live.session_status(session).items()
    )


def show(session: Session) -> str:
    image = live.side_picture(session, is_lettered=False)
    has_colours = sys.stdout.isatty() and "NO_COLOR" not in os.environ
    drawn = terminal_colours if has_colours else terminal_shades
    return f"{drawn(image, PICTURE_COLUMNS)}\n{status(session)}"


def save(session: Session, name: str = "last") -> str:
    live.save(session, name)
    return f"saved as '{name}' at {session.time:.6g} s"


def back(session: Session, name: str = "last") -> str:
    live.restore(session, name)
    return status(session)


def script(session: Session, file: str) -> str:
    if not Path(file).is_file():
        raise BadInput(f"{file}: no such file")
    texts = []
    for number, line in enumerate(Path(file).read_text(encoding="utf-8").splitlines(), start=1):
        try:
            texts.append(execute(session, line))
        except BadInput as error:
            raise BadInput(f"{file}: line {number}: {error}") from None
    return "\n".join(filter(None, texts))


def help_text(session: Session, path: str = "") -> str:
    if path in COMMANDS:
        return usage(path)
    return live.meaning(session, path) if path else HELP


def usage(name: str) -> str:
    """Line of the help on a command."""
    return next(line for line in HELP.split("\n") if line.startswith(f"{name} "))


def quit_session(session: Session) -> str:
    raise EOFError


COMMANDS: dict[str, Callable[..., str]] = {  # of a session and the words behind the name: the text to print
    "step": step,
    "run": run,
    "stage": lambda session: f"stage {live.next_stage(session)} begins",
    "set": set_entry,
    "get": lambda session, path: f"{path} = {live.entry(session, path)}",
    "measure": measure,
    "plot": plot,
    "watch": watch,
    "diff": diff,
    "status": status,
    "show": show,
    "snapshot": lambda session, file: str(live.write_picture(session, Path(file))),
    "save": save,
    "back": back,
    "history": lambda session: "\n".join(session.history),
    "script": script,
    "help": help_text,
    "quit": quit_session,
}


def execute(session: Session, line: str) -> str:
    """Text of one line's command; "" for a comment. Raises BadInput, SimulationStopped, EOFError."""
    try:
        name, *words = shlex.split(line, comments=True) or [""]
    except ValueError as error:
        raise BadInput(f"{line.strip()}: {error}; a text in quotes needs both") from None
    if not name:
        return ""
    if name not in COMMANDS:
        meant = did_you_mean(name, COMMANDS)
        raise BadInput(f"'{name}' is not a command{meant}; the commands are {', '.join(COMMANDS)}")
    try:
        signature(COMMANDS[name]).bind(session, *words)
    except TypeError:
        raise BadInput(f"usage: {usage(name)}") from None
    return COMMANDS[name](session, *words)


def input_lines(session: Session) -> Iterator[str]:
    """Lines of a terminal, with completion where readline is installed, or of a pipe, which are echoed."""
    if sys.stdin.isatty():
        enable_completion(session)
        while True:
            yield input(PROMPT)
    for line in sys.stdin:
        if line.strip():
            typer.echo(f"{PROMPT}{line.strip()}")
        yield line


def enable_completion(session: Session) -> None:
    """Complete commands, and dotted paths of the scene, by the tab key."""
    try:
        import readline
    except ImportError:
        return

    def complete(text: str, state: int) -> str | None:
        paths = sorted(path for path, _ in leaves(resolved(session.scene)))
        found = [word for word in (*COMMANDS, *paths) if word.startswith(text)]
        return found[state] if state < len(found) else None

    readline.set_completer_delims(" ")
    readline.set_completer(complete)
    readline.parse_and_bind("tab: complete")


def run_prompt(session: Session, path: Path, viewer: str | None) -> None:
    """Run commands to the end of the input, with a growing recording for a viewer.

    An error ends a session of a pipe; in a terminal it is printed.
    """
    recorder = live.record_session(session, path, viewer)
    session.callbacks.append(Sampler())
    for sentence in live.warnings_now(session):
        typer.echo(f"warning: {sentence}")
    try:
        for line in input_lines(session):
            try:
                text = execute(session, line)
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
        typer.echo(f"recording {stream.close(recorder.recording)}")
