"""The fitted polynomial written out, in coded and in natural units.

    x_k = (u_k - c_k) / h_k

turns every coded term into a sum of natural ones; u is the natural value, c and h centre and half range of
factor k. The natural equation holds inside the design only; its coefficients must not be compared in size.
"""

from collections.abc import Mapping
from itertools import product
from math import comb

from taichi_erosion.experiments.fit import Fit
from taichi_erosion.experiments.terms import Term, term_name

Polynomial = dict[Term, float]  # coefficient of every term; the constant is the term of zeros


def coded_polynomial(fit: Fit) -> Polynomial:
    """Coefficients in coded units."""
    constant = (0,) * len(fit.factors)
    return dict(zip((constant, *fit.terms), map(float, fit.coefficients), strict=True))


def natural_polynomial(fit: Fit) -> Polynomial:
    """Coefficients in the factors' own units."""
    total: Polynomial = {}
    for term, coefficient in coded_polynomial(fit).items():
        for lower, share in expanded(fit, term).items():
            total[lower] = total.get(lower, 0.0) + coefficient * share
    return total


def expanded(fit: Fit, term: Term) -> Polynomial:
    """One coded term as a natural polynomial, by the binomial theorem factor by factor."""
    shares = [
        [comb(power, k) * (-factor.centre) ** (power - k) / factor.half**power for k in range(power + 1)]
        for factor, power in zip(fit.factors, term, strict=True)
    ]
    found: Polynomial = {}
    for lower in product(*(range(power + 1) for power in term)):
        share = 1.0
        for column, k in zip(shares, lower, strict=True):
            share *= column[k]
        found[lower] = share
    return found


def evaluate(polynomial: Mapping[Term, float], values: tuple[float, ...]) -> float:
    """Value of a polynomial at one point."""
    total = 0.0
    for term, coefficient in polynomial.items():
        for value, power in zip(values, term, strict=True):
            coefficient *= value**power
        total += coefficient
    return total


def equation(fit: Fit, polynomial: Mapping[Term, float], digits: int = 5) -> str:
    """The polynomial as one line of text."""
    names = [factor.path for factor in fit.factors]
    words = [f"{fit.response} ="]
    for term, coefficient in polynomial.items():
        sign = "-" if coefficient < 0.0 else "+"
        size = f"{abs(coefficient):.{digits}g}"
        words.append(f"{sign} {size} {term_name(term, names)}" if any(term) else f"{coefficient:.{digits}g}")
    return " ".join(words)
