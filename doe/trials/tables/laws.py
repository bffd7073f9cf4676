"""What acts in a laboratory: listed effects of the closed form, of constant or varying strength, and others.

A law that no list holds adds `size` times a shape to the angle [deg] or the logarithm of threshold or flux.
The shape depends on a condition by s, its share of the range (t of another one), by x and y, values over the
largest, and by numbers p, q:

    power x^p    hump (s/p) e^(1 - s/p)    onset max(s - p, 0) / (1 - p)    saturation 1 - e^(-s/p)
    interaction x^p y^q    sign sin(2 pi s) or x^p (1 - 2 t)    unread s^p of a column that no model reads
    friction another law of the grain size, or of the wind    soils x^p in the second soil alone
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from doe.trials.tables.words import LABORATORY, NUMBERS, RANGES, SHARES
from taichi_erosion.evidence.data.problem import Floats
from taichi_erosion.evidence.models import reduced
from taichi_erosion.evidence.models.reduced import Shift

Random = np.random.Generator
PLACES = {"threshold_u_star": "threshold", "flux": "flux", "repose_angle": "repose"}  # in a Shift
RIVALS = (0.1, 0.2, 0.4, 0.7, 1.0, 1.5, 2.2, 3.0)  # strengths at which a listed effect is tried as the cause
LEAST_SPAN = 2.5  # of an effect of strength 1 over the noise of one reading
STEP = 1e-3  # of the logarithm of a calibrated number


@dataclass(frozen=True)
class Design:
    """Sets of conditions in the units of the model, of one soil or laboratory each."""

    at: Mapping[str, Floats]
    soil: Floats  # 0 or 1
    extra: Mapping[str, Floats]  # columns that no model reads

    @property
    def varied(self) -> int:
        """Number of conditions that vary; 0 where a soil has but a few sets."""
        few = min(np.unique(self.soil, return_counts=True)[1], default=0) < 4
        return 0 if few else sum(float(np.ptp(column)) > 0.0 for column in self.at.values())

    def rows(self, keep: np.ndarray) -> "Design":
        """Some of the sets."""
        at, extra = ({k: c[keep] for k, c in part.items()} for part in (self.at, self.extra))
        return Design(at, self.soil[keep], extra)

    def share(self, name: str) -> tuple[Floats, Floats, Floats]:
        """A column, its share of the range, and itself over its largest value."""
        column = self.extra[name] if name in self.extra else self.at[name]
        share = (column - column.min()) / max(float(np.ptp(column)), 1e-12)
        return column, share, column / column.max() if column.min() >= 0.0 < column.max() else share


@dataclass(frozen=True)
class Outside:
    """A law that no list holds."""

    form: str
    sizes: dict[str, float]  # by observable
    axes: tuple[str, str]
    numbers: tuple[float, float]
    variant: bool

    def shape(self, design: Design) -> Floats:
        """The law over the sets, of size 1."""
        (first, s, x), (_, t, y), (p, q) = *map(design.share, self.axes), self.numbers
        if self.form == "friction":
            steep = np.log(np.maximum(first, 1e-9))
            return np.asarray(steep - steep.mean())
        return {
            "power": x**p,
            "hump": s / p * np.exp(1.0 - s / p),
            "onset": np.maximum(s - p, 0.0) / max(1.0 - p, 0.1),
            "saturation": (1.0 - np.exp(-s / p)) / (1.0 - np.exp(-1.0 / p)),
            "interaction": x**p * y**q,
            "sign": np.sin(2.0 * np.pi * s) if self.variant else x**p * (1.0 - 2.0 * t),
            "unread": s ** min(p, 1.5),
            "soils": design.soil * x**p,
        }[self.form]


@dataclass(frozen=True)
class Truth:
    """What acts, and the numbers that a calibration would find."""

    kind: str  # null, listed, pair, varying, outside
    effects: dict[str, float]
    parameters: dict[str, float]
    varying: dict[str, Any] = field(default_factory=dict)  # axis, exponent, typical value of the condition
    outside: Outside | None = None
    levels: dict[str, float] = field(default_factory=dict)  # what the second soil reads more, by observable


def one_of(generator: Random, words: Iterable[str]) -> str:
    """One of some words, by weight where they have weights."""
    weights = np.array([float(words[w]) if isinstance(words, Mapping) else 1.0 for w in words])
    return str(generator.choice(list(words), p=weights / weights.sum()))


def drawn_truth(generator: Random, kind: str, observables: tuple[str, ...], design: Design) -> Truth | None:
    """What acts; None where this design shows too few effects."""
    numbers = {name: float(np.exp(generator.uniform(*np.log(e[:2])))) for name, e in NUMBERS.items()}
    levels = {name: float(LABORATORY[name]["level"] * generator.standard_normal()) for name in observables}
    truth = Truth(kind, {}, numbers, levels=levels if design.soil.any() and generator.random() < 0.7 else {})
    if kind == "outside":
        return replace(truth, outside=drawn_outside(generator, observables, design))
    able, count = acting_effects(observables, design), {"null": 0, "pair": 2}.get(kind, 1)
    if len(able) < count:
        return None
    weight = np.sqrt(list(able.values()))  # clear ones more often
    hidden = generator.choice(list(able), count, False, weight / weight.sum()) if count else ()
    truth = replace(truth, effects={str(n): float(np.exp(generator.uniform(-0.92, 0.7))) for n in hidden})
    if kind == "varying":
        positive = [n for n, column in design.at.items() if np.ptp(column) > 0.0 and column.min() >= 0.0]
        axis, sign = str(generator.choice(positive)), float(generator.choice([-1.0, 1.0]))
        exponent = sign * float(generator.uniform(0.3, 1.2))
        typical = float(np.median(design.at[axis])) or 0.01
        truth = replace(truth, varying={"axis": axis, "exponent": exponent, "typical": typical})
    return truth


def drawn_outside(generator: Random, observables: tuple[str, ...], design: Design) -> Outside:
    """A law with numbers drawn broadly, that this design can show."""
    varied = [name for name, column in design.at.items() if np.ptp(column) > 0.0]
    form = one_of(generator, {n: w for n, w in SHARES["forms"].items() if n != "soils" or design.soil.any()})
    axis = str(generator.choice([n for n in varied if n != "u_star"] or varied))
    if form == "friction":
        axis = next((n for n in ("u_star", "diameter") if n in varied), axis)
    if form == "unread":
        axis = str(generator.choice([name for name in RANGES if name not in ("mass", "density")]))
    other = str(generator.choice([name for name in varied if name != axis] or varied))
    sign = 1.0 if generator.random() < 0.7 else -1.0
    sizes = {n: float(sign * np.exp(generator.uniform(*np.log(LABORATORY[n]["size"])))) for n in observables}
    (p, q), place = np.exp(generator.uniform(-1.2, 1.1, 2)), float(generator.uniform(0.15, 0.65))
    p = {"hump": place, "onset": place, "saturation": 0.5 * place}.get(form, float(p))
    return Outside(form, sizes, (axis, other), (p, float(q)), bool(generator.random() < 0.5))


def values(truth: Truth, observable: str, design: Design, without: str = "") -> Floats:
    """Values without noise, where one effect, or as `outside` the law that no list holds, does not act."""
    at = reduced.DEFAULT_COLUMNS | dict(design.at)
    effects = [(name, size) for name, size in truth.effects.items() if name != without]
    found = [effect_shift(truth, name, size, at, design.soil.size) for name, size in effects]
    amount = truth.levels.get(observable, 0.0) * design.soil
    if truth.outside is not None and without != "outside":
        amount = amount + truth.outside.sizes[observable] * truth.outside.shape(design)
    found.append(Shift(**{PLACES[observable]: amount}))
    numbers = {**reduced.PARAMETERS, **truth.parameters}
    return np.asarray(
        reduced.mean_with_shifts(observable, design.soil.size, at, numbers, found), dtype=np.float64
    )


def effect_shift(truth: Truth, name: str, strength: float, at: Mapping[str, Floats], size: int) -> Shift:
    """Shift of a listed effect, row by row where its strength varies."""
    law = reduced.EFFECTS[name]
    if not truth.varying:
        return law(strength, dict(at))
    axis, exponent, typical = (truth.varying[key] for key in ("axis", "exponent", "typical"))
    wide = {key: np.broadcast_to(column, size) for key, column in at.items()}
    strengths = strength * (np.maximum(wide[axis], 0.05 * typical) / typical) ** exponent
    rows = [law(float(psi), {k: c[i : i + 1] for k, c in wide.items()}) for i, psi in enumerate(strengths)]
    return Shift(
        **{part: np.array([np.ravel(getattr(r, part))[0] for r in rows]) for part in PLACES.values()}
    )


def acting_effects(observables: tuple[str, ...], design: Design) -> dict[str, float]:
    """Listed effects that the varied conditions move, and how far over the noise of one reading."""
    at, found = reduced.DEFAULT_COLUMNS | dict(design.at), dict[str, float]()
    for name, law in reduced.EFFECTS.items():
        shift, spans = law(1.0, dict(at)), [0.0]
        for each in observables:
            parts = [PLACES[each]] + ["threshold"] * (each == "flux")
            columns = [np.asarray(getattr(shift, part)) * np.ones(design.soil.size) for part in parts]
            spans += [float(np.ptp(column)) / np.mean(LABORATORY[each]["noise"]) for column in columns]
        found[name] = max(spans)
    return {name: span for name, span in found.items() if span > LEAST_SPAN}


@dataclass(frozen=True)
class Sight:
    """What an observer without noise could see of a truth through its design."""

    truth: Truth
    design: Design
    sd: Mapping[str, Floats]  # of the mean of every set on the scale of even scatter, by observable
    seen: Mapping[str, np.ndarray]  # sets of which a value is known

    def signal(self, truth: Truth, without: str = "") -> Floats:
        """Values of all observables without noise, over their sd; 0 where none is known."""
        parts = []
        for name, sd in self.sd.items():
            value = values(truth, name, self.design, without)
            with np.errstate(divide="ignore", invalid="ignore"):
                value = value if name == "repose_angle" else np.log(value)
            parts.append(np.where(self.seen[name] & np.isfinite(value), value / sd, 0.0))
        return np.concatenate(parts)

    @cached_property
    def imitations(self) -> tuple[Floats, int]:
        """What calibrated numbers, to the sd of their prior, and free levels of soils do; how many."""
        base, columns, numbers = self.signal(self.truth), [], self.truth.parameters
        for name, start in numbers.items():
            moved = replace(self.truth, parameters=numbers | {name: start * np.exp(STEP)})
            columns.append((self.signal(moved) - base) / STEP * NUMBERS[name][2])
        for name in self.sd:
            levels = self.truth.levels
            raised = replace(self.truth, levels=levels | {name: levels.get(name, 0.0) + 1.0})
            columns.append(self.signal(raised) - base)
        return np.column_stack(columns), len(numbers)

    def left(self, change: Floats, *others: Floats) -> float:
        """Size of a change [sd] beyond what calibration, levels of soils and some other columns imitate."""
        own, count = self.imitations
        wide = np.column_stack([own, *others])
        matrix = np.vstack([wide, np.eye(count, wide.shape[1])])
        aim = np.append(change, np.zeros(count))
        return float(np.linalg.norm(aim - matrix @ np.linalg.lstsq(matrix, aim, rcond=None)[0]))

    def difficulty(self) -> dict[str, Any]:
        """Least ratio of what acts, and how far the nearest listed effect is from a law outside the list."""
        truth, base = self.truth, self.signal(self.truth)
        changes = {n: base - self.signal(truth, n) for n in truth.effects or ["outside"]}
        ratios = [self.left(x, *(y for m, y in changes.items() if m != n)) for n, x in changes.items()]
        found = {"ratio": min(ratios), "separation": None, "twin": ""}
        if truth.outside is not None:
            rivals = [(name, size) for name in reduced.EFFECTS for size in RIVALS]
            bare = replace(truth, outside=None)
            gaps = [self.left(base - self.signal(replace(bare, effects={n: size}))) for n, size in rivals]
            found |= {"separation": min(gaps), "twin": rivals[int(np.argmin(gaps))][0]}
        return found
