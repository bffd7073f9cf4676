"""What a design cannot tell apart.

    E[b_1] = beta_1 + A beta_2,   A = (X_1' X_1)^-1 X_1' X_2

with X_1 the terms in the model and X_2 those left out. In a regular fraction A holds 0 and +-1, in a
Plackett-Burman design fractions such as +-1/3.

Reference: Box & Wilson (1951); Montgomery (2017), 8.2 and 10.7.
"""

from collections.abc import Sequence

import numpy as np

from taichi_erosion.experiments.table import Design, Floats
from taichi_erosion.experiments.terms import Term, interaction_terms, linear_terms, model_matrix, term_name

NONE = 1e-9  # entries of A below it are rounding [1]

Alias = tuple[str, float]  # a term and its share in the estimate of another


def alias_matrix(coded: Floats, kept: Sequence[Term], left_out: Sequence[Term]) -> Floats:
    """A, [1 + kept, left out]; the first row is the constant's."""
    inside = model_matrix(coded, kept)
    outside = model_matrix(coded, left_out)[:, 1:]
    return np.asarray(np.linalg.lstsq(inside, outside, rcond=None)[0], dtype=float)


def aliases(design: Design, order: int = 2) -> dict[str, list[Alias]]:
    """For every main effect, the interactions of up to `order` factors that are mixed into its estimate."""
    count = len(design.factors)
    names = [factor.path for factor in design.factors]
    kept = linear_terms(count)
    left_out = [term for size in range(2, order + 1) for term in interaction_terms(count, size)]
    matrix = alias_matrix(design.coded, kept, left_out)
    return {
        term_name(term, names): [
            (term_name(other, names), float(share))
            for other, share in zip(left_out, row, strict=True)
            if abs(share) > NONE
        ]
        for term, row in zip(kept, matrix[1:], strict=True)
    }


def alias_table(design: Design, order: int = 4) -> list[str]:
    """Chains of effects that share a column of a two-level fraction, `A = B*C*D`, the defining one first."""
    count = len(design.factors)
    names = [factor.path for factor in design.factors]
    corners = design.coded[np.all(np.abs(design.coded) == 1.0, axis=1)]
    chains: dict[bytes, list[str]] = {}
    for size in range(1, min(order, count) + 1):
        for term in interaction_terms(count, size):
            column = model_matrix(corners, [term])[:, 1]
            sign = "" if column[0] > 0.0 else "-"
            chains.setdefault((column * column[0]).tobytes(), []).append(sign + term_name(term, names))
    constant = np.ones(len(corners)).tobytes()
    defining = [f"I = {' = '.join(chains.pop(constant))}"] if constant in chains else []
    return defining + [tidy(chain) for chain in chains.values() if len(chain) > 1]


def tidy(chain: Sequence[str]) -> str:
    """A chain whose first word carries no sign."""
    if not chain[0].startswith("-"):
        return " = ".join(chain)
    return " = ".join(word[1:] if word.startswith("-") else f"-{word}" for word in chain)
