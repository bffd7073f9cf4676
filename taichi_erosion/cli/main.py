"""The door: words in, exit code out; every expected failure is one line on stderr."""

import logging
import os
import signal
import sys
import traceback
from collections.abc import Sequence
from types import FrameType

import typer

from taichi_erosion.cli import effects, evidence
from taichi_erosion.cli.commands import app
from taichi_erosion.cli.progress import LOG, close_log
from taichi_erosion.core.errors import BadInput, ExitCode, SimulationStopped

TRACEBACK_SWITCH = (
    "TAICHI_EROSION_TRACEBACK"  # environment variable: "1" shows where an unexpected error arose
)
NAME_SWITCH = "TAICHI_EROSION_NAME"  # environment variable: what the program was called by

# matrices here are small, and threads of a linear algebra library that wait for a busy core cost minutes
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
# where the home directory cannot be written, it tells at length where it keeps its cache instead
logging.getLogger("matplotlib").setLevel(logging.ERROR)

app.add_typer(evidence.app)
app.add_typer(effects.app)


def main(words: Sequence[str] | None = None) -> int:
    """Carry out one command and return its exit code; `words` are those after the program's name."""
    previous = signal.signal(signal.SIGTERM, end_cleanly)
    code: int = ExitCode.TERMINATED
    try:
        code = obey(sys.argv[1:] if words is None else list(words))
        return code
    finally:
        LOG.info("exit code %d", code)
        close_log()
        signal.signal(signal.SIGTERM, previous)


def obey(words: list[str]) -> int:
    """Carry out one command; every expected failure becomes a line and an exit code."""
    name = os.environ.get(NAME_SWITCH, "taichi-erosion")
    try:
        return app(words, prog_name=name, obj=words, standalone_mode=False) or ExitCode.SUCCESS
    except typer.TyperException as error:
        return refuse(error.format_message(), ExitCode.BAD_INPUT)
    except BadInput as error:
        return refuse(str(error), ExitCode.BAD_INPUT)
    except SimulationStopped as error:
        return refuse(str(error), ExitCode.STOPPED)
    except Exception as error:
        return report_unexpected(error)


def end_cleanly(_number: int, _frame: FrameType | None) -> None:
    """Turn SIGTERM into an ordinary exit: Python's own default skips what closes a recording."""
    sys.exit(ExitCode.TERMINATED)


def refuse(sentence: str, code: ExitCode) -> ExitCode:
    """Say in one line why there is no result; help that was printed instead leaves nothing to say."""
    if sentence:
        line = " ".join(sentence.split())
        LOG.error(line)
        typer.echo(line, err=True)
    return code


def report_unexpected(error: Exception) -> ExitCode:
    """Say in one line what went wrong inside, or all of it where the user asked for that."""
    if os.environ.get(TRACEBACK_SWITCH) == "1":
        typer.echo("".join(traceback.format_exception(error)), err=True)
        return ExitCode.FAILURE
    sentence = f"unexpected {type(error).__name__}: {error} ({TRACEBACK_SWITCH}=1 shows where)"
    return refuse(sentence, ExitCode.FAILURE)
