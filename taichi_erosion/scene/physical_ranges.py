"""Physical ranges of numbers of a scene and of measured quantities, and the units in which one is usual.

The possible range of a condition is that of the place which it sets (the schema of scenes). An observable has
its own here. The usual range is that of soil, sand and wind on Earth.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

from taichi_erosion.scene.paths import number_entry_at_path
from taichi_erosion.scene.schema.fields import PhysicalRange
from taichi_erosion.scene.schema.units import Scale, UnknownUnit, parse_scale, parse_unit, scale_between

GRAIN = (2e-6, 2e-2)  # m: from clay to gravel
UNITS = "um mm cm m % 1 deg rad m/s cm/s mm/s degC K Pa hPa kPa s min h d".split()  # that are usual in tables
ANGLE = PhysicalRange("deg", 0.0, 90.0, (5.0, 70.0))
THRESHOLD = PhysicalRange("m/s", 1e-3, 10.0, (0.03, 3.0))
TUNNEL_WIND = PhysicalRange("m/s", 0.0, 100.0, (1.0, 60.0))
LENGTH = PhysicalRange("m", 0.0, 100.0)
SHARE = PhysicalRange("1", 0.0, 1.0)
OBSERVED: Mapping[str, PhysicalRange] = {
    **dict.fromkeys(("repose_angle", "cone_angle", "angle_of_repose", "dynamic_angle"), ANGLE),
    **dict.fromkeys(("sliding_angle", "friction_angle", "residual_friction_angle"), ANGLE),
    **dict.fromkeys(("shear_stress", "normal_stress"), PhysicalRange("Pa", 0.0, 1e9)),
    "wall_force": PhysicalRange("N", -1e6, 1e6),
    "wall_torque": PhysicalRange("N m", -1e6, 1e6),
    **dict.fromkeys(("threshold_u_star", "fluid_threshold", "impact_threshold", "rolling_onset"), THRESHOLD),
    "impact_threshold_linear": THRESHOLD,
    "threshold_wind_speed": TUNNEL_WIND,
    "flux": PhysicalRange("kg/(m s)", 0.0, 100.0),
    **dict.fromkeys(("pile_height", "centroid_height", "radius_90", "runout_radius"), LENGTH),
    **dict.fromkeys(("column_height", "flux_height", "peak_displacement"), LENGTH),
    **dict.fromkeys(("rebound_share", "solid_fraction"), SHARE),
    "lateral_stress_ratio": PhysicalRange("1", 0.0, 50.0),
    "mass_flow": PhysicalRange("kg/s", -1e6, 1e6),
}
USUAL: Mapping[str, tuple[float, float]] = {  # of places, or of their last word, in their units
    **dict.fromkeys(("friction_sliding", "friction_rolling"), (0.0, 1.5)),
    "grains.size.diameter": GRAIN,
    "conditions.diameter": GRAIN,
    "conditions.moisture": (5e-4, 0.6),
    "conditions.relative_humidity": (0.05, 1.0),
    "conditions.temperature": (230.0, 330.0),
    "conditions.pressure": (4e4, 1.2e5),
    "conditions.friction_velocity": (0.02, 5.0),
    "conditions.wind_speed": (0.2, 60.0),
}
OWN_RANGES: Mapping[str, PhysicalRange] = {  # of conditions that no scene has by itself
    "conditions.width": PhysicalRange("m", 0.0, 100.0, (5e-4, 5.0)),
    "conditions.turbulence": PhysicalRange("1", 0.0, 2.0),
    "conditions.spread": PhysicalRange("1", 1.0, 100.0),
    "conditions.air_density": PhysicalRange("kg/m3", 0.001, 100.0, (0.5, 2.0)),
    "conditions.roughness_length": PhysicalRange("m", 0.0, 10.0, (1e-7, 0.5)),
}


def range_at(path: str) -> PhysicalRange | None:
    """Range of the number at a dotted path of a scene: the schema's, with the usual one where it is known.

    A condition of the scene's own has none.
    """
    number = None if path.startswith("conditions.extra.") else number_entry_at_path(path)
    if number is None:
        return OWN_RANGES.get(path)
    return replace(number, usual=USUAL.get(path, USUAL.get(path.split(".")[-1])))


def range_of(name: str) -> PhysicalRange | None:
    """Range of an observable, or of the number at a place, of several the first; None where none is known."""
    return OBSERVED.get(name) or (range_at(name.split(",")[0].strip()) if name else None)


def is_other_kind(unit: str | None, name: str) -> bool:
    """Whether a unit is of another kind than that of an observable or a place; an angle may be a tangent."""
    allowed = range_of(name)
    tangent = allowed is not None and allowed.unit == "deg" and range_scale(unit, SHARE) is not None
    return allowed is not None and bool(unit) and range_scale(unit, allowed) is None and not tangent


def range_scale(unit: str | None, allowed: PhysicalRange) -> Scale | None:
    """Scale from a unit as written to that of a range; None where they differ in kind."""
    try:
        return scale_between(unit or allowed.unit, parse_unit(allowed.unit))
    except UnknownUnit:
        return None


def plausible_units(values: Sequence[float], unit: str | None, allowed: PhysicalRange) -> list[str]:
    """Other units that put all numbers of a column within the usual range."""
    source, units = parse_scale(unit or allowed.unit), list[str]()
    for other in UNITS if any(values) else ():
        scale, target = range_scale(other, allowed), parse_scale(other)
        another = (target.factor, target.origin) != (source.factor, source.origin)
        if scale is not None and another and all(allowed.is_usual(scale.to_use(value)) for value in values):
            units.append(other)
    return units
