"""Watching what a file makes the program do: its time, what it writes, what it runs.

Python tells an audit hook of every file that is opened, of every process and connection that is begun and of
all code that is executed. A hook cannot be taken away again, so it sleeps while nothing is watched.
"""

import os
import platform
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from types import CodeType, FrameType
from typing import Any

import taichi_erosion

PATIENCE = 20.0  # s of this process's own time that one file may take
AWAITED = 300  # s of wall time: a pipe that nobody fills takes none of the process's own
WRITING = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_APPEND
CHANGES = ("os.remove", "os.rename", "os.mkdir", "os.rmdir", "os.link", "os.symlink", "shutil.rmtree")
OWN_CODE = (str(Path(taichi_erosion.__file__).parent), sys.prefix, sys.base_prefix, "<")


class Hang(BaseException):
    """A file has taken too long; nothing catches this by mistake."""


@dataclass
class Watch:
    """What may be written, and what was done that may not."""

    folder: str
    trespasses: list[str] = field(default_factory=list)


WATCHES: list[Watch] = []  # the one that is awake, if any; the hook has no other way to learn of it


def note(event: str, arguments: tuple[Any, ...]) -> None:
    if not WATCHES:
        return
    watch = WATCHES[-1]
    if event in ("os.system", "os.exec", "os.fork", "os.posix_spawn", "subprocess.Popen", "socket.connect"):
        watch.trespasses.append(f"{event} {arguments!r}")
    elif event == "exec" and isinstance(arguments[0], CodeType):
        if not arguments[0].co_filename.startswith(OWN_CODE):
            watch.trespasses.append(f"executed {arguments[0].co_filename}")
    elif event in CHANGES or (event == "open" and isinstance(arguments[2], int) and arguments[2] & WRITING):
        path = os.path.abspath(os.fsdecode(arguments[0])) if isinstance(arguments[0], str | bytes) else ""
        # compiled Python of a first import may lie outside the folder
        if not (path.startswith(watch.folder) or "__pycache__" in path or path in ("", os.devnull)):
            watch.trespasses.append(f"{event} {path}")


import_module("matplotlib.font_manager")  # makes folders of its own when it is first imported
platform.processor()  # starts uname when libraries first ask for it
sys.addaudithook(note)


@contextmanager
def watched(folder: Path) -> Iterator[Watch]:
    """Nothing but the folder may be changed, nothing be begun, and the patience not be used up."""
    watch = Watch(os.path.abspath(folder))
    before = {alarm: signal.signal(alarm, interrupt) for alarm in (signal.SIGVTALRM, signal.SIGALRM)}
    signal.setitimer(signal.ITIMER_VIRTUAL, PATIENCE)
    signal.alarm(AWAITED)
    WATCHES.append(watch)
    try:
        yield watch
    finally:
        WATCHES.pop()
        signal.setitimer(signal.ITIMER_VIRTUAL, 0.0)
        signal.alarm(0)
        for alarm, handler in before.items():
            signal.signal(alarm, handler)


def interrupt(_number: int, _frame: FrameType | None) -> None:
    raise Hang
