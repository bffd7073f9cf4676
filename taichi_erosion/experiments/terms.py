"""Terms of a polynomial model: products of powers of coded factors, and their hierarchy."""

from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import Literal

import numpy as np

from taichi_erosion.core.setup import Floats

Term = tuple[int, ...]  # exponent of every factor; (1, 0, 1) is A C, (0, 2, 0) is B^2
Order = Literal["linear", "interactions", "quadratic"]


def linear_terms(count: int) -> tuple[Term, ...]:
    """A, B, C ..."""
    return interaction_terms(count, 1)


def interaction_terms(count: int, order: int = 2) -> tuple[Term, ...]:
    """Products of `order` different factors: A B, A C, B C ..."""
    chosen = combinations(range(count), order)
    return tuple(tuple(int(k in factors) for k in range(count)) for factors in chosen)


def model_terms(count: int, order: Order) -> tuple[Term, ...]:
    """Terms of a complete model, without the constant."""
    terms = linear_terms(count)
    if order in ("interactions", "quadratic"):
        terms += interaction_terms(count)
    if order == "quadratic":
        terms += tuple(tuple(2 * power for power in term) for term in linear_terms(count))
    return terms


def term_name(term: Term, names: Sequence[str]) -> str:
    """`A`, `A*B`, `A^2`, with the factors' names."""
    parts = [
        name if power == 1 else f"{name}^{power}" for name, power in zip(names, term, strict=True) if power
    ]
    return "*".join(parts) or "1"


def term_label(name: str, labels: Mapping[str, str]) -> str:
    """A term's name with labels for the factors, "sliding friction × restitution^2"."""
    words = (factor.partition("^") for factor in name.split("*"))
    return " \N{MULTIPLICATION SIGN} ".join(
        labels.get(path, path) + hat + power for path, hat, power in words
    )


def parents(term: Term) -> set[Term]:
    """Terms that hierarchy requires beside this one: each exponent lowered, down to single factors."""
    lower = [(*term[:k], power - 1, *term[k + 1 :]) for k, power in enumerate(term) if power]
    return set[Term]().union(*({each} | parents(each) for each in lower if any(each)))


def model_matrix(coded: Floats, terms: Sequence[Term]) -> Floats:
    """Constant and terms at coded points, [runs, 1 + terms]."""
    points = np.atleast_2d(np.asarray(coded, dtype=float))
    powers = np.array(terms, dtype=int).reshape(len(terms), points.shape[1])
    return np.column_stack([np.ones(len(points)), np.prod(points[:, None, :] ** powers, axis=2)])
