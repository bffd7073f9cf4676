"""Dotted paths of a scene: which there are, and what an entry means."""

from collections.abc import Iterator
from typing import Any

from taichi_erosion.core.errors import BadInput
from taichi_erosion.scene.json_schema import scene_schema
from taichi_erosion.scene.load import resolved
from taichi_erosion.scene.schema.scene import Scene


def scene_paths(scene: Scene) -> list[str]:
    """Paths of all entries that the scene has, defaults included."""
    return sorted(leaves(resolved(scene), ""))


def leaves(table: Any, above: str) -> Iterator[str]:
    """Paths of everything below a table that is not a table."""
    for key, value in table.items():
        path = f"{above}.{key}" if above else key
        if isinstance(value, dict):
            yield from leaves(value, path)
        else:
            yield path


def meaning_of(path: str) -> str:
    """Meaning, unit and range of an entry. Raises BadInput for a path that no scene has."""
    schema = scene_schema()
    found: Any = schema
    for key in path.split("."):
        found = descend(schema, found, key)
        if found is None:
            raise BadInput(f"no scene has an entry '{path}'")
    bounds = [
        f"{name} {found[word]:g}" for name, word in (("from", "minimum"), ("to", "maximum")) if word in found
    ]
    return " ".join([f"{path}: {found.get('description', 'a section')}", *bounds])


def descend(schema: dict[str, Any], node: dict[str, Any], key: str) -> dict[str, Any] | None:
    """Schema of an entry below a section; a section that may be one of several is searched in order."""
    for option in options(schema, node):
        within = option.get("properties", {})
        if key in within:
            return within[key]
        below = option.get("additionalProperties") or next(
            iter(option.get("patternProperties", {}).values()), None
        )
        if isinstance(below, dict):
            return below
        if key.isdigit() and "items" in option:
            return option["items"]
    return None


def options(schema: dict[str, Any], node: dict[str, Any]) -> Iterator[dict[str, Any]]:
    """The node with references followed, and what it may be instead."""
    if "$ref" in node:
        name = node["$ref"].rsplit("/", 1)[-1]
        yield from options(schema, schema["$defs"][name])
        return
    yield node
    for word in ("anyOf", "oneOf", "allOf"):
        for other in node.get(word, ()):
            yield from options(schema, other)
