"""Exit codes of the command line, and the two exceptions that stand for an expected failure."""

import re
from collections.abc import Iterable
from difflib import get_close_matches
from enum import IntEnum

PART = re.compile(r"[._]")  # between the parts of a name
ALIKE = 0.75  # likeness of one name, or of one part of it [1]


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


def nearest_word(word: str, choices: Iterable[str]) -> str | None:
    """Known name that a word is close to, as a whole or in one part of it (`friktion`, `rolling`)."""
    names = list(choices)
    parts = {part: name for name in reversed(names) for part in PART.split(name)}
    if close := get_close_matches(word, names, n=1, cutoff=ALIKE):
        return close[0]
    if close := get_close_matches(word, parts, n=1, cutoff=ALIKE):
        return parts[close[0]]
    return next(iter(get_close_matches(word, names, n=1)), None)


def did_you_mean(word: str, names: Iterable[str]) -> str:
    """`; did you mean X?` where a known name is near; empty otherwise."""
    near = nearest_word(word, names)
    return f"; did you mean {near}?" if near else ""
