"""The cost that is told before the first run."""

import pytest

from taichi_erosion.campaign.request import START
from taichi_erosion.evidence.emulator.plan_cost import starts_s


@pytest.mark.parametrize(("groups", "workers", "starts"), [(0, 2, 0), (1, 2, 1), (10, 1, 10), (10, 4, 3)])
def test_every_group_of_runs_starts_an_ensemble_of_its_own(groups, workers, starts):
    assert starts_s(groups, workers) == starts * START
