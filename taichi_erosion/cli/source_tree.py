"""What stands beside the package in its source tree and not in the wheel: all claims, and the timed cases."""

import sys
from importlib import import_module
from pathlib import Path
from types import ModuleType

ROOT = Path(__file__).parents[2]


def source_module(name: str) -> ModuleType | None:
    """Module of the source tree by its dotted name; None where the program is installed without its tree."""
    if not (ROOT / name.replace(".", "/")).with_suffix(".py").is_file():
        return None
    if sys.path[:1] != [str(ROOT)]:
        sys.path.insert(0, str(ROOT))
    return import_module(name)
