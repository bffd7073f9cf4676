"""Coarse-grained fields of a running simulation, on a line through its bed or where they are wanted."""

from collections.abc import Mapping

import numpy as np

from taichi_erosion import simulation
from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.setup import Floats
from taichi_erosion.core.snapshot import GrainFields, Snapshot
from taichi_erosion.measures.coarse_graining import AXES, Kernel, coarse_grain
from taichi_erosion.simulation import Simulation

WIDTH = 1.0  # of the kernel over the mean diameter of the grains [1]: it smooths their layers
STEP = 0.5  # between two points of a line, over the width [1]
REACH = 3.0  # of a line beyond the outermost centres, over the width [1]


def present_grain_fields(
    sim: Simulation,
    replica: int,
    at: Mapping[str, Floats] | None = None,
    width: float | None = None,
    extent: Mapping[str, float] | None = None,
) -> GrainFields:
    """Fields at coordinates [m] by axis; without any on a line along z, at whole multiples of its step.

    An axis that is left out is averaged over its period, or over its `extent` [m]. Raises BadInput without
    either, and for clumps.
    """
    setup, state = sim.setups[replica], simulation.snapshot(sim, replica)
    if setup.clumps is not None:
        raise BadInput("fields: grains are clumps, whose spheres overlap; fields are of single spheres")
    if not len(state.mass):
        raise BadInput("fields: no grain is there")
    chosen = width or WIDTH * 2.0 * float(setup.grains.radius.mean())
    places = {name: np.atleast_1d(np.asarray(at[name], float)) for name in AXES if at and name in at}
    if wrong := [name for name in (*(at or {}), *(extent or {})) if name not in AXES]:
        raise BadInput(f"fields: {wrong[0]} is no axis; there are x, y and z")
    lengths = {name: length for name, length in zip(AXES, setup.period, strict=True) if length > 0.0}
    kernel = Kernel(
        places or points_along_z(state, chosen, lengths), chosen, lengths | dict(extent or {}), setup.period
    )
    for name in AXES:
        if name not in kernel.at and not kernel.extent.get(name, 0.0) > 0.0:
            raise BadInput(f"fields: {name} is open; give its coordinates or the extent to average over")
    return coarse_grain(state, simulation.contact_network(sim, replica), kernel)


def points_along_z(state: Snapshot, width: float, lengths: Mapping[str, float]) -> dict[str, Floats]:
    """Coordinates of a line along z; along an axis without a period it goes through the centre of mass."""
    centre = np.average(state.position, axis=0, weights=state.mass)
    z, reach, step = state.position[:, 2], REACH * width, STEP * width
    line = np.arange(np.floor((z.min() - reach) / step), np.ceil((z.max() + reach) / step) + 1.0) * step
    return {name: centre[k : k + 1] for k, name in enumerate("xy") if name not in lengths} | {"z": line}
