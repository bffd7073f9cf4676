"""The checks by id, and the claims that they make when run."""

import time
from collections.abc import Callable, Iterator, Sequence
from math import nan

from taichi_erosion.core.errors import BadInput
from taichi_erosion.verification import designed_experiments, reproducibility
from taichi_erosion.verification.air import channel, vortices
from taichi_erosion.verification.claim import Claim, Outcome, as_claim
from taichi_erosion.verification.contact import (
    adhesion,
    bulk,
    discharge,
    invariance,
    motion,
    normal_impact,
    oblique_impact,
    walls,
)
from taichi_erosion.verification.wind import exchange, packed_bed, saltation

Check = Callable[[], Iterator[Outcome]]
REASON_LENGTH = 200  # characters of an error that are printed

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
    "V21": reproducibility.restart,
    "V22": reproducibility.single_and_double,
    "V23": reproducibility.threads_and_ensembles,
    "V24": reproducibility.bad_starts,
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


def verify(ids: Sequence[str] = (), on_claim: Callable[[Claim], object] | None = None) -> list[Claim]:
    """Claims of the checks named by `ids` (all where empty), each handed to `on_claim` once known."""
    unknown = [ident for ident in ids if ident not in CHECKS]
    if unknown:
        raise BadInput(f"verify: {unknown[0]} is unknown; choose from {', '.join(CHECKS)}")
    claims = []
    for ident in ids or CHECKS:
        for claim in claims_of(ident):
            claims.append(claim)
            if on_claim is not None:
                on_claim(claim)
    return claims


def claims_of(ident: str) -> Iterator[Claim]:
    """Claims of one check; a claim's wall time counts from the one before it."""
    began = time.perf_counter()
    try:
        for outcome in CHECKS[ident]():
            now = time.perf_counter()
            yield as_claim(ident, outcome, now - began)
            began = now
    except Exception as fault:
        # one broken check must not hide the others: it becomes a claim that fails and says why
        reason = " ".join(str(fault).split())[:REASON_LENGTH]
        lost = Outcome(f"runs to its end ({type(fault).__name__}: {reason})", nan, nan, 0.0, "f64")
        yield as_claim(ident, lost, time.perf_counter() - began)
