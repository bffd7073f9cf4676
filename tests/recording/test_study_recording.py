"""One recording shows a whole study, and a browser may look at it from this machine alone."""

import urllib.request
from pathlib import Path

import imageio.v3 as imageio
import numpy as np
import psutil
import pytest
from recorded_heaps import read_frames, read_properties, record_heap
from viewer_reports import view_reports

from taichi_erosion.recording import viewer
from taichi_erosion.recording.study_recording import RecordedRun, StudyPage, record_study

FIGURE = imageio.imwrite("<bytes>", np.full((40, 60, 3), 200, np.uint8), extension=".png")


def study(folder: Path, runs: int) -> Path:
    """A study of heaps that are all alike."""
    shown = []
    for number in range(runs):
        record_heap(folder / f"{number}.rrd")
        settings = {"friction": 0.1 * number, "angle": 30.0}
        name, title = f"confirm-{number}", f"run {number}: 30 deg"
        shown.append(RecordedRun(name, title, folder / f"{number}.rrd", settings))
    table = "| run |\n| :-- |\n| 1 |\n"
    page = StudyPage("A study", "# Found\n\nIt fits.", table, {"effects": FIGURE}, shown)
    return record_study(folder / "study.rrd", page)


def test_runs_stand_side_by_side_with_their_factors_and_results(tmp_path: Path) -> None:
    path = study(tmp_path, 2)
    heaps = [read_frames(path, f"runs/confirm-{number}") for number in range(2)]
    assert [len(frames) for frames in heaps] == [5, 5]
    np.testing.assert_array_equal(heaps[0][-1][1], heaps[1][-1][1])
    properties = read_properties(path)
    assert properties["confirm-1"]["friction"] == pytest.approx(0.1)
    assert properties["confirm-1"]["angle"] == pytest.approx(30.0)


@pytest.mark.viewer
@pytest.mark.parametrize("runs", [pytest.param(0, marks=pytest.mark.slow), 2])
def test_every_view_of_a_study_draws(tmp_path: Path, runs: int) -> None:
    assert view_reports(study(tmp_path, runs)) == []


@pytest.mark.viewer
def test_the_page_for_browsers_is_served_to_this_machine_alone(tmp_path: Path) -> None:
    record_heap(tmp_path / "heap.rrd")
    with viewer.serve_web_viewer(tmp_path / "heap.rrd") as served:
        with urllib.request.urlopen(f"http://127.0.0.1:{served.page}/", timeout=600.0) as page:
            assert b"<html" in page.read().lower()
        ports = {served.page, served.port}
        listening = [c.laddr for c in psutil.net_connections("tcp") if c.status == psutil.CONN_LISTEN]
        assert {address.port for address in listening if address.port in ports} == ports
        assert {address.ip for address in listening if address.port in ports} == {"127.0.0.1"}
        assert f"http://127.0.0.1:{served.page}/" in served.instructions
    assert not viewer.is_listening(served.page)
