"""The small worlds are run once for all tests of this folder."""

import pytest
from few_grains import WorldRecord, run_worlds


@pytest.fixture(scope="session")
def records() -> dict[str, WorldRecord]:
    return run_worlds()
