"""Exports: the one door through which recordings and states of sessions become tables, files and pictures.

tables      xarray, in memory or as files of NetCDF: grains, contacts
vtk         ParaView: grains as points, contacts as lines, walls as triangles, with a list of all frames
chains      picture of the force chains at one moment
"""

from bisect import bisect_right
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any
from xml.etree import ElementTree

import numpy as np

from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.files import mark_png, refuse_foreign_file, source_mark, write_atomic
from taichi_erosion.core.snapshot import FIELD_UNITS, ContactNetwork, GrainFields, Snapshot
from taichi_erosion.recording import readback
from taichi_erosion.recording.pictures import SideView, force_chain_picture, png_bytes
from taichi_erosion.recording.stream import CONTACT_VECTORS
from taichi_erosion.recording.wall_mesh import WallMesh

if TYPE_CHECKING:
    import xarray as xr

COLLECTION = "grains.pvd"  # list of the frames for ParaView
UNITS = {"position": "m", "radius": "m", "velocity": "m s-1", "spin": "rad s-1", "force": "N"}
UNITS |= {"centre": "m", "point": "m", "branch": "m", "normal_force": "N", "mass": "kg"}
NOTHING = dict.fromkeys(FIELD_UNITS, 0.0) | {"velocity": np.nan}  # beyond the grains
NO_CONTACTS = "holds no contacts; run the scene with --set record.contacts=true"


def frame_of_state(state: Snapshot) -> readback.GrainFrame:
    """Frame of a state that has not been recorded."""
    columns = {n: getattr(state, n) for n in ("velocity", "spin", "force", "mass", "contacts", "kind")}
    columns = {name: values for name, values in columns.items() if values is not None}
    columns |= state.effect_state
    return readback.GrainFrame(state.time, state.ident, state.position, state.radius, columns)


def grain_table(frames: Sequence[readback.GrainFrame]) -> "xr.Dataset":
    """Grains by time and grain, vectors also by axis; NaN where a grain is not there."""
    import xarray as xr

    grains = max((int(one.ident.max(initial=-1)) for one in frames), default=-1) + 1
    columns = [{"position": one.position, "radius": one.radius, **one.state} for one in frames]
    variables = {}
    for name, first in columns[0].items() if columns else ():
        kind = np.promote_types(first.dtype, np.float32)
        table = np.full((len(frames), grains, *first.shape[1:]), np.nan, kind)
        for row, one, frame_columns in zip(table, frames, columns, strict=True):
            row[one.ident] = frame_columns[name]
        variables[name] = (("time", "grain", "axis")[: table.ndim], table, {"units": UNITS.get(name, "1")})
    times = ("time", [one.time for one in frames], {"units": "s"})
    return xr.Dataset(variables, {"time": times, "grain": np.arange(grains), "axis": ["x", "y", "z"]})


def contact_table(networks: Sequence[ContactNetwork]) -> "xr.Dataset":
    """Contacts of all frames one after the other, each with its time; vectors also by axis."""
    import xarray as xr

    def concatenate_column(name: str) -> np.ndarray:
        return np.concatenate([getattr(one, name) for one in networks]) if networks else np.zeros(0)

    walls = networks[-1].walls if networks else ()
    columns = {"meaning": "row of the grain; of a wall -1 - its place in the attribute walls"}
    scalars = {name: ("contact", concatenate_column(name), columns) for name in ("first", "second")}
    vectors = {
        name: (("contact", "axis"), concatenate_column(name).reshape(-1, 3), {"units": UNITS.get(name, "1")})
        for name in CONTACT_VECTORS
    }
    normal = {"normal_force": ("contact", concatenate_column("normal_force"), {"units": "N"})}
    times = np.repeat([one.time for one in networks], [len(one.first) for one in networks])
    places = {"time": ("contact", times, {"units": "s"}), "axis": ["x", "y", "z"]}
    return xr.Dataset(scalars | vectors | normal, places, {"walls": ", ".join(walls)})


def field_table(profiles: Sequence[GrainFields]) -> "xr.Dataset":
    """Coarse-grained fields by time and coordinates; a coordinate of one place is a number by time."""
    import xarray as xr

    tables = []
    for fields in profiles:
        variables = {}
        for name, unit in FIELD_UNITS.items():
            values = getattr(fields, name)
            inner = ("axis", "along")[: values.ndim - len(fields.at)]
            variables[name] = ((*fields.at, *inner), values, {"units": unit})
        axes = {"time": fields.time, "axis": list("xyz"), "along": list("xyz")}
        table = xr.Dataset(variables, {**fields.at, **axes})
        tables.append(table.squeeze([name for name, places in fields.at.items() if len(places) == 1]))
    whole = xr.concat(tables, "time", join="outer", fill_value=NOTHING, coords="different", compat="equals")
    return whole.assign_attrs(width=profiles[-1].width, stress="positive where it presses")


def wall_table(poses: Mapping[str, Any], network: ContactNetwork) -> "xr.Dataset":
    """Walls by name: whether present, rotation since the start, shift [m], force of the grains on it [N]."""
    import xarray as xr

    force = np.zeros((len(network.walls), 3))
    on_wall = network.second < 0
    np.add.at(force, -1 - network.second[on_wall], -network.force[on_wall])
    turned = np.array([pose.rotation for pose in poses.values()]).reshape(-1, 3, 3)
    shifted = np.array([pose.translation for pose in poses.values()]).reshape(-1, 3)
    variables = {
        "present": ("wall", [pose.present for pose in poses.values()]),
        "rotation": (("wall", "axis", "of"), turned, {"units": "1"}),
        "shift": (("wall", "axis"), shifted, {"units": "m"}),
        "force": (("wall", "axis"), force, {"units": "N"}),
    }
    axes = ["x", "y", "z"]
    return xr.Dataset(variables, {"wall": list(network.walls), "axis": axes, "of": axes})


def export_netcdf(recording: Path, folder: Path, force: bool = False) -> Path:
    """Write grains, and contacts and fields where they are recorded, as NAME.nc; returns the folder."""
    tables = {"grains": grain_table(readback.read_grains(recording))}
    tables |= {"contacts": contact_table(networks)} if (networks := readback.read_contacts(recording)) else {}
    tables |= {"fields": field_table(fields)} if (fields := readback.read_fields(recording)) else {}
    for name, table in tables.items():
        refuse_foreign_file(folder / f"{name}.nc", recording, force)
        table.attrs["source"] = source_mark(folder / f"{name}.nc", recording)
        write_atomic(folder / f"{name}.nc", bytes(table.to_netcdf()))
    return folder


def export_chains(recording: Path, picture: Path, moment: float | None = None, force: bool = False) -> Path:
    """Write the force chains at a moment [s], or at the end, seen from the side (PNG). Raises BadInput."""
    refuse_foreign_file(picture, recording, force)
    networks, frames = readback.read_contacts(recording), readback.read_grains(recording)
    if not networks:
        raise BadInput(f"{recording}: {NO_CONTACTS}")
    time = networks[-1].time if moment is None else moment
    if not networks[0].time <= time <= networks[-1].time * (1.0 + 1e-6):
        raise BadInput(f"--time {time:g}: contacts run from {networks[0].time:g} to {networks[-1].time:g} s")
    network = networks[bisect_right([one.time for one in networks], time * (1.0 + 1e-9)) - 1]
    frame = next(one for one in frames if one.time == network.time)
    walls = [(track, track.at(frame.time)) for track in readback.read_walls(recording)]
    meshes = [WallMesh(one.name, at, one.triangles, False) for one, at in walls if at is not None]
    return write_atomic(picture, mark_png(picture, recording, force_chain_png(frame, network, meshes)))


def force_chain_png(frame: readback.GrainFrame, network: ContactNetwork, walls: Sequence[WallMesh]) -> bytes:
    """PNG of the force chains among grains that fill the picture."""
    reach = frame.radius[:, None]
    low = (frame.position - reach).min(axis=0, initial=np.inf)
    high = (frame.position + reach).max(axis=0, initial=-np.inf)
    margin = 0.05 * float((high - low).max())
    view = SideView((low[0] - margin, low[2] - margin), (high[0] + margin, high[2] + margin), (960, 720))
    return png_bytes(force_chain_picture(frame.position, frame.radius, network, view, walls))


def export_vtk(recording: Path, folder: Path, force: bool = False) -> Path:
    """Write every frame of a recording with all its columns; returns the list of frames.

    Open the list in ParaView and draw the points of grains as spheres scaled by `radius` [m]. Raises BadInput
    where the recording holds no frame, the folder cannot be written, or it holds frames of something else.
    """
    refuse_foreign_file(folder / COLLECTION, recording, force)
    if not force and not (folder / COLLECTION).exists() and any(folder.glob("grains_*.vtu")):
        raise BadInput(f"{folder}: holds grains_*.vtu of something else; name another folder or give --force")
    frames, walls = readback.read_grains(recording), readback.read_walls(recording)
    if not frames:
        raise BadInput(f"{recording}: holds no frame of grains")
    networks = {network.time: network for network in readback.read_contacts(recording)}
    parts: list[tuple[float, int, str]] = []  # time, part and name of every file
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for number, frame in enumerate(frames):
            parts.append((frame.time, 0, write_vtk_grains(frame, folder, number)))
            if any(wall.at(frame.time) is not None for wall in walls):
                parts.append((frame.time, 1, write_vtk_walls(walls, frame.time, folder, number)))
            if network := networks.get(frame.time):
                parts.append((frame.time, 2, write_vtk_contacts(network, folder, number)))
    except OSError as error:
        raise BadInput(f"{folder}: cannot be written ({error.strerror})") from None
    return write_vtk_collection(folder, parts, recording)


def write_vtk_grains(frame: readback.GrainFrame, folder: Path, number: int) -> str:
    """Write the grains of one frame; returns the name of the file."""
    import meshio

    name = f"grains_{number:05d}.vtu"
    points = np.arange(len(frame.ident))[:, None]
    columns = {"radius": frame.radius, "ident": frame.ident, **frame.state}
    meshio.Mesh(frame.position, [("vertex", points)], point_data=columns).write(folder / name, "vtu")
    return name


def write_vtk_contacts(network: ContactNetwork, folder: Path, number: int) -> str:
    """Write the contacts of one frame as lines that end at the first body; returns the name of the file."""
    import meshio

    name, count = f"contacts_{number:05d}.vtu", len(network.first)
    ends = np.concatenate([network.centre - network.branch, network.centre])
    lines = np.stack([np.arange(count), count + np.arange(count)], axis=1)
    columns = ("first", "second", "point", "normal", "force", "normal_force", "tangential_force")
    data = {column: [getattr(network, column)] for column in columns}
    meshio.Mesh(ends, [("line", lines)], cell_data=data).write(folder / name, "vtu")
    return name


def write_vtk_walls(walls: Sequence[readback.WallTrack], time: float, folder: Path, number: int) -> str:
    """Write the walls at a time [s], numbered by `wall`; returns the name of the file, one if none moves."""
    import meshio

    moving = any(wall.poses for wall in walls)
    name = f"walls_{number:05d}.vtu" if moving else "walls.vtu"
    if moving or number == 0:
        tracks = [(place, wall, at) for place, wall in enumerate(walls) if (at := wall.at(time)) is not None]
        before = np.cumsum([0, *(len(at) for _, _, at in tracks)])
        triangles = [wall.triangles + first for (_, wall, _), first in zip(tracks, before, strict=False)]
        of_wall = np.repeat([place for place, _, _ in tracks], [len(wall.triangles) for _, wall, _ in tracks])
        cells: Any = [("triangle", np.concatenate(triangles))]
        vertices = np.concatenate([at for _, _, at in tracks])
        meshio.Mesh(vertices, cells, cell_data={"wall": [of_wall]}).write(folder / name, "vtu")
    return name


def write_vtk_collection(folder: Path, parts: Sequence[tuple[float, int, str]], recording: Path) -> Path:
    """List of files with their times, marked by the recording."""
    root = ElementTree.Element("VTKFile", type="Collection", version="0.1")
    collection = ElementTree.SubElement(root, "Collection")
    for time, part, name in parts:
        entry = {"timestep": f"{time:.9g}", "part": str(part), "file": name}
        ElementTree.SubElement(collection, "DataSet", entry)
    root.insert(0, ElementTree.Comment(f" {source_mark(folder / COLLECTION, recording)} "))
    return write_atomic(folder / COLLECTION, ElementTree.tostring(root, xml_declaration=True))
