"""Files that users name: plain ones, so that no pipe or device is waited for or read for ever."""

from pathlib import Path

LARGEST_TEXT = 100_000_000  # bytes; nobody writes a longer table or document for this program


def plain_file(path: Path) -> Path:
    """The path, where a plain file stands. Raises OSError for a pipe, a device, a folder or nothing."""
    path.stat()
    if not path.is_file():
        raise OSError("is not a file")
    return path


def plain_text(path: Path, encoding: str = "utf-8") -> str:
    """Content of a text file. Raises OSError for no plain file or a huge one, ValueError for no text."""
    size = plain_file(path).stat().st_size
    if size > LARGEST_TEXT:
        raise OSError(f"{size} bytes are too many; at most {LARGEST_TEXT}")
    return path.read_text(encoding=encoding)
