"""Words on the agreement of a calibrated model with measurements, from the document of a comparison."""

from collections.abc import Mapping
from typing import Any

from taichi_erosion.evidence.data.number_words import counted, plain
from taichi_erosion.evidence.inference.verdict_levels import CONSISTENT_MISFIT, fails, p_text

Document = Mapping[str, Any]

NO_MISFIT = "No significant misfit in any observable or along any condition."


def comparison_sentences(document: Document) -> list[str]:
    """What a comparison found: the overall agreement, levels and places, and a row that is off."""
    failing = [place["sentence"] for place in document["where"] if fails(place["p"])]
    return [
        agreement(document),
        *(level["sentence"] for level in document["levels"]),
        *(failing or ([] if is_untested(document) else [NO_MISFIT])),
        *row_sentences(document["worst_row"]),
    ]


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
