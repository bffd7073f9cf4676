"""Search for the threshold winds of one bed: a sequence of trials, each with one friction velocity u*.

    ramp    u* grows in small steps over the bed as it is, until the first grains roll or leave
    hold    from rest, from that wind on: in such steps to the other side of the threshold, then bisected
            until the step has been halved often enough
    start   from rest, well above the fluid threshold, until transport has developed
    fall    u* falls in small steps over moving grains, until they come to rest

Where the scene names the wind of the transport, the search begins with `start`, over the grains as they are.

At every change of u* the air takes its steady profile at once, and where the scene asks for it at every check
of a transport: a column that is spun up over few grains is too fast for those that will fly. Below the
threshold nothing happens for long: in a steady wind a trial ends early once the bed is at rest.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from math import ceil, log, sqrt
from typing import Any, Literal

import numpy as np

from taichi_erosion.core.setup import Floats
from taichi_erosion.core.snapshot import Snapshot
from taichi_erosion.measures.threshold import Bracket, friction_velocity_at_zero_flux
from taichi_erosion.scene import Scene
from taichi_erosion.scene.preparation.sizes import nominal_diameter
from taichi_erosion.simulation import Simulation, air_profile, export_bed, import_bed, snapshot, spin_up_wind

FIRST_WIND = 0.08  # of sqrt((s - 1) g d): below all thresholds of dry grains in air, with drag alone [1]
LEAST_WIND = 0.02  # of the same: a bed that moves in such a wind was not at rest, and has no threshold [1]
REST_MOTION = 1e-4  # of a diameter, between two checks: less motion is rest in a steady wind [1]
REST_AFTER = 0.2  # of a trial, before which a bed does not count as at rest [1]
ROUNDING = 1e-9  # of an interval or of a grain: what lies on its end counts as reached [1]
ALOFT = 0.6, 0.9  # of the height of the air: where grains are carried off [1]
LANDING = 0.4  # of that height, below which they are lifted again [1]
DURATION = {"ramp": "rise_hold", "hold": "hold", "start": "spin_up", "fall": "fall_hold"}  # by phase
FROM_REST = ("hold", "start")  # phases whose trials begin with the bed at rest
TRANSPORT = ("start", "fall")  # phases in which grains blow
USUAL_WATCHES, USUAL_RATIO = 2.0, 0.6  # full watches from rest; last wind of a fall over the fluid threshold
# measures that ask for the start and the fall
IMPACT = ("impact_threshold", "impact_threshold_linear", "threshold_ratio", "threshold_ratio_linear")

Phase = Literal["ramp", "hold", "start", "fall"]


@dataclass
class Trial:
    """One friction velocity over the bed, and the motion of the grains since it began."""

    friction_velocity: float  # m s-1
    began: float  # s
    start: Floats  # [n, 3] m, of every grain when it began
    last: Floats  # [n, 3] m, at the last check
    rolling: Any  # [n] bool, moved along the bed by the distance
    risen: Any  # [n] bool, moved upwards by the distance
    largest_motion: float = np.inf  # m, largest displacement of a grain between the last two checks
    flux: list[float] = field(default_factory=list)  # kg m-1 s-1, at every check

    @property
    def mean_flux_of_second_half(self) -> float:
        """Mean flux over the second half [kg m-1 s-1]."""
        return float(np.mean(self.flux[len(self.flux) // 2 :]))


@dataclass
class ThresholdSearch:
    """State of the search in one bed, and the brackets found."""

    scene: Scene
    bed: dict[str, Any]  # saved state of the grains at rest
    trial: Trial
    phase: Phase = "ramp"
    low: float | None = None  # m s-1, highest wind from rest that the bed withstood
    high: float | None = None  # m s-1, lowest wind from rest that moved it
    flux_at_start: float = 0.0  # kg m-1 s-1, flux from which the fall begins
    brackets: dict[str, Bracket] = field(default_factory=dict)
    fluxes: list[tuple[float, float]] = field(default_factory=list)  # friction velocity, flux: start and fall
    is_over: bool = False

    @property
    def period(self) -> Floats:
        """Length and width of the patch [m]."""
        assert self.scene.wind is not None
        return np.array([self.scene.wind.length, self.scene.wind.width])

    @property
    def diameter(self) -> float:
        return nominal_diameter(self.scene.grains)

    @property
    def grains_needed(self) -> int:
        """Number of grains that must leave the bed for it to count as moved."""
        return max(1, ceil(self.scene.threshold.share * self.period.prod() / self.diameter**2 - ROUNDING))

    def share_done(self, elapsed: float) -> float:
        """Rough share of the cost [1] at a time after the begin [s]: half is from rest, half transport."""
        settings, last = self.scene.threshold, 0.5 if set(IMPACT) & set(self.scene.measure) else 1.0
        if self.phase not in TRANSPORT:
            return last * elapsed / (USUAL_WATCHES * settings.hold + elapsed)
        fall = self.fluxes[0][0] / self.trial.friction_velocity if self.fluxes else 1.0
        return 0.5 + 0.5 * min(1.0, log(fall) / log(settings.excess / USUAL_RATIO))


def begin_search(sim: Simulation, scene: Scene, replica: int, time: float) -> ThresholdSearch:
    """First trial: of the ramp, or of transport; the bed as it is serves all later trials from rest."""
    transport = scene.threshold.transport
    first = transport or first_wind(scene)
    bed, trial = export_bed(sim, replica), begin_trial(sim, replica, first, time)
    spin_up_wind(sim, replica, first)
    return ThresholdSearch(scene, bed, trial, "start" if transport else "ramp")


def first_wind(scene: Scene) -> float:
    """Friction velocity with which the ramp begins [m s-1]."""
    return scene.threshold.first or FIRST_WIND * velocity_scale(scene)


def velocity_scale(scene: Scene) -> float:
    """sqrt((s - 1) g d) of the scene's grains [m s-1], the velocity that friction velocities scale with."""
    assert scene.wind is not None
    diameter, density = nominal_diameter(scene.grains), scene.grain_density
    return sqrt((density / scene.wind.density - 1.0) * scene.gravity.magnitude * diameter)


def begin_trial(sim: Simulation, replica: int, friction_velocity: float, time: float) -> Trial:
    start = snapshot(sim, replica).position
    nothing = np.zeros(len(start), dtype=bool)
    return Trial(friction_velocity, time, start, start, nothing, nothing)


def advance_search(sim: Simulation, replica: int, search: ThresholdSearch, time: float) -> None:
    """Record the motion since the last check; where a trial ends begin the next one, if there is any."""
    record_grain_motion(search, snapshot(sim, replica))
    if search.scene.threshold.steady_air and search.phase in TRANSPORT:
        spin_up_wind(sim, replica, search.trial.friction_velocity)
    # neither an effect nor an eddy changes the wind over grains at rest
    steady = not sim.world.grain_effects.any and (sim.coupling.air is None or sim.coupling.air.is_column)
    outcome = does_bed_move(search, time, steady)
    if outcome is None:
        if search.phase in ("ramp", "hold") and not search.scene.threshold.landings:
            lift_grains_that_left_bed(sim, replica, search)
        return
    old = search.trial
    wind = NEXT_WIND[search.phase](search, outcome)
    if wind is None:
        search.is_over = True
        return
    from_rest = search.phase in FROM_REST
    if from_rest:
        import_bed(sim, replica, search.bed)
    spin_up_wind(sim, replica, wind, anew=from_rest)
    search.trial = begin_trial(sim, replica, wind, time)
    if search.phase == "ramp":
        search.trial.start, search.trial.rolling, search.trial.risen = old.start, old.rolling, old.risen


def lift_grains_that_left_bed(sim: Simulation, replica: int, search: ThresholdSearch) -> None:
    """Lift grains that have left the bed high into the air, at its speed, before they land on others."""
    assert search.scene.wind is not None
    (risen,) = np.nonzero(search.trial.risen)
    place, height = search.trial.last[risen, 2], search.scene.wind.height
    if not (place < LANDING * height).any():
        return
    bed, air = export_bed(sim, replica), air_profile(sim, replica)
    rows, heights = np.argsort(bed["ident"])[risen], height * np.linspace(*ALOFT, len(risen))
    speed = np.interp(heights, 0.5 * (air.face[1:] + air.face[:-1]), air.velocity[:, 0])
    bed["origin"][rows, 2] += heights - place
    bed["velocity"][rows] = np.outer(speed, [1.0, 0.0, 0.0])
    bed["spin"][rows] = 0.0
    import_bed(sim, replica, bed)


def record_grain_motion(search: ThresholdSearch, state: Snapshot) -> None:
    """Update which grains have rolled or risen, the largest motion and the flux."""
    trial = search.trial
    far = search.scene.threshold.distance * search.diameter
    shift = periodic_displacement(state.position, trial.start, search.period)
    trial.rolling = trial.rolling | (np.hypot(shift[:, 0], shift[:, 1]) > far)
    trial.risen = trial.risen | (shift[:, 2] > far)
    step = periodic_displacement(state.position, trial.last, search.period)
    trial.largest_motion = float(np.abs(step).max())
    trial.last = state.position
    trial.flux.append(float((state.mass * state.velocity[:, 0]).sum() / search.period.prod()))


def periodic_displacement(after: Floats, before: Floats, period: Floats) -> Floats:
    """Displacement to the nearest periodic image, [n, 3] m."""
    shift = after - before
    shift[:, :2] -= period * np.round(shift[:, :2] / period)
    return shift


def does_bed_move(search: ThresholdSearch, time: float, steady: bool) -> bool | None:
    """Whether the bed moves in this wind; None while that is open."""
    settings, trial = search.scene.threshold, search.trial
    elapsed = (time - trial.began) / getattr(settings, DURATION[search.phase])
    over = elapsed >= 1.0 - ROUNDING
    quiet = steady and elapsed > REST_AFTER and trial.largest_motion < REST_MOTION * search.diameter
    if search.phase in ("ramp", "hold"):
        if np.count_nonzero(trial.risen) >= search.grains_needed:
            return True
        return False if over or quiet else None
    if search.phase == "fall" and (over or quiet):
        return over and trial.mean_flux_of_second_half > settings.ceased * search.flux_at_start
    return True if over else None


def next_wind_of_ramp(search: ThresholdSearch, in_motion: bool) -> float:
    """A stronger wind; once grains roll the same one from rest, once they leave the bed a weaker one.

    Beds are moved from rest by about the wind in which their grains begin to roll: a ramp that goes on until
    grains leave the bed, for which a step is short, ends far above it.
    """
    now, factor = search.trial.friction_velocity, 1.0 + search.scene.threshold.rise
    rolled = np.count_nonzero(search.trial.rolling) >= search.grains_needed
    if not (rolled or in_motion):
        return now * factor
    if now > first_wind(search.scene):  # else grains rolled before
        search.brackets["rolling_onset"] = Bracket(now / factor, now)
    search.phase = "hold"
    return now / factor if in_motion else now


def next_wind_from_rest(search: ThresholdSearch, in_motion: bool) -> float | None:
    """Next wind from rest: between the weakest that moved the bed and the strongest that did not."""
    settings, now = search.scene.threshold, search.trial.friction_velocity
    if in_motion:
        search.high = now
    else:
        search.low = now
    if search.high is None:
        return now * (1.0 + settings.rise)
    if search.low is None:
        return now / (1.0 + settings.rise) if now > LEAST_WIND * velocity_scale(search.scene) else None
    bracket = Bracket(search.low, search.high)
    if bracket.high > bracket.low * (1.0 + settings.rise) ** (0.5**settings.levels) * (1.0 + ROUNDING):
        return bracket.middle
    search.brackets["fluid_threshold"] = bracket
    if not set(IMPACT) & set(search.scene.measure):
        return None
    search.phase = "start"
    return settings.excess * bracket.middle


def first_wind_of_fall(search: ThresholdSearch, in_motion: bool) -> float | None:
    """First wind of the fall; the flux of developed transport is stored."""
    search.flux_at_start = search.trial.mean_flux_of_second_half
    search.fluxes.append((search.trial.friction_velocity, search.flux_at_start))
    if search.flux_at_start <= 0.0:
        return None
    search.phase = "fall"
    return search.trial.friction_velocity * (1.0 - search.scene.threshold.fall)


def next_wind_of_fall(search: ThresholdSearch, in_motion: bool) -> float | None:
    """A weaker wind while transport goes on; at its end the impact threshold."""
    now, factor = search.trial.friction_velocity, 1.0 - search.scene.threshold.fall
    search.fluxes.append((now, search.trial.mean_flux_of_second_half))
    if in_motion:
        return now * factor
    search.brackets["impact_threshold"] = Bracket(now, now / factor)
    if (line := friction_velocity_at_zero_flux(search.fluxes)) is not None:
        search.brackets["impact_threshold_linear"] = line
    return None


NEXT_WIND: dict[str, Callable[[ThresholdSearch, bool], float | None]] = {
    "ramp": next_wind_of_ramp,
    "hold": next_wind_from_rest,
    "start": first_wind_of_fall,
    "fall": next_wind_of_fall,
}
