"""Scenes of a campaign go as one ensemble through the real simulator and come out as if each were alone."""

import pytest
from execution.small_scene import TAPPED, WET, write_scene
from recorded_heaps import read_properties
from stand_in import opened

from taichi_erosion.campaign.execute import run_requests
from taichi_erosion.campaign.request import request_of_file
from taichi_erosion.campaign.study_file import WorkersEntry
from taichi_erosion.core.errors import BadInput
from taichi_erosion.execution import RunOptions, run_scene, scene_run
from taichi_erosion.scene.load import SCENES

pytestmark = pytest.mark.usefixtures("start_device")  # which stops what a test has started
ROUGH = "contact.soil-soil.friction_sliding=0.9"
STIFF = "materials.soil.shear_modulus=2e6"  # Pa: another time step beside the others
BY_GRAIN, AUTO = WorkersEntry(decomposition="grains"), WorkersEntry(arch="auto")
HASTY = ("run.time_step=5e-3", "run.force_time_step=true")  # s, thirty Rayleigh times: a guard will stop it
GRID = SCENES.parent / "doe" / "wind" / "gusty_patch.toml"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("scenes")


@pytest.fixture(scope="module")
def results(folder):
    scene = write_scene(folder)
    doe = {"doe": {"friction_sliding": 0.9}}
    requests = [
        request_of_file(scene, (), 3),
        request_of_file(scene, (ROUGH, *WET, *TAPPED), 4, record=folder / "rough.rrd", properties=doe),
        request_of_file(scene, (STIFF,), 3),
        request_of_file(scene, HASTY, 3),
    ]
    with opened(folder / "campaign") as store:
        return run_requests(requests, store, workers=1)


@pytest.mark.parametrize(("place", "orders", "seed"), [(0, (), 3), (1, (ROUGH, *WET, *TAPPED), 4)])
def test_a_scene_gives_the_same_bits_beside_others_as_alone(results, folder, place, orders, seed):
    options = RunOptions(overrides=orders, seed=seed, replicas=1, threads=1, no_record=True)
    single = run_scene(write_scene(folder), options)
    assert results[place].record["measures"] == single["replicas"][0]["measures"]
    assert results[place].record["hash"] == single["hash"]
    assert [result.failure for result in results[:3]] == [None] * 3
    assert len({result.value("pile_height") for result in results[:3]}) == 3


def test_a_stopped_run_is_kept_with_its_reason_and_a_recording_holds_factors_and_results(results, folder):
    assert "likely cause" in results[3].failure
    assert results[3].record["stopped"] is not None
    properties = read_properties(folder / "rough.rrd")
    assert properties["doe"] == {"friction_sliding": pytest.approx(0.9)}
    assert properties["result"]["pile_height"] == pytest.approx(results[1].value("pile_height"))
    assert properties["scene"]["seed"] == 4


def test_the_key_follows_scene_seed_and_what_moves_bits_and_nothing_else(folder):
    scene = write_scene(folder)
    usual = request_of_file(scene, (), 3)
    assert request_of_file(scene, ('scene.title="other"',), 3, record=folder / "x.rrd").key == usual.key
    assert request_of_file(scene, (), 4).key != usual.key
    assert request_of_file(scene, (ROUGH,), 3).key != usual.key
    devices = [BY_GRAIN, WorkersEntry(arch="cuda"), WorkersEntry(arch="cuda", decomposition="partitions")]
    asked = [request_of_file(scene, (), 3, device=device) for device in devices]
    assert len({usual.key, *(request.key for request in asked)}) == 4
    assert len({usual.group, *(request.group for request in asked)}) == 4
    assert request_of_file(scene, (), 3, device=WorkersEntry(decomposition="partitions")).key == usual.key
    # no graphics processor here, and too few grains for one
    assert request_of_file(scene, (), 3, device=AUTO).key == usual.key


def test_what_the_device_cannot_run_is_refused_or_left_to_the_cpu(folder, monkeypatch):
    with pytest.raises(BadInput, match="no grids of air"):
        request_of_file(GRID, (), 3, device=BY_GRAIN)
    monkeypatch.setattr(scene_run, "has_cuda", lambda: True)
    monkeypatch.setattr(scene_run, "CROSSOVER", 1)
    on_grid, usual = (request_of_file(path, (), 3, device=AUTO) for path in (GRID, write_scene(folder)))
    assert (on_grid.arch, usual.arch) == ("cpu", "cuda")
    assert on_grid.key == request_of_file(GRID, (), 3).key


def test_the_work_of_a_run_counts_the_spheres_and_steps_that_its_effects_make():
    scene = SCENES / "column_collapse.toml"
    plain, long, spread = (
        request_of_file(scene, words, 1).work
        for words in ((), ("effects.grain_shape.strength=1.0",), ("effects.size_distribution.strength=1.0",))
    )
    assert long / plain == pytest.approx(2.0 * (1.0 + 1.5 * 0.3 - 0.5 * 0.3**3) ** (1.0 / 3.0), rel=1e-4)
    assert spread / plain > 2.0
