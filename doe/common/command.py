"""Words on the command line of a study's script."""

import sys
from collections.abc import Callable, Mapping


def words(usage: str | None) -> list[str]:
    """Words after the script's name; `--help` prints the usage, which is the script's docstring, and ends."""
    if "--help" in sys.argv[1:]:
        sys.stdout.write(f"{usage}\n")
        raise SystemExit(0)
    return sys.argv[1:]


def run_step(usage: str | None, steps: Mapping[str, Callable[[], object]]) -> None:
    """Run the step that the only word names; anything else prints the usage and ends with exit code 2."""
    asked = words(usage)
    if len(asked) != 1 or asked[0] not in steps:
        sys.stderr.write(f"{usage}\n")
        raise SystemExit(2)
    steps[asked[0]]()
