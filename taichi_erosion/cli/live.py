"""The prompt of a live session: one line is one order, from a terminal, a pipe or a file."""

import os
import shlex
import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from taichi_erosion.core.errors import BadInput, SimulationStopped

if TYPE_CHECKING:
    from taichi_erosion.run.session import Session

PROMPT = "erosion> "
PICTURE_COLUMNS = 72
TIME_SUFFIX = "s"


@dataclass(frozen=True)
class Order:
    """One word that a session understands."""

    usage: str
    meaning: str
    act: Callable[["Session", list[str]], str]


def seconds(word: str) -> float:
    """A duration as `0.5s` or `0.5`."""
    try:
        return float(word.removesuffix(TIME_SUFFIX))
    except ValueError:
        raise BadInput(f"'{word}' is not a duration; write for example 0.5s") from None


def one(words: list[str], usage: str) -> str:
    """The only word after an order."""
    if len(words) != 1:
        raise BadInput(f"usage: {usage}")
    return words[0]


def step(session: "Session", words: list[str]) -> str:
    from taichi_erosion.run import session as live

    word = words[0] if words else "1"
    if not word.isdigit():
        raise BadInput(f"'{word}' is not a number of steps")
    live.step(session, int(word))
    return status(session)


def run(session: "Session", words: list[str]) -> str:
    from taichi_erosion.run import session as live

    if words == ["until", "rest"]:
        rested = live.run_until_rest(session)
        return status(session) + ("" if rested else "  (time limit of the stage, not at rest)")
    live.run_for(session, seconds(one(words, ORDERS["run"].usage)))
    return status(session)


def stage(session: "Session", words: list[str]) -> str:
    from taichi_erosion.run import session as live

    return f"stage {live.next_stage(session)} begins"


def change(session: "Session", words: list[str]) -> str:
    from taichi_erosion.run import session as live

    if len(words) != 2:
        raise BadInput(f"usage: {ORDERS['set'].usage}")
    return f"{words[0]} = {words[1]} {live.set_entry(session, words[0], words[1])}"


def entry(session: "Session", words: list[str]) -> str:
    from taichi_erosion.scene import resolved

    found: Any = resolved(session.scene)
    for key in one(words, ORDERS["get"].usage).split("."):
        if not isinstance(found, dict) or key not in found:
            near = ", ".join(found) if isinstance(found, dict) else "nothing"
            raise BadInput(f"no entry '{words[0]}'; below it there is {near}")
        found = found[key]
    return f"{words[0]} = {found}"


def measured(session: "Session", words: list[str]) -> str:
    from taichi_erosion.run import session as live

    lines = [f"{m.name} = {m.value:.5g} {m.unit}" for m in live.measure_now(session).values()]
    return "\n".join(lines) or "the scene names nothing to measure"


def status(session: "Session") -> str:
    from taichi_erosion.run import session as live_view

    found = live_view.session_status(session)
    return "  ".join(
        f"{name} {value:.5g}" if isinstance(value, float) else f"{name} {value}"
        for name, value in found.items()
    )


def show(session: "Session", words: list[str]) -> str:
    from taichi_erosion.recording.pictures import in_colour, in_shades
    from taichi_erosion.run import session as live_view

    image = live_view.side_picture(session, is_lettered=False)
    has_colours = sys.stdout.isatty() and "NO_COLOR" not in os.environ
    drawn = in_colour if has_colours else in_shades
    return f"{drawn(image, PICTURE_COLUMNS)}\n{status(session)}"


def picture(session: "Session", words: list[str]) -> str:
    from taichi_erosion.run import session as live_view

    return str(live_view.write_picture(session, Path(one(words, ORDERS["snapshot"].usage))))


def save(session: "Session", words: list[str]) -> str:
    from taichi_erosion.run import session as live

    name = words[0] if words else "last"
    live.save(session, name)
    return f"saved as '{name}' at {session.time:.6g} s"


def back(session: "Session", words: list[str]) -> str:
    from taichi_erosion.run import session as live

    live.restore(session, words[0] if words else "last")
    return status(session)


def history(session: "Session", words: list[str]) -> str:
    return "\n".join(session.history)


def script(session: "Session", words: list[str]) -> str:
    path = Path(one(words, ORDERS["script"].usage))
    if not path.is_file():
        raise BadInput(f"{path}: no such file")
    said = [obey(session, line) for line in path.read_text(encoding="utf-8").splitlines()]
    return "\n".join(text for text in said if text)


def explain(session: "Session", words: list[str]) -> str:
    if words:
        return describe_entry(words[0])
    width = max(len(order.usage) for order in ORDERS.values())
    return "\n".join(f"{order.usage:<{width}}  {order.meaning}" for order in ORDERS.values())


def describe_entry(path: str) -> str:
    """Unit and range of a scene's entry, or what an order does."""
    from taichi_erosion.scene.paths import meaning_of

    return ORDERS[path].meaning if path in ORDERS else meaning_of(path)


ORDERS = {
    "step": Order("step [N]", "run N time steps", step),
    "run": Order("run TIME | run until rest", "run for a simulated time, such as 0.5s", run),
    "stage": Order("stage", "begin the next stage of the scene", stage),
    "set": Order("set PATH VALUE", "change an entry of the scene while it runs", change),
    "get": Order("get PATH", "show an entry of the scene", entry),
    "measure": Order("measure", "read the scene's observables now", measured),
    "status": Order("status", "time, grains, energies", lambda session, words: status(session)),
    "show": Order("show", "a small picture and the numbers", show),
    "snapshot": Order("snapshot FILE", "write the picture as PNG", picture),
    "save": Order("save [NAME]", "keep the state", save),
    "back": Order("back [NAME]", "return to a kept state", back),
    "history": Order("history", "what was ordered so far", history),
    "script": Order("script FILE", "obey the lines of a file", script),
    "help": Order("help [PATH]", "this list; or meaning, unit and range of an entry", explain),
    "quit": Order("quit", "end the session", lambda session, words: ""),
}


def obey(session: "Session", line: str) -> str:
    """Carry out one line; empty lines and comments say nothing. Raises BadInput, SimulationStopped."""
    words = shlex.split(line, comments=True)
    if not words:
        return ""
    if words[0] not in ORDERS:
        raise BadInput(f"'{words[0]}' is not an order; there are {', '.join(ORDERS)}")
    said = ORDERS[words[0]].act(session, words[1:])
    session.history.append(line.strip())
    return said


def typed_lines(session: "Session") -> Iterator[str]:
    """Lines of a terminal, with completion where readline is there, or of a pipe."""
    if not sys.stdin.isatty():
        yield from (line.rstrip("\n") for line in sys.stdin)
        return
    complete_words(session)
    while True:
        try:
            yield input(PROMPT)
        except EOFError:
            return


def complete_words(session: "Session") -> None:
    """Complete orders, and dotted paths of the scene."""
    try:
        import readline
    except ImportError:
        return
    from taichi_erosion.scene.paths import scene_paths

    def complete(text: str, state: int) -> str | None:
        known = [*ORDERS, *scene_paths(session.scene)]
        found = [word for word in known if word.startswith(text)]
        return found[state] if state < len(found) else None

    readline.set_completer_delims(" ")
    readline.set_completer(complete)
    readline.parse_and_bind("tab: complete")


def converse(session: "Session", lines: Iterable[str], is_strict: bool) -> None:
    """Obey line after line; a strict session ends at the first mistake, a typed one says it and goes on."""
    for line in lines:
        if line.strip() == "quit":
            return
        try:
            said = obey(session, line)
        except (BadInput, SimulationStopped) as error:
            if is_strict:
                raise
            said = str(error)
        except KeyboardInterrupt:
            said = "interrupted; the session stands at the last check"
        if said:
            typer.echo(said)


def live(
    scene: Annotated[Path, typer.Argument(metavar="SCENE", help="Scene file (TOML).")],
    override: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="PATH=VALUE", help="Change one entry; may be repeated."),
    ] = None,
    seed: Annotated[int | None, typer.Option(min=0, help="Seed of the grains.")] = None,
    record: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Recording that grows meanwhile.")
    ] = None,
    viewer: Annotated[
        str | None,
        typer.Option(metavar="URL", help="Viewer that follows, such as rerun+http://127.0.0.1:9876/proxy."),
    ] = None,
    web: Annotated[bool, typer.Option("--web", help="Serve a viewer that follows to a browser.")] = False,
) -> None:
    """Play a scene by hand: type `help` at the prompt, or pipe orders in."""
    from taichi_erosion.recording.viewer import web_viewer
    from taichi_erosion.run.session import open_session

    if web and viewer:
        raise BadInput("--web and --viewer exclude each other")
    session = open_session(scene, tuple(override or ()), seed)
    path = record or Path("recordings") / f"{scene.stem}-live-{session.seed}.rrd"
    with web_viewer() if web else nullcontext() as served:
        if served:
            typer.echo(served.words, err=True)
        converse_recorded(session, path, served.sink if served else viewer)


def converse_recorded(session: "Session", path: Path, viewer: str | None) -> None:
    """Obey until the end of the lines, while a recording grows that a viewer may follow."""
    from taichi_erosion.recording import stream
    from taichi_erosion.run import session as live_view

    recorder = live_view.record_session(session, path, viewer)
    try:
        converse(session, typed_lines(session), is_strict=not sys.stdin.isatty())
    finally:
        typer.echo(f"recording {stream.close(recorder.recording)}")
