"""A laboratory in closed form whose errors are not those that the inference assumes: one disturbance a case.

    y_i = m(c_i, theta, psi) + stated sd_i (e_i + b_i) + smooth discrepancy,    on the comparison scale

with e the error of a row and b an error that rows of one batch, source or observable share. Every table names
batches (`group`) and some name two sources, whether these matter or not.
"""

from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from doe.sealed.laboratory import (
    CENSORING,
    FLUX_FLOOR,
    FLUX_ZERO,
    NOISE,
    RANGES,
    REPEATED,
    ROWS,
    drawn_condition,
)
from taichi_erosion.evidence.data.problem import Conditions, Floats, Integers, Measurements
from taichi_erosion.evidence.models import reduced

Disturbance = Literal[
    "none",
    "student",
    "outlier",
    "batch",
    "source",
    "coarse_source",
    "offset",
    "understated",
    "growing",
    "correlated",
    "discrepancy",
    "form",
    "beyond",
]
NEEDS_EFFECT = ("form", "beyond")  # disturbances of what acts, not of what is measured
STUDENT_FREEDOM, STUDENT_SCALE = 3, 0.8  # variance 1.9 of the stated one
SECOND_SOURCE = 0.4  # share of tables with two sources, where these do not matter
SOURCES = ("laboratory A", "laboratory B")
BATCH_ROWS = (3, 6)  # rows of one batch, from and below
GROWTH = (0.6, 3.0)  # true over stated sd at the two ends of a condition
TOGETHER = 0.15  # sd of the second of two conditions about the first, over the range
LEAST_LOGARITHM = 1e-300


@dataclass(frozen=True)
class DisturbedTruth:
    """What was hidden; the names of `doe.sealed.laboratory.Truth`, and the disturbance with its size."""

    kind: str
    effects: dict[str, float]
    parameters: dict[str, float]
    repeats: bool
    outside: str
    disturbance: Disturbance
    size: float  # sd of a row, ratio, or exponent, whichever the disturbance has
    understated: float = 1.0
    rows: tuple[int, ...] = field(default=())  # outliers


@dataclass(frozen=True)
class Design:
    """Where one observable was measured, by whom and in which batch; equal `number` for repeats."""

    observable: str
    at: Conditions
    number: Integers
    batch: Integers
    source: Integers


def designed(
    generator: np.random.Generator, truth: DisturbedTruth, observable: str, varied: tuple[str, ...]
) -> Design:
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
    return Design(observable, at, number, batch[number], sources[number])


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
        return reduced.expected(observable, at, truth.parameters, truth.effects)
    bent = {name: bent_condition(name, column, truth.size) for name, column in at.items()}
    bent |= {name: at[name] for name in ("u_star",) if name in at}
    gain = reduced.expected(observable, bent, truth.parameters, truth.effects)
    bare = reduced.expected(observable, bent, truth.parameters, {})
    here = reduced.expected(observable, at, truth.parameters, {})
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


@dataclass(frozen=True)
class Part:
    """Rows of one observable as written down."""

    design: Design
    value: Floats
    sd: Floats


def part_of(
    generator: np.random.Generator,
    truth: DisturbedTruth,
    observable: str,
    varied: tuple[str, ...],
    level: float,
) -> Part:
    """One observable measured; `level` is its noise over the usual one."""
    design = designed(generator, truth, observable, varied)
    mean, sd = true_mean(truth, observable, design.at), NOISE[observable] * level
    kick = sd * row_errors(generator, truth, design, varied)
    if observable == "repose_angle":
        return Part(design, mean + kick, np.full(mean.size, sd))
    zero = FLUX_ZERO if observable == "flux" else 0.0
    value = mean * np.exp(kick) + zero * generator.standard_normal(mean.size)
    return Part(design, value, np.hypot(sd * np.abs(mean), zero))


def measured(
    generator: np.random.Generator,
    truth: DisturbedTruth,
    observables: tuple[str, ...],
    varied: tuple[str, ...],
    level: float,
) -> Measurements:
    """What the laboratory wrote down; of an offset only the first observable has one."""
    first = [truth if k == 0 or truth.disturbance != "offset" else plain(truth) for k in range(3)]
    parts = [part_of(generator, first[k], name, varied, level) for k, name in enumerate(observables)]
    parts = with_outliers(truth, parts, generator)
    value = np.concatenate([part.value for part in parts])
    names = tuple(part.design.observable for part in parts for _ in part.value)
    flux = np.array([name == "flux" for name in names])
    no_transport = flux & (value < FLUX_FLOOR) & bool(generator.random() < CENSORING)
    return Measurements(
        observable=names,
        value=value,
        sd=np.concatenate([part.sd for part in parts]),
        n=np.ones(value.size),
        group=tuple(f"{p.design.observable}-{k}" for p in parts for k in p.design.batch),
        unit=("",) * value.size,
        conditions={name: np.concatenate([p.design.at[name] for p in parts]) for name in varied},
        censored=no_transport,
        limit=np.where(no_transport, FLUX_FLOOR, np.nan),
        source=tuple(SOURCES[k] for p in parts for k in p.design.source),
    )


def plain(truth: DisturbedTruth) -> DisturbedTruth:
    """The same without a disturbance of what is measured."""
    return DisturbedTruth(
        truth.kind, truth.effects, truth.parameters, truth.repeats, truth.outside, "none", 0.0
    )


def with_outliers(truth: DisturbedTruth, parts: list[Part], generator: np.random.Generator) -> list[Part]:
    """The parts with one or two rows of one observable far off."""
    if truth.disturbance != "outlier":
        return parts
    part = parts[int(generator.integers(len(parts)))]
    value = part.value.copy()
    count = int(generator.integers(1, 3))
    for row in generator.choice(value.size, min(count, value.size), replace=False):
        off = truth.size * float(generator.choice([-1.0, 1.0]))
        if part.design.observable == "repose_angle":
            value[row] += off * part.sd[row]
        else:
            value[row] *= np.exp(off * part.sd[row] / max(abs(value[row]), LEAST_LOGARITHM))
    return [Part(p.design, value, p.sd) if p is part else p for p in parts]
