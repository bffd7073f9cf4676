"""Words on held-out measurements: whether they are unseen, and what they say against an adoption."""

from collections.abc import Mapping
from math import sqrt
from typing import TYPE_CHECKING, Any

from taichi_erosion.evidence.inference import verdict_levels as levels

if TYPE_CHECKING:
    from taichi_erosion.evidence.data.findings import HypothesisFit

Document = Mapping[str, Any]

SOURCES = (
    "Errors in chi2, residuals and p: of the measured mean, the declared tolerance and the simulated mean; "
)
FITTED_ERRORS = f"{SOURCES}those that rows share are taken at their best."
HELD_OUT_ERRORS = (
    f"{SOURCES}of held-out rows also what the fitted rows leave uncertain in calibrated numbers, strengths "
    "and shared errors."
)


def unseen_words(opened: int) -> str:
    """What held-out measurements are after so many openings of the vault."""
    if opened <= 1:
        return "that no fit has seen"
    return f"that were held out (vault opened {opened} times, no longer unseen)"


def open_words(adoption: Document) -> str:
    """What held-out rows say against an adoption: that they do not confirm it, or that something is left.

    Empty where they support it, where nothing is left, and where none was held out.
    """
    judged = adoption.get("with_all") or adoption["added"]
    if judged["vault_chi2_per_row"] is None:
        return ""
    if adoption["contradicted"]:
        return "they do not confirm it"
    if not levels.fails(judged["vault_p"]):
        return ""
    size = f"{sqrt(judged['vault_chi2_per_row']):.2g} times their errors"
    return f"the model still differs from them by {size}, which nothing in it explains"


def by_observable(before: Mapping[str, float], after: Mapping[str, float]) -> str:
    """`falls for angle, rises for height (by 12 %)`, of errors by observable; `falls` where all do."""
    rising = {name: after[name] / before[name] - 1.0 for name in before if after[name] > before[name] > 0.0}
    if not rising:
        return "falls"
    falling = [name for name in before if name not in rising]
    told = ", ".join(f"{name} (by {share:.0%})".replace("%", " %") for name, share in rising.items())
    return f"falls for {', '.join(falling)} and rises for {told}" if falling else f"rises for {told}"


def uneven(before: "HypothesisFit", after: "HypothesisFit") -> str:
    """End of a sentence, and the errors of held-out rows by observable where not all of them fall."""
    sides = by_observable(before.vault_rmse, after.vault_rmse)
    return "." if sides == "falls" else f". The error of held-out rows {sides}."


def refuted(before: float, after: float) -> bool:
    """Whether held-out rows contradict what was adopted: they failed before, and hardly less after."""
    return before > levels.HELD_OUT_MISFIT and after > levels.HELD_OUT_SHARE * before
