"""Changing one number of a TOML file and nothing else: comments, order and spelling stay."""

import re
import tomllib
from collections.abc import Sequence
from typing import Any

from taichi_erosion.core.errors import BadInput

BARE = re.compile(r"[A-Za-z0-9_-]+")
VALUE = r"(?P<value>\"[^\"]*\"|'[^']*'|[^\s,#}\]]+)"


def with_entry(text: str, path: Sequence[str], value: float | str) -> str:
    """The file with one entry set, where it stands or in a section made for it; raises BadInput."""
    lines = text.splitlines()
    written = literal(value)
    changed = replaced(lines, tuple(path), written) or added(lines, tuple(path), written)
    result = "\n".join(changed) + "\n"
    if entry(result, path) != value:
        raise BadInput(f"{'.'.join(path)}: could not be set to {written} in the file; set it by hand")
    return result


def literal(value: float | str) -> str:
    """A value as TOML writes it."""
    return f'"{value}"' if isinstance(value, str) else repr(float(value))


def entry(text: str, path: Sequence[str]) -> Any:
    """Entry of a TOML text, None where there is none or the text is none."""
    try:
        holder: Any = tomllib.loads(text)
    except tomllib.TOMLDecodeError:
        return None
    for key in path:
        holder = holder.get(key) if isinstance(holder, dict) else None
    return holder


def replaced(lines: Sequence[str], path: tuple[str, ...], written: str) -> list[str] | None:
    """Lines with the entry changed where it stands, None where it is not there."""
    for section, number in entries(lines):
        below = path[len(section) :]
        if path[: len(section)] != section or not below:
            continue
        pattern = r"^\s*" + r".*?(?<![\w.-])".join(key_pattern(key) + r"\s*=\s*" for key in below) + VALUE
        match = re.match(pattern, lines[number])
        if match:
            line = lines[number]
            line = line[: match.start("value")] + written + line[match.end("value") :]
            return [*lines[:number], line, *lines[number + 1 :]]
    return None


def added(lines: Sequence[str], path: tuple[str, ...], written: str) -> list[str]:
    """Lines with a new entry: at the head of its section, or in a new section at the end."""
    line = f"{quoted(path[-1])} = {written}"
    for number, text in enumerate(lines):
        if header(text) == path[:-1]:
            return [*lines[: number + 1], line, *lines[number + 1 :]]
    return [*lines, "", f"[{'.'.join(quoted(key) for key in path[:-1])}]", line]


def entries(lines: Sequence[str]) -> list[tuple[tuple[str, ...], int]]:
    """(section, line number) of every line that is no heading."""
    section: tuple[str, ...] = ()
    found = []
    for number, text in enumerate(lines):
        heading = header(text)
        if heading is None:
            found.append((section, number))
        else:
            section = heading
    return found


def header(line: str) -> tuple[str, ...] | None:
    """Keys of a section heading, None for any other line."""
    if not line.lstrip().startswith("["):
        return None
    try:
        table = tomllib.loads(line)
    except tomllib.TOMLDecodeError:
        return None
    keys: list[str] = []
    while isinstance(table, dict) and table:
        ((key, table),) = table.items()
        keys.append(key)
    return tuple(keys)


def key_pattern(key: str) -> str:
    """Pattern of a key, bare or quoted."""
    return rf"(?:{re.escape(key)}|\"{re.escape(key)}\"|'{re.escape(key)}')"


def quoted(key: str) -> str:
    """A key as TOML writes it."""
    return key if BARE.fullmatch(key) else f'"{key}"'
