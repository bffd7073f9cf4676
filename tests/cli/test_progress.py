"""Log file and progress of commands."""

import re
from pathlib import Path

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
    assert (told[4], len(told)) == ("exit code 2", 5)


def test_the_time_that_is_left_follows_from_the_pace_since_the_first_report(monkeypatch, capsys):
    clock = [100.0]
    monkeypatch.setattr("rich.console.monotonic", lambda: clock[0])
    monkeypatch.setattr(progress, "LINE_INTERVAL", 0.0)
    monkeypatch.delenv("FORCE_COLOR", raising=False)
    with progress.progress_report("heaping") as report:
        report(0.5, "2 heaps")  # done before, which does not count as pace
        clock[0] += 60.0
        report(0.75, "3 heaps")
    lines = ["heaping: 50%, 2 heaps", "heaping: 75%, 3 heaps, about 0:01:00 left"]
    assert capsys.readouterr().err.splitlines() == lines
