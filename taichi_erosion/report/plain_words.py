"""Words of a laboratory for observables, conditions, effects and numbers."""

from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class ObservableWords:
    """Noun of an observable, and what samples do whose measured value lies above or below the model."""

    noun: str
    above: str
    below: str


@dataclass(frozen=True)
class ConditionWords:
    """Samples at the low end, at the high end, in the middle and at one level of a condition."""

    low: str
    high: str
    middle: str
    single: str


WIND = ObservableWords(
    "threshold friction velocity", "need more wind than the model says", "need less wind than the model says"
)
HEAP = ObservableWords(
    "angle of repose",
    "lie at a steeper angle than the model says",
    "lie at a flatter angle than the model says",
)
FLUX = ObservableWords(
    "flux", "move in larger amounts than the model says", "move in smaller amounts than the model says"
)
OBSERVABLES = {
    "threshold_u_star": WIND,
    "fluid_threshold": WIND,
    "impact_threshold": WIND,
    "threshold_wind_speed": ObservableWords("threshold wind speed", WIND.above, WIND.below),
    "repose_angle": HEAP,
    "angle_of_repose": HEAP,
    "flux": FLUX,
    "saturated_flux": FLUX,
}
CONDITIONS = {
    "diameter": ConditionWords(
        "Grains up to {high}", "Grains from {low}", "Grains of {low} to {high}", "Grains of {}"
    ),
    "moisture": ConditionWords(
        "Soils with up to {high} of water",
        "Soils with {low} of water or more",
        "Soils with {low} to {high} of water",
        "Soils with {} of water",
    ),
    "slope": ConditionWords(
        "Beds with a slope up to {high}",
        "Beds with a slope from {low}",
        "Beds with a slope of {low} to {high}",
        "Beds with a slope of {}",
    ),
}
EVERYWHERE = "The samples"


def words_of(observable: str) -> ObservableWords:
    """Words of an observable; for one without its own, the measured value is called higher or lower."""
    noun = observable.replace("_", " ")
    general = (f"have a {side} {noun} than the model says" for side in ("higher", "lower"))
    return OBSERVABLES.get(observable) or ObservableWords(noun, *general)


def condition_words(name: str, path: str) -> ConditionWords:
    """Words of a condition, by its column or by the last part of the path that it sets."""
    for key in (name, path.split(",")[0].rpartition(".")[2]):
        if key in CONDITIONS:
            return CONDITIONS[key]
    plain = name.replace("_", " ")
    return ConditionWords(
        f"Samples with {plain} up to {{high}}",
        f"Samples with {plain} from {{low}}",
        f"Samples with {plain} between {{low}} and {{high}}",
        f"Samples with {plain} of {{}}",
    )


def effect_words(name: str) -> str:
    """Name of an effect as it stands in a sentence."""
    return name.replace("_", " ")


def listed(names: Sequence[str]) -> str:
    """`a`, `a and b`, `a, b and c`."""
    return " and ".join([", ".join(names[:-1]), names[-1]] if len(names) > 1 else names)
