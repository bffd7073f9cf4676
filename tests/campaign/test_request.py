"""Scenes of a campaign go as one ensemble through the real simulator and come out as if each were alone."""

from typing import Any, cast

import pytest
from recorded_heaps import read_properties
from run.small_scene import write_scene

from taichi_erosion.campaign.execute import Campaign, WorkDone, execute, report_progress
from taichi_erosion.campaign.ledger import close_ledger, open_ledger
from taichi_erosion.campaign.request import scene_request
from taichi_erosion.campaign.study_file import WorkersEntry
from taichi_erosion.core.device import stop_device
from taichi_erosion.core.errors import BadInput
from taichi_erosion.run import RunOptions, run_scene, scene_run
from taichi_erosion.scene.shipped import SCENES

ROUGH = "contact.soil-soil.friction_sliding=0.9"
STIFF = "materials.soil.shear_modulus=2e6"  # Pa: another time step beside the others
BY_GRAIN, AUTO = WorkersEntry(decomposition="grains"), WorkersEntry(arch="auto")
HASTY = ("run.time_step=5e-3", "run.force_time_step=true")  # s, thirty Rayleigh times: a guard will stop it


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("scenes")


@pytest.fixture(scope="module")
def results(folder):
    scene = write_scene(folder)
    doe = {"doe": {"friction_sliding": 0.9}}
    requests = [
        scene_request(scene, (), 3),
        scene_request(scene, (ROUGH,), 4, record=folder / "rough.rrd", properties=doe),
        scene_request(scene, (STIFF,), 3),
        scene_request(scene, HASTY, 3),
    ]
    store = open_ledger(folder / "campaign")
    found = execute(requests, store, workers=1)
    close_ledger(store)
    return found


def alone(folder, order, seed):
    options = RunOptions(overrides=order, seed=seed, replicas=1, threads=1, no_record=True)
    document = run_scene(write_scene(folder), options)
    stop_device()
    return document


def test_a_scene_gives_the_same_bits_in_a_campaign_as_alone(results, folder):
    single = alone(folder, (ROUGH,), 4)
    assert results[1].record["measures"] == single["replicas"][0]["measures"]
    assert results[1].record["hash"] == single["hash"]
    assert [result.failure for result in results[:3]] == [None] * 3
    heights = [result.value("pile_height") for result in results[:3]]
    assert len(set(heights)) == 3


def test_a_run_that_a_guard_stops_is_kept_with_its_reason_and_stops_no_other(results):
    assert "likely cause" in results[3].failure
    assert results[3].record["stopped"] is not None


def test_factors_and_results_are_properties_of_the_recording(results, folder):
    properties = read_properties(folder / "rough.rrd")
    assert properties["doe"] == {"friction_sliding": pytest.approx(0.9)}
    assert properties["result"]["pile_height"] == pytest.approx(results[1].value("pile_height"))
    assert properties["scene"]["seed"] == 4


def test_the_key_follows_scene_and_seed_and_nothing_else(folder):
    scene = write_scene(folder)
    key = scene_request(scene, (), 3).key
    assert scene_request(scene, ('scene.title="other"',), 3, record=folder / "x.rrd").key == key
    assert scene_request(scene, (), 4).key != key
    assert scene_request(scene, (ROUGH,), 3).key != key


def test_runs_whose_bits_differ_by_the_way_they_are_made_have_keys_of_their_own(folder):
    scene = write_scene(folder)
    usual = scene_request(scene, (), 3)
    devices = [BY_GRAIN, *(WorkersEntry(arch=arch) for arch in ("vulkan", "cuda"))]
    devices.append(WorkersEntry(arch="cuda", decomposition="partitions"))
    asked = [scene_request(scene, (), 3, device=device) for device in devices]
    assert len({usual.key, *(request.key for request in asked)}) == 5
    assert len({usual.group, *(request.group for request in asked)}) == 5
    assert scene_request(scene, (), 3, device=WorkersEntry(decomposition="partitions")).key == usual.key
    # no graphics processor here, and too few grains for one
    assert scene_request(scene, (), 3, device=AUTO).key == usual.key


@pytest.mark.slow
def test_one_thread_per_grain_makes_the_runs_of_a_campaign_too(results, folder):
    store = open_ledger(folder / "by grain")
    (by_grain,) = execute([scene_request(write_scene(folder), (), 3, device=BY_GRAIN)], store, workers=1)
    close_ledger(store)
    usual = results[0]
    assert by_grain.failure is None
    # single precision, the same grains, forces summed in another order: heaps of a few grains stay alike
    assert by_grain.value("column_height") == pytest.approx(usual.value("column_height"), rel=0.02)
    assert by_grain.key != usual.key


GRID = SCENES.parent / "doe" / "wind" / "gusty_patch.toml"


def test_what_one_thread_per_grain_cannot_run_is_refused_before_the_campaign():
    with pytest.raises(BadInput, match="no grids of air"):
        scene_request(GRID, (), 3, device=BY_GRAIN)


def test_auto_leaves_a_scene_that_the_device_cannot_run_to_the_cpu_and_says_why(folder, monkeypatch):
    monkeypatch.setattr(scene_run, "has_cuda", lambda: True)
    monkeypatch.setattr(scene_run, "CROSSOVER", 1)
    on_grid, usual = (scene_request(path, (), 3, device=AUTO) for path in (GRID, write_scene(folder)))
    assert (on_grid.arch, usual.arch, usual.note) == ("cpu", "cuda", "")
    assert on_grid.note.startswith("--arch auto: on the CPU, since one thread per grain has no grids of air")
    assert on_grid.key == scene_request(GRID, (), 3).key
    told, unused = list[str](), cast(Any, None)
    both = {request.key: request for request in (on_grid, usual)}
    ledger = open_ledger(folder / "told")
    left = Campaign(both, ledger, unused, lambda _, line: told.append(line), WorkDone(both, 1.0))
    report_progress(left, [on_grid.key, usual.key])
    report_progress(left, [usual.key])
    close_ledger(ledger)
    assert told == [f"0 of 2 runs; {on_grid.note}", "1 of 2 runs"]
