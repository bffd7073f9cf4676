"""Words on the agreement with measurements and on held-out rows; they load no other room."""

from collections.abc import Mapping
from math import sqrt
from typing import TYPE_CHECKING, Any

from taichi_erosion.evidence.data.number_words import counted, plain
from taichi_erosion.evidence.inference import verdict_levels as levels
from taichi_erosion.evidence.inference.verdict_levels import CONSISTENT_MISFIT, fails, p_text

if TYPE_CHECKING:
    from taichi_erosion.evidence.data.findings import HypothesisFit

NO_MISFIT = "No significant misfit in any observable or along any condition."
Document = Mapping[str, Any]

SOURCES = (
    "Errors in chi2, residuals and p: of the measured mean, the declared tolerance and the simulated mean; "
)
FITTED_ERRORS = f"{SOURCES}those that rows share are taken at their best."
HELD_OUT_ERRORS = (
    f"{SOURCES}of held-out rows also what the fitted rows leave uncertain in calibrated numbers, strengths "
    "and shared errors."
)


def comparison_sentences(document: Document) -> list[str]:
    """What a comparison found: the overall agreement, levels and places, and a row that is off."""
    failing = [place["sentence"] for place in document["where"] if fails(place["p"])]
    return [
        agreement(document),
        *(level["sentence"] for level in document["levels"]),
        *(failing or ([] if is_untested(document) else [NO_MISFIT])),
        *repeat_sentences(document["lack_of_fit"].get("all")),
        *row_sentences(document["worst_row"]),
    ]


def repeat_sentences(test: Document | None) -> list[str]:
    """That no scatter explains a misfit, where repeats say so."""
    if test is None or not fails(test["p"]):
        return []
    factor = plain(sqrt(test["ratio"]), 2)
    return [f"Repeats differ less: the misfit is {factor} times their scatter ({p_text(test['p'], 3)})."]


def agreement(document: Document) -> str:
    """Sentence on the overall agreement."""
    p, rows = document["p"], rows_words(document)
    if p is None:
        count = counted(document["rows_visible"], "row")
        return f"The misfit cannot be judged: the scatter of the {count} is not known."
    if is_untested(document):
        return untested_sentence(document)
    freedom = f"{plain(document['dof'])} degrees of freedom"
    numbers = f"(chi2 = {plain(document['chi2'])} for {freedom}, {p_text(p, 3)})"
    if fails(p) or document["chi2"] > CONSISTENT_MISFIT * max(document["dof"], 1.0):
        return f"The model does not agree with the {rows}, for any values of its parameters {numbers}."
    if any(fails(place["p"]) for place in document["where"]):
        return f"The model agrees with the {rows} as a whole {numbers}, but not everywhere."
    return f"The model is consistent with the {rows} {numbers}."


def rows_words(document: Document) -> str:
    """How many rows were compared, and how many measured means where some of them are repeats."""
    rows, means = counted(document["rows_visible"], "row"), means_of(document)
    return rows if means == document["rows_visible"] else f"{counted(means, 'measured mean')} of {rows}"


def is_untested(document: Document) -> bool:
    """Whether calibration can follow all measured values, so that they test nothing."""
    few = means_of(document) <= len(document["parameters"])
    return few and not fails(document.get("p")) and not any(fails(place["p"]) for place in document["where"])


def untested_sentence(document: Document) -> str:
    """Why so few rows test nothing."""
    means, numbers = means_of(document), len(document["parameters"])
    told = (
        f"{counted(means, 'measured mean')} cannot test a model with {counted(numbers, 'calibrated number')}"
    )
    return f"{told}: calibration follows {'it' if means == 1 else 'them'}."


def means_of(document: Document) -> int:
    """Measured values of a comparison, repeats under the same conditions counted once."""
    return sum(misfit["n"] for misfit in document["observables"].values())


def row_sentences(worst: Document | None) -> list[str]:
    """The row that holds most of a misfit, and what is left without it."""
    if worst is None:
        return []
    way = "above" if worst["residual_sd"] > 0.0 else "below"
    at = f" at {worst['setting']}" if worst.get("setting") else ""
    size = f"{plain(abs(worst['residual_sd']), 2)} sd {way} the model"
    return [
        f"One row holds {worst['share']:.0%} of the misfit: {worst['observable']}{at}, "
        f"{size}; without it {p_text(worst['p_without'])}. Check that row in the table."
    ]


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
