"""Contact mechanics of grains: state, neighbour lists, contact laws, walls, integration.

`World` holds the fields and device functions of all replicas; kernels take it as one argument.
"""

from typing import Any

from taichi_erosion.core.effect_device import DeviceEffects
from taichi_erosion.core.transfer import device_record
from taichi_erosion.grains.cells import Cells
from taichi_erosion.grains.clumps import Clumps
from taichi_erosion.grains.contact import ContactLaws
from taichi_erosion.grains.frozen_drag import FrozenDrag
from taichi_erosion.grains.materials import Materials
from taichi_erosion.grains.neighbour_list import NeighbourList
from taichi_erosion.grains.sleep import Sleep
from taichi_erosion.grains.state import Grains, Replicas, Source
from taichi_erosion.grains.wall_contacts import WallList
from taichi_erosion.grains.walls import Walls


@device_record
class World:
    """Fields and compiled laws of all replicas."""

    grains: Grains
    source: Source
    replicas: Replicas
    cells: Cells
    pairs: NeighbourList
    walls: Walls
    wall_pairs: WallList
    materials: Materials
    laws: ContactLaws
    lanes: int  # contacts of a batch
    batch_type: Any  # struct type of a batch of pairs, in the run's precision
    has_clumps: bool  # compiled in: without clumps nothing of them is in the kernels
    clumps: Clumps
    pair_effects: DeviceEffects
    pair_type: Any  # struct type of a pair, for its effects
    first_contact_effects: DeviceEffects
    first_contact_type: Any  # likewise, of two grains that begin to overlap
    grain_effects: DeviceEffects
    has_state: bool  # compiled in: whether any effect has state variables of grains
    has_external_forces: bool  # compiled in: whether air or grain effects act between contacts
    frozen_drag: FrozenDrag
    sleeps: bool  # compiled in: whether deep grains may sleep
    sleep: Sleep
