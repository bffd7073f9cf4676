"""Buffer reuse: an ensemble runs in the fields, and with the kernels, of one of its kind that has ended.

For new fields Taichi reads the source of every kernel again and makes machine code of it: seconds of a core,
more than sixteen heaps of a hundred grains take. Reused fields are zeroed first, so that no result depends on
the ensemble before.
"""

from collections.abc import Sequence
from dataclasses import fields

from taichi_erosion.core.effect_device import write_constants
from taichi_erosion.core.setup import Laws, Numerics, Setup
from taichi_erosion.core.transfer import device_fields, write
from taichi_erosion.coupling.coupling_state import upload_exchange_settings
from taichi_erosion.simulation.assemble import (
    Simulation,
    assemble,
    check_mixture,
    release_start,
    upload_setups,
)
from taichi_erosion.simulation.capacities import Capacities, initial_capacities, padded_with_copies

EXCLUSIVE = ("first_contact", "grain")  # places of effects that all replicas of an ensemble must share


def reuse_or_assemble(
    before: Simulation | None, setups: Sequence[Setup], laws: Laws, numerics: Numerics
) -> Simulation:
    """An ensemble that is ready to run, in the fields of the one `before` where they fit.

    `before` must not be used any more. Raises BadInput for what cannot run.
    """
    listed = list(setups)
    check_mixture(listed)
    if before is None or not is_reusable(before, listed, laws, numerics):
        return assemble(listed, laws, numerics)
    for record in (before.world, before.coupling, *([before.buffers] if before.buffers else [])):
        for field in device_fields(record):
            write(field, 0)
    before.setups = listed
    everyone = padded_with_copies(listed, before.capacities)
    for bound in (before.world.pair_effects, before.world.first_contact_effects, before.world.grain_effects):
        write_constants(bound, [setup.effects for setup in everyone])
    upload_setups(before.world, everyone)
    upload_exchange_settings(before.coupling.exchange, everyone)
    release_start(before)
    return before


def is_reusable(before: Simulation, setups: list[Setup], laws: Laws, numerics: Numerics) -> bool:
    """Whether an ensemble would compile what the one before has compiled, and fits in its fields."""
    demand = initial_capacities(setups, numerics.by_grain)
    same_laws = (before.laws, before.numerics) == (laws, numerics)
    alike = (before.setups[0].clumps is None) == (setups[0].clumps is None)
    without_air = not before.coupling.has_air and all(setup.air is None for setup in setups)
    return (
        same_laws
        and alike
        and without_air
        and all(getattr(before.capacities, f.name) >= getattr(demand, f.name) for f in fields(Capacities))
        and before.capacities.materials == demand.materials  # tables of contacts have the same size
        and has_same_effects(before, setups)
    )


def has_same_effects(before: Simulation, setups: list[Setup]) -> bool:
    """Whether all effects are compiled in, and no others that would change a replica without them."""
    present = {(one.effect.place, one.effect.name): one.effect for s in setups for one in s.effects}
    bounds = {"pair": before.world.pair_effects, "first_contact": before.world.first_contact_effects}
    bounds["grain"] = before.world.grain_effects
    compiled = {(place, name) for place, bound in bounds.items() for name in bound.names}
    same = all(effect.act in bounds[place].functions for (place, _), effect in present.items())
    return same and not any(place in EXCLUSIVE for place, _ in compiled - present.keys())
