"""Log file and progress of commands."""

import re
from itertools import pairwise
from pathlib import Path

import pytest

from taichi_erosion.cli import progress
from taichi_erosion.cli.main import main

TOLD = re.compile(r"about ([\d.]+) (s|min) left")
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


def phases(pace: list[float], plan: list[float]) -> list[tuple[float, float]]:
    """Time and share of work in phases that take `pace` seconds where `plan` expected others."""
    total, now, done, told = sum(plan), 0.0, 0.0, [(0.0, 0.0)]
    for took, expected in zip(pace, plan, strict=True):
        steps = max(int(took), 1)
        for step in range(1, steps + 1):
            told.append((now + took * step / steps, (done + expected * step / steps) / total))
        now, done = now + took, done + expected
    return told


@pytest.mark.parametrize(
    "pace",
    [
        [300.0, 20.0, 100.0, 20.0],  # as planned
        [600.0, 20.0, 100.0, 40.0],  # the first runs are slower
        [150.0, 60.0, 100.0, 60.0],  # the first runs are faster, the statistics slower
        [300.0, 20.0, 1.0, 1.0],  # the round was not needed
    ],
)
def test_the_time_that_is_left_never_jumps_after_the_first_tenth(pace: list[float]):
    plan = [300.0, 20.0, 100.0, 20.0]
    countdown = progress.Countdown(0.0)
    told = phases(pace, plan)
    found = [(time, share, countdown.seconds(share, time)) for time, share in told]
    later = [(time, left) for time, share, left in found if share > 0.1 and left]
    for (_, before), (_, after) in pairwise(later):
        assert 0.499 < after / before < 2.001
    factors = [took / expected for took, expected in zip(pace, plan, strict=True)]
    if max(factors) <= 2.0 * min(factors):  # then the estimate is as good as the plan
        end = told[-1][0]
        assert all(0.49 < left / (end - time) < 2.01 for time, left in later if end - time > 60.0)


def test_no_two_lines_in_a_row_tell_times_that_differ_by_more_than_two(monkeypatch):
    now, lines = [0.0], []
    monkeypatch.setattr(progress, "monotonic", lambda: now[0])
    report = progress.report_by_lines("simulating", lines.append)
    # a cold start, then a leap of the share between two lines, as where kernels are compiled first
    for second in range(600):
        now[0] = float(second)
        report(0.11 * second / 300 if second < 300 else 0.11 + 0.89 * (1.0 - 0.99 ** (second - 300)), "runs")
    told = [float(match[1]) * 60.0 ** (match[2] == "min") for line in lines if (match := TOLD.search(line))]
    assert len(told) > 20
    for before, after in list(pairwise(told))[26:]:
        assert 0.45 < after / before < 2.2  # minutes are rounded
