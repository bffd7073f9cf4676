"""Words of a laboratory for observables, conditions and effects."""

from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class ObservableWords:
    """Noun of an observable, and what samples do whose measured value lies above or below the model."""

    noun: str
    above: str
    below: str


WIND = ObservableWords("threshold friction velocity", "need more wind", "need less wind")
HEAP = ObservableWords("angle of repose", "lie at a steeper angle", "lie at a flatter angle")
FLUX = ObservableWords("flux", "move in larger amounts", "move in smaller amounts")
OBSERVABLES = {
    **dict.fromkeys(("threshold_u_star", "fluid_threshold", "impact_threshold"), WIND),
    "threshold_wind_speed": ObservableWords("threshold wind speed", WIND.above, WIND.below),
    **dict.fromkeys(("repose_angle", "angle_of_repose"), HEAP),
    **dict.fromkeys(("flux", "saturated_flux"), FLUX),
}
SAMPLES = {  # condition -> samples that differ in it
    "diameter": "Grains",
    "moisture": "Soils with a water content",
    "slope": "Beds with a slope",
}
EVERYWHERE = "The samples"


def words_of(observable: str) -> ObservableWords:
    """Words of an observable; for one without its own, the measured value is called higher or lower."""
    noun = observable.replace("_", " ")
    return OBSERVABLES.get(observable) or ObservableWords(
        noun, f"have a higher {noun}", f"have a lower {noun}"
    )


def samples_words(name: str, path: str) -> str:
    """Samples that differ in a condition, by its column or by the last part of the path that it sets."""
    known = (SAMPLES[key] for key in (name, path.split(",")[0].rpartition(".")[2]) if key in SAMPLES)
    return next(known, f"Samples with {name.replace('_', ' ')}")


def effect_words(name: str) -> str:
    """Name of an effect as it stands in a sentence."""
    return name.replace("_", " ")


def listed(names: Sequence[str]) -> str:
    """`a`, `a and b`, `a, b and c`."""
    return " and ".join([", ".join(names[:-1]), names[-1]] if len(names) > 1 else names)
