"""Clean cases: errors as the inference assumes them, a hidden truth, and the model that lacks it.

A case is drawn from one seed: which observables and conditions a laboratory would have varied, well or
poorly, how noisy it is and whether it says so, which candidates a user would list, and what really acts:
nothing, one effect, two, one that no candidate describes, or one that this design cannot identify. Calibrated
numbers are drawn from their priors, strengths log-uniformly between 0.3 and 3 times the textbook.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from doe.trials.reduced.laboratory import (
    BOX,
    FLUX_FLOOR,
    RANGES,
    TRANSFORMS,
    CaseModel,
    Truth,
    drawn_condition,
    measured,
)
from taichi_erosion.evidence.data.problem import (
    Candidate,
    Measurements,
    Observable,
    Parameter,
    Problem,
    Vault,
)
from taichi_erosion.evidence.models import reduced
from taichi_erosion.evidence.models.reduced import EFFECTS

KINDS = ("null", "single", "pair", "outside", "impossible")
SHARES = (0.50, 0.22, 0.10, 0.12, 0.06)
VARIED = {"impossible": (0, 1), "pair": (5, 9)}  # conditions besides the wind; else 2 to 6
PRIOR_SD = 0.3  # of ln of every calibrated number
WEAKEST, STRONGEST = 0.3, 3.0  # strength of a hidden effect
UNDERSTATED, SHARE_UNDERSTATED = 1.5, 0.1  # true over stated sd, and how many laboratories have it
TWIN = "twin_of_"  # before the name of a copy of what acts
OWNERS = {  # observable -> calibrated numbers that move it
    "threshold_u_star": ("threshold_coefficient",),
    "flux": ("threshold_coefficient", "flux_coefficient"),
    "repose_angle": ("friction_sliding", "friction_rolling"),
}


@dataclass(frozen=True)
class Case:
    """One study and its truth."""

    number: int
    problem: Problem
    truth: Truth
    level: float = 1.0  # noise of its laboratory over the usual one


def draw_case(family: int, number: int) -> Case:
    """Case `number` of a seed family; the same numbers always give the same case."""
    generator = np.random.default_rng([family, number])
    kind = str(generator.choice(KINDS, p=SHARES))
    observables = chosen_observables(generator)
    varied = chosen_conditions(generator, *VARIED.get(kind, (2, 6)), observables)
    library, effects, outside = chosen_effects(generator, kind, observables, varied)
    truth = Truth(
        kind=kind,
        effects=effects,
        parameters=true_parameters(generator, observables),
        understated=float(
            generator.choice([1.0, UNDERSTATED], p=[1.0 - SHARE_UNDERSTATED, SHARE_UNDERSTATED])
        ),
        repeats=bool(generator.random() < 0.5),
        outside=outside,
    )
    level = float(np.exp(generator.uniform(np.log(0.5), np.log(1.5))))
    table = measured(generator, truth, observables, varied, level)
    return Case(number, study_of(generator, table, observables, library, level), truth, level)


def study_of(
    generator: np.random.Generator,
    table: Measurements,
    observables: tuple[str, ...],
    library: list[str],
    level: float,
) -> Problem:
    """What the solver is given: candidates in any order, a model with or without scatter, a vault."""
    scatter = float(generator.choice([0.0, 0.5, 1.0], p=[0.5, 0.3, 0.2]))
    aliases = {name: name.removeprefix(TWIN) for name in library}
    model = CaseModel(scatter * level, float(generator.choice([0.0, 0.3])), aliases)
    order = generator.permutation(len(library))
    return Problem(
        measurements=table,
        observables={k: Observable(k, TRANSFORMS[k], FLUX_FLOOR * (k == "flux")) for k in observables},
        parameters=parameters_of(observables),
        candidates=tuple(Candidate(library[i]) for i in order),
        model=model,
        vault=drawn_vault(generator, table),
    )


def start_values(observables: tuple[str, ...]) -> dict[str, float]:
    """Calibrated numbers that move the measured observables."""
    used = {path for name in observables for path in OWNERS[name]}
    return {path: value for path, value in reduced.PARAMETERS.items() if path in used}


def parameters_of(observables: tuple[str, ...]) -> tuple[Parameter, ...]:
    """Calibrated numbers with their ranges and priors."""
    return tuple(
        Parameter(path, value, value / 5.0, value * 5.0, PRIOR_SD)
        for path, value in start_values(observables).items()
    )


def true_parameters(generator: np.random.Generator, observables: tuple[str, ...]) -> dict[str, float]:
    """Calibrated numbers drawn from their priors."""
    return {
        path: value * float(np.exp(PRIOR_SD * generator.standard_normal()))
        for path, value in start_values(observables).items()
    }


def chosen_observables(
    generator: np.random.Generator, shares: Sequence[float] = (0.25, 0.4, 0.35)
) -> tuple[str, ...]:
    """One to three instruments, in any order."""
    count = int(generator.choice([1, 2, 3], p=shares))
    return tuple(str(name) for name in generator.choice(reduced.OBSERVABLES, count, replace=False))


def chosen_conditions(
    generator: np.random.Generator, least: int, most: int, observables: tuple[str, ...]
) -> tuple[str, ...]:
    """Conditions that the laboratory varied."""
    count = int(generator.integers(least, most + 1))
    names = [name for name in RANGES if name != "u_star"]
    varied = [str(name) for name in generator.choice(names, count, replace=False)]
    return (*varied, "u_star") if "flux" in observables else tuple(varied)


def acts(law: str, observables: tuple[str, ...], varied: tuple[str, ...]) -> bool:
    """Whether a law moves any measured observable somewhere in the varied range."""
    generator = np.random.default_rng(0)
    at = {
        name: drawn_condition(generator, name, 20) if name in varied else np.full(20, value)
        for name, value in {**reduced.DEFAULTS, "width": BOX}.items()
    }
    for name in observables:
        bare, with_law = reduced.model_mean(name, at, {}, {}), reduced.model_mean(name, at, {}, {law: 1.0})
        if np.any(np.abs(with_law - bare) > 1e-9 * np.abs(bare).max()):
            return True
    return False


def chosen_effects(
    generator: np.random.Generator, kind: str, observables: tuple[str, ...], varied: tuple[str, ...]
) -> tuple[list[str], dict[str, float], str]:
    """Candidates of the study, what acts, and the law that was taken off the list."""
    able = [law for law in EFFECTS if acts(law, observables, varied)]
    wanted = {"null": 0, "outside": 1, "pair": 2}.get(kind, 1)
    hidden = [str(law) for law in generator.choice(able, min(wanted, len(able)), replace=False)]
    effects = {law: float(np.exp(generator.uniform(np.log(WEAKEST), np.log(STRONGEST)))) for law in hidden}
    others = [law for law in EFFECTS if law not in hidden]
    count = int(generator.integers(5, 12))
    library = [str(law) for law in generator.choice(others, min(count, len(others)), replace=False)]
    if kind == "outside":
        return library, effects, hidden[0] if hidden else ""
    library += hidden
    if kind == "impossible" and hidden and generator.random() < 0.5:
        library.append(f"{TWIN}{hidden[0]}")
    return library, effects, ""


def drawn_vault(generator: np.random.Generator, table: Measurements) -> Vault:
    """A fifth of the groups, kept from the search."""
    names = sorted(set(table.group))
    hidden = set(generator.permutation(names)[: len(names) // 5].tolist()) if len(names) > 9 else set()
    return Vault(np.array([i for i, name in enumerate(table.group) if name in hidden], dtype=np.int64))
