"""What ParaView reads is what the recording holds."""

from pathlib import Path
from xml.etree import ElementTree

import meshio
import numpy as np
import pytest
from recorded_heaps import record_heap

from taichi_erosion.recording.export import export_vtk
from taichi_erosion.recording.readback import read_grains


def test_every_frame_is_written_with_its_time_and_its_grains(tmp_path: Path) -> None:
    recording = tmp_path / "heap.rrd"
    record_heap(recording)
    listing = export_vtk(recording, tmp_path / "vtk")
    entries = ElementTree.parse(listing).findall("./Collection/DataSet")
    frames = read_grains(recording)
    assert [float(entry.attrib["timestep"]) for entry in entries] == pytest.approx([f.time for f in frames])
    last = meshio.read(listing.parent / entries[-1].attrib["file"])
    np.testing.assert_array_equal(last.points, frames[-1].position)
    np.testing.assert_array_equal(last.point_data["radius"], frames[-1].radius)
    assert {"velocity", "spin", "force", "contacts"} <= set(last.point_data)
    for name, values in frames[-1].state.items():
        np.testing.assert_array_equal(last.point_data[name], values)
