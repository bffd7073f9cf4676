"""A run function with a known answer: an angle that grows with two frictions and falls with restitution."""

import random
from contextlib import nullcontext
from typing import Any

from taichi_erosion.campaign.request import RunRequest, RunResult

FUNCTION = "closed_form:answering"
NOISE = 0.3  # deg


def angle(contact: dict[str, Any]) -> float:
    """20 to 40 deg; bends with the friction on steel, as a heap does that no longer slides on its plate."""
    soil, steel = contact["soil-soil"], contact["soil-steel"]
    slip = steel["friction_sliding"] - 0.35
    base = 29.0 + 30.0 * slip - 40.0 * slip**2
    return base + 10.0 * (soil["friction_rolling"] - 0.7) - 6.0 * soil["restitution"]


def answer(payloads: list[dict[str, Any]], tell: Any) -> None:
    for place, payload in enumerate(payloads):
        value = angle(payload["scene"]["contact"]) + random.Random(payload["seed"]).gauss(0.0, NOISE)
        measures = {"repose_angle": {"value": value, "sd": None, "unit": "deg", "n": 1}}
        tell(place, {"seed": payload["seed"], "measures": measures, "failure": None})


def answering() -> Any:
    return nullcontext(answer)


def execute_here(requests: list[RunRequest], *_: Any, **__: Any) -> list[RunResult]:
    """Results of all requests, in this process and without a ledger."""
    results: list[RunResult] = []
    for request in requests:
        answer([request.payload], lambda _, record, key=request.key: results.append(RunResult(key, record)))
    return results
