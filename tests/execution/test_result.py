"""A run replaces the files of an earlier run of its scene, and no others."""

import json
from pathlib import Path

import pytest

from taichi_erosion.core.errors import BadInput
from taichi_erosion.execution.result import refuse_foreign_outputs
from taichi_erosion.execution.session import unused_path

SCENE = Path("scenes/heap.toml")


def test_an_earlier_run_of_the_scene_is_replaced_and_of_another_refused(tmp_path):
    record = tmp_path / "heap.rrd"
    record.write_bytes(b"RRF2\0taichi_erosion\0")
    document = {"scene": str(SCENE), "versions": {"taichi_erosion": "1"}, "film": "elsewhere/heap.gif"}
    record.with_suffix(".json").write_text(json.dumps(document))
    record.with_suffix(".gif").write_bytes(b"GIF")
    refuse_foreign_outputs(record, SCENE)
    refuse_foreign_outputs(tmp_path / "new.rrd", SCENE)
    with pytest.raises(BadInput, match=r"heap\.json: exists, and no run of scenes/drum\.toml wrote it"):
        refuse_foreign_outputs(record, Path("scenes/drum.toml"))


@pytest.mark.parametrize("suffix", [".rrd", ".json", ".png", ".gif"])
def test_a_file_that_no_run_wrote_is_refused_before_anything_is_simulated(tmp_path, suffix):
    (tmp_path / "heap.rrd").with_suffix(suffix).write_text('{"mine": 1}')
    with pytest.raises(BadInput, match=rf"heap\{suffix}: exists, and no run of scenes/heap\.toml wrote it"):
        refuse_foreign_outputs(tmp_path / "heap.rrd", SCENE)
    refuse_foreign_outputs(tmp_path / "heap.rrd", SCENE, force=True)


def test_sessions_count_their_recordings(tmp_path):
    path = tmp_path / "heap-live-1.rrd"
    assert unused_path(path) == path
    path.touch()
    (tmp_path / "heap-live-1-2.rrd").touch()
    assert unused_path(path).name == "heap-live-1-3.rrd"
