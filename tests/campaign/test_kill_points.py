"""A campaign struck down at random moments loses nothing and does nothing twice."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

SEED = 20261


def struck(folder: Path, kills: int) -> dict[str, int]:
    program = [
        sys.executable,
        str(Path(__file__).with_name("kill_points.py")),
        str(folder),
        str(kills),
        str(SEED),
    ]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    ended = subprocess.run(program, env=environment, capture_output=True, text=True, check=False)
    assert ended.returncode == 0, ended.stderr
    assert "in worker_main" not in ended.stderr, "a worker complained of its dead parent"
    return json.loads(ended.stdout)


@pytest.mark.parametrize("kills", [4, pytest.param(100, marks=pytest.mark.slow)])
def test_kills_at_random_moments_lose_no_result_and_repeat_none(tmp_path: Path, kills: int):
    found = struck(tmp_path, kills)
    assert found["kills"] == kills
    assert (found["lost"], found["repeated"], found["wrong"]) == (0, 0, 0)
    assert found["cut"] > 0  # runs that were under way when a kill struck, and were begun again
