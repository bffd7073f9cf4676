"""Prompt of a live session: one line is one command, from a terminal, a pipe or a file."""

import os
import shlex
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from math import inf, isfinite
from pathlib import Path
from time import monotonic

import numpy as np
import typer

from taichi_erosion.core.errors import BadInput, SimulationStopped, did_you_mean
from taichi_erosion.measures.result import Measurement
from taichi_erosion.recording import stream
from taichi_erosion.recording.pictures import terminal_colours, terminal_shades
from taichi_erosion.run import session as live
from taichi_erosion.run.session import Session
from taichi_erosion.scene import resolved
from taichi_erosion.scene.paths import leaves

PROMPT = "erosion> "
PICTURE_COLUMNS = 72
TIME_SUFFIX = "s"
WATCH_INTERVAL = 1.0  # s of wall time between two lines of watched numbers
WIDTH, HEIGHT = 64, 12  # characters of the curve
MARK, EMPTY = "*", " "


@dataclass(frozen=True)
class LiveCommand:
    """Command of a session; `run` returns the text to print."""

    usage: str
    meaning: str
    run: Callable[[Session, list[str]], str]


def seconds(word: str) -> float:
    """Duration [s] from `0.5s` or `0.5`."""
    try:
        return float(word.removesuffix(TIME_SUFFIX))
    except ValueError:
        raise BadInput(f"'{word}' is not a duration; write for example 0.5s") from None


def only(words: list[str], command: str) -> str:
    """The single argument of a command. Raises BadInput with its usage otherwise."""
    if len(words) != 1:
        raise BadInput(f"usage: {COMMANDS[command].usage}")
    return words[0]


def step(session: Session, words: list[str]) -> str:
    word = words[0] if words else "1"
    if not word.isdigit():
        raise BadInput(f"'{word}' is not a number of steps")
    live.step(session, int(word))
    return status(session)


def run(session: Session, words: list[str]) -> str:
    if words == ["until", "rest"]:
        is_at_rest = live.run_until_rest(session)
        return status(session) + ("" if is_at_rest else "  (time limit of the stage, not at rest)")
    live.run_for(session, seconds(only(words, "run")))
    return status(session)


def set_entry(session: Session, words: list[str]) -> str:
    if len(words) != 2:
        raise BadInput(f"usage: {COMMANDS['set'].usage}")
    before = live.warnings_now(session)
    done = live.set_entry(session, words[0], words[1])
    new = [f"\nwarning: {each}" for each in live.warnings_now(session) if each not in before]
    return f"{words[0]} = {words[1]} {done}{''.join(new)}"


def get_entry(session: Session, words: list[str]) -> str:
    path = only(words, "get")
    return f"{path} = {live.entry(session, path)}"


def measure(session: Session, words: list[str]) -> str:
    found = live.measure_now(session).values()
    lines = [spoken(each) for each in found]
    for each in found:
        for lack in each.shortfalls:
            lines.append(f"{'limit' if lack.stated else 'warning'}: {each.name}: {lack.sentence}")
    return "\n".join(lines) or "the scene has no measures"


def spoken(found: Measurement) -> str:
    """A measure with its unit; without a value the reason."""
    if isfinite(found.value):
        return f"{found.name} = {found.value:.5g} {found.unit}"
    return f"{found.name}: no value, {found.notes[0] if found.notes else 'the state holds none'}"


def plot(session: Session, words: list[str]) -> str:
    """Curve of a number over the session so far, in the terminal or as PNG."""
    if not 1 <= len(words) <= 2:
        usage = f"usage: {COMMANDS['plot'].usage}"
        raise BadInput(f"{usage}; NAME is one of {', '.join(live.number_names(session))}")
    name, *files = words
    time, value = live.curve(session, name)
    if not files:
        return text_plot(time, value, name)
    from taichi_erosion.report.figure_style import curve_figure, raster

    return str(live.write_file(session, Path(files[0]), raster(curve_figure(time, value, name))))


def text_plot(time: Sequence[float], value: Sequence[float], name: str) -> str:
    """Curve with its range on the left and the time [s] below; values that are not finite leave gaps."""
    t, y = np.asarray(time, dtype=float), np.asarray(value, dtype=float)
    known = np.isfinite(y)
    if not known.any():
        return f"{name}: no value yet"
    t, y = t[known], y[known]
    low, high = float(y.min()), float(y.max())
    across = np.zeros(t.size) if np.ptp(t) == 0.0 else (t - t[0]) / np.ptp(t)
    up = np.full(t.size, 0.5) if high == low else (y - low) / (high - low)
    cells = [[EMPTY] * WIDTH for _ in range(HEIGHT)]
    for column, row in zip((across * (WIDTH - 1)).round(), (up * (HEIGHT - 1)).round(), strict=True):
        cells[HEIGHT - 1 - int(row)][int(column)] = MARK
    labels = [f"{high:.4g}", *[""] * (HEIGHT - 2), f"{low:.4g}"]
    margin = max(map(len, labels))
    lines = [f"{label:>{margin}} |{''.join(row).rstrip()}" for label, row in zip(labels, cells, strict=True)]
    begin, end = f"{t[0]:.4g}", f"{t[-1]:.4g} s"
    gap = max(WIDTH - len(begin) - len(end), 1)
    axis = f"{'':>{margin}} +{'-' * WIDTH}\n{'':>{margin}}  {begin}{'':>{gap}}{end}"
    return "\n".join([name, *lines, axis])


def diff(session: Session, words: list[str]) -> str:
    """Entries that differ: from the scene file, or from a saved state to another or to the present."""
    if len(words) > 2:
        raise BadInput(f"usage: {COMMANDS['diff'].usage}")
    found = live.differences(session, *words).items()
    return "\n".join(f"{path}: {old} -> {new}" for path, (old, new) in found) or "no entry differs"


def watch(session: Session, words: list[str]) -> str:
    """Print numbers while the scene runs, once a second, until `watch off`."""
    if words == ["off"]:
        session.watched.clear()
        return "watching nothing"
    live.watch(session, *words)
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


def status(session: Session) -> str:
    return "  ".join(
        f"{name} {value:.5g}" if isinstance(value, float) else f"{name} {value}"
        for name, value in live.session_status(session).items()
    )


def show(session: Session, words: list[str]) -> str:
    image = live.side_picture(session, is_lettered=False)
    has_colours = sys.stdout.isatty() and "NO_COLOR" not in os.environ
    drawn = terminal_colours if has_colours else terminal_shades
    return f"{drawn(image, PICTURE_COLUMNS)}\n{status(session)}"


def save(session: Session, words: list[str]) -> str:
    name = words[0] if words else "last"
    live.save(session, name)
    return f"saved as '{name}' at {session.time:.6g} s"


def back(session: Session, words: list[str]) -> str:
    live.restore(session, words[0] if words else "last")
    return status(session)


def script(session: Session, words: list[str]) -> str:
    path = Path(only(words, "script"))
    if not path.is_file():
        raise BadInput(f"{path}: no such file")
    texts = []
    for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), start=1):
        try:
            texts.append(execute(session, line))
        except BadInput as error:
            raise BadInput(f"{path}: line {number}: {error}") from None
    return "\n".join(text for text in texts if text)


def help_text(session: Session, words: list[str]) -> str:
    if words:
        return COMMANDS[words[0]].meaning if words[0] in COMMANDS else live.meaning(session, words[0])
    width = max(len(command.usage) for command in COMMANDS.values())
    return "\n".join(f"{command.usage:<{width}}  {command.meaning}" for command in COMMANDS.values())


COMMANDS = {
    "step": LiveCommand("step [N]", "run N time steps", step),
    "run": LiveCommand("run TIME | run until rest", "run for a simulated time, such as 0.5s", run),
    "stage": LiveCommand(
        "stage",
        "begin the next stage of the scene",
        lambda session, words: f"stage {live.next_stage(session)} begins",
    ),
    "set": LiveCommand("set PATH VALUE", "change an entry of the scene during the run", set_entry),
    "get": LiveCommand("get PATH", "show an entry of the scene", get_entry),
    "measure": LiveCommand("measure", "evaluate the scene's measures now", measure),
    "plot": LiveCommand("plot NAME [FILE]", "curve of a number so far, here or as PNG", plot),
    "watch": LiveCommand("watch NAME... | watch off", "print numbers once a second while it runs", watch),
    "diff": LiveCommand(
        "diff [NAME [NAME]]", "entries changed since the scene file or a saved state, or between two", diff
    ),
    "status": LiveCommand("status", "time, grains, energies", lambda session, words: status(session)),
    "show": LiveCommand("show", "a small picture and the numbers", show),
    "snapshot": LiveCommand(
        "snapshot FILE",
        "write the picture as PNG",
        lambda session, words: str(live.write_picture(session, Path(only(words, "snapshot")))),
    ),
    "save": LiveCommand("save [NAME]", "save the state", save),
    "back": LiveCommand("back [NAME]", "return to a saved state", back),
    "history": LiveCommand("history", "commands so far", lambda session, words: "\n".join(session.history)),
    "script": LiveCommand("script FILE", "run the commands in a file", script),
    "help": LiveCommand("help [PATH]", "this list; or meaning, unit and range of an entry", help_text),
    "quit": LiveCommand("quit", "end the session", lambda session, words: ""),
}


def execute(session: Session, line: str) -> str:
    """Text of one line's command; "" for a comment. Raises BadInput, SimulationStopped."""
    try:
        words = shlex.split(line, comments=True)
    except ValueError as error:
        raise BadInput(f"{line.strip()}: {error}; a text in quotes needs both") from None
    if not words:
        return ""
    if words[0] not in COMMANDS:
        meant = did_you_mean(words[0], COMMANDS)
        raise BadInput(f"'{words[0]}' is not a command{meant}; the commands are {', '.join(COMMANDS)}")
    text = COMMANDS[words[0]].run(session, words[1:])
    session.history.append(line.strip())
    return text


def input_lines(session: Session) -> Iterator[str]:
    """Lines of a terminal, with completion where readline is installed, or of a pipe."""
    if not sys.stdin.isatty():
        yield from (line.rstrip("\n") for line in sys.stdin)
        return
    enable_completion(session)
    while True:
        try:
            yield input(PROMPT)
        except EOFError:
            return


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


def read_commands(session: Session, lines: Iterable[str], is_strict: bool) -> None:
    """Run line after line and print the texts; an error ends a strict session, and is printed otherwise."""
    for line in lines:
        if is_strict and line.strip():
            typer.echo(f"{PROMPT}{line.strip()}")
        if line.strip() == "quit":
            return
        try:
            text = execute(session, line)
        except (BadInput, SimulationStopped) as error:
            if is_strict:
                raise
            text = str(error)
        except KeyboardInterrupt:
            text = "interrupted; the session is at its last check"
        if text:
            typer.echo(text)


def run_prompt(session: Session, path: Path, viewer: str | None) -> None:
    """Run commands to the end of the input, with a growing recording for a viewer."""
    recorder = live.record_session(session, path, viewer)
    session.callbacks.append(Sampler())
    for sentence in live.warnings_now(session):
        typer.echo(f"warning: {sentence}")
    try:
        read_commands(session, input_lines(session), is_strict=not sys.stdin.isatty())
    finally:
        typer.echo(f"recording {stream.close(recorder.recording)}")
