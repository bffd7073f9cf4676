"""The table of checks, and the walk along it."""

import time
from collections.abc import Callable, Iterator, Sequence
from math import nan

from taichi_erosion.core.errors import BadInput
from taichi_erosion.verification import (
    adhesion,
    air_mass,
    bouncing,
    cavity,
    designed_effects,
    determinism,
    discharge,
    energy,
    exchange,
    frames,
    free_motion,
    grid_patch,
    heaps,
    hostile,
    normal_impact,
    oblique_impact,
    packed_bed,
    parallel_flow,
    precision,
    rolling,
    saltation,
    settling,
    sliding,
    spin_impact,
    vortices,
    walls,
    wind_profile,
)
from taichi_erosion.verification.claim import Claim, Outcome, as_claim

Check = Callable[[], Iterator[Outcome]]
REASON_LENGTH = 200  # characters of an error that are printed

LADDER: dict[str, Check] = {
    "V01": free_motion.free_fall,
    "V02": normal_impact.hertz_peaks,
    "V03": normal_impact.step_order,
    "V04": normal_impact.restitution,
    "V05": oblique_impact.test4,
    "V06": oblique_impact.test6,
    "V07": spin_impact.equal_spins,
    "V08": spin_impact.momentum,
    "V09": sliding.slide_to_roll,
    "V10": sliding.incline,
    "V11": rolling.rolling_resistance,
    "V12": bouncing.bounce_heights,
    "V13": bouncing.stacked_pair,
    "V14": energy.energy_balance,
    "V15": frames.invariance,
    "V16": walls.mesh_and_plane,
    "V17": adhesion.landmarks,
    "V18": adhesion.sticking_speed,
    "V19": adhesion.vanishing_adhesion,
    "V20": adhesion.friction_caps,
    "V21": determinism.restart,
    "V22": precision.single_and_double,
    "V23": determinism.threads_and_ensembles,
    "V24": hostile.bad_starts,
    "V25": cavity.lid_cavity,
    "V26": vortices.taylor_green,
    "V27": parallel_flow.plane_flows,
    "V28": wind_profile.wind_profile,
    "V29": air_mass.mass,
    "V30": settling.terminal_velocities,
    "V31": packed_bed.packed_bed,
    "V32": exchange.action_and_reaction,
    "V33": discharge.opening_flow,
    "V34": heaps.repose_trends,
    "V36": saltation.saltation,
    "V37": designed_effects.recovered_effects,
    "V38": grid_patch.grid_patch,
}


def verify(ids: Sequence[str] = (), on_claim: Callable[[Claim], object] | None = None) -> list[Claim]:
    """Claims of the checks named by `ids` (all where empty), each handed to `on_claim` once known."""
    unknown = [ident for ident in ids if ident not in LADDER]
    if unknown:
        raise BadInput(f"verify: {unknown[0]} is not on the ladder; choose from {', '.join(LADDER)}")
    claims = []
    for ident in ids or LADDER:
        for claim in climb(ident):
            claims.append(claim)
            if on_claim is not None:
                on_claim(claim)
    return claims


def climb(ident: str) -> Iterator[Claim]:
    """Claims of one check; a claim's wall time counts from the one before it."""
    began = time.perf_counter()
    try:
        for outcome in LADDER[ident]():
            now = time.perf_counter()
            yield as_claim(ident, outcome, now - began)
            began = now
    except Exception as fault:
        # one broken check must not hide the others: it becomes a claim that fails and says why
        reason = " ".join(str(fault).split())[:REASON_LENGTH]
        lost = Outcome(f"runs to its end ({type(fault).__name__}: {reason})", nan, nan, 0.0, "f64")
        yield as_claim(ident, lost, time.perf_counter() - began)
