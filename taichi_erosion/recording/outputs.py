"""Files of a run beside its recording, and the refusal to replace those of another run.

A run of a scene replaces the recording, document, silhouettes and film of an earlier run of the same scene
under the same name. The document names its scene and the other files; a recording without a document, which
an interruption leaves, is known by the name of the program at its beginning.
"""

import json
from pathlib import Path
from typing import Any

from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.files import REMEDY

SUFFIXES = (".rrd", ".json", ".png", ".gif")
HEAD = 4096  # bytes of a recording in which the name of its program stands
PROGRAM = b"taichi_erosion"


def refuse_foreign_outputs(record: Path, scene: Path, force: bool = False) -> None:
    """Raise BadInput where a run would replace a file that no run of this scene wrote."""
    present = [path for suffix in SUFFIXES if (path := record.with_suffix(suffix)).exists()]
    if force or not present:
        return
    document = document_of(record)
    if document and Path(str(document["scene"])).name != scene.name:
        told = f"exists, and belongs to a run of {document['scene']}"
        raise BadInput(f"{record.with_suffix('.json')}: {told}; {REMEDY}")
    named = {
        Path(str(document[key])).name for key in ("recording", "silhouettes", "film") if document.get(key)
    }
    for path in present:
        own = path.name in named or (document and path.suffix == ".json") or is_recording(path)
        if not own:
            raise BadInput(f"{path}: exists, and no run of {scene} wrote it; {REMEDY}")


def document_of(record: Path) -> dict[str, Any]:
    """Document of the run beside a recording; empty where there is none of this program."""
    try:
        document = json.loads(record.with_suffix(".json").read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    known = (
        isinstance(document, dict)
        and "scene" in document
        and "taichi_erosion" in document.get("versions", {})
    )
    return document if known else {}


def is_recording(path: Path) -> bool:
    """Whether a file is a recording of this program."""
    if path.suffix != ".rrd" or not path.is_file():
        return False
    with path.open("rb") as file:
        return PROGRAM in file.read(HEAD)


def unused_name(path: Path) -> Path:
    """The path, or the first of PATH-2, PATH-3 and so on that does not exist."""
    number, free = 1, path
    while free.exists():
        number += 1
        free = path.with_name(f"{path.stem}-{number}{path.suffix}")
    return free
