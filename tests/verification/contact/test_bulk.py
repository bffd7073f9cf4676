"""The silos of V33 lie where Beverloo's law is stated for."""

import numpy as np
import pytest

from taichi_erosion.verification.contact import bulk
from taichi_erosion.verification.contact.bulk import (
    DIAMETER,
    GRAINS_PER_CUBE,
    HOLES,
    PLUG,
    SLOTS,
    Silos,
    soft_touch,
)

PACKING = 0.6  # denser than grains with friction lie [1]
BOTH = pytest.mark.parametrize("silos", [HOLES, SLOTS], ids=lambda silos: silos.kind)


@BOTH
def test_silos_are_wide_and_high_enough_for_the_law(silos: Silos):
    assert silos.openings.min() >= 6.0
    assert np.all(silos.widths >= 2.5 * silos.openings)
    left = silos.stock - silos.until
    height = left * (np.pi / 6.0) / (PACKING * silos.sections)
    assert np.all(height > 1.19 * silos.widths)
    assert pytest.approx(PACKING, rel=0.01) == GRAINS_PER_CUBE * np.pi / 6.0
    assert np.all(SLOTS.widths >= SLOTS.openings + 30.0)


@BOTH
def test_a_silo_holds_its_grains_above_a_plug_that_fills_the_opening(silos: Silos):
    touch = soft_touch(0.5, 0.05)
    width, opening = silos.widths[0] * DIAMETER, silos.openings[0] * DIAMETER
    setup = silos.scene(touch, int(silos.stock[0]), width, opening, 1)
    place = setup.grains.position
    assert len(place) == silos.stock[0]
    assert place[:, 2].min() > 0.5 * DIAMETER
    assert np.abs(place[:, 0]).max() < 0.5 * (width - DIAMETER)
    plug = [surface.name for surface in setup.surfaces].index(PLUG)
    numbers = setup.primitives.shape[setup.primitives.surface == plug]
    assert np.isclose(np.abs(numbers), 0.5 * opening).any()


def test_the_flow_is_read_between_two_numbers_of_grains():
    time = np.linspace(0.0, 1.0, 101)
    passed = np.where(time < 0.2, 500.0 * time, 100.0 + 1000.0 * (time - 0.2))
    assert bulk.steady_slope(time, passed, 110.0, 800.0) == pytest.approx(1000.0)
