"""Sealed cases whose generator is not the prior of the inference: disturbed errors, up to four effects.

Drawn from a secret salt and the number of a case; what a user would hand in goes to the solver, the truth
stays in a folder of its own.
"""

from dataclasses import dataclass
from hashlib import sha256

import numpy as np

from doe.sealed.cases import OWNERS, Case, drawn_vault, observables_of, parameters_of, true_parameters
from doe.sealed.laboratory import FLUX_FLOOR, NOISE, RANGES, CaseModel, Truth, drawn_condition
from doe.t0_disturbed.laboratory import NEEDS_EFFECT, Disturbance, DisturbedTruth, measured
from taichi_erosion.evidence.data.problem import Candidate, Problem
from taichi_erosion.evidence.models import reduced
from taichi_erosion.evidence.models.reduced import EFFECTS

KINDS = ("null", "single", "pair", "triple", "four", "outside")
ACTING = {"null": 0, "single": 1, "outside": 1, "pair": 2, "triple": 3, "four": 4}
SHARES = (0.60, 0.12, 0.10, 0.04, 0.14)  # of the kinds in which something acts
WEAKEST, STRONGEST = 0.4, 3.0  # strength of a hidden effect; the maximum of the list is 3
BEYOND = 2.0  # of the maximum, that an effect beyond it reaches
SIZES: dict[Disturbance, tuple[float, float]] = {  # range of the size of every disturbance
    "none": (0.0, 0.0),
    "student": (1.0, 1.0),
    "outlier": (5.0, 12.0),  # stated sd
    "batch": (1.0, 2.0),  # sd of a batch over that of a row
    "source": (1.5, 4.0),  # stated sd
    "coarse_source": (1.5, 4.0),
    "offset": (2.0, 8.0),
    "understated": (1.5, 2.0),  # true over stated sd
    "growing": (1.0, 1.0),
    "correlated": (1.0, 1.0),
    "discrepancy": (0.5, 2.0),  # sd of the discrepancy over that of a row
    "form": (0.5, 2.0),  # exponent, one of both ends
    "beyond": (1.0, BEYOND),  # strength over the maximum
}
PROBES = 20  # conditions at which it is asked whether a law shows
LISTED = (5, 12)  # further candidates, from and below


@dataclass(frozen=True)
class DisturbedCase:
    """One study and its truth."""

    number: int
    problem: Problem
    truth: DisturbedTruth


def draw_case(salt: str, number: int, nulls: float) -> DisturbedCase:
    """Case `number` of a salt; `nulls` is the share of cases in which nothing is missing."""
    digest = sha256(f"{salt}/{number}".encode()).digest()
    generator = np.random.default_rng(np.frombuffer(digest, dtype=np.uint32))
    kind = drawn_kind(generator, nulls)
    observables = drawn_observables(generator)
    varied = drawn_conditions(generator, kind, observables)
    library, effects, outside = drawn_effects(generator, kind, observables, varied)
    disturbance, size = drawn_disturbance(generator, kind)
    if disturbance == "beyond":
        effects = {name: STRONGEST * size for name in effects}
    truth = DisturbedTruth(
        kind=kind if len(effects) == ACTING[kind] else "null" if not effects else kind,
        effects=effects,
        parameters=true_parameters(generator, observables),
        repeats=bool(generator.random() < 0.5),
        outside=outside,
        disturbance=disturbance,
        size=size,
        understated=size if disturbance == "understated" else 1.0,
    )
    return DisturbedCase(number, problem_of(generator, truth, observables, varied, library), truth)


def problem_of(
    generator: np.random.Generator,
    truth: DisturbedTruth,
    observables: tuple[str, ...],
    varied: tuple[str, ...],
    library: list[str],
) -> Problem:
    """What the solver is given."""
    level = float(np.exp(generator.uniform(np.log(0.5), np.log(1.5))))
    table = measured(generator, truth, observables, varied, level)
    scatter = float(generator.choice([0.0, 0.5, 1.0], p=[0.5, 0.3, 0.2]))
    model = CaseModel(scatter * level, float(generator.choice([0.0, 0.3])), {name: name for name in library})
    return Problem(
        measurements=table,
        observables=observables_of(observables),
        parameters=parameters_of(observables),
        candidates=tuple(Candidate(library[i]) for i in generator.permutation(len(library))),
        model=model,
        vault=drawn_vault(generator, table),
    )


def drawn_kind(generator: np.random.Generator, nulls: float) -> str:
    """How many effects act."""
    if generator.random() < nulls:
        return "null"
    return str(generator.choice(KINDS[1:], p=SHARES))


def drawn_observables(generator: np.random.Generator) -> tuple[str, ...]:
    """One to three instruments, in the order in which one of them may be off."""
    count = int(generator.choice([1, 2, 3], p=[0.2, 0.35, 0.45]))
    return tuple(str(name) for name in generator.choice(list(OWNERS), count, replace=False))


def drawn_conditions(
    generator: np.random.Generator, kind: str, observables: tuple[str, ...]
) -> tuple[str, ...]:
    """Conditions that the laboratory varied; more where more effects act."""
    least = 2 + ACTING[kind]
    count = int(generator.integers(least, least + 4))
    names = [name for name in RANGES if name != "u_star"]
    varied = [str(name) for name in generator.choice(names, min(count, len(names)), replace=False)]
    return (*varied, "u_star") if "flux" in observables else tuple(varied)


def shows(law: str, observables: tuple[str, ...], varied: tuple[str, ...]) -> bool:
    """Whether a law of textbook strength varies by the scatter of a row or more over the varied range."""
    generator = np.random.default_rng(0)
    at = {name: drawn_condition(generator, name, PROBES) for name in varied}
    for name in observables:
        bare, acting = (reduced.expected(name, at, {}, effects) for effects in ({}, {law: 1.0}))
        if name != "repose_angle":
            bare, acting = (np.log(np.maximum(each, FLUX_FLOOR)) for each in (bare, acting))
        if np.std(acting - bare) > NOISE[name]:
            return True
    return False


def drawn_effects(
    generator: np.random.Generator, kind: str, observables: tuple[str, ...], varied: tuple[str, ...]
) -> tuple[list[str], dict[str, float], str]:
    """Candidates of the study, what acts, and the law that was taken off the list."""
    able = [law for law in EFFECTS if shows(law, observables, varied)]
    wanted = min(ACTING[kind], len(able))
    hidden = [str(law) for law in generator.choice(able, wanted, replace=False)] if wanted else []
    effects = {law: float(np.exp(generator.uniform(np.log(WEAKEST), np.log(STRONGEST)))) for law in hidden}
    others = [law for law in EFFECTS if law not in hidden]
    count = int(generator.integers(*LISTED))
    library = [str(law) for law in generator.choice(others, min(count, len(others)), replace=False)]
    if kind == "outside":
        return library, effects, hidden[0] if hidden else ""
    return library + hidden, effects, ""


def drawn_disturbance(generator: np.random.Generator, kind: str) -> tuple[Disturbance, float]:
    """One disturbance out of those that the kind can have, and its size."""
    able: list[Disturbance] = [
        name for name in SIZES if kind not in ("null", "outside") or name not in NEEDS_EFFECT
    ]
    name = able[int(generator.integers(len(able)))]
    low, high = SIZES[name]
    if name == "form":
        return name, float(generator.choice([low, high]))
    return name, float(generator.uniform(low, high))


def undisturbed(case: DisturbedCase) -> Case:
    """The case as the oracle takes it: no disturbance, strengths no larger than the list allows."""
    truth = case.truth
    effects = {name: min(strength, STRONGEST) for name, strength in truth.effects.items()}
    plain = Truth(truth.kind, effects, truth.parameters, truth.understated, truth.repeats, truth.outside)
    return Case(case.number, case.problem, plain)
