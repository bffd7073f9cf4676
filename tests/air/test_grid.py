"""Ensembles of air on the device."""

import pytest
from flows import column

from taichi_erosion.air.grid import allocate_air
from taichi_erosion.core.air_setup import AirModel
from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.setup import Numerics


def test_an_ensemble_shares_its_cells_and_model(start_device):
    start_device(Numerics(threads=1))
    other = column(model=AirModel("none"))
    with pytest.raises(BadInput, match="share"):
        allocate_air([column(), other])
