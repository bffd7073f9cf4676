"""The small worlds are played once for all tests of this folder."""

import pytest
from few_grains import Film, play_worlds


@pytest.fixture(scope="session")
def films() -> dict[str, Film]:
    return play_worlds()
