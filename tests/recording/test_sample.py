"""The recording that comes with the source tree: small, whole, made by the command beside it."""

import json
import re
import shlex
from itertools import pairwise
from pathlib import Path

import pytest
from viewer_reports import view_reports

from taichi_erosion.execution import check_scene

ROOT = Path(__file__).parents[2]
FOLDER = ROOT / "recordings"
SAMPLE = FOLDER / "sample.rrd"


def test_the_command_beside_it_names_the_scene_that_was_run() -> None:
    page = (FOLDER / "README.md").read_text(encoding="utf-8")
    (line,) = re.findall(r"^\./erosion run (.*)$", page, re.MULTILINE)
    words = shlex.split(line)
    changes = tuple(after for word, after in pairwise(words) if word == "--set")
    document = json.loads((FOLDER / "sample.json").read_text(encoding="utf-8"))
    assert check_scene(ROOT / words[0], changes, ())["hash"] == document["hash"]
    assert words[words.index("--record") + 1] == document["recording"] == "recordings/sample.rrd"


@pytest.mark.viewer
def test_it_opens_without_a_screen_with_its_own_layout(tmp_path: Path) -> None:
    from rerun.chunk import RrdReader

    assert RrdReader(SAMPLE).blueprints()
    assert view_reports(SAMPLE) == []
