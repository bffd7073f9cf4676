"""Faces of cells along z."""

import numpy as np
import pytest

from taichi_erosion.core.air_setup import bed_faces, stretched_faces


def test_cells_of_a_bed_are_fine_in_it_and_widen_above():
    faces = bed_faces(0.0, 2e-3, 0.1, 1e-4, 1.2)
    width = np.diff(faces)
    assert (faces[0], faces[-1]) == (0.0, pytest.approx(0.1))
    assert width[:20] == pytest.approx(1e-4)
    assert np.all(width[21:] > width[20:-1])
    assert (width[1:] / width[:-1]).max() < 1.2 * (1.0 + 1e-9)


def test_stretched_cells_begin_with_the_finest_and_fill_the_box():
    width = np.diff(stretched_faces(1.0, 3.0, 20, 0.01))
    assert (width[0], width.sum()) == (pytest.approx(0.01), pytest.approx(2.0))
    assert width[1:] / width[:-1] == pytest.approx(width[1] / width[0])
