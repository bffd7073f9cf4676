"""Resume after a kill or an interruption: the document is that of a run that nobody disturbed."""

import json
import signal
import time
from hashlib import sha256
from pathlib import Path
from typing import Any

import pytest
from small_scene import PATIENCE, start, write_scene

from taichi_erosion.core.device import stop_device
from taichi_erosion.core.errors import BadInput
from taichi_erosion.recording.checkpoint import load_checkpoint
from taichi_erosion.recording.readback import read_grains
from taichi_erosion.run import RunOptions, run_scene
from taichi_erosion.run import scene_run as scene_run_module
from taichi_erosion.run.ensemble_loop import EnsembleRun

OF_THIS_CALL = ("scene", "wall_s", "recording", "film", "silhouettes", "numerics")  # not of the physics


def fingerprint(document: dict[str, Any]) -> str:
    """Digest of all that a run's document says of its physics."""
    said = {name: entry for name, entry in document.items() if name not in OF_THIS_CALL}
    return sha256(json.dumps(said, sort_keys=True, default=str).encode()).hexdigest()


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    return tmp_path_factory.mktemp("faults")


@pytest.fixture(scope="module")
def scene(folder) -> Path:
    """Two replicas, seeds 3 and 4."""
    return write_scene(folder)


@pytest.fixture(scope="module")
def whole(scene) -> dict[str, Any]:
    """The document of a run that nobody disturbed, on one thread."""
    document = run_scene(scene, RunOptions(threads=1, no_record=True))
    stop_device()
    return document


@pytest.fixture(scope="module")
def killed(scene, folder) -> Path:
    """Checkpoint of a run on two threads that was killed as soon as there was one."""
    kept = folder / "killed.npz"
    words = ("--checkpoint", str(kept), "--every", "0.02", "--record", str(folder / "killed.rrd"))
    run = start(scene, "--threads", "2", *words)
    end = time.monotonic() + PATIENCE
    while not kept.exists():
        assert run.poll() is None, run.communicate()
        assert time.monotonic() < end, "no checkpoint came"
        time.sleep(0.002)
    run.send_signal(signal.SIGKILL)
    run.communicate()
    return kept


def test_a_killed_run_leaves_a_recording_that_can_be_read(killed, folder):
    assert not (folder / "killed.rrd").exists()
    assert not (folder / "killed.json").exists()
    read_grains(folder / "killed.rrd.part")


def test_one_thread_goes_on_where_two_were_killed_and_ends_with_the_same_document(whole, killed, scene):
    checks = load_checkpoint(killed)[1]["checks"]
    assert 0 < checks < 120  # the run has 120 of them
    resumed = run_scene(scene, RunOptions(threads=1, no_record=True, resume=killed))
    stop_device()
    assert fingerprint(resumed) == fingerprint(whole)


def test_a_seed_alone_on_two_threads_ends_as_in_the_ensemble(whole, scene):
    alone = run_scene(scene, RunOptions(threads=2, no_record=True, seed=4, replicas=1))
    stop_device()
    assert alone["replicas"] == whole["replicas"][1:]


def test_another_seed_gives_another_document(whole):
    first, second = (replica["measures"] for replica in whole["replicas"])
    assert first != second


CUT = 0.08  # s, within the second stage: measures of the first are known by then


def stop_at(time: float) -> Any:
    """Stand-in for Ctrl-C: a callback that interrupts the run at its first check from a time on."""
    run_ensemble = scene_run_module.run_ensemble

    def cut_short(ensemble: EnsembleRun, callbacks: list[Any]) -> None:
        def interrupt(now: EnsembleRun) -> None:
            if now.time >= time:
                raise KeyboardInterrupt

        run_ensemble(ensemble, [*callbacks, interrupt])

    return cut_short


@pytest.fixture(scope="module")
def resumed(folder) -> dict[str, Any]:
    """The document of the same run, interrupted in its second stage and taken up again."""
    scene, kept = write_scene(folder), folder / "cut.checkpoint.npz"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(scene_run_module, "run_ensemble", stop_at(CUT))
        with pytest.raises(KeyboardInterrupt, match=r"cut\.checkpoint\.npz"):
            run_scene(scene, RunOptions(threads=1, record=folder / "cut.rrd"))
    assert load_checkpoint(kept)[1]["checks"] == pytest.approx(CUT / 1e-3)
    document = run_scene(scene, RunOptions(threads=1, record=folder / "resumed.rrd", resume=kept))
    stop_device()
    return document


def test_a_resumed_run_ends_with_the_same_measures_bit_for_bit(whole, resumed):
    assert resumed["replicas"] == whole["replicas"]
    assert resumed["measures"] == whole["measures"]
    assert resumed["grain_steps"] == whole["grain_steps"]


def test_a_checkpoint_of_other_seeds_is_refused(resumed, folder):
    kept = folder / "cut.checkpoint.npz"
    with pytest.raises(BadInput, match=r"cut\.checkpoint\.npz"):
        run_scene(write_scene(folder), RunOptions(threads=1, seed=8, no_record=True, resume=kept))
