"""An ensemble that has ended lends its fields to the next one of its kind, and with them its kernels.

Taichi reads the source of every kernel anew for fields that are new, and makes machine code of it: seconds of
a core, more than sixteen heaps of a hundred grains take. What is lent is emptied first, so that no result
depends on who ran before.
"""

from collections.abc import Sequence
from dataclasses import fields

from taichi_erosion.core.effect_device import write_constants
from taichi_erosion.core.setup import Laws, Numerics, Setup
from taichi_erosion.core.transfer import device_fields, write
from taichi_erosion.coupling.coupling_state import write_looks
from taichi_erosion.simulation.assemble import Simulation, assemble, checked, fill
from taichi_erosion.simulation.capacities import Sizes, filled_up, first_sizes
from taichi_erosion.simulation.step import release_first

APART = ("meeting", "grain")  # places of effects beside which replicas without them cannot run


def succeed(before: Simulation | None, setups: Sequence[Setup], laws: Laws, numerics: Numerics) -> Simulation:
    """An ensemble that is ready to run, in the fields of the one before where they serve it.

    `before` must not be used any more. Raises BadInput for what cannot run.
    """
    listed = checked(setups)
    if before is None or not serves(before, listed, laws, numerics):
        return assemble(listed, laws, numerics)
    for record in (before.world, before.around):
        for field in device_fields(record):
            write(field, 0)
    before.setups = listed
    everyone = filled_up(listed, before.sizes)
    for bound in (before.world.pair_effects, before.world.meeting_effects, before.world.grain_effects):
        write_constants(bound, [setup.effects for setup in everyone])
    fill(before.world, everyone)
    write_looks(before.around.exchange, everyone)
    release_first(before.world)
    return before


def serves(before: Simulation, setups: list[Setup], laws: Laws, numerics: Numerics) -> bool:
    """Whether an ensemble would compile what the one before has compiled, and has room in its fields."""
    same_laws = (before.laws, before.numerics) == (laws, numerics)
    alike = (before.setups[0].clumps is None) == (setups[0].clumps is None)
    without_air = not before.around.windy and all(setup.air is None for setup in setups)
    return (
        same_laws
        and alike
        and without_air
        and has_room(before.sizes, first_sizes(setups))
        and holds_effects(before, setups)
    )


def has_room(sizes: Sizes, wanted: Sizes) -> bool:
    """Whether capacities suffice; tables of contacts are as long as the materials make them."""
    enough = all(getattr(sizes, f.name) >= getattr(wanted, f.name) for f in fields(Sizes))
    return enough and sizes.materials == wanted.materials


def holds_effects(before: Simulation, setups: list[Setup]) -> bool:
    """Whether all effects are compiled in, and none beside which a replica would not come out as alone."""
    acting = {(one.effect.place, one.effect.name): one.effect for s in setups for one in s.effects}
    bounds = {"pair": before.world.pair_effects, "meeting": before.world.meeting_effects}
    bounds["grain"] = before.world.grain_effects
    held = {(place, name) for place, bound in bounds.items() for name in bound.names}
    same = all(effect.act in bounds[place].acts for (place, _), effect in acting.items())
    return same and not any(place in APART for place, _ in held - acting.keys())
