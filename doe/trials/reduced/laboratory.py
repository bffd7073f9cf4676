"""The two sides of a case: a laboratory in whose world an effect acts, and the model that lacks it.

Both stand on the closed form of `reduced.py`. The laboratory has its own calibrated numbers, a stated sd that
may be too small, repeats or none, and a floor below which it may write "no transport" instead of a flux. The
model has replicate noise of its own, part of which paired seeds may not share.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from math import sqrt

import numpy as np

from taichi_erosion.evidence.data.problem import (
    Conditions,
    Floats,
    Integers,
    Measurements,
    Transform,
    row_count,
)
from taichi_erosion.evidence.models import reduced

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
TRANSFORMS: dict[str, Transform] = {
    "threshold_u_star": "log",
    "flux": "log_floor",
    "repose_angle": "identity",
}
FLUX_FLOOR = 1e-4  # kg m-1 s-1, the least that is called transport
FLUX_ZERO = 1e-5  # kg m-1 s-1, noise of an empty trap
CENSORING = 0.5  # share of laboratories that write "no transport" below the floor
BOX = 0.2  # m between the walls of a heap where a laboratory states no width
REPEATED = 4  # conditions that a laboratory with repeats measures three times
ROWS, FEW_ROWS = (8, 25), (2, 9)  # of one observable, from and below; few where the design is impossible


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
class Place:
    """Rows of one observable under their conditions."""

    columns: tuple[Floats, ...]  # as they were given
    count: int
    at: Conditions  # with every default
    states: np.ndarray  # a number for every row that its observable and conditions make
    drawn: dict[bytes, Floats] = field(default_factory=dict)

    def kick(self, seeds: Integers) -> Floats:
        """What paired seeds share."""
        key = seeds.tobytes()
        if key not in self.drawn:
            self.drawn[key] = reduced.normal_numbers_of_states(self.states, seeds)
        return self.drawn[key]


@dataclass(frozen=True)
class CaseModel:
    """The reduced model with a chosen scatter; part of it may be chaotic, different at every setting."""

    scatter: float  # of one seed, over that of one measured row
    chaos: float  # share of the variance that paired seeds do not share
    aliases: dict[str, str]  # candidate -> law
    states: dict[tuple[str, tuple[int, ...]], Place] = field(default_factory=dict)

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
        place = self.place(observable, conditions)
        shifts = [reduced.EFFECTS[name](psi, place.at) for name, psi in acting.items() if psi != 0.0]
        known = {**reduced.PARAMETERS, **parameters}
        value = reduced.mean_with_shifts(observable, place.count, place.at, known, shifts)
        if self.scatter == 0.0:
            return np.repeat(value[np.newaxis], seeds.size, axis=0)
        kick = sqrt(1.0 - self.chaos) * place.kick(seeds)
        if self.chaos > 0.0:
            setting = np.array([*parameters.values(), *effects.values()]).view(np.uint64)
            other = seeds.astype(np.uint64) ^ np.bitwise_xor.reduce(reduced.splitmix64(setting))
            kick = kick + sqrt(self.chaos) * reduced.normal_numbers_of_states(place.states, other)
        kick = kick * self.scatter * NOISE[observable]
        return value + kick if observable == "repose_angle" else value * np.exp(kick)

    def place(self, observable: str, conditions: Conditions) -> Place:
        """What does not depend on the setting, kept for rows whose conditions cannot change."""
        columns = tuple(conditions.values())
        key = (observable, tuple(map(id, columns)))
        found = self.states.get(key)
        if found is None or any(own is not given for own, given in zip(found.columns, columns, strict=True)):
            found = Place(
                columns,
                row_count(conditions),
                reduced.DEFAULT_COLUMNS | {"width": np.asarray(BOX)} | conditions,
                reduced.hash_rows(observable, conditions),
            )
            if not any(column.flags.writeable for column in columns):
                self.states[key] = found
        return found


def drawn_condition(generator: np.random.Generator, name: str, count: int) -> Floats:
    """Values over the range of one condition, at random or on a few levels."""
    low, high, logarithmic = RANGES[name]
    share = generator.random(count) if generator.random() < 0.5 else generator.integers(0, 4, count) / 3.0
    if logarithmic:
        return np.exp(np.log(low) + share * np.log(high / low))
    return low + share * (high - low)


@dataclass(frozen=True)
class Readings:
    """What one instrument gave."""

    observable: str
    at: Conditions
    value: Floats
    sd: Floats  # as stated
    group: tuple[str, ...]
    source: tuple[str, ...] = ()


def readings(
    generator: np.random.Generator, truth: Truth, observable: str, varied: tuple[str, ...], level: float
) -> Readings:
    """Rows of one instrument; `level` is its noise over the usual one."""
    count = int(generator.integers(*(FEW_ROWS if truth.kind == "impossible" else ROWS)))
    at = {name: drawn_condition(generator, name, count) for name in varied}
    again = np.arange(count)
    if truth.repeats and count > REPEATED:
        again = np.concatenate([again, np.repeat(generator.choice(count, REPEATED, replace=False), 2)])
    at = {name: column[again] for name, column in at.items()}
    if not at:
        at = {"diameter": np.full(again.size, reduced.DEFAULTS["diameter"])}
    group = tuple(f"{observable}-{number // 2}" for number in again)
    return read(generator, truth, observable, at, level, group)


def read(
    generator: np.random.Generator,
    truth: Truth,
    observable: str,
    at: Conditions,
    level: float,
    group: tuple[str, ...],
) -> Readings:
    """One reading of one instrument for every set of conditions."""
    mean = reduced.model_mean(observable, at, truth.parameters, truth.effects)
    sd = NOISE[observable] * level
    kick = sd * truth.understated * generator.standard_normal(mean.size)
    if observable == "repose_angle":
        return Readings(observable, at, mean + kick, np.full(mean.size, sd), group)
    value, zero = mean * np.exp(kick), 0.0
    if observable == "flux":
        zero = FLUX_ZERO
        value = value + zero * generator.standard_normal(mean.size)
    return Readings(observable, at, value, np.hypot(sd * np.abs(mean), zero), group)


def measured(
    generator: np.random.Generator,
    truth: Truth,
    observables: tuple[str, ...],
    varied: tuple[str, ...],
    level: float,
) -> Measurements:
    """What the laboratory wrote down."""
    return written(generator, [readings(generator, truth, name, varied, level) for name in observables])


def written(generator: np.random.Generator, parts: Sequence[Readings]) -> Measurements:
    """One table; half of the laboratories write "no transport" instead of a flux below the floor."""
    table = table_of(parts)
    no_transport = np.array(table.observable) == "flux"
    no_transport &= (table.value < FLUX_FLOOR) & bool(generator.random() < CENSORING)
    return replace(table, censored=no_transport, limit=np.where(no_transport, FLUX_FLOOR, np.nan))


def table_of(parts: Sequence[Readings], repeats: float = 1.0) -> Measurements:
    """Readings of several instruments one below the other, each the mean of some repeats."""
    names = tuple(part.observable for part in parts for _ in part.value)
    size = len(names)
    return Measurements(
        observable=names,
        value=np.concatenate([part.value for part in parts]),
        sd=np.concatenate([part.sd for part in parts]),
        n=np.full(size, float(repeats)),
        group=tuple(group for part in parts for group in part.group),
        unit=("",) * size,
        conditions={name: np.concatenate([part.at[name] for part in parts]) for name in parts[0].at},
        censored=np.zeros(size, dtype=np.bool_),
        limit=np.full(size, np.nan),
        source=tuple(source for part in parts for source in part.source) or ("sealed case",) * size,
    )
