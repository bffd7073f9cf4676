"""The checks by id, the claims that they make when run, and those that are known not to hold."""

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
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


@dataclass(frozen=True)
class KnownFailure:
    """Claims of one check that fail, with the range in which they were found.

    It is told in every run; it is no news, and a larger one is.
    """

    id: str
    words: str  # in the claim
    low: float  # of what was got
    high: float
    source: str  # of the range


KNOWN = (
    KnownFailure(
        "V33", "Beverloo, round holes", 2.58, 2.70, "2.64 +- 0.03 from nine fillings, and two standard errors"
    ),
    KnownFailure(
        "V39",
        "impact over fluid threshold",
        0.49,
        0.58,
        "0.53, and the 95 % interval of the fluid threshold of five beds, 0.298 to 0.343 m/s",
    ),
    KnownFailure(
        "V36",
        "stress of the air at the bed of 0.5 mm",
        1.0,
        1.5,
        "1.39 and 1.34 in the winds that fail, scatter of a tenth",
    ),
    KnownFailure(
        "V36",
        "stress of the air at the bed of 0.25 mm under u* = 0.6 m/s",
        0.6,
        0.8,
        "0.71, scatter of a tenth; other beds of 0.24 mm have 0.71 at 0.56 m/s and 0.79 at 0.51 m/s",
    ),
)


def is_known(claim: Claim) -> bool:
    """Whether a claim fails, and as far as is known."""
    return not claim.passed and any(
        claim.id == known.id and known.words in claim.claim and known.low <= claim.got <= known.high
        for known in KNOWN
    )


def news(claims: list[Claim], strict: bool = False) -> list[Claim]:
    """Claims that fail and are not known to; with `strict` all that fail."""
    return [claim for claim in claims if not claim.passed and (strict or not is_known(claim))]
