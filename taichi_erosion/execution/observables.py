"""Observables by name: the measure of each, measures in files of the user, and the input of all."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from math import copysign, inf, nan, prod
from typing import Any

import numpy as np
from numpy.typing import NDArray

from taichi_erosion.core.effect_file import EffectFile, error_text, execute_effect, line_of, read_effect_file
from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.setup import Floats, Triple
from taichi_erosion.core.snapshot import AirProfile, ContactNetwork, GrainFields, Snapshot, WallPose
from taichi_erosion.measures import (
    coarse_graining,
    drum_and_incline,
    heap,
    mass_flow,
    shortfalls,
    splash,
    threshold,
    wall_loads,
    wind_bed,
)
from taichi_erosion.measures.result import Measurement, Shortfall, no_measurement
from taichi_erosion.scene import Scene
from taichi_erosion.scene.preparation.air import bed_surface_height
from taichi_erosion.scene.preparation.sizes import nominal_diameter
from taichi_erosion.scene.preparation.walls import surface_of_revolution_rows
from taichi_erosion.scene.schema.fields import unit_vector
from taichi_erosion.scene.schema.geometry import ORIGIN, Cone, Cylinder, Disc, Funnel, Plane, Wall
from taichi_erosion.scene.schema.scene import SPLASH, Measure

AZIMUTHS = 12  # silhouettes of a heap where the scene names no number
CONE_SHARE = 0.5  # of the grains of a planned heap, without which no cone has its rows [1]
LEFT_MOST = 0.05  # of the grains: more inside, and a funnel or tube has not emptied [1]
REMEDY = 'it needs UNIT = "..." and a function measure(grains, contacts, walls) that gives a number'


@dataclass(frozen=True)
class MeasureInput:
    """Input of a measure: the end of its stage, and the frames stored during the stage."""

    scene: Scene
    request: Measure
    end: Snapshot
    frames: tuple[Snapshot, ...]
    tilts: tuple[float, ...]  # rad, of the frames
    air: AirProfile | None = None  # at the end, where there is any
    airs: tuple[AirProfile, ...] = ()  # of the frames
    thresholds: Mapping[str, threshold.Bracket] = field(default_factory=dict)  # found so far, by name
    profile: Callable[[], GrainFields] | None = None  # coarse-grained fields over the height, at the end
    period: Triple = (0.0, 0.0, 0.0)  # m, 0 where open
    window: wind_bed.Window | None = None  # of steady transport; None: the whole stage
    loads: tuple[Floats, ...] = ()  # of walls, and shifts of the frames, where a measure reads them
    poses: Mapping[str, WallPose] = field(default_factory=dict)  # of walls at the end; others stand as built
    network: Callable[[], ContactNetwork] | None = None  # contacts at the end
    waiting: int = 0  # spheres that have not been released

    @property
    def wind_patch(self) -> wind_bed.Patch:
        return wind_patch_of_scene(self.scene)

    @property
    def steady_frames(self) -> tuple[Snapshot, ...]:
        return self.frames[self.window.first :] if self.window else self.frames

    @property
    def steady_air_profiles(self) -> tuple[AirProfile, ...]:
        return self.airs[self.window.first :] if self.window else self.airs

    @property
    def wind_tunnel(self) -> threshold.Tunnel:
        patch, search = self.wind_patch, self.scene.threshold
        return threshold.Tunnel(search.fetch, patch.diameter, patch.viscosity, search.speed_ratio)

    @property
    def plate_under_heap(self) -> Wall | None:
        """The plate under the heap: as stated, or that of another measure."""
        requests = (self.request, *self.scene.measure.values())
        return self.scene.geometry.get(next((each.plate for each in requests if each.plate), ""))

    @property
    def axis(self) -> Floats:
        """Axis that the measure states, a unit vector."""
        return np.array(unit_vector(self.request.axis))

    @property
    def wall_load(self) -> list[Floats]:
        """Force and torque on the walls of the measure together, and shift of the first, by frame."""
        names = sorted(self.scene.geometry)
        rows = [names.index(name) for name in self.request.walls or names]
        return [np.append(load[rows, :6].sum(axis=0), load[rows[0], 6:]) for load in self.loads]

    @property
    def area(self) -> float:
        """Area that the measure states, or that of the periodic patch [m2]."""
        return self.request.area or prod(self.scene.periods_xy or ())

    @property
    def base_height(self) -> float:
        """Height of the plate at the origin [m]."""
        if isinstance(self.plate_under_heap, Plane):
            return self.plate_under_heap.point[2]
        return self.plate_under_heap.centre[2] if isinstance(self.plate_under_heap, Disc) else 0.0

    @property
    def plate_radius(self) -> float | None:
        """Radius of a round plate [m], None for one without an edge."""
        return self.plate_under_heap.radius if isinstance(self.plate_under_heap, Disc) else None

    @cached_property
    def grains_off_plate(self) -> NDArray[np.bool_]:
        """Grains at the end that have fallen below a round plate."""
        if not isinstance(self.plate_under_heap, Disc):
            return np.zeros(self.end.radius.size, bool)
        upwards = np.multiply(self.plate_under_heap.axis, copysign(1.0, self.plate_under_heap.axis[2]))
        return (self.end.position - self.plate_under_heap.centre) @ upwards <= 0.0

    @cached_property
    def grains_in_tube(self) -> NDArray[np.bool_]:
        """Grains at the end inside a funnel or a lifted tube that ends above the plate."""
        inside = np.zeros(self.end.radius.size, bool)
        for name, wall in self.scene.geometry.items() if inside.size else ():
            pose = self.poses.get(name, WallPose(True, np.eye(3), np.zeros(3)))
            lifted = pose.translation[2] > 0.0
            if isinstance(wall, Funnel) or (isinstance(wall, Cylinder | Cone) and lifted):
                rows = np.array(surface_of_revolution_rows(wall))
                ends = [row[:3] + row[k] * row[3:6] for row in rows for k in (7, 9)]
                lowest = (ends @ pose.rotation.T + pose.translation)[:, 2].min()
                gap = 0.0 if lifted else heap.median_diameter_by_volume(self.end)
                if pose.present and lowest > self.base_height + gap:
                    as_built = (self.end.position - pose.translation) @ pose.rotation
                    inside |= heap.inside_surface_of_revolution(rows, as_built)
        return inside

    @cached_property
    def heap_snapshot(self) -> Snapshot:
        """The heap alone at the end: without grains that fell off a round plate or are held above it."""
        away = self.grains_off_plate | self.grains_in_tube
        return heap.select_grains(self.end, ~away) if away.any() else self.end

    @property
    def count_of_fallen_grains(self) -> int:
        """Number of grains that fell off the plate or left the domain."""
        return int(self.grains_off_plate.sum()) + self.end.removed

    @property
    def fallen_grains_text(self) -> str:
        """How many grains fell off the plate, in words; empty where none did."""
        whole, loss = self.end.radius.size + self.end.removed, self.count_of_fallen_grains
        return f"{loss:,} of {whole:,} grains fell off the plate; the others are measured" if loss else ""

    @cached_property
    def splash_of_landings(self) -> splash.Splash:
        """Landings of grains in steady transport."""
        return splash.count_splash_events(self.steady_frames, self.wind_patch, self.scene.gravity.magnitude)


def wind_patch_of_scene(scene: Scene) -> wind_bed.Patch:
    wind = scene.wind
    assert wind is not None
    diameter, surface = nominal_diameter(scene.grains), bed_surface_height(scene, wind)
    return wind_bed.Patch(wind.length * wind.width, surface, diameter, wind.density, wind.viscosity)


def dynamic_angle_in_drum(state: MeasureInput) -> Measurement:
    """Dynamic angle in the cylinder that the measure names as its plate."""
    wall = state.scene.geometry.get(state.request.plate or "")
    if isinstance(wall, Cylinder):
        return drum_and_incline.dynamic_angle(state.frames, wall.radius, wall.centre, wall.axis)
    return drum_and_incline.dynamic_angle(state.frames, inf)


def measure_of_threshold(name: str, kind: str) -> Callable[[MeasureInput], Measurement]:
    """Measure of a threshold that the search has bracketed."""
    return lambda state: threshold.threshold_from_bracket(name, state.thresholds.get(kind))


def measure_of_threshold_ratio(name: str, impact: str) -> Callable[[MeasureInput], Measurement]:
    """Measure of one reading of the impact threshold over the fluid threshold."""
    return lambda e: threshold.ratio(name, OBSERVABLES[impact](e), OBSERVABLES["fluid_threshold"](e))


def measure_of_profile(name: str) -> Callable[[MeasureInput], Measurement]:
    """Measure of the coarse-grained profile, by the name of its function."""

    def measure_profile_now(state: MeasureInput) -> Measurement:
        assert state.profile is not None
        try:
            return getattr(coarse_graining, name)(state.end, state.profile())
        except BadInput as error:
            return no_measurement(name, "1", str(error))

    return measure_profile_now


def measure_at_peak(name: str) -> Callable[[MeasureInput], Measurement]:
    """Measure of a plane that is sheared, where its strength is largest."""
    return lambda state: wall_loads.value_at_peak(name, state.wall_load, state.axis, state.area)


OBSERVABLES: dict[str, Callable[[MeasureInput], Measurement]] = {
    "repose_angle": lambda e: heap.repose_angle(
        e.heap_snapshot, e.plate_radius, e.base_height, e.request.azimuths or AZIMUTHS
    ),
    "cone_angle": lambda e: heap.cone_angle(e.heap_snapshot, e.base_height),
    "angle_of_repose": lambda e: heap.angle_of_repose_outline(e.heap_snapshot, e.base_height),
    "pile_height": lambda e: heap.pile_height(e.heap_snapshot, e.base_height),
    "centroid_height": lambda e: heap.centroid_height(e.heap_snapshot, e.base_height),
    "radius_90": lambda e: heap.radius_90(e.heap_snapshot),
    "runout_radius": lambda e: heap.runout_radius(e.heap_snapshot, e.base_height),
    "column_height": lambda e: heap.settled_column_height(e.heap_snapshot, e.base_height),
    "wall_force": lambda e: wall_loads.mean_force_along_axis(e.wall_load, e.axis),
    "wall_torque": lambda e: wall_loads.mean_torque_about(e.wall_load, e.axis, np.array(e.request.centre)),
    "friction_angle": lambda e: wall_loads.peak_friction_angle(e.wall_load, e.axis),
    "residual_friction_angle": lambda e: wall_loads.residual_friction_angle(e.wall_load, e.axis),
    **{name: measure_at_peak(name) for name in ("shear_stress", "normal_stress", "peak_displacement")},
    "dynamic_angle": dynamic_angle_in_drum,
    "sliding_angle": lambda e: drum_and_incline.angle_at_which_grains_slide(e.frames, e.tilts),
    "mass_flow": lambda e: mass_flow.mass_flow_rate(
        e.frames, e.request.plane_point or ORIGIN, e.request.plane_normal, e.period
    ),
    **{name: measure_of_profile(name) for name in ("solid_fraction", "lateral_stress_ratio")},
    "settling_velocity": lambda e: wind_bed.mean_settling_velocity(e.end),
    "pressure_drop": lambda e: wind_bed.pressure_drop(e.airs),
    "bed_height": lambda e: wind_bed.bed_height(e.end),
    "flux": lambda e: wind_bed.mean_sand_flux(e.steady_frames, e.wind_patch),
    "flux_height": lambda e: wind_bed.flux_decay_height(e.steady_frames, e.wind_patch),
    "bed_stress": lambda e: wind_bed.mean_air_stress_at_bed(e.steady_air_profiles, e.wind_patch),
    "grain_stress": lambda e: wind_bed.mean_grain_stress_at_bed(e.steady_air_profiles, e.wind_patch),
    "rebound_share": lambda e: splash.rebound_share(e.splash_of_landings),
    "rebound_speed": lambda e: splash.rebound_speed_ratio(e.splash_of_landings),
    "ejecta_share": lambda e: splash.ejecta_share(e.splash_of_landings),
    "rolling_onset": measure_of_threshold("rolling_onset", "rolling_onset"),
    "fluid_threshold": measure_of_threshold("fluid_threshold", "fluid_threshold"),
    "threshold_u_star": measure_of_threshold("threshold_u_star", "fluid_threshold"),
    "impact_threshold": measure_of_threshold("impact_threshold", "impact_threshold"),
    threshold.LINE: lambda e: threshold.threshold_from_line(e.thresholds.get(threshold.LINE)),
    "threshold_ratio": measure_of_threshold_ratio("threshold_ratio", "impact_threshold"),
    "threshold_ratio_linear": measure_of_threshold_ratio("threshold_ratio_linear", "impact_threshold_linear"),
    "threshold_wind_speed": lambda e: threshold.tunnel_speed(
        "threshold_wind_speed", e.thresholds.get("fluid_threshold"), e.wind_tunnel
    ),
}


ANGLES = ("repose_angle", "cone_angle", "angle_of_repose")
OF_HEAP = (*ANGLES, "pile_height", "centroid_height", "radius_90", "runout_radius", "column_height")


def shortfalls_of_heap_size(heap_state: MeasureInput, measurement: Measurement) -> Iterable[Shortfall]:
    """Whether the heap is large enough for an angle."""
    state = heap_state.heap_snapshot
    measured = heap_state.scene.measured.get(measurement.name)
    if heap.why_snapshot_unmeasurable(state) or (measured is not None and measured.same_size):
        return ()
    height = measurement.details.get("height") or heap.pile_height(state, heap_state.base_height).value
    rows = shortfalls.grain_rows_on_flank(height, heap.median_diameter_by_volume(state))
    goal = nan if measured is None else measured.value
    poured = heap_state.scene.fill.law == "pour"
    lacking = shortfalls.heap_shortfalls(rows, state.radius.size, poured, goal, measurement.value)
    return (replace(each, stated=heap_state.request.of_this_size and not each.blocks) for each in lacking)


def why_heap_is_too_small(scene: Scene, name: str, angles: Floats) -> str:
    """Why a heap is too small for all of some angles [deg], before it is simulated; else empty.

    A cone without stray grains has half of those by which heaps are planned.
    """
    measured, count = scene.measured.get(name), scene.grains.count
    as_small = measured is not None and measured.same_size
    if name not in ANGLES or as_small or scene.grains.clump or not angles.size:
        return ""
    least, usual = (shortfalls.grain_count(shortfalls.LEAST_ROWS, float(f(angles))) for f in (np.max, np.min))
    words = f"the heap is too small for an angle: use at least {usual:,} grains ({count:,} now)"
    return words if count < CONE_SHARE * least else ""


def shortfalls_of_drum_surface(state: MeasureInput, measurement: Measurement) -> Iterable[Shortfall]:
    """Whether the surface in a drum is steady, and wide enough for a slope."""
    wall = state.scene.geometry.get(state.request.plate or "")
    if not isinstance(wall, Cylinder) or heap.why_snapshot_unmeasurable(state.end):
        return
    width = 2.0 * drum_and_incline.MIDDLE_SHARE * wall.radius
    bins = width / heap.median_diameter_by_volume(state.end)
    yield from shortfalls.surface_shortfalls(bins, measurement.value, measurement.sd)


LACKING: dict[str, Callable[[MeasureInput, Measurement], Iterable[Shortfall]]] = {
    **dict.fromkeys(ANGLES, shortfalls_of_heap_size),
    "dynamic_angle": shortfalls_of_drum_surface,
    "settling_velocity": lambda e, _: shortfalls.touching_shortfalls(float((e.end.contacts > 0).mean())),
    **dict.fromkeys(
        ("flux", "flux_height", *SPLASH),
        lambda e, _: shortfalls.hop_shortfalls(len(e.splash_of_landings.impacts)),
    ),
}
OF_TRANSPORT = ("flux", "flux_height", "bed_stress", "grain_stress", *SPLASH)  # measured where it is steady


def measure_observable(name: str, state: MeasureInput) -> Measurement:
    """The measurement, with what the set-up lacks for it; no heap where a funnel or tube has not emptied."""
    if (kind := state.request.kind) is not None:
        of_kind = (heap.select_grains(s, s.kind == s.kinds.index(kind)) for s in (state.end, *state.frames))
        end, *frames = of_kind
        state = replace(state, end=end, frames=tuple(frames))
    if state.request.file is not None:
        return measure_by_user_file(name, state)
    measurement = OBSERVABLES[name](state)
    count, inside = state.waiting + state.end.radius.size, int(state.grains_in_tube.sum())
    if name in OF_HEAP and state.waiting + inside > LEFT_MOST * count:
        where = "not released yet" if state.waiting > inside else "still in the funnel or tube"
        reason = f"{state.waiting + inside:,} of {count:,} grains are {where}"
        return no_measurement(name, measurement.unit, reason)
    lacking = tuple(LACKING[name](state, measurement) if name in LACKING else ())
    if state.window and name in OF_TRANSPORT:
        window = {"window_start": state.window.start, "stress_over_wind": state.window.balance}
        measurement = replace(measurement, details=measurement.details | window)
        lacking += state.window.lacking
    if state.fallen_grains_text and name in OF_HEAP:
        notes = (*measurement.notes, state.fallen_grains_text)
        details = measurement.details | {"fallen_grains": state.count_of_fallen_grains}
        measurement = replace(measurement, notes=notes, details=details)
    return replace(measurement, shortfalls=(*measurement.shortfalls, *lacking))


@lru_cache
def load_measure_file(file: EffectFile) -> tuple[str, Callable[..., Any]]:
    """Unit and function of a file, which is executed once. Raises BadInput where one is missing."""
    module = execute_effect(file, REMEDY)
    unit, function = getattr(module, "UNIT", None), getattr(module, "measure", None)
    if not isinstance(unit, str) or not callable(function):
        raise BadInput(f"{file}: is no measure; {REMEDY}")
    return unit, function


def measure_files_of_scene(scene: Scene) -> dict[str, EffectFile]:
    """Files of the measures of a scene that are the user's own, by name. Raises BadInput."""
    named = {name: order.file for name, order in scene.measure.items() if order.file is not None}
    files = {name: read_effect_file(scene.folder / file, scene.file) for name, file in named.items()}
    for file in files.values():
        load_measure_file(file)
    return files


def measure_by_user_file(name: str, state: MeasureInput) -> Measurement:
    """What the function gives at the end of the stage: a number, or one with its standard deviation.

    It gets xarrays of the grains that are there, of the contacts and of the walls, in SI units.
    """
    from taichi_erosion.recording.export import contact_table, frame_of_state, grain_table, wall_table

    assert state.network is not None
    unit, function = load_measure_file(measure_files_of_scene(state.scene)[name])
    network = state.network()
    grains = grain_table([frame_of_state(state.end)]).isel(time=0).sel(grain=state.end.ident)
    try:
        result = function(grains, contact_table([network]), wall_table(state.poses, network))
        value, sd = (float(number) for number in (result if isinstance(result, tuple) else (result, nan)))
    except Exception as error:  # whatever the user's code raises
        return no_measurement(name, unit, f"its function failed{line_of(error)}: {error_text(error)}")
    return Measurement(name, value, sd, unit)
