"""Processes that measure in turn while the others wait, so that other work on the machine slows all alike."""

import json
import os
import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from benchmarks.versions import answer

ROOT = Path(__file__).parents[1]


def serve(portion: Callable[[int], Sequence[Any]]) -> None:
    """Say that the process is ready, then measure a portion for every line read; portions count from 1."""
    sys.stdout.write("ready\n")
    sys.stdout.flush()
    for turn, _ in enumerate(sys.stdin, 1):
        sys.stdout.write(json.dumps(portion(turn)) + "\n")
        sys.stdout.flush()


def start(module: str, words: Sequence[str], environment: Mapping[str, str]) -> subprocess.Popen[str]:
    """A process that runs a module of the benchmarks with changes of the environment."""
    return subprocess.Popen(
        [sys.executable, "-m", module, *words],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        env=os.environ | environment,
        cwd=ROOT,
    )


def take_turns(processes: Mapping[str, subprocess.Popen[str]], turns: int) -> dict[str, list[Any]]:
    """What every process answers in every turn, once all are ready."""
    found: dict[str, list[Any]] = {name: [] for name in processes}
    for process in processes.values():
        answer(process)
    for _ in range(turns):
        for name, process in processes.items():
            assert process.stdin is not None
            process.stdin.write("go\n")
            process.stdin.flush()
            found[name].append(json.loads(answer(process)))
    for process in processes.values():
        process.communicate()
    return found
