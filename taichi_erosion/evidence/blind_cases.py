"""Sealed cases that test the statistics: measurements made with a hidden truth, and the model that lacks it.

A case is drawn from one seed: which observables and conditions a laboratory would have varied, well or poorly,
how noisy it is and whether it says so, which candidates a user would list, and what really acts: nothing, one
effect, two, one that no candidate describes, or one that this design cannot identify. Calibrated numbers are
drawn from their priors, strengths log-uniformly between 0.3 and 3 times the textbook.
"""

from dataclasses import dataclass, field

import numpy as np

from taichi_erosion.evidence import reduced
from taichi_erosion.evidence.problem import (
    Budget,
    Candidate,
    Floats,
    Integers,
    Measurements,
    Observable,
    Parameter,
    Problem,
    Vault,
)
from taichi_erosion.evidence.reduced_effects import EFFECTS

KINDS = ("null", "single", "pair", "outside", "impossible")
SHARES = (0.50, 0.26, 0.06, 0.12, 0.06)
RANGES: dict[str, tuple[float, float, bool]] = {  # condition -> low, high, spread over its logarithm
    "diameter": (7.5e-5, 1.0e-3, True),
    "moisture": (0.0, 0.02, False),
    "slope": (-0.15, 0.15, False),
    "roughness": (0.0, 0.05, False),
    "air_density": (0.95, 1.3, False),
    "spread": (1.2, 4.0, True),
    "angularity": (0.0, 1.0, False),
    "turbulence": (0.02, 0.25, False),
    "fetch": (1.0, 15.0, True),
    "width": (0.005, 0.2, True),
    "u_star": (0.35, 0.8, False),
}
NOISE = {"threshold_u_star": 0.03, "flux": 0.12, "repose_angle": 0.8}  # of one row: relative, relative, deg
TRANSFORMS = {"threshold_u_star": "log", "flux": "log_floor", "repose_angle": "identity"}
FLUX_FLOOR = 1e-4  # kg m-1 s-1, the least that is called transport
FLUX_ZERO = 1e-5  # kg m-1 s-1, noise of an empty trap
CENSORING = 0.5  # share of laboratories that write "no transport" below the floor
PRIOR_SD = 0.3  # of ln of every calibrated number
OWNERS = {  # observable -> calibrated numbers that move it
    "threshold_u_star": ("threshold_coefficient",),
    "flux": ("threshold_coefficient", "flux_coefficient"),
    "repose_angle": ("friction_sliding", "friction_rolling"),
}


@dataclass(frozen=True)
class CaseModel:
    """The reduced model with a chosen scatter; part of it may be chaotic, different at every setting."""

    scatter: float  # of one seed, over that of one measured row
    chaos: float  # share of the variance that paired seeds do not share
    aliases: dict[str, str]  # candidate -> law
    drawn: dict[tuple[str, bytes, bytes], Floats] = field(default_factory=dict)

    def __call__(
        self,
        observable: str,
        conditions: dict[str, Floats],
        parameters: dict[str, float],
        effects: dict[str, float],
        seeds: Integers,
    ) -> Floats:
        acting: dict[str, float] = {}
        for name, strength in effects.items():
            if strength != 0.0:
                law = self.aliases.get(name, name)
                acting[law] = acting.get(law, 0.0) + strength
        value = reduced.expected(observable, conditions, parameters, acting)
        if self.scatter == 0.0:
            return np.repeat(value[np.newaxis], seeds.size, axis=0)
        kick = np.sqrt(1.0 - self.chaos) * self.kick(observable, conditions, seeds)
        if self.chaos > 0.0:
            setting = np.array([*parameters.values(), *effects.values()]).view(np.uint64)
            other = seeds.astype(np.uint64) ^ np.bitwise_xor.reduce(reduced.scrambled(setting))
            kick = kick + np.sqrt(self.chaos) * reduced.disturbance(observable, conditions, other)
        kick = kick * self.scatter * NOISE[observable]
        return value + kick if observable == "repose_angle" else value * np.exp(kick)

    def kick(self, observable: str, conditions: dict[str, Floats], seeds: Integers) -> Floats:
        key = (observable, seeds.tobytes(), b"".join(column.tobytes() for column in conditions.values()))
        if key not in self.drawn:
            self.drawn[key] = reduced.disturbance(observable, conditions, seeds)
        return self.drawn[key]


@dataclass(frozen=True)
class Truth:
    """What was hidden."""

    kind: str
    effects: dict[str, float]
    parameters: dict[str, float]
    understated: float  # true sd over stated sd
    repeats: bool
    outside: str  # law that no candidate describes


@dataclass(frozen=True)
class Case:
    """One study and its truth."""

    number: int
    problem: Problem
    truth: Truth


def draw_case(family: int, number: int, budget: Budget | None = None) -> Case:
    """Case `number` of a seed family; the same numbers always give the same case."""
    generator = np.random.default_rng([family, number])
    kind = str(generator.choice(KINDS, p=SHARES))
    observables = chosen_observables(generator)
    varied = chosen_conditions(generator, kind, observables)
    library, effects, outside = chosen_effects(generator, kind, observables, varied)
    truth = Truth(
        kind=kind,
        effects=effects,
        parameters=true_parameters(generator, observables),
        understated=float(generator.choice([1.0, 1.5], p=[0.9, 0.1])),
        repeats=bool(generator.random() < 0.5),
        outside=outside,
    )
    level = float(np.exp(generator.uniform(np.log(0.5), np.log(1.5))))
    table = measured(generator, truth, observables, varied, level)
    scatter = float(generator.choice([0.0, 0.5, 1.0], p=[0.5, 0.3, 0.2]))
    aliases = {name: name.removeprefix("twin_of_") for name in library}
    model = CaseModel(scatter * level, float(generator.choice([0.0, 0.3])), aliases)
    order = generator.permutation(len(library))
    problem = Problem(
        measurements=table,
        observables={
            name: Observable(name, TRANSFORMS[name], FLUX_FLOOR if name == "flux" else 0.0)
            for name in observables
        },
        parameters=tuple(
            Parameter(path, reduced.PARAMETERS[path], value / 5.0, value * 5.0, PRIOR_SD)
            for path, value in start_values(observables).items()
        ),
        candidates=tuple(Candidate(library[i]) for i in order),
        model=model,
        budget=budget or Budget(),
        vault=drawn_vault(generator, table),
    )
    return Case(number, problem, truth)


def start_values(observables: tuple[str, ...]) -> dict[str, float]:
    """Calibrated numbers that move the measured observables."""
    used = {path for name in observables for path in OWNERS[name]}
    return {path: value for path, value in reduced.PARAMETERS.items() if path in used}


def true_parameters(generator: np.random.Generator, observables: tuple[str, ...]) -> dict[str, float]:
    """Calibrated numbers drawn from their priors."""
    return {
        path: value * float(np.exp(PRIOR_SD * generator.standard_normal()))
        for path, value in start_values(observables).items()
    }


def chosen_observables(generator: np.random.Generator) -> tuple[str, ...]:
    """One to three instruments."""
    count = int(generator.choice([1, 2, 3], p=[0.25, 0.4, 0.35]))
    return tuple(str(name) for name in generator.choice(reduced.OBSERVABLES, count, replace=False))


def chosen_conditions(
    generator: np.random.Generator, kind: str, observables: tuple[str, ...]
) -> tuple[str, ...]:
    """Conditions that the laboratory varied: one to six, none or one where the design shall be impossible."""
    count = int(generator.integers(0, 2)) if kind == "impossible" else int(generator.integers(2, 7))
    names = [name for name in RANGES if name != "u_star"]
    varied = [str(name) for name in generator.choice(names, count, replace=False)]
    return (*varied, "u_star") if "flux" in observables else tuple(varied)


def acts(law: str, observables: tuple[str, ...], varied: tuple[str, ...]) -> bool:
    """Whether a law moves any measured observable somewhere in the varied range."""
    generator = np.random.default_rng(0)
    at = {
        name: drawn_condition(generator, name, 20) if name in varied else np.full(20, value)
        for name, value in reduced.DEFAULTS.items()
    }
    for name in observables:
        bare, with_law = reduced.expected(name, at, {}, {}), reduced.expected(name, at, {}, {law: 1.0})
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
    effects = {law: float(np.exp(generator.uniform(np.log(0.3), np.log(3.0)))) for law in hidden}
    others = [law for law in EFFECTS if law not in hidden]
    count = int(generator.integers(5, 12))
    library = [str(law) for law in generator.choice(others, min(count, len(others)), replace=False)]
    if kind == "outside":
        return library, effects, hidden[0] if hidden else ""
    library += hidden
    if kind == "impossible" and hidden and generator.random() < 0.5:
        library.append(f"twin_of_{hidden[0]}")
    return library, effects, ""


def drawn_condition(generator: np.random.Generator, name: str, count: int) -> Floats:
    """Values over the range of one condition, at random or on a few levels."""
    low, high, logarithmic = RANGES[name]
    share = generator.random(count) if generator.random() < 0.5 else generator.integers(0, 4, count) / 3.0
    if logarithmic:
        return np.exp(np.log(low) + share * np.log(high / low))
    return low + share * (high - low)


def measured(
    generator: np.random.Generator,
    truth: Truth,
    observables: tuple[str, ...],
    varied: tuple[str, ...],
    level: float,
) -> Measurements:
    """What the laboratory wrote down."""
    columns: dict[str, list[float]] = {name: [] for name in varied}
    names: list[str] = []
    values: list[float] = []
    stated: list[float] = []
    groups: list[str] = []
    for observable in observables:
        count = (
            int(generator.integers(8, 25)) if truth.kind != "impossible" else int(generator.integers(2, 9))
        )
        at = {name: drawn_condition(generator, name, count) for name in varied}
        again = np.arange(count)
        if truth.repeats and count > 4:
            again = np.concatenate([again, np.repeat(generator.choice(count, 4, replace=False), 2)])
        at = {name: column[again] for name, column in at.items()} or {"diameter": np.full(again.size, 2.5e-4)}
        mean = reduced.expected(observable, at, truth.parameters, truth.effects)
        sd = NOISE[observable] * level
        kick = sd * truth.understated * generator.standard_normal(again.size)
        drawn = mean + kick if observable == "repose_angle" else mean * np.exp(kick)
        if observable == "flux":
            drawn = drawn + FLUX_ZERO * generator.standard_normal(again.size)
        names += [observable] * again.size
        values += [float(value) for value in drawn]
        size = np.ones(again.size) if observable == "repose_angle" else np.abs(mean)
        extra = FLUX_ZERO if observable == "flux" else 0.0
        stated += [float(value) for value in np.hypot(sd * size, extra)]
        groups += [f"{observable}-{number // 2}" for number in again]
        for name in columns:
            columns[name] += [float(value) for value in at[name]]
    silent = np.array([name == "flux" for name in names]) & (np.array(values) < FLUX_FLOOR)
    silent &= generator.random() < CENSORING
    conditions = {name: np.array(column) for name, column in columns.items()}
    if not conditions:
        conditions = {"diameter": np.full(len(names), 2.5e-4)}
    return Measurements(
        observable=tuple(names),
        value=np.array(values),
        sd=np.array(stated),
        n=np.ones(len(names)),
        group=tuple(groups),
        unit=tuple("" for _ in names),
        conditions=conditions,
        censored=silent,
        limit=np.where(silent, FLUX_FLOOR, np.nan),
        source=tuple("sealed case" for _ in names),
    )


def drawn_vault(generator: np.random.Generator, table: Measurements) -> Vault:
    """A fifth of the groups, kept from the search."""
    names = sorted(set(table.group))
    hidden = set(generator.permutation(names)[: len(names) // 5].tolist()) if len(names) > 9 else set()
    return Vault(np.array([i for i, name in enumerate(table.group) if name in hidden], dtype=np.int64))
