"""Winds in which the grains of a bed begin to tip, from balances of moments apart from the simulator.

python -m doe.fluid_threshold.balance    computes balance.csv; `doe.fluid_threshold.run --page` shows it

A grain tips about two of its contacts where the work of drag, lift and torque of the air in the first small
rotation exceeds that of its weight, of the pull of the contacts that open, and of rolling friction,

    F x + T w + (L - W) z >= P s + mu_r (d / 4) N

with x, z the way of the centre, w the rotation across the wind, s the way by which contacts open and N the
normal forces of both contacts. The wind over the surface of the bed is van Driest's, with Rotta's shift for
roughness; its mean over the sphere makes the drag at a wall of Zeng et al., 1.7 times that of a free sphere
in creeping flow, their lift, and the torque 0.944 (4 pi) mu a^3 G. Gusts are log-normal, the deviation 0.4 of
the mean near the bed and 2.5 u* above; the peak of a watch is the median largest mean over sqrt(d / g), in
which a grain leaves its pocket, of a Langevin process with a memory of 20 ms; or, near a wall, with the
Lagrangian time scale of the air there, 10 nu / u*^2 in the sublayer, and three times that, where the peak is
that of a normal process whose crossings of a high level are independent (Rice). Nothing of the simulator is
used, and nothing is fitted.

Reference: Goldman, Cox & Brenner (1967), Chem. Eng. Sci. 22, 653; Zeng et al. (2009), Phys. Fluids 21,
033302; van Driest (1956), J. Aeronaut. Sci. 23, 1007; Cebeci & Chang (1978), AIAA J. 16, 730 (Rotta's shift);
Alfredsson et al. (1988), Phys. Fluids 31, 1026; Pahtz et al. (2018), Geosciences 8, 314 (sqrt(d / g)); Kallio
& Reeks (1989), Int. J. Multiphase Flow 15, 433 (time scale near a wall); Rice (1945), Bell Syst. Tech. J. 24,
46.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import exp, inf, log, pi, sqrt
from pathlib import Path

import numpy as np
from scipy.optimize import root_scalar
from scipy.stats import norm

from doe.common.command import words
from doe.common.tables import write_table
from doe.fluid_threshold.dropped_bed import Loose, dropped, loose_grains
from taichi_erosion.core.setup import Floats

TABLE = Path(__file__).with_name("balance.csv")
SIZES = (0.075, 0.1, 0.15, 0.25, 0.5, 1.0)  # mm
SIDE, SEEDS = 20.0, (1, 2, 3)  # of the patch in diameters; of the beds
SHARES = (0.01, 0.1)  # of the surface grains, one on the square of a diameter
VISCOSITY, AIR, QUARTZ, GRAVITY, KARMAN, DAMPING = 1.46e-5, 1.225, 2650.0, 9.81, 0.4, 26.0
WINDS = np.geomspace(0.03, 2.5, 90)  # m s-1
SLICES = np.linspace(-0.95, 0.95, 20)  # heights over the radius at which a sphere meets the wind
MEMORY, TRIES = 0.02, 200  # s; realisations of a gust
BETA, ROLLING = 1.5e-4, 0.1  # N m-1, of a whole grain; of the scene
SHORT, LONG = 0.3, 5.0  # s, of a watch


@dataclass(frozen=True)
class Question:
    """What acts."""

    name: str
    watch: float = 0.0  # s in gusts; 0: a steady wind
    pull: float = 0.0  # of one contact over the diameter [N m-1]
    rolling: float = 0.0
    wall: float = 0.0  # memory of gusts in the sublayer over nu / u*^2 [1]; 0: 20 ms in every wind


QUESTIONS = (
    Question("steady"),
    Question("0.3 s of gusts", SHORT),
    Question("5 s of gusts", LONG),
    Question("and adhesion of a whole grain", LONG, BETA / sqrt(6.0)),
    Question("and adhesion in every contact", LONG, BETA),
    Question("and rolling friction", LONG, BETA / sqrt(6.0), ROLLING),
    Question("and gusts as short as near a wall", LONG, BETA / sqrt(6.0), ROLLING, 10.0),
    Question("and three times as long", LONG, BETA / sqrt(6.0), ROLLING, 30.0),
)


@dataclass(frozen=True)
class Start:
    """Friction velocity at which a share of the surface grains can tip."""

    question: str
    diameter: float  # mm
    share: float
    wind: float  # m s-1


def wind_at(friction: float, diameter: float, height: Floats) -> tuple[Floats, Floats]:
    """Wind [m s-1] and shear [s-1] at heights over the surface of a bed [m]; both 0 below."""
    rough = friction * diameter / VISCOSITY
    shift = 0.9 * (sqrt(rough) - rough * exp(-rough / 6.0)) if rough > 4.535 else 0.0
    above = np.maximum(height, 0.0) * friction / VISCOSITY
    grid = np.linspace(0.0, 1.0, 2000) ** 2 * max(60.0, float(above.max()))
    length = KARMAN * (grid + shift) * (1.0 - np.exp(-(grid + shift) / DAMPING))
    slope = 2.0 / (1.0 + np.sqrt(1.0 + 4.0 * length**2))
    speed = np.append(0.0, np.cumsum(0.5 * (slope[1:] + slope[:-1]) * np.diff(grid)))
    inside = np.where(height > 0.0, np.interp(above, grid, slope), 0.0)
    return friction * np.interp(above, grid, speed), friction**2 / VISCOSITY * inside


def forces(speed: Floats, shear: Floats, radius: Floats, gap: Floats) -> tuple[Floats, Floats, Floats]:
    """Drag [N], torque [N m] and lift [N] of air on spheres at rest near a wall; gap over the diameter."""
    reynolds = np.maximum(2.0 * radius * speed / VISCOSITY, 1e-12)
    creeping = 1.0 + 0.138 * np.exp(-2.0 * gap) + 9.0 / (16.0 * (1.0 + 2.0 * gap))
    share = 0.15 - 0.046 * (1.0 - 0.16 * gap**2) * np.exp(-0.7 * gap)
    power = 0.687 + 0.066 * (1.0 - 0.76 * gap**2) * np.exp(-(gap**0.9))
    drag = creeping * (1.0 + share * reynolds**power) * 6.0 * pi * AIR * VISCOSITY * radius * speed
    torque = 0.944 * 4.0 * pi * AIR * VISCOSITY * radius**3 * shear
    lift = 0.5 * pi * AIR * (radius * speed) ** 2 * 3.663 / (reynolds**2 + 0.1173) ** 0.22
    return drag, torque, lift


def gust_peak(watch: float, diameter: float, memory: float = MEMORY, seed: int = 1) -> float:
    """Largest mean over sqrt(d / g) within a watch [s] of a process of variance 1, the median of many."""
    step = memory / 20.0
    rng, keep = np.random.default_rng(seed), exp(-step / memory)
    wait = max(1, round(sqrt(diameter / GRAVITY) / step))
    state = rng.normal(size=TRIES)
    path = np.empty((int(watch / step) + wait, TRIES))
    for row in path:
        state = keep * state + sqrt(1.0 - keep**2) * rng.normal(size=TRIES)
        row[:] = state
    sums = np.vstack([np.zeros(TRIES), np.cumsum(path, axis=0)])
    return float(np.median((sums[wait:] - sums[:-wait]).max(axis=0) / wait))


def memory_at_wall(friction: float, diameter: float, wall: float) -> float:
    """Memory of gusts [s] at the height of a grain that lies on the bed, by Kallio & Reeks, at most 20 ms."""
    height = min(0.5 * diameter * friction / VISCOSITY, 200.0)
    growth = 1.0 if height < 5.0 else 0.7122 + 0.05731 * height - 0.000129 * height**2
    return min(wall * growth * VISCOSITY / friction**2, MEMORY)


def crossing_peak(watch: float, wait: float, memory: float) -> float:
    """Median of the largest mean over `wait` in a watch [s] of a Langevin process of variance 1, by Rice.

    The mean of such a process has the variance 2 (a - 1 + exp(-a)) / a^2 with a = wait / memory, its slope
    2 (1 - exp(-a)) / wait^2; crossings of a high level are taken as independent.
    """
    span = wait / memory
    deviation = sqrt(2.0 * (span - 1.0 + exp(-span))) / span
    crossings = watch * sqrt(2.0 * (1.0 - exp(-span))) / (2.0 * pi * wait * deviation)

    def rarity(level: float) -> float:
        return float(norm.logcdf(level)) - crossings * exp(-0.5 * level**2) - log(0.5)

    return deviation * root_scalar(rarity, bracket=(0.0, 10.0)).root


def gust_factor(speed: Floats, friction: float, peak: float) -> Floats:
    """Wind in a gust over its mean [m s-1], where its process of variance 1 is at a peak."""
    spread = np.log(1.0 + np.minimum(2.5 * friction / np.maximum(speed, 1e-9), 0.4) ** 2)
    return np.exp(np.sqrt(spread) * peak - 0.5 * spread)


def excess(
    grains: Sequence[Loose], diameter: float, friction: float, peak: float | None, asked: Question
) -> Floats:
    """Work of the air less that of what holds, in the easiest rotation of each grain, over its weight [1]."""
    height, radius = (
        diameter * np.array([getattr(g, name) for g in grains]) for name in ("height", "radius")
    )
    chord = np.sqrt(1.0 - SLICES**2)
    spots = height[:, np.newaxis] + radius[:, np.newaxis] * SLICES
    speed, shear = (part @ (chord / chord.sum()) for part in wind_at(friction, diameter, spots))
    gust = 1.0 if peak is None else gust_factor(speed, friction, peak)
    gap = np.maximum((height - radius) / (2.0 * radius), 0.0)
    return easiest(grains, diameter, forces(gust * speed, gust * shear, radius, gap), asked)


def easiest(
    grains: Sequence[Loose], diameter: float, loads: tuple[Floats, Floats, Floats], asked: Question
) -> Floats:
    """Excess of the work in the easiest rotation of each grain, from drag, torque and lift; as `excess`."""
    drag, torque, lift = loads
    radius = diameter * np.array([grain.radius for grain in grains])
    weight = (QUARTZ - AIR) * GRAVITY * 4.0 / 3.0 * pi * radius**3
    down, pull = weight - lift, asked.pull * 2.0 * radius
    press = asked.rolling * 0.5 * radius * np.hypot(drag, down) / diameter
    best = np.full(len(grains), -inf)
    for k, grain in enumerate(grains):
        best[k] = max(
            drag[k] * t.forward + torque[k] / diameter * t.spin - down[k] * t.upward
            - pull[k] * t.opening - press[k] * t.carried
            for t in grain.tilts
        ) / weight[k]  # fmt: skip
    return best


def peaks_of(asked: Question, diameter: float) -> list[float | None]:
    """Peak of the gusts of a watch in each of WINDS; None in a steady wind."""
    if not asked.wall:
        return [gust_peak(asked.watch, diameter) if asked.watch else None] * len(WINDS)
    wait = sqrt(diameter / GRAVITY)
    memories = (memory_at_wall(float(wind), diameter, asked.wall) for wind in WINDS)
    return [crossing_peak(asked.watch, wait, memory) for memory in memories]


def tipping_winds(grains: Sequence[Loose], diameter: float, asked: Question) -> Floats:
    """Friction velocity at which each grain begins to tip [m s-1], infinite where none of WINDS does it."""
    peaks = peaks_of(asked, diameter)
    work = np.array([
        excess(grains, diameter, float(wind), peak, asked) for wind, peak in zip(WINDS, peaks, strict=True)
    ])  # fmt: skip
    moved = work >= 0.0
    first = moved.argmax(axis=0)
    at = np.arange(len(grains))
    before = np.maximum(first - 1, 0)
    low, high = work[before, at], work[first, at]
    share = np.clip(low / np.where(low == high, -1.0, low - high), 0.0, 1.0)
    winds = np.exp(np.log(WINDS[before]) * (1.0 - share) + np.log(WINDS[first]) * share)
    return np.where(moved.any(axis=0), winds, inf)


def starts() -> Iterator[Start]:
    """All questions at all diameters; the beds are the same, in diameters."""
    beds = [dropped(SIDE, seed) for seed in SEEDS]
    grains = [grain for centres, radii in beds for grain in loose_grains(centres, radii, SIDE).values()]
    surface = len(SEEDS) * SIDE**2
    for asked in QUESTIONS:
        for size in SIZES:
            ordered = np.sort(tipping_winds(grains, 1e-3 * size, asked))
            for share in SHARES:
                yield Start(asked.name, size, share, float(ordered[int(share * surface) - 1]))


if __name__ == "__main__":
    words(__doc__)
    write_table(TABLE, Start, list(starts()), digits=4)
