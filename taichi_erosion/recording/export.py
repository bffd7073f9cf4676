"""Recordings for ParaView: one VTK file a frame, and a list of frames with their times."""

from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.files import mark_of, refuse_foreign, write_atomic
from taichi_erosion.recording.readback import GrainFrame, read_grains

COLLECTION = "grains.pvd"


def export_vtk(recording: Path, folder: Path, force: bool = False) -> Path:
    """Write every frame of a recording as points with all their columns; returns the list of frames.

    Open the list in ParaView and draw the points as spheres scaled by `radius` [m]. Raises BadInput where the
    recording holds no frame, the folder cannot be written, or it holds frames of something else.
    """
    refuse_foreign(folder / COLLECTION, recording, force)
    if not force and not (folder / COLLECTION).exists() and any(folder.glob("grains_*.vtu")):
        raise BadInput(
            f"{folder}: holds grains_*.vtu of something else; name another folder, or give --force"
        )
    frames = read_grains(recording)
    if not frames:
        raise BadInput(f"{recording}: holds no frame of grains")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        names = [write_frame(frame, folder, number) for number, frame in enumerate(frames)]
    except OSError as error:
        raise BadInput(f"{folder}: cannot be written ({error.strerror})") from None
    return write_collection(folder, names, [frame.time for frame in frames], recording)


def write_frame(frame: GrainFrame, folder: Path, number: int) -> str:
    """Write one frame; returns the name of its file."""
    import meshio

    name = f"grains_{number:05d}.vtu"
    points = np.arange(len(frame.ident))[:, None]
    columns = {"radius": frame.radius, "ident": frame.ident, **frame.state}
    mesh = meshio.Mesh(frame.position, [("vertex", points)], point_data=columns)
    mesh.write(folder / name, file_format="vtu")
    return name


def write_collection(folder: Path, names: list[str], times: list[float], recording: Path) -> Path:
    """List of frames with their times, marked by the recording."""
    root = ElementTree.Element("VTKFile", type="Collection", version="0.1")
    collection = ElementTree.SubElement(root, "Collection")
    for name, time in zip(names, times, strict=True):
        ElementTree.SubElement(collection, "DataSet", timestep=f"{time:.9g}", part="0", file=name)
    root.insert(0, ElementTree.Comment(f" {mark_of(folder / COLLECTION, recording)} "))
    return write_atomic(folder / COLLECTION, ElementTree.tostring(root, xml_declaration=True))
