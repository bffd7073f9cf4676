"""A scene from file to document, recording and pictures; stopped by a check or a signal."""

import json
import os
import random
import signal
import time
from contextlib import nullcontext

import numpy as np
import pytest
from small_scene import PATIENCE, start, write_scene

from taichi_erosion.cli.main import ExitCode, main
from taichi_erosion.execution import RunOptions, run_scene, scene_run
from taichi_erosion.execution.checks import library_of, read_scene
from taichi_erosion.execution.scene_run import assemble_run, defer_signals
from taichi_erosion.recording.readback import read_grains
from taichi_erosion.scene.load import SCENES

pytestmark = pytest.mark.usefixtures("start_device")  # which stops what a test has started
DURATION = 0.12  # s, of both stages
COLOURS = 3  # channels of a film
ABSURD_STEP = {"time_step": 5e-3, "force_time_step": True}  # s, thirty Rayleigh times


def test_a_run_leaves_document_recording_and_film(whole, folder):
    import imageio.v3 as imageio

    assert json.loads((folder / "whole.json").read_text(encoding="utf-8"))["hash"] == whole["hash"]
    assert (folder / "whole.rrd").stat().st_size > 1000
    frames = imageio.imread(folder / "whole.gif", index=None)
    assert frames.ndim == COLOURS + 1
    assert np.ptp(frames) > 0  # something is drawn


def test_the_document_holds_every_replica_with_the_measures_of_its_stages_and_the_pool(whole):
    assert [replica["seed"] for replica in whole["replicas"]] == [3, 4]
    assert all(replica["stopped"] is None for replica in whole["replicas"])
    assert all(replica["time"] == pytest.approx(DURATION, rel=1e-3) for replica in whole["replicas"])
    heights = [replica["measures"]["pile_height"]["value"] for replica in whole["replicas"]]
    pooled = whole["measures"]["pile_height"]
    assert heights[0] != heights[1]
    assert pooled["value"] == pytest.approx(np.mean(heights), rel=1e-12)
    assert (pooled["sd"], pooled["n"]) == (pytest.approx(np.std(heights, ddof=1), rel=1e-9), 2)
    # the column is read before the tube goes, the pile after
    for replica in whole["replicas"]:
        measures = replica["measures"]
        assert measures["column_height"]["value"] > measures["pile_height"]["value"] > 1e-3
        assert measures["runout_radius"]["value"] > 5e-3  # the tube has a radius of 6 mm, a grain one of 1 mm


def test_a_scene_without_gravity_runs_and_is_recorded(tmp_path):
    # nothing moves and nothing weighs: every energy is 0
    free = {"gravity": {"magnitude": 0.0}, "measured": {"pile_height": {"value": 0.01}}}
    path = write_scene(tmp_path, **free, run={"replicas": 1})
    path.write_text(path.read_text("utf-8").replace('until = "time"', 'until = "rest"'), encoding="utf-8")

    def edit_file(*_: object) -> None:
        path.write_text("[half a", encoding="utf-8")

    document = run_scene(path, RunOptions(threads=1, record=tmp_path / "free.rrd", progress=edit_file))
    assert document["replicas"][0]["stopped"] is None
    assert document["measured"]["pile_height"]["value"] == 0.01  # of the file as the run began
    assert path.read_text("utf-8") == "[half a"
    assert len(read_grains(tmp_path / "free.rrd")) > 1


def test_a_time_step_beyond_all_limits_is_stopped_with_one_sentence(tmp_path, capsys):
    scene = write_scene(tmp_path, run=ABSURD_STEP)
    code = main(["run", str(scene), "--threads", "1", "--record", str(tmp_path / "kept.rrd")])
    said = capsys.readouterr().err.strip().splitlines()
    assert code == ExitCode.STOPPED
    assert "likely cause" in said[-1]
    assert (tmp_path / "kept.rrd").stat().st_size > 0


def test_an_unwritable_folder_is_told_before_the_device_starts(scene, unwritable, capsys, monkeypatch):
    monkeypatch.setattr("taichi_erosion.execution.scene_run.assemble", lambda *_: pytest.fail("too late"))
    for option in ("--record", "--checkpoint"):
        record = ["--no-record"] if option == "--checkpoint" else []
        assert main(["run", str(scene), option, str(unwritable / "few.rrd"), *record]) == ExitCode.BAD_INPUT
        said = capsys.readouterr().err
        assert "few.rrd: cannot be written (" in said
        assert said.count("\n") == 1


@pytest.mark.parametrize(
    ("number", "before", "end"),
    [
        (signal.SIGINT, signal.SIG_DFL, pytest.raises(KeyboardInterrupt)),
        (signal.SIGTERM, signal.SIG_DFL, pytest.raises(SystemExit)),
        (signal.SIGHUP, signal.SIG_DFL, pytest.raises(SystemExit)),
        (signal.SIGHUP, signal.SIG_IGN, nullcontext()),  # a signal that was to be ignored stays ignored
    ],
)
def test_a_signal_is_heard_at_the_next_check(number, before, end):
    kept = signal.signal(number, before)
    try:
        with defer_signals() as pending:
            os.kill(os.getpid(), number)  # it does not strike in the middle of something
            with end:
                pending.raise_first_signal()
        assert signal.getsignal(number) == before
    finally:
        signal.signal(number, kept)


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
        assert run.returncode in (0, 128 + number, -number), said
        assert "unexpected" not in said
        for left in (record, record.with_name(record.name + ".part")):
            if left.exists() and left.stat().st_size > 0:
                read_grains(left)
        if record.with_suffix(".json").exists():
            json.loads(record.with_suffix(".json").read_text(encoding="utf-8"))


def test_auto_runs_on_the_cpu_what_the_device_refuses(monkeypatch, tmp_path):
    monkeypatch.setattr(scene_run, "has_cuda", lambda: True)
    monkeypatch.setattr(scene_run, "CROSSOVER", 1)
    path = SCENES.parent / "doe" / "wind" / "gusty_patch.toml"
    scene = read_scene(path, ("grains.count=100", "wind.columns=[4,4]"))
    options = RunOptions(arch="auto", threads=1, no_record=True)
    ensemble = assemble_run(path, scene, library_of(scene), options, tmp_path / "unused.rrd")
    assert ensemble.sim.numerics.arch == "cpu"
