"""Explanations and the experiments that tell them apart, in words."""

from collections.abc import Mapping, Sequence

from taichi_erosion.evidence.data.findings import OUTSIDE, Discovery
from taichi_erosion.evidence.inference.posterior import label

UNPREDICTED = (
    "Something outside the list is likelier than any rival; it predicts nothing, so that no experiment "
    "can be planned against it."
)
REMEDIES = "wider ranges, another observable, or a separate measurement of a calibrated number would."


def separation_sentence(leader: str, chances: Mapping[str, float], separated: Sequence[str]) -> str:
    """Which rivals the experiments tell from the leader, and which no measurement does."""
    alike = [spoken(name) for name in chances if name not in separated]
    words = ""
    if separated:
        each = ", ".join(f"{spoken(name)} ({chances[name]:.0%})" for name in separated)
        words = (
            f"To tell {spoken(leader)} from {each}; in brackets, the chance that all of them together decide."
        )
    if alike:
        words += f" Nothing that can be measured within the stated ranges tells {spoken(leader)} from "
        words += f"{', '.join(alike)}: {REMEDIES}"
    return words.strip()


def scatter_sentence(leader: str, rivals: Sequence[str]) -> str:
    """Rivals that predict what the leader predicts, with another uncertainty."""
    if not rivals:
        return ""
    others = ", ".join(map(spoken, rivals))
    verbs = ("predicts", "differs") if len(rivals) == 1 else ("predict", "differ")
    words = (
        f"Beside {spoken(leader)}, {others} {verbs[0]} the same values and {verbs[1]} in uncertainty alone"
    )
    return f"{words}: no measurement is proposed for that."


def spoken(name: str) -> str:
    """An explanation as a sentence names it."""
    return "nothing missing" if name == label(()) else name.replace("+", " with ")


def alone_sentence(weights: Mapping[str, float], found: Discovery) -> str:
    """Sentence where fewer than two explanations are left."""
    outside = found.probabilities.get(OUTSIDE, 0.0)
    if not weights or outside > max(weights.values()):
        return UNPREDICTED
    (name,) = weights
    words = f"One explanation is left: {spoken(name)} (probability {found.probabilities.get(name, 1.0):.2g})."
    return f"{words} There is nothing to tell it from."
