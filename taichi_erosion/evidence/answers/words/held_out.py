"""Words on held-out measurements: whether they are unseen, and what they say against an adoption."""

from math import sqrt

from taichi_erosion.evidence.inference import verdict_levels as levels


def unseen_words(opened: int) -> str:
    """What held-out measurements are after so many openings of the vault."""
    if opened <= 1:
        return "that no fit has seen"
    return f"that were held out (vault opened {opened} times, no longer unseen)"


def remainder_words(before: float, after: float, rows: str = "them") -> str:
    """What held-out rows say against an adoption: that it does not help, or that something is left.

    `before` and `after`: misfit (chi2) per held-out row. Empty where they support it and nothing is left.
    """
    if refuted(before, after):
        verb = "does not fall" if after >= before else "hardly falls"
        return f"the error on {rows} {verb}: they do not confirm it"
    if after <= levels.HELD_OUT_MISFIT:
        return ""
    size = f"{sqrt(after):.2g} times their errors"
    return f"the model still differs from {rows} by {size}, which nothing in it explains"


def refuted(before: float, after: float) -> bool:
    """Whether held-out rows contradict what was adopted: they failed before, and hardly less after."""
    return before > levels.HELD_OUT_MISFIT and after > levels.HELD_OUT_SHARE * before
