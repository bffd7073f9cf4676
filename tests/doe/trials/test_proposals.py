"""Cases of the proposals: their tables, random requests, and what the laboratory measures."""

import numpy as np
import pytest

from doe.trials.proposals import SLOTS, laboratory, measured_too, proposed_requests, random_requests
from doe.trials.reduced.clean import draw_case
from doe.trials.reduced.families import with_constants
from doe.trials.reduced.laboratory import RANGES
from taichi_erosion.evidence.models import reduced
from taichi_erosion.evidence.models.reduced import DEFAULTS


@pytest.fixture(scope="module")
def case():
    return draw_case(5000, 1)


def test_conditions_that_were_held_are_stated_and_change_no_value(case):
    full = with_constants(case.problem)
    table = full.measurements
    assert set(table.conditions) | {"u_star"} == set(DEFAULTS)
    for name, column in case.problem.measurements.conditions.items():
        assert table.conditions[name] == pytest.approx(column)
    observable = next(iter(full.observables))
    before, after = (
        reduced.expected(observable, p.measurements.conditions, {}, {"gusts": 1.0})
        for p in (case.problem, full)
    )
    assert after == pytest.approx(before)


def test_random_requests_lie_within_the_ranges_and_fill_slots_that_are_left(case):
    problem = with_constants(case.problem)
    asked = random_requests(np.random.default_rng(1), problem)
    assert len(asked) == SLOTS
    for observable, setting in asked:
        assert observable in problem.observables
        assert set(setting) == set(laboratory(problem).ranges)
        assert all(RANGES[name][0] <= value <= RANGES[name][1] for name, value in setting.items())
    assert proposed_requests((), asked) == asked


def test_the_laboratory_measures_its_own_world_with_its_scatter(case):
    problem = with_constants(case.problem)
    asked = random_requests(np.random.default_rng(2), problem) * 40
    more = measured_too(np.random.default_rng(3), problem, case.truth, case.level, asked).measurements
    new = slice(problem.measurements.size, None)
    at = {name: column[new] for name, column in more.conditions.items()}
    assert more.size == problem.measurements.size + 3 * len(asked)
    names = np.array(more.observable[problem.measurements.size :])
    for observable in np.unique(names):
        own = names == observable
        here = {name: column[own] for name, column in at.items()}
        exact = reduced.expected(str(observable), here, case.truth.parameters, case.truth.effects)
        off = (more.value[new][own] - exact) / more.sd[new][own]
        assert np.std(off) == pytest.approx(case.truth.understated, rel=0.25)
