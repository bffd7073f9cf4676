"""Cases beyond the list: tables of the reduced model with a mechanism whose dose follows a hidden law.

A case is drawn from one seed: nothing is missing, a listed effect acts, or a mechanism acts with a dose that
depends on one condition by a power, an onset, a saturation or an exponential.
"""

from dataclasses import dataclass, field, replace

import numpy as np

from doe.beyond import reduced_places
from doe.trials.reduced.laboratory import Readings, table_of
from doe.trials.reduced.oracle import least_misfit, root
from taichi_erosion.evidence.data.problem import (
    Candidate,
    Conditions,
    Floats,
    Integers,
    Measurements,
    Mechanism,
    Numbers,
    Observable,
    Parameter,
    Problem,
    Vault,
)
from taichi_erosion.evidence.data.transforms import axis_position
from taichi_erosion.evidence.models import reduced
from taichi_erosion.evidence.models.prepared_problem import prepare_problem

Shares = tuple[float, float, float]
KINDS, SHARES = ("outside", "null", "listed"), (0.4, 0.4, 0.2)
OBSERVABLES = {
    "threshold_u_star": Observable("threshold_u_star", "log"),
    "flux": Observable("flux", "log_floor", 1e-3),
    "repose_angle": Observable("repose_angle"),
}
SD = {"threshold_u_star": 0.025, "flux": 0.09, "repose_angle": 0.6}  # relative, relative, deg
FLUX_ZERO = 1e-4  # sd of a flux of nothing [kg m-1 s-1]
CANDIDATES = ("liquid_bridge", "dry_cohesion", "gusts", "electrostatics", "bed_slope", "mid_air_collisions")
LISTED = ("liquid_bridge", "dry_cohesion", "mid_air_collisions")  # that act on the conditions varied here
SET_UPS = (14, 25)
PRIOR_SD = 0.3
HELD_OUT = 0.25  # share of the set-ups
FORMS = ("power", "power", "saturating", "onset", "exponential")


@dataclass(frozen=True)
class Truth:
    """What is hidden."""

    kind: str
    name: str = ""  # effect or mechanism
    condition: str = ""
    form: str = ""
    size: float = 0.0  # strength, or dose at typical conditions
    exponent: float = 0.0
    parameters: dict[str, float] = field(default_factory=dict)


def expected_model(
    observable: str, conditions: Conditions, parameters: Numbers, effects: Numbers, seeds: Integers
) -> Floats:
    """Model of the study: without scatter."""
    value = reduced_places.expected(observable, conditions, parameters, effects)
    return np.repeat(value[np.newaxis], len(seeds), axis=0)


def draw(*seed: int, shares: Shares = SHARES) -> tuple[Problem, Truth]:
    """One case; the same numbers always give the same case. Two stored sets have shares of 0.5, 0.3, 0.2."""
    generator = np.random.default_rng([*seed, 23])
    truth = drawn_truth(generator, shares)
    count = int(generator.integers(*SET_UPS))
    moisture = np.asarray(0.01 * generator.integers(0, 5, count), dtype=np.float64)
    diameter = np.asarray(np.exp(generator.uniform(np.log(1.2e-4), np.log(8e-4), count)), dtype=np.float64)
    conditions = {"moisture": moisture, "diameter": diameter, "u_star": generator.uniform(0.35, 0.8, count)}
    truth = within_range(truth, conditions)
    table = measured(generator, truth, conditions, float(np.exp(generator.uniform(np.log(0.5), np.log(1.5)))))
    hidden = generator.choice(count, round(HELD_OUT * count), replace=False)
    rows = np.concatenate([hidden + k * count for k in range(len(OBSERVABLES))])
    parameters = tuple(
        Parameter(path, value, value / 5.0, value * 5.0, PRIOR_SD)
        for path, value in reduced.PARAMETERS.items()
    )
    mechanisms = tuple(Mechanism(name, *ends) for name, ends in reduced_places.predict_mechanisms.items())
    candidates = tuple(Candidate(name) for name in generator.permutation(CANDIDATES))
    vault = Vault(np.sort(rows))
    problem = Problem(
        table, OBSERVABLES, parameters, candidates, expected_model, vault=vault, mechanisms=mechanisms
    )
    return problem, truth


def drawn_truth(generator: np.random.Generator, shares: Shares) -> Truth:
    """What acts, how strongly, by which law."""
    kind = str(generator.choice(KINDS, p=shares))
    parameters = {
        path: float(value * np.exp(PRIOR_SD * generator.standard_normal()))
        for path, value in reduced.PARAMETERS.items()
    }
    if kind == "null":
        return Truth(kind, parameters=parameters)
    if kind == "listed":
        size = float(np.exp(generator.uniform(np.log(0.5), np.log(2.0))))
        return Truth(kind, str(generator.choice(LISTED)), size=size, parameters=parameters)
    name = str(generator.choice(list(reduced_places.PLACES)))
    low, high = reduced_places.predict_mechanisms[name]
    size = float(np.exp(generator.uniform(np.log(0.03), np.log(0.3))))
    downwards = low < 0.0 and generator.random() < 0.5
    return Truth(
        kind,
        name,
        condition=str(generator.choice(["moisture", "diameter"])),
        form=str(generator.choice(FORMS)),
        size=size * high if not downwards else max(-0.6, 1.5 * size * low),
        exponent=float(generator.uniform(0.5, 1.5)),
        parameters=parameters,
    )


def within_range(truth: Truth, conditions: Conditions) -> Truth:
    """The same with a smaller size where doses would leave the range of the model."""
    if truth.kind != "outside":
        return truth
    low, high = reduced_places.predict_mechanisms[truth.name]
    law = doses(truth, conditions)
    beyond = max(float(law.max()) / high, float(law.min()) / low if low < 0.0 else 0.0, 1.0)
    return replace(truth, size=truth.size / beyond)


def doses(truth: Truth, conditions: Conditions) -> Floats:
    """Dose of the mechanism in every row."""
    typical = {"moisture": 0.02, "diameter": 3e-4}[truth.condition]
    share = conditions[truth.condition] / typical
    if truth.form == "power":
        law = share ** (truth.exponent if truth.condition == "moisture" else -truth.exponent)
    elif truth.form == "saturating":
        law = 1.0 - np.exp(-1.5 * share)
    elif truth.form == "onset":
        law = np.maximum(share - 0.5, 0.0) ** truth.exponent
    else:
        law = np.expm1(0.5 * share) if truth.condition == "moisture" else np.exp(1.0 - share)
    return np.asarray(truth.size * law, dtype=np.float64)


def exact(truth: Truth, observable: str, conditions: Conditions) -> Floats:
    """Values without noise."""
    if truth.kind != "outside":
        acting = {truth.name: truth.size} if truth.name else {}
        return reduced_places.expected(observable, conditions, truth.parameters, acting)
    values = []
    for row, dose in enumerate(doses(truth, conditions)):
        own = {name: column[row : row + 1] for name, column in conditions.items()}
        values.append(
            reduced_places.expected(observable, own, truth.parameters, {truth.name: float(dose)})[0]
        )
    return np.array(values)


def measured(
    generator: np.random.Generator, truth: Truth, conditions: Conditions, level: float
) -> Measurements:
    """All observables at all set-ups; `level` is the noise over the usual one."""
    group = tuple(f"set-up {k}" for k in range(conditions["moisture"].size))
    parts = []
    for observable in OBSERVABLES:
        mean = exact(truth, observable, conditions)
        own = level * SD[observable] * (np.ones(mean.size) if observable == "repose_angle" else mean)
        own = np.hypot(own, FLUX_ZERO if observable == "flux" else 0.0)
        value = mean + own * generator.standard_normal(mean.size)
        parts.append(Readings(observable, conditions, value, own, group))
    return table_of(parts)


def ratio(problem: Problem, truth: Truth) -> float:
    """Root of the misfit that the calibrated bare model keeps without noise, in sd of the measurements."""
    table = problem.visible_rows()
    named, value = np.array(table.observable), table.value.copy()
    for observable in OBSERVABLES:
        rows = named == observable
        own = {name: column[rows] for name, column in table.conditions.items()}
        value[rows] = exact(truth, observable, own)
    prepared = prepare_problem(problem, replace(table, value=value), 0)
    x = np.array([axis_position(axis, truth.parameters[axis.name]) for axis in prepared.parameter_axes])
    return root(least_misfit(prepared, x, {}))
