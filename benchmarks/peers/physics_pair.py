"""The JKR pull-off curve of two grains: a slow prescribed path in LAMMPS beside a free bounce in our code.

Both are held against the closed form; overlaps are in L^2/R*, forces in pi gamma R*.

Reference: Johnson, Kendall & Roberts (1971), Proc. R. Soc. A 324, 301.
"""

import tempfile
from pathlib import Path

import numpy as np

from benchmarks.peers.cases import Floats
from benchmarks.peers.codes import Peer
from benchmarks.peers.physics_codes import Failed, called
from benchmarks.peers.physics_measures import Numbers
from tests.verification.contact import adhesion
from tests.verification.reference import contact as jkr

POISSON = 0.29  # 1; only E* counts
PATH_STEPS = 20_000  # of the deck
ACTS = 1e-3  # of pi gamma R*: smaller forces are none


def lammps_curve(peer: Peer) -> tuple[Floats, Floats]:
    """Overlap and force along the path, first towards each other, then apart."""
    pair = adhesion.PAIR
    numbers = {
        "young": 2.0 * (1.0 - POISSON**2) * pair.young,
        "poisson": POISSON,
        "surface_energy": pair.energy,
        "diameter": 2.0 * adhesion.RADIUS,
        "density": adhesion.DENSITY,
        "reach": pair.depth,
    }
    with tempfile.TemporaryDirectory() as name:
        log = called(peer, "physics_pair", numbers, Path(name))
        rows = [line.split() for line in log.read_text().splitlines()]
    table = np.array([[float(word) for word in row] for row in rows if len(row) == 3 and row[0].isdigit()])
    if len(table) <= PATH_STEPS:
        raise Failed(f"{peer.name}: the path of the pair ends after {len(table) - 1} of {PATH_STEPS} steps")
    return -table[:, 1] / pair.depth, table[:, 2] / pair.force_scale


def pair_numbers(overlap: Floats, force: Floats) -> Numbers:
    """Landmarks of a curve, and how far it is from the closed form while the grains part."""
    acts = np.flatnonzero(np.abs(force) > ACTS)
    deepest = int(np.argmax(overlap))
    parting = slice(deepest, int(acts[-1]) + 1)
    d, f = overlap[parting], force[parting]
    law = np.array([jkr.branch_force(float(one)) for one in d])
    yield "force at first touch, pi gamma R*", float(force[acts[0]])
    yield "pull-off force, pi gamma R*", -float(f.min())
    yield "gap at which the contact ends, L^2/R*", -float(d[-1])
    yield (
        "largest distance from the closed form, 1e-6 of the pull-off force",
        1e6 * float(np.abs(f - law).max() / 3.0),
    )
