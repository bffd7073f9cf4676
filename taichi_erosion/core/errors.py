"""Exit codes of the command line, and the two exceptions that stand for an expected failure."""

from collections.abc import Iterable
from difflib import get_close_matches
from enum import IntEnum


class ExitCode(IntEnum):
    """Exit status of a command."""

    SUCCESS = 0
    FAILURE = 1  # an unexpected error, or a check that does not hold
    BAD_INPUT = 2
    STOPPED = 3  # a run that a guard ended
    INTERRUPTED = 130  # 128 + SIGINT
    TERMINATED = 143  # 128 + SIGTERM


class BadInput(Exception):
    """Unusable arguments or files; one line with what, where and what is allowed (ExitCode.BAD_INPUT).

    A file may have several faults, each in one line; as text it is the first one and the number of others.
    """

    def __init__(self, *faults: str) -> None:
        first = faults[0] if faults else ""
        super().__init__(first if len(faults) < 2 else f"{first} (and {len(faults) - 1} more)")
        self.faults = faults


class SimulationStopped(Exception):
    """Simulation ended by a guard; one line with grains, time and likely cause (ExitCode.STOPPED)."""


def did_you_mean(word: str, known: Iterable[str]) -> str:
    """`; did you mean X?` where a known word is close; empty otherwise."""
    close = get_close_matches(word, list(known), n=1)
    return f"; did you mean {close[0]}?" if close else ""
