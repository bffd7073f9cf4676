"""Sanity checks of a running replica: grain count, mass; messages of failures."""

import numpy as np

from taichi_erosion.core.snapshot import Failure, Status
from taichi_erosion.simulation import Simulation, snapshot

MASS_ERROR = 1e-5  # of the sum of all masses; they are stored in single precision [1]


def count_failure(sim: Simulation, replica: int, time: float) -> Failure | None:
    """Failure where grains are missing or doubled, a coordinate is not finite, or mass was lost.

    A grain that leaves the domain stops its replica at once, so the grains inside must be the released rows
    of the GrainTable, each once, with their masses.
    """
    state, table = snapshot(sim, replica), sim.setups[replica].grains
    if not np.array_equal(state.ident, np.arange(len(state.ident))):
        missing = np.setdiff1d(np.arange(len(state.ident)), state.ident)
        return Failure(Status.COUNT, time, int(missing[0]), -1, float(len(missing)))
    if not np.isfinite(state.position).all() or not np.isfinite(state.velocity).all():
        bad = ~np.isfinite(state.position + state.velocity).all(axis=1)
        return Failure(Status.NOT_FINITE, time, int(np.flatnonzero(bad)[0]), -1, float("nan"))
    weighed, listed = float(state.mass.sum()), float(table.mass[: len(state.mass)].sum())
    if abs(weighed - listed) > MASS_ERROR * listed:
        return Failure(Status.COUNT, time, 0, -1, weighed / listed - 1.0)
    return None


LIKELY_CAUSES = {
    Status.OVERLAP: "the time step is too long, the material too soft for these speeds, "
    "or grains start inside each other",
    Status.LOST: "a grain passed a gap in the walls or was shot away by an overlap",
    Status.NOT_FINITE: "a parameter is not a number, or forces grew without bound: shorten the time step",
    Status.ENERGY: "the time step is too long for the stiffest contact",
    Status.OVERFLOW: "lists could not grow: out of memory",
    Status.COUNT: "an error of this program: please report it",
    Status.AIR: "the wind crosses more than a cell between two exchanges: lower wind.look_steps",
}


def failure_message(failure: Failure, seed: int) -> str:
    """One line: seed, time, the violated check with its numbers, and the likely cause."""
    partner = f"grain {failure.partner}" if failure.partner >= 0 else f"wall piece {-1 - failure.partner}"
    finding = {
        Status.OVERLAP: f"grain {failure.grain} overlaps {partner} by {failure.value:.3g} radii",
        Status.LOST: f"grain {failure.grain} left the domain at a coordinate of {failure.value:.4g} m",
        Status.AIR: "the pressure of the air was not found",
        Status.NOT_FINITE: f"grain {failure.grain} has a coordinate that is not a number",
        Status.ENERGY: f"mechanical energy grew by {failure.value:.3g} of itself between two checks",
        Status.COUNT: f"grain {failure.grain} is missing, or not all mass is there ({failure.value:.3g})",
    }.get(failure.status, failure.status.name.lower())
    finding += f"; likely cause: {LIKELY_CAUSES.get(failure.status, '')}"
    return f"seed {seed} stopped at {failure.time:.6g} s: {finding}"
