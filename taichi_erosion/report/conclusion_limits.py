"""Limits of a conclusion, one sentence each: noise, names, runs, vault, answers to another table."""

from collections.abc import Iterator

from taichi_erosion.evidence.inference.verdict_levels import ABSORBED, STABLE
from taichi_erosion.report.evidence_results import Document, Results
from taichi_erosion.report.plain_words import effect_words, listed

UNDECLARED_NUMERICS = (
    "Numerics: the study declares no tolerance for box, time step and grain number. A smooth numerical error "
    "of the model would look like a missing effect."
)


def limits(found: Results) -> Iterator[str]:
    """What could change the conclusion."""
    discovery, adoption = found.discovery, found.adoption
    noise = (discovery or found.comparison or {}).get("noise", {}).get("observables", {})
    if unrepeated := ", ".join(name for name, budget in noise.items() if budget["repeats"] < 1):
        yield f"Repeats: the scatter of {unrepeated} is stated, not checked. A larger one lowers misfits."
    if noise and not any(budget["numerical"] for budget in noise.values()):
        yield UNDECLARED_NUMERICS
    if discovery:
        yield from limits_of_names(discovery)
        yield from limits_of_runs(discovery)
    if adoption and adoption["vault"]["opened"] > 1:
        yield "Vault: it was opened more than once. Its rows are no longer unseen data."
    for command in found.outdated:
        yield f"Table: the answer of `{command}` rests on another version of the table and is left out."


def limits_of_names(discovery: Document) -> Iterator[str]:
    """Limits of the named effects."""
    effects = discovery["effects"]
    hidden = [effect_words(name) for name, effect in effects.items() if effect["status"] == "not_testable"]
    unnamed = [name for name in hidden if name not in map(effect_words, discovery["group"])]
    if unnamed:
        yield f"Not testable: these measurements cannot show {listed(unnamed)}, even if present."
    for name in dict.fromkeys((*discovery["named"], *discovery["group"])):
        if (effects.get(name, {}).get("absorption") or 0.0) > ABSORBED:
            parameter = discovery["absorbed_by"].get(name, "a calibrated parameter")
            yield f"Absorption: {parameter} can imitate most of {effect_words(name)}. Measure it separately."
    if len(discovery["group"]) > 1:
        group = listed([effect_words(name) for name in discovery["group"]])
        yield f"Group: these measurements cannot separate {group}."


def limits_of_runs(discovery: Document) -> Iterator[str]:
    """Limits of the runs behind the named effects."""
    if discovery["decoy_rank"] == 1:
        yield "Decoy: an artificial effect fits best. The shortlist of effects is not reliable."
    stability = discovery["stability"]
    if stability is not None and stability < STABLE:
        yield f"Seeds: {100.0 * stability:.0f} % of the repeats with other seeds name the same effect first."
    if discovery["failures"]:
        yield f"Failures: {discovery['failures']} model values could not be computed and are left out."
