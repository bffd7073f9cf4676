"""Where the wind begins over spheres: the resolved flow and the column, on cases whose answer is known."""

import numpy as np
import pytest

from doe.bed_wind import stokes
from doe.bed_wind.column import (
    LAYERS,
    Blow,
    Layer,
    cells_over,
    drags_of,
    faces_over,
    volume_shares,
    wind_over,
    zero_depth,
)

CREEPING = 3e-4  # m2 s-1


def test_shear_over_a_plane_without_spheres_begins_at_the_plane(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(stokes, "solid_nodes", lambda *_: np.zeros((1, 1, 8), dtype=bool))
    # one diameter lower than the tops of spheres would lie
    assert stokes.zero_depth("quadratic", 4) == pytest.approx(1.0, abs=1e-3)


def test_resolved_shear_begins_a_little_below_the_tops_of_spheres():
    # 0.09 with 8 and 0.10 with 12 cells on a diameter
    assert 0.05 < stokes.zero_depth("quadratic", 6) < 0.13


@pytest.mark.parametrize("name", LAYERS)
def test_the_column_holds_the_whole_volume_of_its_spheres(name: str):
    assert volume_shares(LAYERS[name], faces_over(1.0)).sum(axis=1) == pytest.approx(1.0)


def test_the_column_carries_the_stress_of_the_lid_in_laminar_air():
    heights, speed = wind_over(LAYERS["quadratic"], Blow(0.3, 2.5e-4, "two_limits", False, CREEPING))
    above = heights > 2.0
    shear = np.diff(speed[above]) / np.diff(heights[above]) / 2.5e-4
    assert shear == pytest.approx(0.3**2 / CREEPING, rel=1e-4)


@pytest.mark.parametrize("name", LAYERS)
def test_the_drag_of_neighbours_raises_the_zero_towards_that_of_resolved_flow(name: str):
    depth = {
        law: zero_depth(LAYERS[name], Blow(0.3, 2.5e-4, law, False, CREEPING))
        for law in ("two_limits", "two_limits_hindered")
    }
    resolved = {"quadratic": 0.097, "triangular": 0.083}[name]
    assert resolved < depth["two_limits_hindered"] < resolved + 0.1
    assert depth["two_limits"] > resolved + 0.4


def test_spheres_of_two_sizes_hold_their_volume_and_carry_the_stress_of_the_lid():
    mixed = (Layer(0.5, 0.5), Layer(0.3, 0.8, 0.6))
    faces, _, void = cells_over(mixed)
    volume = np.pi / 6.0 * (0.5 + 0.8 * 0.6**3)
    assert ((1.0 - void) * np.diff(faces)).sum() == pytest.approx(volume)
    drags = drags_of(mixed, Blow(0.3, 2.5e-4, "two_limits_hindered"))
    # but for what the plane below takes
    assert 0.95 < 0.5 * drags[0] + 0.8 * drags[1] < 1.0
    assert drags[0] > drags[1]
