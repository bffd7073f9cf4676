"""What leaves the process to be looked at: recordings, pictures.

Only this room imports rerun, as `rr` and `rrb`, at their first use: the import takes half a second.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any


class LateModule:
    """A module that is imported when something of it is used."""

    def __init__(self, name: str) -> None:
        self.name = name

    def __getattr__(self, attribute: str) -> Any:
        return getattr(import_module(self.name), attribute)


if TYPE_CHECKING:
    import rerun as rr
    import rerun.blueprint as rrb
else:
    rr, rrb = LateModule("rerun"), LateModule("rerun.blueprint")
