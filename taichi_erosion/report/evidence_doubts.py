"""What would change the conclusion of an evidence study, in sentences, as far as its numbers know."""

from collections.abc import Iterator, Mapping
from typing import Any

Document = Mapping[str, Any]

UNSTABLE = 1.0  # share of repeats that agree; below it the name depends on the seeds
ABSORBED = 0.8  # above it calibration imitates most of an effect


def doubts(
    comparison: Document | None, discovery: Document | None, adoption: Document | None
) -> Iterator[str]:
    """All doubts, those about the noise first."""
    noise = (discovery or comparison or {})["noise"]["observables"]
    unrepeated = ", ".join(name for name, budget in noise.items() if budget["repeats"] < 1)
    if unrepeated:
        yield f"Repeats: the scatter of {unrepeated} is stated, not seen; if it is larger, misfits shrink."
    if not any(budget["numerical"] for budget in noise.values()):
        yield (
            "Numerics: no tolerance for box, time step and grain number is declared; a smooth bias of the "
            "model would look like physics."
        )
    if discovery:
        yield from doubts_about_names(discovery)
        yield from doubts_about_runs(discovery)
    if adoption and adoption["vault"]["opened"] > 1:
        yield (
            "The vault has been opened more than once: its error is not that of unseen measurements any more."
        )


def doubts_about_names(discovery: Document) -> Iterator[str]:
    """What could be wrong with the names."""
    effects = discovery["effects"]
    hiding = ", ".join(name for name, effect in effects.items() if effect["status"] == "not_testable")
    if hiding:
        yield f"Hidden: {hiding} could act without these measurements showing it."
    for name in dict.fromkeys((*discovery["named"], *discovery["group"])):
        if (effects.get(name, {}).get("absorption") or 0.0) > ABSORBED:
            parameter = discovery["absorbed_by"].get(name, "a calibrated number")
            yield f"Calibration imitates most of {name}: measure {parameter} by itself to break this."
    if len(discovery["group"]) > 1:
        yield f"These measurements do not tell {', '.join(discovery['group'])} apart."


def doubts_about_runs(discovery: Document) -> Iterator[str]:
    """What could be wrong with the runs behind the names."""
    if discovery["decoy_rank"] == 1:
        yield "A made-up effect fits best of all: the shortlist is not to be trusted."
    stability = discovery["stability"]
    if stability is not None and stability < UNSTABLE:
        yield f"With other seeds the first name is the same in {100.0 * stability:.0f} % of repeats."
    if discovery["failures"]:
        yield f"{discovery['failures']} model values could not be computed; they were left out."
