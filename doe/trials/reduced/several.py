"""Sealed cases with none to four effects at once, and with one beyond the largest strength of its list.

Drawn as those of `clean.py`, but only designs in which every effect that acts could be seen: without it the
model keeps a misfit of at least `least_ratio` squared on noise-free measurements.
"""

import numpy as np

from doe.trials.reduced.clean import (
    STRONGEST,
    WEAKEST,
    Case,
    acts,
    chosen_conditions,
    chosen_observables,
    drawn_vault,
    observables_of,
    parameters_of,
    true_parameters,
)
from doe.trials.reduced.laboratory import CaseModel, Truth, measured
from doe.trials.reduced.oracle import least_misfit, noise_free, root
from taichi_erosion.evidence.data.problem import Candidate, Problem
from taichi_erosion.evidence.models.reduced import EFFECTS

KINDS = {"null": 0, "single": 1, "pair": 2, "triple": 3, "quadruple": 4, "beyond": 1}  # effects that act
BEYOND = 2.0  # times the maximum, up to which an effect beyond it is drawn
MAXIMUM = Candidate("").maximum
LIBRARY = (5, 12)  # candidates beside those that act, from and below
TRIES = 200  # designs drawn until one shows every effect


def draw_several(salt: int, number: int, kind: str, least_ratio: float) -> Case:
    """Case `number` of one kind; the same salt, number and kind always give the same case."""
    generator = np.random.default_rng([salt, number, list(KINDS).index(kind)])
    for _ in range(TRIES):
        case = drawn(generator, number, kind)
        if len(case.truth.effects) == KINDS[kind] and least_ratio_of(case, least_ratio) >= least_ratio:
            return case
    raise RuntimeError(f"no design in {TRIES} shows every effect of a {kind}")


def drawn(generator: np.random.Generator, number: int, kind: str) -> Case:
    """One draw of a design, a truth and its measurements."""
    observables = chosen_observables(generator)
    varied = chosen_conditions(generator, *((5, 9) if KINDS[kind] > 1 else (2, 6)), observables)
    effects = hidden(generator, kind, observables, varied)
    repeats = bool(generator.random() < 0.5)
    truth = Truth(kind, effects, true_parameters(generator, observables), 1.0, repeats, "")
    level = float(np.exp(generator.uniform(np.log(0.5), np.log(1.5))))
    table = measured(generator, truth, observables, varied, level)
    scatter = float(generator.choice([0.0, 0.5, 1.0], p=[0.5, 0.3, 0.2]))
    others = [law for law in EFFECTS if law not in truth.effects]
    count = min(int(generator.integers(*LIBRARY)), len(others))
    library = [*truth.effects, *(str(law) for law in generator.choice(others, count, replace=False))]
    problem = Problem(
        measurements=table,
        observables=observables_of(observables),
        parameters=parameters_of(observables),
        candidates=tuple(Candidate(library[i]) for i in generator.permutation(len(library))),
        model=CaseModel(scatter * level, float(generator.choice([0.0, 0.3])), {law: law for law in library}),
        vault=drawn_vault(generator, table),
    )
    return Case(number, problem, truth)


def hidden(
    generator: np.random.Generator, kind: str, observables: tuple[str, ...], varied: tuple[str, ...]
) -> dict[str, float]:
    """What acts, with its strength."""
    able = [law for law in EFFECTS if acts(law, observables, varied)]
    laws = generator.choice(able, min(KINDS[kind], len(able)), replace=False)
    low, high = (MAXIMUM, BEYOND * MAXIMUM) if kind == "beyond" else (WEAKEST, STRONGEST)
    return {str(law): float(np.exp(generator.uniform(np.log(low), np.log(high)))) for law in laws}


def least_ratio_of(case: Case, enough: float) -> float:
    """Least ratio over the effects that act, or the first below what is enough; infinite for a null."""
    truth, least = case.truth.effects, np.inf
    if not truth:
        return least
    prepared, x = noise_free(case)
    floor = least_misfit(prepared, x, dict(truth))
    for name in truth:
        rest = {other: strength for other, strength in truth.items() if other != name}
        least = min(least, root(least_misfit(prepared, x, rest) - floor))
        if least < enough:
            break
    return least
