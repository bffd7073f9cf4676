"""Files that users name: reading of regular files only, atomic writing, and what may be replaced.

A file that a command makes from a source (a study, a scene, a recording, a photograph) carries the mark

    made by taichi_erosion from SOURCE[, content DIGEST];

in a comment, with SOURCE relative to the folder of the file and percent-encoded. A command replaces a file
only if that file is from the same source and, where it has a digest, still as it was written: what a user has
changed belongs to the user. Tables, which hold no comment, are listed with their digests in `written.json`.
"""

import json
import os
import re
import struct
import tempfile
import zlib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import BinaryIO
from urllib.parse import quote, unquote

from taichi_erosion.core.errors import BadInput

PART_SUFFIX = ".part"  # name of a file while it is being written
MARK = re.compile(rb"made by taichi_erosion from ([^ \r\n;,]+)(?:, content ([0-9a-f]+))?;")
LOOKED_THROUGH = 65536  # bytes at the beginning of a file in which its mark stands
DIGEST_LENGTH = 16  # hexadecimal digits
LIST = "written.json"
REMEDY = "move it away, or replace it with --force"
PNG_HEADER = 33  # bytes of signature and first chunk


def one_line_name(path: str | Path) -> str:
    """Name of a file as messages print it."""
    return str(path).replace("\n", "?")


def require_regular_file(path: Path) -> Path:
    """The path of a regular file. Raises OSError for a pipe, a device, a folder or nothing."""
    path.stat()
    if not path.is_file():
        raise OSError("is not a file")
    return path


def read_text_file(path: Path, encoding: str = "utf-8") -> str:
    """Content of a text file. Raises OSError for no regular file, ValueError for no text."""
    return require_regular_file(path).read_text(encoding=encoding)


def part_path(path: Path) -> Path:
    """Path of the unfinished file, in the same folder, so that renaming it is one step."""
    return path.with_name(path.name + PART_SUFFIX)


def make_parent_folder(path: Path) -> None:
    """Make the parent folder of a file. Raises BadInput where it cannot be made, or a folder has the name."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.name.encode()
    except OSError as error:
        raise BadInput(f"{path}: its folder cannot be made ({error.strerror})") from error
    except ValueError:
        raise BadInput(f"{str(path)!a}: is not a name in UTF-8") from None
    if not path.name or (path.exists() and not path.is_file()):
        raise BadInput(f"{path}: is not the name of a file")


def require_writable(path: Path) -> None:
    """Raise BadInput where a file cannot be made."""
    make_parent_folder(path)
    try:
        with tempfile.TemporaryFile(dir=path.parent):
            return
    except OSError as error:
        raise BadInput(f"{path}: cannot be written ({error.strerror})") from None


@contextmanager
def atomic_file(path: Path) -> Iterator[BinaryIO]:
    """Empty file that replaces the one at a path in one step once it is flushed to disk. Raises OSError.

    A crash at any moment leaves the old file or the new one, never a part.
    """
    part = path.with_name(f"{path.name}.{os.getpid()}{PART_SUFFIX}")
    try:
        with part.open("wb") as file:
            yield file
            file.flush()
            os.fsync(file.fileno())
        part.replace(path)
    except BaseException:
        part.unlink(missing_ok=True)  # frees its space on a full disk
        raise


def write_atomic(path: Path, content: bytes) -> Path:
    """Write a file as `atomic_file` does. Raises BadInput where it cannot be written."""
    make_parent_folder(path)
    try:
        with atomic_file(path) as file:
            file.write(content)
    except OSError as error:
        raise BadInput(f"{path}: cannot be written ({error.strerror})") from error
    return path


def content_digest(content: bytes) -> str:
    return sha256(content).hexdigest()[:DIGEST_LENGTH]


def source_mark(path: Path, source: Path, content: bytes | None = None) -> str:
    """Mark of a file made from a source, with the digest of its content where it is given."""
    relative = os.path.relpath(source.absolute(), path.absolute().parent)
    digest = "" if content is None else f", content {content_digest(content)}"
    return f"made by taichi_erosion from {quote(relative)}{digest};"


def mark_toml(path: Path, source: Path, text: str) -> bytes:
    """A TOML text below a comment with its mark; an earlier mark goes."""
    body = remove_mark(text).encode()
    return f"# {source_mark(path, source, body)}\n".encode() + body


def remove_mark(text: str) -> str:
    """A TOML text without the comment of its mark."""
    first, newline, rest = text.partition("\n")
    return rest if newline and MARK.search(first.encode()) else text


def mark_html(path: Path, source: Path, page: str) -> bytes:
    """An HTML page with its mark in a comment at the beginning of its head."""
    head, tag, rest = page.partition("<head>")
    return f"{head}{tag}<!-- {source_mark(path, source)} -->{rest}".encode()


def mark_png(path: Path, source: Path, picture: bytes) -> bytes:
    """A PNG with its mark as a text after the header, where readers expect comments."""
    body = b"tEXt" + b"Comment\0" + source_mark(path, source).encode("latin-1")
    chunk = struct.pack(">I", len(body) - 4) + body + struct.pack(">I", zlib.crc32(body))
    return picture[:PNG_HEADER] + chunk + picture[PNG_HEADER:]


def refuse_foreign_file(path: Path, source: Path, force: bool = False) -> None:
    """Raise BadInput where a file exists that is not from this source, or was changed since; not by force."""
    if force or not path.exists():
        return
    if not path.is_file():
        raise BadInput(f"{path}: is not the name of a file")
    content = path.read_bytes()
    mark = MARK.search(content[:LOOKED_THROUGH])
    if mark is None:
        raise BadInput(f"{path}: exists, and this program did not write it; {REMEDY}")
    written_from = (path.parent / unquote(mark[1].decode())).resolve()
    if written_from != source.resolve():
        raise BadInput(f"{path}: exists, made from {unquote(mark[1].decode())}, not from {source}; {REMEDY}")
    _, _, body = content.partition(b"\n")
    if mark[2] is not None and content_digest(body) != mark[2].decode():
        raise BadInput(f"{path}: was changed after this program wrote it; {REMEDY}")


@dataclass(frozen=True)
class ListedFolder:
    """A folder in which `written.json` lists what this program wrote, by name with the digest."""

    path: Path

    @property
    def digests(self) -> dict[str, str]:
        """Digests by name; none where there is no list. Raises BadInput for a damaged one."""
        try:
            entries = json.loads((self.path / LIST).read_text(encoding="utf-8"))
        except FileNotFoundError:
            return {}
        except (OSError, ValueError) as error:
            raise BadInput(f"{self.path / LIST}: cannot be read ({error}); {REMEDY}") from None
        return {str(name): str(each) for name, each in entries.items()} if isinstance(entries, dict) else {}

    def refuse_foreign_files(self, names: Sequence[str], force: bool = False) -> None:
        """Raise BadInput where one of these files exists that is not listed, or was changed; not by force."""
        digests = {} if force else self.digests
        for path in (self.path / name for name in names):
            if force or not path.exists():
                continue
            name = path.relative_to(self.path).as_posix()
            if name not in digests:
                raise BadInput(f"{path}: exists, and this program did not write it; {REMEDY}")
            if content_digest(path.read_bytes()) != digests[name]:
                raise BadInput(f"{path}: was changed after this program wrote it; {REMEDY}")

    def write_file(self, name: str, content: bytes) -> Path:
        path = write_atomic(self.path / name, content)
        digests = self.digests | {name: content_digest(path.read_bytes())}
        text = json.dumps(dict(sorted(digests.items())), indent=1) + "\n"
        write_atomic(self.path / LIST, text.encode())
        return path
