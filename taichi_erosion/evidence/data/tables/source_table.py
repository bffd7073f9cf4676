"""The laboratory's table from which `study new` made a study, known again by a digest of its cells."""

import os
from hashlib import sha256
from pathlib import Path

from taichi_erosion.core.errors import BadInput
from taichi_erosion.evidence.data.tables.spreadsheet import read_cells

DIGITS = 16  # of the digest


def source_digest(table: Path) -> str:
    """Digest of the cells of a table, whatever its format; empty where it cannot be read."""
    try:
        rows = read_cells(table, table.name, []).rows
    except BadInput:
        return ""
    return sha256(repr([cells for _, cells in rows]).encode()).hexdigest()[:DIGITS]


def relative_path(table: Path, folder: Path) -> str:
    """Path of a table as seen from a folder, with forward slashes."""
    return Path(os.path.relpath(table, folder)).as_posix()


def source_changed(table: Path, digest: str) -> bool:
    """Whether a table is there and has other cells than those of a digest."""
    return table.is_file() and source_digest(table) != digest
