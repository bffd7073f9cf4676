"""Log file and progress of commands."""

import re
from pathlib import Path

import pytest

from taichi_erosion.cli import progress
from taichi_erosion.cli.main import main

ROOT = Path(__file__).resolve().parents[2]


def test_the_log_tells_order_warnings_and_end_with_their_times(tmp_path: Path, capsys) -> None:
    log = tmp_path / "erosion.log"
    scene = str(ROOT / "scenes" / "incline.toml")
    assert main(["--log", str(log), "run", scene, "--check"]) == 0
    assert main(["--log", str(log), "run", scene, "--check", "--set", "grains.count=-1"]) == 2
    capsys.readouterr()
    lines = log.read_text(encoding="utf-8").splitlines()
    assert all(re.match(r"\d{4}-\d\d-\d\d \d\d:\d\d:\d\d,\d{3} (INFO|ERROR) ", line) for line in lines)
    told = [line.split(" ", 3)[3] for line in lines]
    assert told[0].endswith(f"run {scene} --check")
    assert told[1] == "exit code 0"
    assert "grains.count" in told[3]
    assert told[4] == "exit code 2"
    assert len(told) == 5


def test_a_log_that_cannot_be_written_is_refused_in_one_line(tmp_path: Path, capsys) -> None:
    assert main(["--log", str(tmp_path / "no" / "log"), "effects"]) == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    assert printed.err.count("\n") == 1
    assert "--log" in printed.err


@pytest.mark.parametrize(
    ("share", "elapsed", "said"),
    [
        (0.25, 10.0, "about 30 s left"),
        (0.5, 600.0, "about 10 min left"),
        (0.5, 7200.0, "about 2.0 h left"),
        (0.001, 60.0, ""),  # too little is done to tell
        (0.5, 1.0, ""),
    ],
)
def test_the_time_that_is_left_is_told_once_the_pace_is_known(share: float, elapsed: float, said: str):
    countdown = progress.Countdown(0.0)
    assert countdown.seconds(0.0, 100.0) is None
    assert progress.left_words(countdown.seconds(share, 100.0 + elapsed)) == said


def test_what_was_done_before_does_not_count_as_pace():
    countdown = progress.Countdown(0.0)
    countdown.seconds(0.8, 0.0)
    assert countdown.seconds(0.9, 60.0) == pytest.approx(60.0)
