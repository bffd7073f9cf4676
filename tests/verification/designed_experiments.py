"""V37: a screening and a response surface give back the effects that were put in.

The responses are polynomials of the coded factors with normal noise from a fixed seed. Without noise the
effects must come back to rounding. With noise, a share k of N tables is binomial: it may miss the wanted
share p by four standard errors, 4 sqrt(p (1 - p) / N), which chance does once in 16,000 times.
"""

from collections.abc import Callable, Iterator
from math import sqrt

import numpy as np
from scipy.spatial.distance import cosine

from taichi_erosion.core.setup import Floats
from taichi_erosion.experiments import fit as fits
from taichi_erosion.experiments.anova import anova, pure_error_row
from taichi_erosion.experiments.confirm import power, welch_test
from taichi_erosion.experiments.design import Design, Factor, box_behnken, plackett_burman, steepest_ascent
from taichi_erosion.experiments.optimise import Goal, optimise
from taichi_erosion.verification.claims import Outcome, below

SEED = 37
TABLES = 400  # synthetic experiments behind a share
ROUNDING = 1e-12  # of effects of order 10
NOISE = 0.7  # standard deviation of a run, beside effects of 0.1 to 12
SCREENED = np.array([-2.6, -0.7, -8.4, 0.9, 4.1, 3.3, 12.7, -1.3, -5.3])  # coded slopes of nine factors
CURVED = np.array([25.9, -0.8, 5.6, 0.7, -0.5, -0.6, -1.3, 0.9, -0.4, -5.6])  # of a quadratic in three
FOUR = 4.0  # standard errors
RUNS = 5  # of a confirmation
CONFIDENCE, SIGNIFICANCE = 0.95, 0.05


def factors(count: int) -> list[Factor]:
    """Factors whose natural units are far from coded ones."""
    return [Factor(f"x{k}", 0.1 * k, 0.1 * k + 10.0**k) for k in range(count)]


def fitted(design: Design, values: Floats, order: fits.Order) -> fits.Fit:
    return fits.fit_model(design.with_responses(y=values), "y", order)


def share(claim: str, hits: list[bool], wanted: float) -> Outcome:
    """A share of tables that should be `wanted`."""
    error = FOUR * sqrt(wanted * (1.0 - wanted) / len(hits))
    return Outcome(claim, float(np.mean(hits)), wanted, error, "f64")


def covered(fit: fits.Fit, truth: Floats) -> list[bool]:
    """Whether the interval of each slope holds the true one."""
    slopes = fits.coefficient_table(fit)[1:]
    return list((slopes["low"] <= truth) & (truth <= slopes["high"]))


def recovered_effects() -> Iterator[Outcome]:
    """V37."""
    rng = np.random.default_rng(SEED)
    screening, surface = plackett_burman(factors(9), centre_points=1), box_behnken(factors(3))
    yield from exact_effects(screening, surface)
    yield from noisy_effects(screening, surface, lambda runs: NOISE * rng.normal(size=runs))


def exact_effects(screening: Design, surface: Design) -> Iterator[Outcome]:
    linear = fitted(screening, 20.0 + screening.coded @ SCREENED, "linear")
    yield below("Plackett-Burman: error of nine slopes", linear.coefficients[1:] - SCREENED, ROUNDING, "f64")
    kept = fits.model_matrix(screening.coded, fits.model_terms(9, "linear"))
    left_out = fits.model_matrix(screening.coded, fits.interaction_terms(9, 2))[:, 1:]
    strengths = np.linspace(-1.0, 1.0, left_out.shape[1])
    mixed = fitted(screening, left_out @ strengths, "linear")
    predicted = np.linalg.lstsq(kept, left_out, rcond=None)[0] @ strengths
    name = "Plackett-Burman: bias by interactions less what the alias table says"
    yield below(name, mixed.coefficients - predicted, ROUNDING, "f64")
    bowl = fits.model_matrix(surface.coded, fits.model_terms(3, "quadratic")) @ CURVED
    quadratic = fitted(surface, bowl, "quadratic")
    name = "Box-Behnken: error of ten coefficients"
    yield below(name, quadratic.coefficients - CURVED, 10.0 * ROUNDING, "f64")
    path = steepest_ascent(factors(9), list(SCREENED), steps=2).coded[1]
    angle = np.arccos(min(1.0 - cosine(path, SCREENED), 1.0))
    yield below("steepest path: angle to the gradient [rad]", angle, 1e-7, "f64")
    hill = fitted(surface, 9.0 - np.sum((surface.coded - [0.3, -0.2, 0.6]) ** 2, axis=1), "quadratic")
    top = optimise([hill], [Goal("y", 10.0)]).optima[0].coded
    yield below("optimum: coded distance from the top of a hill", top - [0.3, -0.2, 0.6], 1e-5, "f64")


def noisy_effects(screening: Design, surface: Design, noise: Callable[[int], Floats]) -> Iterator[Outcome]:
    """What must hold in the right share of tables."""
    plane = 20.0 + screening.coded @ SCREENED
    bowl = fits.model_matrix(surface.coded, fits.model_terms(3, "quadratic"))
    lines = [fitted(screening, plane + noise(len(screening)), "linear") for _ in range(TABLES)]
    curves = [fitted(surface, bowl @ CURVED + noise(len(surface)), "quadratic") for _ in range(TABLES)]
    # one slope of each table: slopes of one table share their error and are no independent trials
    hits = [covered(fit, SCREENED)[0] for fit in lines]
    yield share("Plackett-Burman: 95 % interval holds the true slope", hits, CONFIDENCE)
    hits = [covered(fit, CURVED[1:])[-1] for fit in curves]
    yield share("Box-Behnken: 95 % interval holds the true curvature", hits, CONFIDENCE)
    lack = [row.p < SIGNIFICANCE for fit in curves for row in anova(fit) if row.source == "Lack of fit"]
    yield share("Box-Behnken: lack of fit of a right model at 5 %", lack, SIGNIFICANCE)
    errors = [pure_error_row(fit) for fit in curves]
    variance = sum(e.sum_of_squares for e in errors) / sum(e.df for e in errors)
    # s^2 scatters by sqrt(2 / df) of itself
    tolerance = FOUR * NOISE**2 * sqrt(2.0 / sum(e.df for e in errors))
    yield Outcome("Box-Behnken: variance of replicates", variance, NOISE**2, tolerance, "f64")
    tests = [welch_test((30.0 + noise(RUNS)).tolist(), 30.0 + NOISE) for _ in range(TABLES)]
    noticed = [test.p < SIGNIFICANCE for test in tests]
    wanted = power(NOISE, NOISE / sqrt(RUNS), RUNS - 1.0)
    yield share("confirmation: a difference of one sd is noticed as often as its power says", noticed, wanted)
