"""Timed cases: beds, funnels and the scenes of `scenes/`, and every byte counted."""

from pathlib import Path
from typing import Any

import pytest
from grain_worlds import heap

from benchmarks import grain_cases
from benchmarks.grain_cases import FUNNELS, QUICK_ENSEMBLE, device_bytes, device_grain_cases
from benchmarks.roofline import step_bytes
from benchmarks.wind_cases import SCENES, STEP_FRACTION, WINDS, threshold_scene
from taichi_erosion.core.setup import Laws, Numerics
from taichi_erosion.core.ti import ti
from taichi_erosion.core.transfer import device_record, upload, write_field
from taichi_erosion.scene import load_scene
from taichi_erosion.scene.load import INSTALLED
from taichi_erosion.simulation import assemble


@device_record
class Inner:
    exact: Any


@device_record
class Outer:
    count: int
    numbers: Any
    inner: Inner


def test_memory_counts_fields_of_records_within_records(start_device):
    start_device(Numerics("cpu", 1))
    outer = Outer(7, ti.Vector.field(3, ti.f32, shape=10), Inner(ti.field(ti.f64, shape=(2, 5))))
    assert device_bytes(outer) == 10 * 3 * 4 + 2 * 5 * 8


def test_quick_cases_of_a_device_are_a_bed_a_funnel_and_an_ensemble_that_start_on_the_cpu(monkeypatch):
    begun: list[list[int]] = []

    def note(_: float, setups: Any) -> None:
        begun.append([len(setup.grains.radius) for setup in setups()])

    monkeypatch.setattr(grain_cases, "after_on_cpu", note)
    cases = device_grain_cases("cuda", "quick")
    bed, funnel, ensemble = begun
    assert [case.name for case in cases] == ["settled bed", "funnel", "ensemble of beds"]
    assert funnel[0] == pytest.approx(FUNNELS[0], rel=0.2)  # whole layers of a cone: the widest holds a fifth
    assert ensemble == QUICK_ENSEMBLE * bed
    usual = device_grain_cases("cuda", "usual")
    assert all(quick.steps < case.steps for quick, case in zip(cases, usual, strict=True))


GRAINS, ENTRIES, CONTACTS = 20, 70, 40
# numbers of 4 bytes. Of a grain: 10 for the pairs; 9 moved twice, 3 constants, 6 sums twice; bounds for pairs
# and motion, and how long its reverse list is. Of an entry: owner, neighbour, label, separation; if it acts;
# its place in a reverse list; force twice, torque, back. Of a contact: 3 constants, two displacements twice,
# three vectors.
GRAIN, ENTRY, CONTACT = 10 + 2 * 9 + 3 + 2 * 6 + 5, 6 + 1 + 1 + 12, 3 + 2 * 6 + 9


@pytest.mark.usefixtures("start_device")  # which stops what a test has started
def test_every_number_counts_once_for_every_stage_that_reads_or_writes_it():
    sim = assemble([heap(GRAINS, 1)] * 2, Laws(), Numerics("cpu", 1, "f32", "grains"))
    write_field(sim.buffers.partners, 0)
    upload([(sim.buffers.partners, [ENTRIES])])
    found = step_bytes(sim, CONTACTS)
    assert found == pytest.approx(4 * (2 * GRAINS * GRAIN + ENTRIES * ENTRY + CONTACTS * CONTACT), rel=1e-12)


def test_scenes_under_wind_are_those_of_the_source_tree_but_for_what_the_timing_changes():
    root = Path(__file__).parents[2]
    assert SCENES == root / "scenes"
    assert INSTALLED == root / "taichi_erosion" / "scene" / "shipped"  # as in pyproject.toml
    timed, scene = threshold_scene(), load_scene(SCENES / "wind_threshold.toml")
    kept = ("grains", "materials", "laws", "contact", "geometry", "wind", "fill", "threshold", "stages")
    assert [name for name in kept if getattr(timed, name) != getattr(scene, name)] == []
    assert (timed.effects, timed.run.time_step_fraction) == ({}, STEP_FRACTION)
    stages = load_scene(SCENES / "saltation.toml").stages
    assert [stages[1].friction_velocity, stages[2].friction_velocity] == [wind for wind, _ in WINDS]
