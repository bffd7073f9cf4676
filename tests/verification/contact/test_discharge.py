"""The silos of V33 lie where Beverloo's law is stated for."""

import numpy as np
import pytest

from tests.verification.contact import discharge
from tests.verification.contact.bulk import DIAMETER
from tests.verification.contact.discharge import (
    GRAINS_PER_CUBE,
    HOLES,
    PLUG,
    SENSIBLE,
    SLOTS,
    TOLERANCE,
    Silos,
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


@BOTH
def test_several_fillings_tell_their_scatter_and_several_openings_the_law(silos: Silos):
    assert len(np.unique(silos.openings)) >= 4
    assert len(silos.openings) - len(np.unique(silos.openings)) >= 5
    assert SENSIBLE <= 0.5 * TOLERANCE


@BOTH
def test_a_silo_holds_its_grains_above_a_plug_that_fills_the_opening(silos: Silos):
    width, opening = silos.widths[0] * DIAMETER, silos.openings[0] * DIAMETER
    setup = silos.scene(int(silos.stock[0]), width, opening, 1)
    place = setup.grains.position
    assert len(place) == silos.stock[0]
    assert place[:, 2].min() > 0.5 * DIAMETER
    assert np.abs(place[:, 0]).max() < 0.5 * (width - DIAMETER)
    plug = [surface.name for surface in setup.surfaces].index(PLUG)
    numbers = setup.primitives.shape[setup.primitives.surface == plug]
    assert np.isclose(np.abs(numbers), 0.5 * opening).any()


def test_grains_scatter_about_their_diameter_and_do_not_meet():
    grains = discharge.filling(500, (0.02, 0.02), False, 1)
    assert grains.radius.mean() == pytest.approx(0.5 * DIAMETER, rel=0.01)
    assert np.ptp(grains.radius) == pytest.approx(DIAMETER * discharge.SPREAD, rel=0.02)
    apart = np.linalg.norm(grains.position[:, None] - grains.position, axis=2) + np.eye(500)
    assert (apart > grains.radius[:, None] + grains.radius).all()
