"""Disturbed cases: errors that the inference does not assume, none to four effects; one disturbance a case.

    y_i = m(c_i, theta, psi) + stated sd_i (e_i + b_i) + smooth discrepancy,    on the comparison scale

with e the error of a row and b an error that rows of one batch, source or observable share. Every table names
batches (`group`) and some name two sources, whether these matter or not.
"""

from dataclasses import dataclass, replace
from hashlib import sha256

import numpy as np

from doe.trials.reduced.clean import Case, chosen_conditions, chosen_observables, study_of, true_parameters
from doe.trials.reduced.laboratory import (
    FLUX_FLOOR,
    FLUX_ZERO,
    NOISE,
    RANGES,
    REPEATED,
    ROWS,
    Readings,
    Truth,
    drawn_condition,
    written,
)
from taichi_erosion.evidence.data.problem import Conditions, Floats, Integers, Measurements
from taichi_erosion.evidence.models import reduced
from taichi_erosion.evidence.models.reduced import EFFECTS

NEEDS_EFFECT = ("form", "beyond")  # disturbances of what acts, not of what is measured
STUDENT_FREEDOM, STUDENT_SCALE = 3, 0.8  # variance 1.9 of the stated one
SECOND_SOURCE = 0.4  # share of tables with two sources, where these do not matter
SOURCES = ("laboratory A", "laboratory B")
BATCH_ROWS = (3, 6)  # rows of one batch, from and below
GROWTH = (0.6, 3.0)  # true over stated sd at the two ends of a condition
TOGETHER = 0.15  # sd of the second of two conditions about the first, over the range
LEAST_LOGARITHM = 1e-300
KINDS = ("null", "single", "pair", "triple", "four", "outside")
ACTING = {"null": 0, "single": 1, "outside": 1, "pair": 2, "triple": 3, "four": 4}
SHARES = (0.60, 0.12, 0.10, 0.04, 0.14)  # of the kinds in which something acts
WEAKEST, STRONGEST = 0.4, 3.0  # strength of a hidden effect; the maximum of the list is 3
BEYOND = 2.0  # of the maximum, that an effect beyond it reaches
SIZES: dict[str, tuple[float, float]] = {  # range of the size of every disturbance
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
class DisturbedTruth(Truth):
    """What was hidden, and the disturbance with its size."""

    disturbance: str = "none"
    size: float = 0.0  # sd of a row, ratio, or exponent, whichever the disturbance has


@dataclass(frozen=True)
class Design:
    """Where one observable was measured, by whom and in which batch; equal `number` for repeats."""

    at: Conditions
    number: Integers
    batch: Integers
    source: Integers


def designed(generator: np.random.Generator, truth: DisturbedTruth, varied: tuple[str, ...]) -> Design:
    """Conditions, repeats, batches and sources of one observable."""
    count = int(generator.integers(*ROWS))
    at = {name: drawn_condition(generator, name, count) for name in varied}
    if truth.disturbance == "correlated" and len(varied) > 1:
        at[varied[1]] = following(generator, at[varied[0]], varied[0], varied[1])
    sources = sources_of(generator, truth, at, varied)
    number = np.arange(count)
    if truth.repeats and count > REPEATED:
        again = np.repeat(generator.choice(count, REPEATED, replace=False), 2)
        number = np.concatenate([number, again])
    cuts = np.cumsum(generator.integers(*BATCH_ROWS, size=count))
    batch = np.searchsorted(cuts, generator.permutation(count), side="right")
    at = {name: column[number] for name, column in at.items()}
    return Design(at, number, batch[number], sources[number])


def following(generator: np.random.Generator, first: Floats, name: str, other: str) -> Floats:
    """A condition that goes together with another one."""
    low, high, logarithmic = RANGES[name]
    share = np.log(first / low) / np.log(high / low) if logarithmic else (first - low) / (high - low)
    share = np.clip(share + TOGETHER * generator.standard_normal(first.size), 0.0, 1.0)
    low, high, logarithmic = RANGES[other]
    return low * (high / low) ** share if logarithmic else low + share * (high - low)


def sources_of(
    generator: np.random.Generator, truth: DisturbedTruth, at: Conditions, varied: tuple[str, ...]
) -> Integers:
    """Which of two laboratories measured each condition; one for all, at random, or split by a condition."""
    column = at[varied[0]]
    if truth.disturbance == "coarse_source":
        return (column > np.median(column)).astype(np.int64)
    two = truth.disturbance == "source" or generator.random() < SECOND_SOURCE
    return generator.integers(0, 2, column.size) if two else np.zeros(column.size, dtype=np.int64)


def true_mean(truth: DisturbedTruth, observable: str, at: Conditions) -> Floats:
    """Values without noise; of effects of another form at conditions bent by a power over their range."""
    if truth.disturbance != "form":
        return reduced.model_mean(observable, at, truth.parameters, truth.effects)
    bent = {name: bent_condition(name, column, truth.size) for name, column in at.items()}
    bent |= {name: at[name] for name in ("u_star",) if name in at}
    gain = reduced.model_mean(observable, bent, truth.parameters, truth.effects)
    bare = reduced.model_mean(observable, bent, truth.parameters, {})
    here = reduced.model_mean(observable, at, truth.parameters, {})
    if observable == "repose_angle":
        return here + gain - bare
    ratio = np.where(bare > 0.0, gain / np.maximum(bare, LEAST_LOGARITHM), 1.0)
    return here * ratio


def bent_condition(name: str, column: Floats, power: float) -> Floats:
    """A condition moved within its range: share ** power of it."""
    low, high, _ = RANGES[name]
    return low + (high - low) * np.clip((column - low) / (high - low), 0.0, 1.0) ** power


def row_errors(
    generator: np.random.Generator, truth: DisturbedTruth, design: Design, varied: tuple[str, ...]
) -> Floats:
    """Errors in stated sd: of the row, of what it shares with others, and of a smooth discrepancy."""
    size, kind = design.number.size, truth.disturbance
    error = truth.understated * generator.standard_normal(size)
    if kind == "student":
        error = STUDENT_SCALE * generator.standard_t(STUDENT_FREEDOM, size)
    if kind == "growing":
        low, high, _ = RANGES[varied[0]]
        share = (design.at[varied[0]] - low) / (high - low)
        error = error * GROWTH[0] * (GROWTH[1] / GROWTH[0]) ** share
    if kind == "batch":
        error = error + truth.size * generator.standard_normal(design.batch.max() + 1)[design.batch]
    if kind in ("source", "coarse_source"):
        error = error + truth.size * float(generator.choice([-1.0, 1.0])) * design.source
    if kind == "offset":
        error = error + truth.size * float(generator.choice([-1.0, 1.0]))
    if kind == "discrepancy":
        error = error + truth.size * smooth(generator, design, varied)
    return error


def smooth(generator: np.random.Generator, design: Design, varied: tuple[str, ...]) -> Floats:
    """A smooth function of one condition with mean square 1 over the rows."""
    low, high, logarithmic = RANGES[varied[0]]
    column = design.at[varied[0]]
    share = np.log(column / low) / np.log(high / low) if logarithmic else (column - low) / (high - low)
    turns, phase = generator.uniform(0.5, 1.2), generator.uniform(0.0, 2.0 * np.pi)
    wave = np.sin(2.0 * np.pi * turns * share + phase)
    return wave / max(float(np.sqrt(np.mean(wave**2))), 0.1)


def readings(
    generator: np.random.Generator,
    truth: DisturbedTruth,
    observable: str,
    varied: tuple[str, ...],
    level: float,
) -> Readings:
    """One observable measured; `level` is its noise over the usual one."""
    design = designed(generator, truth, varied)
    mean, sd = true_mean(truth, observable, design.at), NOISE[observable] * level
    kick = sd * row_errors(generator, truth, design, varied)
    if observable == "repose_angle":
        value, stated = mean + kick, np.full(mean.size, sd)
    else:
        zero = FLUX_ZERO if observable == "flux" else 0.0
        value = mean * np.exp(kick) + zero * generator.standard_normal(mean.size)
        stated = np.hypot(sd * np.abs(mean), zero)
    group = tuple(f"{observable}-{k}" for k in design.batch)
    return Readings(observable, design.at, value, stated, group, tuple(SOURCES[k] for k in design.source))


def measured(
    generator: np.random.Generator,
    truth: DisturbedTruth,
    observables: tuple[str, ...],
    varied: tuple[str, ...],
    level: float,
) -> Measurements:
    """What the laboratory wrote down; of an offset only the first observable has one."""
    plain = replace(truth, disturbance="none", size=0.0)
    others = plain if truth.disturbance == "offset" else truth
    parts = [
        readings(generator, others if k else truth, name, varied, level) for k, name in enumerate(observables)
    ]
    return written(generator, with_outliers(truth, parts, generator))


def with_outliers(
    truth: DisturbedTruth, parts: list[Readings], generator: np.random.Generator
) -> list[Readings]:
    """The parts with one or two rows of one observable far off."""
    if truth.disturbance != "outlier":
        return parts
    part = parts[int(generator.integers(len(parts)))]
    value = part.value.copy()
    count = int(generator.integers(1, 3))
    for row in generator.choice(value.size, min(count, value.size), replace=False):
        off = truth.size * float(generator.choice([-1.0, 1.0]))
        if part.observable == "repose_angle":
            value[row] += off * part.sd[row]
        else:
            value[row] *= np.exp(off * part.sd[row] / max(abs(value[row]), LEAST_LOGARITHM))
    return [replace(each, value=value) if each is part else each for each in parts]


def draw_case(salt: str, number: int, nulls: float) -> Case:
    """Case `number` of a salt; `nulls` is the share of cases in which nothing is missing."""
    digest = sha256(f"{salt}/{number}".encode()).digest()
    generator = np.random.default_rng(np.frombuffer(digest, dtype=np.uint32))
    kind = drawn_kind(generator, nulls)
    observables = chosen_observables(generator, (0.2, 0.35, 0.45))
    varied = chosen_conditions(generator, 2 + ACTING[kind], 5 + ACTING[kind], observables)
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
    level = float(np.exp(generator.uniform(np.log(0.5), np.log(1.5))))
    table = measured(generator, truth, observables, varied, level)
    return Case(number, study_of(generator, table, observables, library, level), truth, level)


def drawn_kind(generator: np.random.Generator, nulls: float) -> str:
    """How many effects act."""
    if generator.random() < nulls:
        return "null"
    return str(generator.choice(KINDS[1:], p=SHARES))


def shows(law: str, observables: tuple[str, ...], varied: tuple[str, ...]) -> bool:
    """Whether a law of textbook strength varies by the scatter of a row or more over the varied range."""
    generator = np.random.default_rng(0)
    at = {name: drawn_condition(generator, name, PROBES) for name in varied}
    for name in observables:
        bare, acting = (reduced.model_mean(name, at, {}, effects) for effects in ({}, {law: 1.0}))
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


def drawn_disturbance(generator: np.random.Generator, kind: str) -> tuple[str, float]:
    """One disturbance out of those that the kind can have, and its size."""
    able = [name for name in SIZES if kind not in ("null", "outside") or name not in NEEDS_EFFECT]
    name = able[int(generator.integers(len(able)))]
    low, high = SIZES[name]
    if name == "form":
        return name, float(generator.choice([low, high]))
    return name, float(generator.uniform(low, high))


def undisturbed(case: Case) -> Case:
    """The case as the oracle takes it: no disturbance, strengths no larger than the list allows."""
    effects = {name: min(strength, STRONGEST) for name, strength in case.truth.effects.items()}
    return replace(case, truth=replace(case.truth, effects=effects))
