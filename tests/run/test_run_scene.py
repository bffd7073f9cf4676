"""A scene from file to document, recording and pictures; interrupted and resumed; stopped by a guard."""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from small_scene import write_scene

from taichi_erosion.cli.main import ExitCode, main
from taichi_erosion.core.device import stop_device
from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.snapshot import Failure, Status
from taichi_erosion.recording.checkpoint import load_checkpoint
from taichi_erosion.run import RunOptions, run_scene
from taichi_erosion.run import scene_run as scene_run_module
from taichi_erosion.run.ensemble_loop import Play
from taichi_erosion.run.stages import sentence

DURATION = 0.12  # s, of both stages
CUT = 0.08  # s, within the second stage: measures of the first are known by then
COLOURS = 3  # channels of a film


def stop_at(time: float) -> Any:
    """Stand-in for Ctrl-C: a watcher that interrupts the play at its first check from a time on."""
    play = scene_run_module.play

    def cut_short(stage_play: Play, watchers: list[Any]) -> None:
        def interrupt(now: Play) -> None:
            if now.time >= time:
                raise KeyboardInterrupt

        play(stage_play, [*watchers, interrupt])

    return cut_short


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    return tmp_path_factory.mktemp("runs")


@pytest.fixture(scope="module")
def whole(folder) -> dict[str, Any]:
    """The document of a run that went through."""
    document = run_scene(write_scene(folder), RunOptions(threads=1, record=folder / "whole.rrd"))
    stop_device()
    return document


@pytest.fixture(scope="module")
def resumed(folder) -> dict[str, Any]:
    """The document of the same run, interrupted in its second stage and taken up again."""
    scene, kept = write_scene(folder), folder / "cut.checkpoint.npz"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(scene_run_module, "play", stop_at(CUT))
        with pytest.raises(KeyboardInterrupt, match=r"cut\.checkpoint\.npz"):
            run_scene(scene, RunOptions(threads=1, record=folder / "cut.rrd"))
    assert load_checkpoint(kept)[1]["checks"] == pytest.approx(CUT / 1e-3)
    document = run_scene(scene, RunOptions(threads=1, record=folder / "resumed.rrd", resume=kept))
    stop_device()
    return document


def test_a_run_leaves_document_recording_and_film(whole, folder):
    import imageio.v3 as imageio

    assert json.loads((folder / "whole.json").read_text(encoding="utf-8"))["hash"] == whole["hash"]
    assert (folder / "whole.rrd").stat().st_size > 1000
    frames = imageio.imread(folder / "whole.gif", index=None)
    assert frames.ndim == COLOURS + 1
    assert np.ptp(frames) > 0  # something is drawn


def test_the_document_holds_every_replica_and_the_pool(whole):
    assert [replica["seed"] for replica in whole["replicas"]] == [3, 4]
    assert all(replica["stopped"] is None for replica in whole["replicas"])
    assert all(replica["time"] == pytest.approx(DURATION, rel=1e-3) for replica in whole["replicas"])
    heights = [replica["measures"]["pile_height"]["value"] for replica in whole["replicas"]]
    pooled = whole["measures"]["pile_height"]
    assert heights[0] != heights[1]
    assert pooled["value"] == pytest.approx(np.mean(heights), rel=1e-12)
    assert pooled["sd"] == pytest.approx(np.std(heights, ddof=1), rel=1e-9)
    assert pooled["n"] == 2


def test_the_column_is_read_before_the_tube_goes_and_the_pile_after(whole):
    for replica in whole["replicas"]:
        measures = replica["measures"]
        assert measures["column_height"]["value"] > measures["pile_height"]["value"] > 1e-3
        assert measures["runout_radius"]["value"] > 5e-3  # the tube has a radius of 6 mm, a grain one of 1 mm


def test_grain_steps_count_grains_times_steps(whole):
    steps = DURATION / whole["limits"]["time_step"]
    assert whole["grain_steps"] == pytest.approx(2 * 30 * steps, rel=0.01)  # all grains start at once


def test_a_resumed_run_ends_with_the_same_measures_bit_for_bit(whole, resumed):
    assert resumed["replicas"] == whole["replicas"]
    assert resumed["measures"] == whole["measures"]
    assert resumed["grain_steps"] == whole["grain_steps"]


def test_a_checkpoint_of_other_seeds_is_refused(resumed, folder):
    kept = folder / "cut.checkpoint.npz"
    with pytest.raises(BadInput, match=r"cut\.checkpoint\.npz"):
        run_scene(write_scene(folder), RunOptions(threads=1, seed=8, no_record=True, resume=kept))


OVERLAPPING = {"law": "positions", "grains": [{"position": [0, 0, 2e-3]}, {"position": [0, 0, 3e-3]}]}
ABSURD_STEP = {"time_step": 5e-3, "force_time_step": True}  # s, thirty Rayleigh times


def test_grains_that_start_inside_each_other_are_refused_at_the_door(tmp_path, capsys):
    scene = write_scene(tmp_path, grains={"count": 2}, fill=OVERLAPPING)
    assert main(["run", str(scene), "--record", str(tmp_path / "kept.rrd")]) == ExitCode.BAD_INPUT
    assert len(capsys.readouterr().err.strip().splitlines()) == 1
    assert not (tmp_path / "kept.rrd").exists()


def test_a_time_step_beyond_all_limits_is_stopped_with_one_sentence(tmp_path, capsys):
    scene = write_scene(tmp_path, run=ABSURD_STEP)
    code = main(["run", str(scene), "--threads", "1", "--record", str(tmp_path / "kept.rrd")])
    stop_device()
    said = capsys.readouterr().err.strip().splitlines()
    assert code == ExitCode.STOPPED
    assert "likely cause" in said[-1]
    assert (tmp_path / "kept.rrd").stat().st_size > 0


def test_validation_alone_does_not_load_the_device(tmp_path):
    scene = write_scene(tmp_path)
    words = ["run", str(scene), "--check"]
    code = (
        "import sys; from taichi_erosion.cli.main import main; "
        f"code = main({words!r}); sys.exit(99 if 'taichi' in sys.modules else code)"
    )
    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert ended.returncode == 0, ended.stderr
    assert "valid" in ended.stdout


@pytest.mark.parametrize(
    ("end", "words"),
    [
        (Failure(Status.OVERLAP, 0.5, 7, 9, 0.31), ("grain 7 overlaps grain 9 by 0.31 radii", "0.5 s")),
        (Failure(Status.OVERLAP, 0.5, 7, -3, 0.31), ("grain 7 overlaps wall piece 2",)),
        (Failure(Status.LOST, 0.25, 4, -1, -1.5), ("grain 4 left the domain", "-1.5 m")),
        (Failure(Status.NOT_FINITE, 0.25, 4, -1, np.nan), ("grain 4", "not a number")),
        (Failure(Status.ENERGY, 0.25, -1, -1, 0.2), ("energy grew by 0.2",)),
    ],
)
def test_a_failure_is_told_in_one_line_with_place_time_and_cause(end, words):
    said = sentence(end, 11)
    assert all(word in said for word in ("seed 11", "likely cause", *words))
    assert "\n" not in said
