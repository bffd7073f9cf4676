"""The bead on a regular layer: its geometry, and what the table of results claims."""

import csv

import numpy as np
import pytest

from doe.single_bead.run import LEVERS, RESULTS, places


@pytest.mark.parametrize(("arrangement", "neighbours"), [("triangular", 3), ("quadratic", 4)])
def test_the_bead_touches_its_pocket_and_leaves_over_the_line_through_two_contacts(arrangement, neighbours):
    points, _ = places(arrangement, 8)
    bead, layer = np.array(points[0]), np.array(points[1:])
    apart = np.linalg.norm(layer - bead, axis=1)
    touching = layer[np.isclose(apart, 1.0)]
    assert len(touching) == neighbours
    assert apart.min() == pytest.approx(1.0)
    downwind = touching[touching[:, 0] > bead[0]]
    assert len(downwind) == 2
    contacts = 0.5 * (downwind + bead)
    x, z = contacts[0, 0] - bead[0], bead[2] - contacts[0, 2]
    assert (x, z) == pytest.approx(LEVERS[arrangement])
    assert contacts[1, [0, 2]] == pytest.approx(contacts[0, [0, 2]])


@pytest.mark.parametrize("arrangement", LEVERS)
def test_the_layer_closes_over_the_ends_of_its_patch(arrangement):
    points, length = places(arrangement, 8)
    layer = np.array(points[1:])
    offset = layer[:, None] - layer[None]
    offset[..., 0] -= length * np.round(offset[..., 0] / length)
    offset[..., 1] -= 8.0 * np.round(offset[..., 1] / 8.0)
    apart = np.linalg.norm(offset, axis=2) + 9.0 * np.eye(len(layer))
    assert apart.min() == pytest.approx(1.0)
    assert set(np.isclose(apart, 1.0).sum(axis=1)) == {6 if arrangement == "triangular" else 4}


def test_simulated_beads_leave_where_moments_balance():
    with RESULTS.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 16
    for row in rows:
        # the closed form takes the shear over a diameter: its torque, a third of all, is known to a tenth
        tolerance = 0.06 if "rotational_drag" in row["effects"] else 0.01
        assert float(row["balance"]) == pytest.approx(1.0, abs=tolerance), row
