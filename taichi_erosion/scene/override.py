"""`--set PATH=VALUE`: any parameter of a scene by its dotted path."""

import re
import tomllib
from typing import Any

from taichi_erosion.core.errors import BadInput

BARE_WORD = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")
DIAMETERS = "_d"  # suffix of a value given in nominal diameters


def apply_override(table: dict[str, Any], order: str) -> None:
    """Set one value of a raw scene; `order` is PATH=VALUE, VALUE as TOML writes it or a bare word."""
    path, equals, text = order.partition("=")
    keys = path.strip().split(".")
    if not equals or not all(keys):
        raise BadInput(f"--set {order[:80]}: write it as PATH=VALUE, for example grains.count=3000")
    value = parsed(order, text.strip())
    holder: Any = table
    for depth, key in enumerate(keys[:-1]):
        holder = child(holder, spelled(keys[:depth], holder, key), order)
    put(holder, spelled(keys[:-1], holder, keys[-1]), value, order)


def parsed(order: str, text: str) -> Any:
    """Value of a TOML expression, or the word itself."""
    try:
        table = tomllib.loads(f"value = {text}")
    except (ValueError, RecursionError):
        table = {}
    if set(table) == {"value"}:
        return table["value"]
    if BARE_WORD.fullmatch(text):
        return text
    raise BadInput(f"--set {order[:80]!r}: the value is not a TOML value; text needs quotes")


def spelled(above: list[str], holder: Any, key: str) -> str:
    """The key as the scene writes it: a contact pair may be named in either order."""
    if above == ["contact"] and isinstance(holder, dict) and key not in holder:
        other = "-".join(reversed(key.split("-")))
        return other if other in holder else key
    return key


def child(holder: Any, key: str, order: str) -> Any:
    """The table or list under a key, made when missing."""
    if isinstance(holder, dict):
        return holder.setdefault(key, {})
    return holder[index(holder, key, order)]


def put(holder: Any, key: str, value: Any, order: str) -> None:
    """Write a value; it replaces the same quantity given in metres or in diameters."""
    if isinstance(holder, dict):
        twin = key.removesuffix(DIAMETERS) if key.endswith(DIAMETERS) else key + DIAMETERS
        holder.pop(twin, None)
        holder[key] = value
    else:
        holder[index(holder, key, order)] = value


def index(holder: Any, key: str, order: str) -> int:
    """Position in a list, counted from 0."""
    if not isinstance(holder, list):
        raise BadInput(f"--set {order[:80]}: '{key}' lies below a value that is not a table")
    if not key.isascii() or not key.isdigit() or len(key) > 9 or int(key) >= len(holder):
        raise BadInput(f"--set {order[:80]}: '{key}' is not a place in a list of {len(holder)}")
    return int(key)
