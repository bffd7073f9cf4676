"""Least bytes of a step, counted a second time by hand."""

import pytest
from grain_worlds import heap

from benchmarks.roofline import step_bytes
from taichi_erosion.core.device import stop_device
from taichi_erosion.core.setup import Laws, Numerics
from taichi_erosion.core.transfer import write
from taichi_erosion.simulation import assemble

GRAINS, ENTRIES, CONTACTS = 20, 70, 40
# numbers of 4 bytes. Of a grain: 10 for pairs; force and torque four times; 9 that move twice, 3 constants; 4
# bounds. Of an entry: owner, neighbour, label, separation; level twice; its place in a reverse list. Of a
# contact: 3 constants, two displacements twice, three vectors twice.
GRAIN, ENTRY, CONTACT = 10 + 4 * 6 + 2 * 9 + 3 + 4, 6 + 2 + 1, 3 + 2 * 6 + 2 * 9


def test_every_number_counts_once_for_every_stage_that_reads_or_writes_it():
    sim = assemble([heap(GRAINS, 1)] * 2, Laws(), Numerics("cpu", 1, "f32", "grains"))
    write(sim.buffers.listed, ENTRIES // 2)
    found = step_bytes(sim, CONTACTS)
    stop_device()
    assert found == pytest.approx(4 * (2 * GRAINS * GRAIN + ENTRIES * ENTRY + CONTACTS * CONTACT), rel=1e-12)
