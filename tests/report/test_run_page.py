"""Reports are pages that need nothing beside themselves and that a browser opens without a complaint."""

import json
import re
from pathlib import Path

import imageio.v3 as iio
import numpy as np
import pytest
from scene_tables import refusal

from taichi_erosion.report import write_report
from tests.report.browser import assert_readable


def measure(value: float | None, sd: float | None, count: int) -> dict:
    return {"name": "repose_angle", "value": value, "sd": sd, "unit": "deg", "n": count, "notes": []}


def document(**changes) -> dict:
    """What a run of three seeds leaves, without its details."""
    seeds = [
        {"seed": seed, "measures": {"repose_angle": measure(value, 0.5, 1)}, "warnings": []}
        for seed, value in ((1, 30.0), (2, 32.0), (3, 31.0))
    ]
    seeds[2]["warnings"] = ["flank <not> straight"]
    return {
        "scene": "scenes/heap.toml",
        "title": "A heap",
        "hash": "0123456789ab",
        "seed": 1,
        "replicas": seeds,
        "measures": {"repose_angle": measure(31.0, 1.0, 3)},
        "measured": {"repose_angle": {"value": 33.0, "sd": 0.9, "n": 9, "source": "a laboratory"}},
        "versions": {"taichi_erosion": "0.1.0"},
    } | changes


def written(folder: Path, **changes) -> Path:
    path = folder / "heap.json"
    path.write_text(json.dumps(document(**changes)), encoding="utf-8")
    return path


def page_of(path: Path) -> str:
    return write_report(path).read_text(encoding="utf-8")


def test_a_page_has_measured_beside_simulated_values_and_words_of_the_run_as_text(tmp_path):
    page = page_of(written(tmp_path, title="<script>alert(1)</script>"))
    # (33 - 31) / sqrt(1 / 3 + 0.81 / 9) = 3.07
    assert "The angle of repose is 2 deg lower than measured: 3.1 standard errors." in page
    assert "<td>31.0 ± 1.0</td><td>33.00 ± 0.90 (n = 9)</td>" in page
    assert "alert(1)</script>" not in page
    assert "&lt;script&gt;alert(1)" in page
    assert "flank &lt;not&gt; straight" in page


def test_pictures_of_the_run_are_inside_the_page(tmp_path):
    iio.imwrite(tmp_path / "heap.png", np.zeros((4, 4, 3), np.uint8))
    page = page_of(written(tmp_path, silhouettes="recordings/heap.png", film="recordings/gone.gif"))
    assert page.count("data:image/png;base64,") == 1
    assert not re.search(r"""(?:src|href)=["'](?!data:|#)""", page)


def test_a_measure_without_a_value_is_told_and_a_recording_leads_to_the_document_beside_it(tmp_path):
    written(tmp_path, measures={"repose_angle": measure(None, None, 0)})
    assert "has no simulated value; 33 was measured" in page_of(tmp_path / "heap.rrd")


@pytest.mark.parametrize("text", ["", "[]", "{}", "[1", '{"scene": "a"}', "\x00"])
def test_what_is_no_document_of_a_run_is_told_in_one_line(text: str, tmp_path):
    (tmp_path / "run.json").write_text(text, encoding="utf-8")
    refusals = {"run.json": "not the document of a run"}
    for name, told in (refusals | dict.fromkeys(("gone.json", "gone.rrd", "gone.toml"), "no such")).items():
        assert told in refusal(write_report, tmp_path / name)


def test_a_browser_shows_the_page_on_a_desk_and_on_a_phone(tmp_path):
    page = write_report(written(tmp_path))
    assert "<h1>A heap</h1>" in page.read_text("utf-8")
    assert_readable({"run": page}, tmp_path)
