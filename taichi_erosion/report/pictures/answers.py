"""Bars and curves of answers: probabilities, misfit of held-out rows, errors after each adoption."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from taichi_erosion.report.figure_style import (
    AFTER,
    BEFORE,
    CONTROL,
    INK,
    SOFT,
    Picture,
    numbers,
    responsive,
    scale_axis,
    single,
)
from taichi_erosion.report.html import percent
from taichi_erosion.report.plain_words import effect_words, listed

Record = Mapping[str, Any]

MOST_ANSWERS = 10  # bars of the posterior


def draw_adoptions(adoptions: Sequence[Record]) -> Picture:
    """Misfit per row of fitted and held-out rows after each adopted effect."""

    def draw(width: float) -> Figure:
        figure, frame = single(width, 2.6)
        labels = [
            "\n+ ".join(effect_words(name) for name in step["effects"]) or "without effects"
            for step in adoptions
        ]
        for key, colour, label in (
            ("chi2_per_row_fitted", CONTROL, "fitted rows"),
            ("chi2_per_row_held_out", AFTER, "held-out rows"),
        ):
            frame.plot(labels, numbers([step[key] for step in adoptions]), "o-", color=colour, label=label)
        frame.axhline(1.0, color=SOFT, lw=0.8, ls=":", zorder=0)
        values = numbers(
            [step[key] for step in adoptions for key in ("chi2_per_row_fitted", "chi2_per_row_held_out")]
        )
        scale_axis(frame, "y", values)
        frame.margins(x=0.15)
        frame.set_title("chi2 per row", loc="left")
        frame.legend()
        return figure

    words = "Misfit per row (chi2) after each adopted effect. Dotted: 1, what noise alone gives."
    return responsive(draw, words, "ladder")


def draw_posterior(probabilities: Mapping[str, float | None]) -> Picture:
    """Posterior probabilities of the answers, in order."""
    ranked = sorted(probabilities.items(), key=lambda item: -(item[1] or 0.0))[:MOST_ANSWERS]
    answers = {"none": "nothing is missing", "outside_library": "missing, not in the list"}
    labels = [answers.get(name, effect_words(name.replace("+", " + "))) for name, _ in ranked][::-1]
    values = numbers([p for _, p in ranked])[::-1]

    def draw(width: float) -> Figure:
        figure, frame = single(width, 0.5 + 0.24 * len(ranked))
        frame.barh(labels, values, color=[CONTROL if name in answers.values() else AFTER for name in labels])
        for place, value in enumerate(values):
            frame.text(value + 0.01, place, percent(value), va="center", fontsize=8.0)
        frame.set(xlim=(0.0, 1.12), xticks=[0.0, 0.5, 1.0], xlabel="probability")
        return figure

    return responsive(draw, "Probability of every answer after the measurements.", "posterior")


def draw_vault(adoption: Record) -> Picture:
    """Misfit of the held-out rows before and after adoption, with the controls."""
    labels = {
        "base": "before",
        "added": f"with {listed([effect_words(name) for name in adoption['added']['effects']])}",
        "best_wrong": "control: best other",
        "random_wrong": "control: at random",
    }
    there = {key: label for key, label in labels.items() if adoption.get(key)}
    values = numbers([adoption[key]["vault_chi2_per_row"] for key in there])[::-1]
    colours = {"base": BEFORE, "added": AFTER}

    def draw(width: float) -> Figure:
        figure, frame = single(width, 0.6 + 0.34 * len(there))
        frame.barh(
            list(there.values())[::-1], values, color=[colours.get(key, CONTROL) for key in there][::-1]
        )
        frame.axvline(1.0, color=INK, lw=0.8, ls=":")
        scale_axis(frame, "x", np.append(values, 1.0))
        frame.set_xlabel("chi2 per held-out row")
        return figure

    return responsive(
        draw,
        "Misfit per held-out row (chi2) before and after, with the controls. Dotted: what noise alone gives.",
        "vault",
    )
