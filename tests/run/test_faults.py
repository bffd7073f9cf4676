"""Runs that are struck down: by a kill, a signal, a disk, a home that cannot be written."""

import json
import os
import random
import signal
import subprocess
import sys
import time
from hashlib import sha256
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from small_scene import write_scene

from taichi_erosion.cli.main import ExitCode, main
from taichi_erosion.core.device import stop_device
from taichi_erosion.core.errors import BadInput
from taichi_erosion.recording.checkpoint import load_checkpoint
from taichi_erosion.recording.readback import read_grains
from taichi_erosion.run import RunOptions, recorder, run_scene
from taichi_erosion.run.scene_run import deferred

PATIENCE = 600.0  # s; the cores may be busy
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


def start(scene: Path, *words: str) -> subprocess.Popen[str]:
    """A run in a process of its own."""
    program = [sys.executable, "-m", "taichi_erosion", "run", str(scene), *words]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    return subprocess.Popen(
        program, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=scene.parent
    )


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


STARTS = """
from taichi_erosion.core.device import start_device
from taichi_erosion.core.setup import Numerics
from taichi_erosion.core.ti import ti

start_device(Numerics(threads=1))
total = ti.field(float, shape=())
total[None] = 3.0
print(total[None])
"""


@pytest.mark.parametrize("lost", ["no home", "home is a file", "cache is a file"])
def test_without_a_place_for_its_cache_the_device_starts_and_the_program_ends_well(tmp_path, lost):
    (tmp_path / "file").touch()
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    environment.pop("XDG_CACHE_HOME", None)
    if lost == "no home":
        environment.pop("HOME", None)
    elif lost == "home is a file":
        environment["HOME"] = str(tmp_path / "file")
    else:
        environment["XDG_CACHE_HOME"] = str(tmp_path / "file")
    ended = subprocess.run(
        [sys.executable, "-c", STARTS], env=environment, capture_output=True, text=True, check=False
    )
    assert (ended.returncode, ended.stdout) == (0, "3.0\n"), ended.stderr


def test_an_output_folder_that_cannot_be_written_is_told_before_the_device_starts(
    scene, unwritable, capsys, monkeypatch
):
    monkeypatch.setattr("taichi_erosion.run.scene_run.assemble", lambda *_: pytest.fail("too late"))
    for option in ("--record", "--checkpoint"):
        record = ["--no-record"] if option == "--checkpoint" else []
        assert main(["run", str(scene), option, str(unwritable / "few"), *record]) == ExitCode.BAD_INPUT
        said = capsys.readouterr().err
        assert "few: cannot be written (" in said
        assert said.count("\n") == 1


def stage_play() -> Any:
    return SimpleNamespace(time=0.5, actors=[SimpleNamespace(warnings=[])])


def test_a_checkpoint_that_cannot_be_written_is_told_once_and_the_run_goes_on():
    def refuse(_: Any) -> None:
        raise BadInput("run.npz: the checkpoint cannot be written (No space left on device)")

    play = stage_play()
    for _ in range(2):
        recorder.save_when_due(SimpleNamespace(watch=refuse), play)  # type: ignore[arg-type]
    assert play.actors[0].warnings == ["run.npz: the checkpoint cannot be written (No space left on device)"]


def test_a_disk_that_fills_up_ends_the_recording_whole_and_not_the_run(monkeypatch, tmp_path):
    closed = []
    monkeypatch.setattr(recorder, "is_short_of_room", lambda _: True)
    monkeypatch.setattr(recorder.stream, "log_text", lambda *_: None)
    monkeypatch.setattr(recorder.stream, "close", closed.append)
    monkeypatch.setattr(recorder, "watch_replica", lambda *_: pytest.fail("still recording"))
    recording = SimpleNamespace(path=tmp_path / "few.rrd")
    camera, play = SimpleNamespace(replica=0, interval=0.01, recording=recording), stage_play()
    for _ in range(2):
        recorder.watch_while_there_is_room(camera, play)  # type: ignore[arg-type]
    assert closed == [recording]
    assert play.actors[0].warnings == ["the disk is nearly full: the recording ends at 0.5 s"]


def test_files_that_cannot_be_finished_cost_no_result(monkeypatch):
    def refuse(*_: Any) -> Any:
        raise BadInput("few.gif: cannot be written (No space left on device)")

    monkeypatch.setattr(recorder, "finish", refuse)
    record = {"measures": {"height": 1.0}, "warnings": ["flank not straight"]}
    assert recorder.finish_or_warn(None, None, record, {}) == {}  # type: ignore[arg-type]
    assert record["measures"] == {"height": 1.0}
    assert record["warnings"][0] == "few.gif: cannot be written (No space left on device)"


@pytest.mark.parametrize(
    ("number", "end"),
    [(signal.SIGINT, KeyboardInterrupt), (signal.SIGTERM, SystemExit), (signal.SIGHUP, SystemExit)],
)
def test_a_signal_is_heard_at_the_next_check(number, end):
    before = signal.signal(number, signal.SIG_DFL)  # the tests themselves may have been started to ignore it
    try:
        with deferred() as interruption:
            os.kill(os.getpid(), number)
            done = True  # it has not struck in the middle of something
            with pytest.raises(end):
                interruption.obey()
        assert done
    finally:
        signal.signal(number, before)


def test_a_signal_that_was_to_be_ignored_stays_ignored():
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with deferred() as interruption:
            os.kill(os.getpid(), signal.SIGHUP)
            interruption.obey()
        assert signal.getsignal(signal.SIGHUP) == signal.SIG_IGN
    finally:
        signal.signal(signal.SIGHUP, before)


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_in_any_phase_leaves_whole_files_and_no_traceback(scene, folder, number):
    chance = random.Random(int(number))
    began = time.monotonic()
    start(scene, "--record", str(folder / "undisturbed.rrd")).communicate()
    lasts = time.monotonic() - began
    for place in range(6):
        record = folder / f"{number.name}-{place}.rrd"
        run = start(scene, "--record", str(record))
        time.sleep((place + chance.random()) / 6.0 * lasts)
        run.send_signal(number)
        _, said = run.communicate(timeout=PATIENCE)
        assert run.returncode in (0, 128 + number, -number)
        assert "unexpected" not in said
        for left in (record, record.with_name(record.name + ".part")):
            if left.exists() and left.stat().st_size > 0:
                read_grains(left)
        if record.with_suffix(".json").exists():
            json.loads(record.with_suffix(".json").read_text(encoding="utf-8"))
