"""Typed commands of a live session: one line is one command."""

import shlex
from collections.abc import Callable
from contextlib import suppress
from inspect import signature
from math import isfinite
from pathlib import Path

import numpy as np

from taichi_erosion import simulation
from taichi_erosion.api import session_entries as entries
from taichi_erosion.core.errors import BadInput, did_you_mean
from taichi_erosion.execution import insertion
from taichi_erosion.execution import session as live
from taichi_erosion.execution.session import Session

HELP = """\
step [N]                   run N time steps
run TIME | run until rest  run for a simulated time, such as 0.5s
run to TIME                run to a simulated time
stage                      begin the next stage of the scene
set PATH VALUE             change an entry of the scene during the run
insert N [at X Y Z | through INLET]  let grains in from now on
remove NUMBER...           take grains out by their numbers
get PATH                   show an entry of the scene
measure                    evaluate the scene's measures now
plot NAME FILE             write the curve of a number so far as PNG
watch NAME... | watch off  print numbers once a second while it runs
diff [NAME [NAME]]         entries changed since the scene file or a saved state, or between two
status                     time, grains, energies
snapshot FILE              write the picture as PNG
save [NAME]                save the state
back [NAME] | back to TIME return to a saved state, or to an earlier time
undo                       return to the state before the latest change
grain N                    numbers and contacts of a grain
history [FILE]             commands that lead to the present state, here or as a script
script FILE                run the commands in a file
help [PATH]                this list; or meaning, unit and range of an entry
quit                       end the session"""

BYTE_ORDER_MARK = "\ufeff"  # before the first line of a file of some editors


def step_command(session: Session, count: str = "1") -> None:
    if not count.isdecimal():
        raise BadInput(f"'{count}' is not a number of steps")
    live.run_session_steps(session, int(count))


def run_command(session: Session, *time: str) -> str | None:
    if time == ("until", "rest"):
        is_at_rest = live.run_until_rest(session)
        return status_command(session) + ("" if is_at_rest else "  (time limit of the stage, not at rest)")
    return live.run_until_time(session, parse_end_time(session, *time))


def parse_end_time(session: Session, *words: str) -> float:
    """Time [s] that is meant by `0.5s` from now on, or `to 0.5s`. Raises BadInput."""
    start = 0.0 if words[:1] == ("to",) else session.time
    with suppress(ValueError):
        if isfinite(time := float(" ".join(words).removeprefix("to").removesuffix("s"))):
            return start + time
    raise BadInput(f"'{' '.join(words)}' is not a duration; write for example 0.5s")


def set_command(session: Session, path: str, value: str) -> str:
    before = live.warnings_of_present_scene(session)
    reply = live.change_entry(session, path, value)
    new = [f"\nwarning: {each}" for each in live.warnings_of_present_scene(session) if each not in before]
    return f"{path} = {value} {reply}{''.join(new)}"


def insert_command(session: Session, count: str, way: str = "", *place: str) -> None:
    number, at = 0, tuple[float, ...]()
    if len(place) == {"": 0, "at": 3, "through": 1}.get(way):
        with suppress(ValueError):
            at = tuple(map(float, place)) if way == "at" else ()
            number = int(count)
    if not number:
        raise BadInput(f"usage: {usage_line('insert')}")
    insertion.insert_grains(session, number, at, place[0] if way == "through" else "")


def remove_command(session: Session, *numbers: str) -> None:
    if not all(map(str.isdecimal, numbers or [""])):
        raise BadInput(f"usage: {usage_line('remove')}")
    insertion.remove_grains(session, *map(int, numbers))


def measure_command(session: Session) -> str:
    lines, faults = [], []
    for name, measurement in live.measure_now(session).items():
        reason = ", ".join(measurement.notes[:1]) or "the state holds none"
        value = f"{name} = {measurement.value:.5g} {measurement.unit}"
        lines.append(value if isfinite(measurement.value) else f"{name}: no value, {reason}")
        for lack in measurement.shortfalls:
            faults.append(f"{'limit' if lack.stated else 'warning'}: {name}: {lack.sentence}")
    return "\n".join([*lines, *faults]) or "the scene has no measures"


def plot_command(session: Session, name: str, file: str) -> str:
    from taichi_erosion.report.figure_style import as_png, curve_figure

    picture = as_png(curve_figure(*live.sampled_curve(session, name), name))
    return str(live.write_file(session, Path(file), picture))


def watch_command(session: Session, *names: str) -> str:
    if names == ("off",):
        session.watched.clear()
    else:
        live.watch_measures(session, *names)
    return f"watching {', '.join(session.watched) or 'nothing'}"


def diff_command(session: Session, before: str | None = None, after: str | None = None) -> str:
    differences = entries.changed_entries(session, before, after).items()
    return "\n".join(f"{path}: {old} -> {new}" for path, (old, new) in differences) or "no entry differs"


def status_command(session: Session) -> str:
    numbers = live.session_status(session).items()
    return "  ".join(f"{name} {n:.5g}" if isinstance(n, float) else f"{name} {n}" for name, n in numbers)


def save_command(session: Session, name: str = "last") -> str:
    live.save_state_as(session, name)
    return f"saved as '{name}' at {session.time:.6g} s"


def back_command(session: Session, name: str = "last", *time: str) -> None:
    if name == "to" and time:
        return live.return_to_time(session, parse_end_time(session, name, *time))
    return live.restore_saved_state(session, name)


def grain_command(session: Session, number: str) -> str:
    state, network = simulation.snapshot(session.sim, 0), simulation.contact_network(session.sim, 0)
    rows = np.flatnonzero(state.ident.astype(str) == number)
    if not len(rows):
        raise BadInput(f"no grain has the number {number}; there are {len(state.ident)}")
    row, ends = rows[0], np.stack([network.first, network.second], axis=1)
    x, y, z = 1e3 * state.position[row]
    speed, spin = np.linalg.norm(state.velocity[row]), np.linalg.norm(state.spin[row])
    text = f"grain {number}: radius {1e3 * state.radius[row]:.4g} mm, mass {state.mass[row]:.4g} kg\n"
    text += f"at ({x:.4g}, {y:.4g}, {z:.4g}) mm, {speed:.4g} m/s, spin {spin:.4g} rad/s"
    for touch in np.flatnonzero((ends == state.ident[row]).any(axis=1)):
        partner = ends[touch].sum() - state.ident[row]
        body = f"grain {partner}" if partner >= 0 else network.walls[-1 - partner]
        text += f"\ntouches {body} with {network.normal_force[touch]:.4g} N"
    return text


def history_command(session: Session, file: str = "") -> str:
    return str(live.write_session_commands(session, Path(file))) if file else "\n".join(session.history)


def script_command(session: Session, file: str) -> str:
    if not Path(file).is_file():
        raise BadInput(f"{file}: no such file")
    texts, lines = [], Path(file).read_text(encoding="utf-8-sig", errors="replace").splitlines()
    for number, line in enumerate(lines, start=1):
        try:
            if line.split()[:1] == ["script"]:
                raise BadInput("a script runs no other")
            texts.append(execute_line(session, line))
        except BadInput as error:
            raise BadInput(f"{file}: line {number}: {error}") from None
    return "\n".join(filter(None, texts))


def help_command(session: Session, path: str = "") -> str:
    if path in COMMANDS:
        return usage_line(path)
    return entries.entry_meaning(session, path) if path else HELP


def usage_line(name: str) -> str:
    return next(line for line in HELP.split("\n") if line.startswith(f"{name} "))


def quit_command(session: Session) -> str:
    raise EOFError


# of a session and the words behind the name: the text to print, None for that of the status
COMMANDS: dict[str, Callable[..., str | None]] = {
    "step": step_command,
    "run": run_command,
    "stage": lambda session: f"stage {live.begin_next_stage(session)} begins",
    "set": set_command,
    "insert": insert_command,
    "remove": remove_command,
    "get": lambda session, path: f"{path} = {entries.entry_value(session, path)}",
    "measure": measure_command,
    "plot": plot_command,
    "watch": watch_command,
    "diff": diff_command,
    "status": status_command,
    "snapshot": lambda session, file: str(live.write_side_picture(session, Path(file))),
    "save": save_command,
    "back": back_command,
    "undo": live.undo_latest_change,
    "grain": grain_command,
    "history": history_command,
    "script": script_command,
    "help": help_command,
    "quit": quit_command,
}


def execute_line(session: Session, line: str) -> str:
    """Text of one line's command; "" for a comment. Raises BadInput, SimulationStopped, EOFError."""
    try:
        name, *words = shlex.split(line.removeprefix(BYTE_ORDER_MARK), comments=True) or [""]
    except ValueError as error:
        raise BadInput(f"{line.strip()}: {error}; a text in quotes needs both") from None
    if not name:
        return ""
    if name not in COMMANDS:
        hint = did_you_mean(name, COMMANDS)
        raise BadInput(f"'{name}' is not a command{hint}; the commands are {', '.join(COMMANDS)}")
    try:
        signature(COMMANDS[name]).bind(session, *words)
    except TypeError:
        raise BadInput(f"usage: {usage_line(name)}") from None
    text = COMMANDS[name](session, *words)
    return status_command(session) if text is None else text
