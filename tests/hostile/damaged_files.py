"""Files that the project ships or its users make, and the ways in which they are damaged."""

from pathlib import Path

import imageio.v3 as imageio
import numpy as np
import trimesh
from hypothesis import strategies as st

ROOT = Path(__file__).resolve().parents[2]

TOKENS = (
    *(b"nan", b"-inf", b"1e400", b"-1e-320", b"0", b"-1", b"9" * 30, b"1e9", b"true", b"''", b"[]", b"{}"),
    *(b"[[[[", b"../../etc/passwd", b"/etc/passwd", b"\\", b"\0", b"\r", b"\n", b"\xff\xfe", b"\xef\xbb\xbf"),
    *(b'"' * 3, b"=", b"#", b",", b";", b"..", b"__import__('os').abort()", b"${HOME}", b"%s%n"),
    *("\u202e\u2028".encode(), b"A" * 5000),
)
places = st.floats(0.0, 1.0, exclude_max=True)  # share of a file's length
pieces = st.sampled_from(TOKENS) | st.binary(max_size=12)
WORDS = st.text(max_size=8)
VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | WORDS | st.dates() | st.times(),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(WORDS, inner, max_size=3),
    max_leaves=8,
)
NUMBERS = st.floats().map(str) | st.integers().map(str)
CELLS = st.text(max_size=6) | NUMBERS | st.sampled_from(["", "<1", "NaN", '"'])


def shipped(pattern: str) -> dict[str, bytes]:
    return {str(path.relative_to(ROOT)): path.read_bytes() for path in sorted(ROOT.glob(pattern))}


SCENES = shipped("scenes/*.toml")
STUDIES = shipped("doe/*.toml") | shipped("doe/foreign_lab/*.toml")
MEASURED = shipped("doe/measured/*.csv")
PUBLISHED = shipped("doe/hao2022/table_*.csv")


def meshes() -> dict[str, bytes]:
    """A box in the formats that a scene may name."""
    box = trimesh.creation.box((0.1, 0.1, 0.1))
    kinds = {"wall.stl": "stl", "ascii.stl": "stl_ascii", "wall.ply": "ply", "wall.obj": "obj"}
    found = {name: box.export(file_type=kind) for name, kind in kinds.items()}
    return {name: each.encode() if isinstance(each, str) else bytes(each) for name, each in found.items()}


def pictures() -> dict[str, bytes]:
    """A drawn heap as a camera would store it."""
    across, down = np.meshgrid(np.arange(80), np.arange(40))
    heap = np.where((down > 7 + 0.6 * np.abs(across - 40)) | (down > 27), 40, 220).astype(np.uint8)
    formats = {"heap.png": ".png", "heap.jpg": ".jpg", "heap.gif": ".gif", "heap.bmp": ".bmp"}
    return {name: imageio.imwrite("<bytes>", heap, extension=kind) for name, kind in formats.items()}


MESHES = meshes()
PICTURES = pictures()

blows = st.one_of(
    st.tuples(st.just("put"), places, pieces),  # over what is there
    st.tuples(st.just("insert"), places, pieces),
    st.tuples(st.just("value"), places, pieces),  # instead of what stands right of the next = or ,
    st.tuples(st.just("cut"), places, st.floats(0.0, 0.2)),
    st.tuples(st.just("repeat"), places, st.floats(0.0, 0.2)),
    st.tuples(st.just("end"), places, st.none()),
)


def damaged(content: bytes, damages: list[tuple[str, float, object]]) -> bytes:
    for kind, share, what in damages:
        content = struck(content, kind, int(share * len(content)), what)
    return content


def struck(content: bytes, kind: str, place: int, what: object) -> bytes:
    if kind == "end":
        return content[:place]
    if isinstance(what, float):
        stop = place + int(what * len(content))
        return content[:place] + content[stop:] if kind == "cut" else content[:stop] + content[place:]
    assert isinstance(what, bytes)
    if kind == "value":
        place = next_of(b"=,", content, place, place - 1) + 1  # behind the next sign that a value follows
        stop = next_of(b"\n,", content, place, len(content))
        return content[:place] + b" " + what + content[stop:]
    return content[:place] + what + content[place + (len(what) if kind == "put" else 0) :]


def next_of(signs: bytes, content: bytes, place: int, missing: int) -> int:
    """Place of the first of some signs from a place on."""
    return min((at for at in (content.find(sign, place) for sign in signs) if at >= 0), default=missing)


@st.composite
def damaged_file(draw: st.DrawFn, files: dict[str, bytes]) -> tuple[str, bytes]:
    name = draw(st.sampled_from(sorted(files)))
    return name, damaged(files[name], draw(st.lists(blows, min_size=1, max_size=4)))


# tables as a careless program would write them
tables = st.lists(st.lists(CELLS, min_size=1, max_size=6), max_size=8).map(
    lambda rows: "".join(",".join(row) + "\n" for row in rows).encode("utf-8", errors="surrogatepass")
)
