"""The ladder of `./erosion verify` in a source tree: all checks by id, and failures that are known."""

from typing import NamedTuple

from taichi_erosion.verification import closed_forms
from taichi_erosion.verification.claims import Check, Claim, Ladder
from tests.verification import designed_experiments
from tests.verification.air import channel, vortices
from tests.verification.contact import (
    adhesion,
    bulk,
    discharge,
    invariance,
    motion,
    normal_impact,
    oblique_impact,
    walls,
)
from tests.verification.wind import exchange, packed_bed, saltation

CHECKS: dict[str, Check] = {
    "V01": motion.free_fall,
    "V02": normal_impact.hertz_peaks,
    "V03": normal_impact.step_order,
    "V04": normal_impact.restitution,
    "V05": oblique_impact.oblique_impacts,
    "V06": oblique_impact.spinning_impacts,
    "V07": oblique_impact.equal_spins,
    "V08": oblique_impact.momentum,
    "V09": motion.slide_to_roll,
    "V10": motion.incline,
    "V11": motion.rolling_resistance,
    "V12": motion.bounce_heights,
    "V13": motion.stacked_pair,
    "V14": invariance.energy_balance,
    "V15": invariance.invariance,
    "V16": walls.mesh_and_plane,
    "V17": adhesion.landmarks,
    "V18": adhesion.sticking_speed,
    "V19": adhesion.vanishing_adhesion,
    "V20": adhesion.friction_caps,
    "V22": invariance.single_and_double,
    "V23": closed_forms.thread_outcomes,
    "V25": vortices.lid_cavity,
    "V26": vortices.taylor_green,
    "V27": channel.plane_flows,
    "V28": channel.wind_profile,
    "V29": channel.mass_balance,
    "V30": exchange.terminal_velocities,
    "V31": packed_bed.packed_bed,
    "V32": exchange.column_momentum,
    "V33": discharge.opening_flow,
    "V34": bulk.repose_trends,
    "V36": saltation.saltation,
    "V37": designed_experiments.recovered_effects,
    "V38": exchange.grid_momentum,
    "V39": saltation.start_of_motion,
}


class KnownFailure(NamedTuple):
    """Claims of one check that fail, with the range in which they were found; a larger failure is news."""

    id: str
    words: str  # in the claim
    low: float  # of what was got
    high: float


KNOWN = (
    # 2.64 +- 0.03 from nine fillings, and two standard errors
    KnownFailure("V33", "Beverloo, round holes", 2.58, 2.70),
    # 1.24 and 1.23 in the winds that fail; means of three beds scatter by 0.09
    KnownFailure("V36", "stress of the air at 3 beds of 0.5 mm", 1.0, 1.45),
    # 0.77 under this lid, 0.72 under one at 200 diameters; other beds of 0.24 mm have 0.71 at 0.56 m/s
    KnownFailure("V36", "stress of the air at 3 beds of 0.25 mm under u* = 0.6 m/s", 0.65, 0.9),
)


def is_known(claim: Claim) -> bool:
    """Whether a claim fails, and as far as is known."""
    named = [known for known in KNOWN if claim.id == known.id and known.words in claim.claim]
    return not claim.passed and any(known.low <= claim.got <= known.high for known in named)


LADDER = Ladder(CHECKS, is_known)
