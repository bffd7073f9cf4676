"""Forces of resolved flow on single spheres, and their exposure, on cases whose answer is known."""

from math import acos, pi, sqrt

import numpy as np
import pytest

from doe.bed_wind.exposure import (
    SIDE,
    Spheres,
    exposures,
    load_table,
    mean_forces,
    read_spheres,
    resolved_forces,
    upper_spheres,
)
from doe.bed_wind.run import PAGE


def spheres(*places: tuple[float, float, float], side: float = 6.0) -> Spheres:
    return Spheres(np.array(places), side, 2.0)


def test_a_closed_layer_carries_the_stress_of_the_lid_and_a_sparse_one_leaves_some_to_the_plane():
    closed, lid = resolved_forces(spheres((0.5, 0.5, 0.5), side=1.0), 6)
    assert closed[0] / lid == pytest.approx(1.0, abs=1e-3)
    sparse, lid = resolved_forces(spheres((1.0, 1.0, 0.5), side=2.0), 6)
    assert 0.8 < sparse[0] / lid < 0.98


def test_equal_spheres_carry_equal_shares():
    force, lid = resolved_forces(
        spheres((0.5, 0.5, 0.5), (0.5, 1.5, 0.5), (1.5, 0.5, 0.5), (1.5, 1.5, 0.5), side=2.0), 6
    )
    assert force / lid == pytest.approx(0.25, abs=1e-3)


def test_the_drag_of_the_mean_wind_is_the_stress_of_the_lid():
    bed = spheres((0.5, 0.5, 0.5), side=1.0)
    assert mean_forces(bed, "two_limits_hindered").sum() == pytest.approx(1.0, rel=1e-3)


@pytest.mark.parametrize("across", [0.0, 0.5, 1.0])
def test_a_sphere_hides_the_overlap_of_two_circles_of_the_one_behind_it(across: float):
    pair = spheres((1.0, 1.0, 1.0), (2.0, 1.0 + across, 1.0))
    # two circles of radius 1/2 whose middles are `across` apart
    overlap = 2.0 / pi * (acos(across) - across * sqrt(1.0 - across**2))
    assert exposures(pair, 3.0, 1.0) == pytest.approx([1.0, 1.0 - overlap], abs=0.02)
    assert exposures(pair, 3.0, -1.0) == pytest.approx([1.0 - overlap, 1.0], abs=0.02)


def test_a_sphere_is_hidden_across_the_period_and_not_from_afar():
    assert exposures(spheres((0.3, 1.0, 1.0), (5.8, 1.0, 1.0)), 3.0, 1.0) == pytest.approx([0.0, 1.0])
    assert exposures(spheres((1.0, 1.0, 1.0), (3.1, 1.0, 1.0)), 2.0, 1.0) == pytest.approx([1.0, 1.0])


def test_the_forces_of_the_table_add_up_to_that_of_the_lid_and_stand_on_the_page():
    spheres = read_spheres()
    for name in ("resolved", "two_limits", "two_limits_hindered"):
        for seed in upper_spheres(spheres):
            forces = [getattr(one, name) for one in spheres if one.seed == seed]
            assert sum(forces) == pytest.approx(SIDE**2, rel=1e-3)
    assert load_table(upper_spheres(spheres)) in PAGE.read_text(encoding="utf-8")
