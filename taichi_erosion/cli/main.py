"""Entry point of the command line: arguments in, exit code out; an error is one line on stderr."""

import logging
import os
import signal
import sys
import traceback
from collections.abc import Sequence

import typer

from taichi_erosion.cli import effects, evidence, wind
from taichi_erosion.cli.commands import app
from taichi_erosion.cli.progress import LOG, close_log
from taichi_erosion.core.errors import BadInput, ExitCode, SimulationStopped
from taichi_erosion.evidence.words import NAME_SWITCH

TRACEBACK_SWITCH = "TAICHI_EROSION_TRACEBACK"  # environment variable: "1" shows where an error arose

# matrices here are small, and threads of a linear algebra library that wait for a busy core cost minutes
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
# silences a long message on its cache where the home directory is read-only
logging.getLogger("matplotlib").setLevel(logging.ERROR)

app.add_typer(evidence.app)
app.add_typer(effects.app)
app.add_typer(wind.app)


def main(words: Sequence[str] | None = None) -> int:
    """Run one command and return its exit code; `words` are its arguments, default those of the process."""
    # SystemExit, so that recordings are closed
    previous = signal.signal(signal.SIGTERM, lambda *_: sys.exit(ExitCode.TERMINATED))
    code: int = ExitCode.TERMINATED
    try:
        code = run_command(sys.argv[1:] if words is None else list(words))
        return code
    finally:
        LOG.info("exit code %d", code)
        close_log()
        signal.signal(signal.SIGTERM, previous)


def run_command(words: list[str]) -> int:
    """Run one command; a failure becomes a line on stderr and an exit code.

    Where TRACEBACK_SWITCH is set, an unexpected failure prints its traceback.
    """
    name = os.environ.get(NAME_SWITCH, "taichi-erosion")
    try:
        return app(words, prog_name=name, obj=words, standalone_mode=False) or ExitCode.SUCCESS
    except typer.TyperException as error:
        return print_error(error.format_message(), ExitCode.BAD_INPUT)
    except BadInput as error:
        for fault in error.faults:
            print_error(fault, ExitCode.BAD_INPUT)
        return ExitCode.BAD_INPUT
    except SimulationStopped as error:
        return print_error(str(error), ExitCode.STOPPED)
    except Exception as error:
        from taichi_erosion.core.effect_file import compile_failure_text

        if os.environ.get(TRACEBACK_SWITCH) == "1":
            typer.echo("".join(traceback.format_exception(error)), err=True)
            return ExitCode.FAILURE
        if (reason := compile_failure_text(error)) is not None:  # in the user's own effect
            return print_error(f"{reason}; `effects NAME --effect FILE` checks an effect", ExitCode.BAD_INPUT)
        sentence = f"unexpected {type(error).__name__}: {error} ({TRACEBACK_SWITCH}=1 shows where)"
        return print_error(sentence, ExitCode.FAILURE)


def print_error(sentence: str, code: ExitCode) -> ExitCode:
    """Print an error in one line and return the exit code; nothing is printed after help text."""
    if sentence:
        line = " ".join(sentence.split())
        LOG.error(line)
        typer.echo(line, err=True)
    return code
