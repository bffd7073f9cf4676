"""Exports hold what was recorded: contacts, walls where they stand, tables, and a picture of force chains."""

from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import meshio
import numpy as np
import pytest
import xarray as xr
from PIL import Image
from recorded_heaps import FLOOR, MOVING, QUARTER_TURN, header, heap_snapshot, record_heap, recorded

from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.snapshot import FIELD_UNITS, ContactNetwork, GrainFields
from taichi_erosion.recording import air_recording, export, readback, stream

SHIFT = np.array([0.01, 0.0, 0.002])


def network_of(time: float, force: float = 1e-3) -> ContactNetwork:
    """Every grain presses on the plate; the first two push each other, and later pull."""
    state = heap_snapshot()
    count = len(state.ident)
    one = np.concatenate([[0], np.arange(count)]).astype(np.int32)
    two = np.concatenate([[1], np.full(count, -1)]).astype(np.int32)
    centre = state.position[one]
    branch = np.concatenate([state.position[:1] - state.position[1:2], centre[1:] * [0.0, 0.0, 1.0]])
    normal = branch / np.linalg.norm(branch, axis=1)[:, None]
    pushes = np.concatenate([[force], np.full(count, 2e-3)])
    forces = pushes[:, None] * normal + (np.cross(normal, [0.0, 1.0, 0.0]) * 1e-4)
    return ContactNetwork(time, one, two, centre, centre - branch, branch, normal, forces, ("plate",))


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("export") / "heap.rrd"
    plate = replace(FLOOR, moving=True)
    with recorded(path, replace(header(), walls=(plate,), contacts=True)) as opened:
        for frame in range(3):
            state = heap_snapshot(frame)
            stream.log_frame(opened, state, MOVING)
            stream.log_contacts(opened, network_of(state.time, 1e-3 - 1e-3 * frame))
            if frame == 1:
                stream.log_wall_pose(opened, "plate", QUARTER_TURN, SHIFT)
            if frame == 2:
                stream.log_wall_removed(opened, "plate")
    return path


def test_contacts_are_read_back_as_they_were_written(recording: Path):
    found = readback.read_contacts(recording)
    assert [one.time for one in found] == pytest.approx([0.0, 0.01, 0.02])
    for frame, one in enumerate(found):
        written = network_of(one.time, 1e-3 - 1e-3 * frame)
        assert one.walls == ("plate",)
        for name in ("first", "second", "centre", "point", "branch", "normal", "force"):
            np.testing.assert_allclose(getattr(one, name), getattr(written, name), rtol=1e-6, atol=1e-9)
        np.testing.assert_allclose(one.normal_force, written.normal_force, rtol=1e-5, atol=1e-9)


def test_walls_are_where_they_were_at_every_time(recording: Path):
    (wall,) = readback.read_walls(recording)
    np.testing.assert_allclose(wall.at(0.0), FLOOR.vertices, atol=1e-9)
    np.testing.assert_allclose(wall.at(0.015), FLOOR.vertices @ QUARTER_TURN.T + SHIFT, atol=1e-8)
    assert wall.at(0.02) is None


def test_paraview_gets_grains_lines_and_walls_of_every_frame(recording: Path, tmp_path: Path):
    listing, frame = export.export_vtk(recording, tmp_path / "vtk"), readback.read_grains(recording)[-1]
    entries = ElementTree.parse(listing).findall("./Collection/DataSet")
    assert [entry.attrib["part"] for entry in entries] == list("01201202")  # at last without plate
    files = [meshio.read(listing.parent / entry.attrib["file"]) for entry in entries]
    written = network_of(0.01, 0.0)
    lines = files[5].points[files[5].cells_dict["line"]]
    np.testing.assert_allclose(lines[:, 1] - lines[:, 0], written.branch, atol=1e-8)
    np.testing.assert_allclose(files[5].cell_data["normal_force"][0], written.normal_force, atol=1e-8)
    np.testing.assert_allclose(files[4].points, FLOOR.vertices @ QUARTER_TURN.T + SHIFT, atol=1e-8)
    assert files[4].cells_dict["triangle"].tolist() == FLOOR.triangles.tolist()
    assert [float(entry.attrib["timestep"]) for entry in entries[::3]] == pytest.approx([0.0, 0.01, 0.02])
    np.testing.assert_array_equal(files[6].points, frame.position)
    for name, values in (frame.state | {"radius": frame.radius}).items():
        np.testing.assert_array_equal(files[6].point_data[name], values)


def test_tables_of_netcdf_hold_the_same_numbers(recording: Path, tmp_path: Path):
    folder = export.export_netcdf(recording, tmp_path)
    with xr.open_dataset(folder / "contacts.nc") as contacts, xr.open_dataset(folder / "grains.nc") as grains:
        last = contacts.isel(contact=np.isclose(contacts.time, 0.02))
        np.testing.assert_allclose(last.force, network_of(0.02, -1e-3).force, rtol=1e-5, atol=1e-9)
        assert float(last.normal_force.min()) == pytest.approx(-1e-3)
        np.testing.assert_allclose(grains.position[-1], heap_snapshot(2).position, rtol=1e-6)
        assert grains.position.units == "m"
    export.export_netcdf(recording, tmp_path)  # its own files may be written again
    other = recording.with_name("other.rrd")
    record_heap(other)
    with pytest.raises(BadInput, match="made from"):
        export.export_netcdf(other, tmp_path)


def test_chains_are_brighter_where_forces_are_larger(recording: Path, tmp_path: Path):
    picture = np.asarray(Image.open(export.export_chains(recording, tmp_path / "chains.png", 0.01)))
    assert picture.shape == (720, 960, 3)
    assert (picture[..., 0] > 200).sum() > 300  # lines in ember
    with pytest.raises(BadInput, match=r"0\.02 s"):
        export.export_chains(recording, tmp_path / "late.png", 0.5)
    without = recording.with_name("without.rrd")
    record_heap(without)
    with pytest.raises(BadInput, match=r"record\.contacts=true"):
        export.export_chains(without, tmp_path / "none.png")


def fields_of(time: float, rows: int) -> GrainFields:
    """A profile of numbers that differ from each other, longer or shorter."""
    at = {"x": np.array([time]), "y": np.array([0.5]), "z": 0.1 * np.arange(rows)}
    many = np.arange(9.0 * rows).reshape(1, 1, rows, 3, 3)
    few = many[..., 0], many[..., 1, 1]
    return GrainFields(time, at, 2e-3, few[1], 2.0 * few[1], few[0], many, 2.0 * many, 3.0 * few[0])


def test_fields_are_read_back_and_become_one_table_over_time_and_height(tmp_path: Path):
    path, written = tmp_path / "heap.rrd", [fields_of(0.0, 4), fields_of(0.5, 6)]
    with recorded(path, replace(header(), fields=True)) as opened:
        for frame, one in enumerate(written):
            stream.set_recording_time(opened, one.time, frame)
            air_recording.log_grain_fields(opened, one)
    found = readback.read_fields(path)
    for one, other in zip(found, written, strict=True):
        np.testing.assert_allclose(one.at["z"], other.at["z"])
        for name in FIELD_UNITS:
            np.testing.assert_allclose(getattr(one, name), getattr(other, name))
    table = export.field_table(found)
    assert dict(table.sizes) == {"time": 2, "z": 6, "axis": 3, "along": 3}
    np.testing.assert_allclose(table.contact_stress[1], written[1].contact_stress[0, 0])
    np.testing.assert_allclose(table.solid_fraction[0, 4:], 0.0)
    np.testing.assert_allclose(table.x, [0.0, 0.5])
