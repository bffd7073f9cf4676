"""Quantities as a person reads them: numbers with units, intervals, names with titles, chances, commands.

Estimates have two significant digits, values and conditions three. A model fails where p < ADEQUATE.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from math import isnan

from taichi_erosion.evidence.data.table_units import TableUnits
from taichi_erosion.evidence.record import Interval
from taichi_erosion.tables.number_words import plain, with_unit

LEAST_TOLD = 1e-4  # chance below which its size tells a person nothing more
MOST_TOLD = 3  # things of one kind in a line: more are not read
QUANTITIES = {  # observables, conditions and numbers that say little by their keys
    "repose_angle": "angle of repose",
    "angle_of_repose": "angle of repose (outline)",
    "cone_angle": "angle of the cone",
    "dynamic_angle": "angle in the drum",
    "centroid_height": "height of the centroid",
    "radius_90": "radius of 90 % of the grains",
    "flux": "sand flux",
    "flux_height": "mean height of the flux",
    "bed_stress": "stress at the bed",
    "grain_stress": "stress carried by grains",
    "lateral_stress_ratio": "horizontal over vertical stress",
    "mass_flow": "mass flow through the plane",
    "rebound_share": "share of rebounding grains",
    "rebound_speed": "speed of rebounding grains",
    "ejecta_share": "ejected grains per impact",
    "rolling_onset": "onset of rolling",
    "threshold_u_star": "threshold friction velocity",
    "impact_threshold_linear": "impact threshold (extrapolated)",
    "threshold_ratio": "impact over fluid threshold",
    "threshold_ratio_linear": "impact over fluid threshold (extrapolated)",
    "u_star": "friction velocity",
    "friction_sliding": "sliding friction",
    "friction_rolling": "rolling friction",
}
EXPLANATIONS = {"none": "errors of measurement alone", "outside_library": "an effect that is not in the list"}
EXPLANATIONS |= {"each_set_up": "differences between set-ups, along no condition"}


@dataclass(frozen=True)
class Vocabulary:
    """Names, units and commands of one study, as its user writes them."""

    study: str
    command: Callable[..., str]  # a command in backquotes, of its words
    units: TableUnits = field(default_factory=TableUnits)
    titles: Mapping[str, str] = field(default_factory=dict)  # of effects and mechanisms
    doses: Mapping[str, str] = field(default_factory=dict)  # what the dose of a mechanism counts
    results: str = ""  # file of the answer of `discover`
    sequel: str = ""  # study that `adopt` wrote

    def effect_title(self, name: str) -> str:
        """`capillary bridges between moist grains (liquid_bridge)`; a name without a title stands alone."""
        base, _, observable = name.partition(":")
        title = self.titles.get(base, "").partition(" (")[0]
        return f"{title}{f' of {observable}' if observable else ''} ({name})" if title else name

    def scale(self, observable: str) -> float:
        """Factor from the unit of the model to that of the table."""
        return self.units.value(observable, 1.0) or 1.0


def in_words(name: str) -> str:
    """An observable, condition or number in words: `threshold friction velocity`, `pile height`."""
    return QUANTITIES.get(name, name.replace("_", " "))


def interval(size: Interval, digits: int = 2, scale: float = 1.0, unit: str = "") -> str:
    """`0.9 (0.7 to 1.2)`; a dash where nothing is known."""
    ends = sorted((scale * size.low, scale * size.high))
    value, low, high = (plain(each, digits) for each in (scale * size.value, *ends))
    return "-" if isnan(size.value) else f"{with_unit(value, unit)} ({low} to {high})"


def p_text(p: float) -> str:
    """`p = 0.03`."""
    return f"p < {plain(LEAST_TOLD)}" if p < LEAST_TOLD else f"p = {plain(p, 2)}"


def probability_text(p: float) -> str:
    """A probability, never rounded to certainty."""
    return "> 0.99" if p > 0.99 else "< 0.01" if p < 0.01 else f"{p:.2f}"


def join_words(words: Iterable[str], last: str = "and") -> str:
    """`a`, `a and b`, `a, b and c`."""
    *first, end = tuple(words) or ("",)
    return f"{', '.join(first)} {last} {end}" if first else end


def first_and_count_text(words: Sequence[str]) -> str:
    """The first of some clauses, and how many more there are."""
    more = [f"and {len(words) - MOST_TOLD} more"] if len(words) > MOST_TOLD else []
    return "; ".join([*words[:MOST_TOLD], *more])
