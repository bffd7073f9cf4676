"""Terms of a polynomial model: products of powers of coded factors, their hierarchy, and aliases of a design:

    E[b_1] = beta_1 + A beta_2,   A = (X_1' X_1)^-1 X_1' X_2

with X_1 the terms in the model and X_2 those left out. In a regular fraction A holds 0 and +-1, in a
Plackett-Burman design fractions such as +-1/3.

Reference: Box & Wilson (1951); Montgomery (2017), 8.2 and 10.7.
"""

from collections.abc import Iterable, Sequence
from itertools import combinations
from typing import Literal

import numpy as np

from taichi_erosion.core.errors import BadInput
from taichi_erosion.experiments.design_table import Floats

Term = tuple[int, ...]  # exponent of every factor; (1, 0, 1) is A C, (0, 2, 0) is B^2
Order = Literal["linear", "interactions", "quadratic"]


def linear_terms(count: int) -> tuple[Term, ...]:
    """A, B, C ..."""
    return tuple(exponents(count, {k: 1}) for k in range(count))


def interaction_terms(count: int, order: int = 2) -> tuple[Term, ...]:
    """Products of `order` different factors: A B, A C, B C ..."""
    return tuple(exponents(count, dict.fromkeys(chosen, 1)) for chosen in combinations(range(count), order))


def square_terms(count: int) -> tuple[Term, ...]:
    """A^2, B^2 ..."""
    return tuple(exponents(count, {k: 2}) for k in range(count))


def model_terms(count: int, order: Order) -> tuple[Term, ...]:
    """Terms of a complete model, without the constant."""
    terms = linear_terms(count)
    if order in ("interactions", "quadratic"):
        terms += interaction_terms(count)
    if order == "quadratic":
        terms += square_terms(count)
    return terms


def exponents(count: int, powers: dict[int, int]) -> Term:
    """The term with the given powers of some of `count` factors."""
    return tuple(powers.get(k, 0) for k in range(count))


def term_name(term: Term, names: Sequence[str]) -> str:
    """`A`, `A*B`, `A^2`, with the factors' names."""
    parts = [
        name if power == 1 else f"{name}^{power}" for name, power in zip(names, term, strict=True) if power
    ]
    return "*".join(parts) or "1"


def parse_term(text: str, names: Sequence[str]) -> Term:
    """The term that `term_name` wrote, or that a paper prints as `A2` or `AB`."""
    for term in candidate_terms(len(names)):
        if same_letters(term, text, names):
            return term
    raise BadInput(f"term '{text}': must be a product of {', '.join(names)}, such as {names[0]}^2")


def candidate_terms(count: int) -> Iterable[Term]:
    """Terms that a parsed name may stand for, up to three factors."""
    yield exponents(count, {})
    yield from model_terms(count, "quadratic")
    yield from interaction_terms(count, 3)


def same_letters(term: Term, text: str, names: Sequence[str]) -> bool:
    """Whether a printed name is this term, whatever sign of multiplication or power it uses."""
    plain = "".join(c for c in text if c not in " *^.\u00b7\u00d7").replace("\u00b2", "2")
    used = [name + ("2" if power == 2 else "") for name, power in zip(names, term, strict=True) if power]
    return plain in ("".join(used), "".join(reversed(used)), *(("1", "Intercept") if not used else ()))


def parents(term: Term) -> set[Term]:
    """Terms that hierarchy requires beside this one: each exponent lowered, down to single factors."""
    found: set[Term] = set()
    for k, power in enumerate(term):
        if power:
            lower = (*term[:k], power - 1, *term[k + 1 :])
            if any(lower):
                found |= {lower} | parents(lower)
    return found


def columns(coded: Floats, terms: Sequence[Term]) -> Floats:
    """Values of the terms at coded points, [runs, terms]."""
    points = np.atleast_2d(np.asarray(coded, dtype=float))
    found = np.ones((len(points), len(terms)))
    for place, term in enumerate(terms):
        for factor, power in enumerate(term):
            for _ in range(power):
                found[:, place] *= points[:, factor]
    return found


def model_matrix(coded: Floats, terms: Sequence[Term]) -> Floats:
    """Constant and terms, [runs, 1 + terms]."""
    values = columns(coded, terms)
    return np.column_stack([np.ones(len(values)), values])


def alias_matrix(coded: Floats, kept: Sequence[Term], left_out: Sequence[Term]) -> Floats:
    """A, [1 + kept, left out]; the first row is the constant's."""
    inside = model_matrix(coded, kept)
    outside = model_matrix(coded, left_out)[:, 1:]
    return np.asarray(np.linalg.lstsq(inside, outside, rcond=None)[0], dtype=float)
