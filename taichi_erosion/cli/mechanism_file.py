"""Effect files from the law of a mechanism that a discovery found beyond its list of effects."""

import re
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from jinja2 import Environment

from taichi_erosion.core.errors import BadInput

if TYPE_CHECKING:
    from taichi_erosion.core.effect import Effect

WIDER = 10.0  # range of a number over its fitted value [1]
PARTS = re.compile(r'at\["[^"\]]+"\]|PARAMS_[a-z]|np\.exp|np\.maximum|[\d.]+(?:e[-+]?\d+)?')
OF = ":"  # between a mechanism of an instrument and its observable


def has_law(document: Mapping[str, Any]) -> bool:
    """Whether a discovery holds the law of a mechanism."""
    beyond = document.get("beyond")
    return bool(beyond and beyond["law"] and beyond["group"])


def mechanism_law_file(
    name: str,
    document: Mapping[str, Any],
    columns: Mapping[str, tuple[str, float]],
    readings: Mapping[str, tuple[str, float]],
    source: str,
    page: str,
) -> str:
    """Effect file of the law of the best mechanism.

    `columns`: column -> condition and its unit over SI; `readings`: observable -> measure that an instrument
    reads, and the unit of the study over that of the measure.
    """
    from taichi_erosion.mechanisms.library import load_mechanisms

    beyond = document["beyond"]
    refuse_foreign_code(beyond["law"]["python"])
    law, best = beyond["law"], beyond["mechanisms"][0]
    mechanism, _, observable = best["name"].partition(OF)
    measure, unit = readings.get(observable, (observable, 1.0))
    used = {column: columns[column] for column in law["conditions"]}
    environment = Environment(trim_blocks=True, lstrip_blocks=True, keep_trailing_newline=True)
    return environment.from_string(page).render(
        name=name,
        title=name.replace("_", " ").capitalize(),
        mechanism=mechanism,
        mechanism_title=best["title"],
        observable=measure,
        scale=None if best.get("scale") is None else unit * best["scale"],
        expression=law["expression"],
        python=law["python"].replace("PARAMS_", "params."),
        source=source,
        share=f"{max(law['held_out_share'] or 0.0, 0.0):.0%}",
        columns=used,
        numbers=[number_fields(key, each["value"]) for key, each in law["numbers"].items()],
        points=points(law, used, load_mechanisms()[mechanism]),
    )


def number_fields(key: str, value: float) -> tuple[str, float, str, float, float]:
    """Name, value, meaning and range of one number of a law."""
    meanings = {"a": "dose at typical conditions", "k": "scale or onset, in the unit of the condition"}
    low, high = sorted((value / WIDER, value * WIDER))
    if key in ("p", "q"):
        low, high = -WIDER, WIDER
    return key, value, meanings.get(key, "exponent" if key in ("p", "q") else "rate"), low, high


def points(
    law: Mapping[str, Any], columns: Mapping[str, tuple[str, float]], mechanism: "Effect"
) -> list[tuple[dict[str, float], float, float]]:
    """Conditions in SI units, dose of the law there, and response of a mechanism on the device."""
    stated = [
        {columns[column][0]: value * columns[column][1] for column, value in at.items()}
        for at, _ in law["points"]
    ]
    doses = [dose for _, dose in law["points"]]
    return list(zip(stated, doses, device_responses(mechanism, doses), strict=True))


def refuse_foreign_code(expression: str) -> None:
    """Raise BadInput for anything but numbers, conditions, exponentials and arithmetic."""
    left = PARTS.sub("", expression)
    if set(left) - set(" +-*/(),"):
        raise BadInput(f"the law '{expression}' of the result is not one that discover writes")


def device_responses(mechanism: "Effect", doses: list[float]) -> list[float]:
    """What a mechanism does on the device in a typical situation at some doses; zeros for one of the host."""
    from taichi_erosion.core.device import start_device, stop_device
    from taichi_erosion.core.effect_probe import make_bench, probe_of
    from taichi_erosion.core.setup import Numerics
    from taichi_erosion.mechanisms.law import at_dose, device_response

    if mechanism.constants is None:
        return [0.0] * len(doses)
    start_device(Numerics(threads=1))
    try:
        probe = probe_of(mechanism, make_bench())
        return [device_response(mechanism, probe, at_dose(mechanism, dose), {}) for dose in doses]
    finally:
        stop_device()
