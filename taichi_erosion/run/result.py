"""The result document as a file beside the recording."""

import json
from pathlib import Path
from typing import Any

from taichi_erosion.measures.result import without_nan
from taichi_erosion.recording.whole_file import write_whole


def write_document(path: Path, document: dict[str, Any]) -> None:
    """Write strict JSON; NaN, which JSON does not know, becomes null."""
    text = json.dumps(without_nan(document), indent=1, default=plain, allow_nan=False)
    write_whole(path, (text + "\n").encode())


def plain(value: Any) -> Any:
    """A NumPy scalar or a path as JSON can hold it."""
    return str(value) if isinstance(value, Path) else value.item()
