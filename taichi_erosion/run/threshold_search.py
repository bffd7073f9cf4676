"""The hunt for thresholds in one bed: which wind blows next, and what the bed does in it.

    ramp    u* grows in small steps over the bed as it is, until the first grains roll or leave
    hold    from rest, from that wind on: in such steps to the other side of the threshold, then bisected
            until the step has been halved often enough
    start   from rest, well above the fluid threshold, until transport has developed
    fall    u* falls in small steps over moving grains, until they come to rest

Where the scene names the wind of the transport, the hunt begins with the start, over grains as they blow.

At every change of u* the air takes its steady profile at once. Below the threshold nothing happens for long:
where the wind is steady, a bed that no longer stirs is called at rest before its time is up.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from math import ceil, sqrt
from typing import Any, Literal

import numpy as np

from taichi_erosion.core.setup import Floats
from taichi_erosion.core.snapshot import Snapshot
from taichi_erosion.measures.threshold import Bracket, flux_intercept
from taichi_erosion.scene import Scene
from taichi_erosion.scene.build.sizes import nominal_diameter
from taichi_erosion.simulation import Simulation, export_bed, import_bed, snapshot, spin_up_wind

FIRST = 0.08  # of sqrt((s - 1) g d): below all thresholds of dry grains in air, with drag alone [1]
LEAST = 0.02  # of the same: a bed that moves even in such a wind was not at rest, and has no threshold [1]
QUIET = 1e-4  # of a diameter, between two checks: a bed that stirs less is at rest in a steady wind [1]
STIR = 0.2  # of a trial that a bed is given before it may be called at rest [1]
ROUNDING = 1e-9  # of an interval: what lies on its end counts as reached [1]
DURATION = {"ramp": "rise_hold", "hold": "hold", "start": "spin_up", "fall": "fall_hold"}  # by phase
FROM_REST = ("hold", "start")  # phases whose winds find the bed as it was at rest
# measures that ask for the start and the fall
IMPACT = ("impact_threshold", "impact_threshold_linear", "threshold_ratio")

Phase = Literal["ramp", "hold", "start", "fall"]


@dataclass
class Trial:
    """What the bed has done in the present wind."""

    friction_velocity: float  # m s-1
    began: float  # s
    place: Floats  # [n, 3] m, of every grain when it began
    before: Floats  # [n, 3] m, at the last check
    rolled: Any  # [n] bool, over the bed by the distance
    risen: Any  # [n] bool, above its place by the distance
    stirred: float = np.inf  # m, largest way of a grain between the last two checks
    flux: list[float] = field(default_factory=list)  # kg m-1 s-1, at every check

    @property
    def late_flux(self) -> float:
        """Mean flux over the second half [kg m-1 s-1]."""
        return float(np.mean(self.flux[len(self.flux) // 2 :]))


@dataclass
class Hunt:
    """Where the hunt in one bed stands, and what it has found."""

    scene: Scene
    bed: dict[str, Any]  # grains at rest
    trial: Trial
    phase: Phase = "ramp"
    low: float | None = None  # m s-1, highest wind from rest that the bed withstood
    high: float | None = None  # m s-1, lowest wind from rest that moved it
    full: float = 0.0  # kg m-1 s-1, flux from which the fall begins
    found: dict[str, Bracket] = field(default_factory=dict)
    trials: list[dict[str, Any]] = field(default_factory=list)

    @property
    def period(self) -> Floats:
        """Length and width of the patch [m]."""
        assert self.scene.wind is not None
        return np.array([self.scene.wind.length, self.scene.wind.width])

    @property
    def diameter(self) -> float:
        """Nominal diameter [m]."""
        return nominal_diameter(self.scene.grains.size)

    @property
    def needed(self) -> int:
        """Grains that must move."""
        return max(1, ceil(self.scene.threshold.share * float(self.period.prod()) / self.diameter**2))


def begin_hunt(sim: Simulation, scene: Scene, replica: int, time: float) -> Hunt:
    """Start with the ramp, or with transport; the bed as it lies is what later winds from rest find."""
    transport = scene.threshold.transport
    first = transport or scene.threshold.first or FIRST * weight_velocity(scene)
    hunt = Hunt(scene, export_bed(sim, replica), new_trial(sim, replica, first, time))
    hunt.phase = "start" if transport else "ramp"
    spin_up_wind(sim, replica, first)
    return hunt


def weight_velocity(scene: Scene) -> float:
    """sqrt((s - 1) g d) of the scene's grains [m s-1], the velocity that friction velocities scale with."""
    assert scene.wind is not None
    diameter, density = nominal_diameter(scene.grains.size), scene.materials[scene.grains.material].density
    return sqrt((density / scene.wind.density - 1.0) * scene.gravity.magnitude * diameter)


def new_trial(sim: Simulation, replica: int, friction_velocity: float, time: float) -> Trial:
    """A trial that begins with the bed as it is."""
    place = snapshot(sim, replica).position
    nothing = np.zeros(len(place), dtype=bool)
    return Trial(friction_velocity, time, place, place, nothing, nothing)


def pursue(sim: Simulation, replica: int, hunt: Hunt, time: float) -> bool:
    """Look at the bed and choose the next wind; says whether the hunt is over."""
    watch(hunt, snapshot(sim, replica))
    outcome = judge(hunt, time, steady=is_steady(sim))
    if outcome is None:
        return False
    note(hunt, outcome, time)
    old = hunt.trial
    order = NEXT[hunt.phase](hunt, outcome)
    if order is None:
        return True
    from_rest = hunt.phase in FROM_REST
    if from_rest:
        import_bed(sim, replica, hunt.bed)
    spin_up_wind(sim, replica, order, anew=from_rest)
    hunt.trial = new_trial(sim, replica, order, time)
    if hunt.phase == "ramp":
        hunt.trial.place, hunt.trial.rolled, hunt.trial.risen = old.place, old.rolled, old.risen
    return False


def is_steady(sim: Simulation) -> bool:
    """Whether the wind over grains at rest stays as it is: no effect and no eddy changes it."""
    return not sim.world.grain_effects.any and (sim.coupling.air is None or sim.coupling.air.is_column)


def watch(hunt: Hunt, state: Snapshot) -> None:
    """Which grains have rolled or risen, and the flux."""
    trial, far = hunt.trial, hunt.scene.threshold.distance * hunt.diameter
    moved = way(state.position, trial.place, hunt.period)
    trial.rolled = trial.rolled | (np.hypot(moved[:, 0], moved[:, 1]) > far)
    trial.risen = trial.risen | (moved[:, 2] > far)
    trial.stirred = float(np.abs(way(state.position, trial.before, hunt.period)).max())
    trial.before = state.position
    trial.flux.append(float((state.mass * state.velocity[:, 0]).sum() / hunt.period.prod()))


def way(after: Floats, before: Floats, period: Floats) -> Floats:
    """Shortest ways between places of a periodic patch, [n, 3] m."""
    moved = after - before
    moved[:, :2] -= period * np.round(moved[:, :2] / period)
    return moved


def judge(hunt: Hunt, time: float, steady: bool) -> bool | None:
    """Whether the bed moves in this wind; None while that is open."""
    order, trial = hunt.scene.threshold, hunt.trial
    duration = getattr(order, DURATION[hunt.phase])
    elapsed = (time - trial.began) / duration
    over = elapsed >= 1.0 - ROUNDING
    quiet = steady and elapsed > STIR and trial.stirred < QUIET * hunt.diameter
    if hunt.phase in ("ramp", "hold"):
        if np.count_nonzero(trial.risen) >= hunt.needed:
            return True
        return False if over or quiet else None
    if hunt.phase == "fall" and (over or quiet):
        return over and trial.late_flux > order.ceased * hunt.full
    return True if over else None


def note(hunt: Hunt, outcome: bool, time: float) -> None:
    """Write down how a trial ended."""
    trial = hunt.trial
    hunt.trials.append(
        {
            "phase": hunt.phase,
            "friction_velocity": trial.friction_velocity,
            "moved": outcome,
            "duration": time - trial.began,
            "rolled": int(np.count_nonzero(trial.rolled)),
            "risen": int(np.count_nonzero(trial.risen)),
            "flux": trial.late_flux,
        }
    )


def after_ramp(hunt: Hunt, moved: bool) -> float:
    """A stronger wind; once grains roll, the same one from rest, and a weaker one once they leave the bed.

    Beds are moved from rest by about the wind in which their grains begin to roll: a ramp that goes on until
    grains leave the bed, for which a step is short, ends far above it.
    """
    now, factor = hunt.trial.friction_velocity, 1.0 + hunt.scene.threshold.rise
    rolled = np.count_nonzero(hunt.trial.rolled) >= hunt.needed
    if not (rolled or moved):
        return now * factor
    hunt.found["rolling_onset"] = Bracket(now / factor, now)
    hunt.phase = "hold"
    return now / factor if moved else now


def after_hold(hunt: Hunt, moved: bool) -> float | None:
    """The next wind from rest: between the weakest that moved the bed and the strongest that did not."""
    order, now = hunt.scene.threshold, hunt.trial.friction_velocity
    if moved:
        hunt.high = now
    else:
        hunt.low = now
    if hunt.high is None:
        return now * (1.0 + order.rise)
    if hunt.low is None:
        return now / (1.0 + order.rise) if now > LEAST * weight_velocity(hunt.scene) else None
    bracket = Bracket(hunt.low, hunt.high)
    if bracket.high > bracket.low * (1.0 + order.rise) ** (0.5**order.levels) * (1.0 + ROUNDING):
        return bracket.middle
    hunt.found["fluid_threshold"] = bracket
    if not set(IMPACT) & set(hunt.scene.measure):
        return None
    hunt.phase = "start"
    return order.excess * bracket.middle


def after_start(hunt: Hunt, moved: bool) -> float | None:
    """Remember the flux and let the wind fall."""
    hunt.full = hunt.trial.late_flux
    if hunt.full <= 0.0:
        return None
    hunt.phase = "fall"
    return hunt.trial.friction_velocity * (1.0 - hunt.scene.threshold.fall)


def after_fall(hunt: Hunt, moved: bool) -> float | None:
    """A weaker wind while transport goes on."""
    now, factor = hunt.trial.friction_velocity, 1.0 - hunt.scene.threshold.fall
    if moved:
        return now * factor
    hunt.found["impact_threshold"] = Bracket(now, now / factor)
    blown = [trial for trial in hunt.trials if trial["phase"] in ("start", "fall")]
    line = flux_intercept([(trial["friction_velocity"], trial["flux"]) for trial in blown])
    if line is not None:
        hunt.found["impact_threshold_linear"] = line
    return None


NEXT: dict[str, Callable[[Hunt, bool], float | None]] = {
    "ramp": after_ramp,
    "hold": after_hold,
    "start": after_start,
    "fall": after_fall,
}
