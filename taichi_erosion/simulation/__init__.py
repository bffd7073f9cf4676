"""The coupled step and how it is assembled."""

from taichi_erosion.simulation.advance import advance, failure
from taichi_erosion.simulation.assemble import Simulation, assemble
from taichi_erosion.simulation.control import move_surface, remove_surface, set_contacts, set_gravity
from taichi_erosion.simulation.observe import energies, ledger, share_touching, snapshot
from taichi_erosion.simulation.prepare import effective_scene, prepare
from taichi_erosion.simulation.state import export_state, import_state

__all__ = [
    "Simulation",
    "advance",
    "assemble",
    "effective_scene",
    "energies",
    "export_state",
    "failure",
    "import_state",
    "ledger",
    "move_surface",
    "prepare",
    "remove_surface",
    "set_contacts",
    "set_gravity",
    "share_touching",
    "snapshot",
]
