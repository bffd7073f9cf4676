"""Lengths and times in grain diameters: `radius_d = 9.0` means nine nominal diameters.

The suffix serves every quantity in m or s of the sections below; a time then reads in s per m of diameter.
"""

from collections.abc import Iterator
from functools import cache
from typing import Any, get_args

from pydantic import TypeAdapter, ValidationError

from taichi_erosion.core.errors import BadInput
from taichi_erosion.scene.preparation.sizes import nominal_diameter
from taichi_erosion.scene.schema.fields import Section, unit_of
from taichi_erosion.scene.schema.grains import Size
from taichi_erosion.scene.schema.scene import Scene

DIAMETERS = "_d"  # suffix of a value given in nominal diameters
SECTIONS = ("run", "geometry", "fill", "wind", "threshold", "stages", "measure", "record")
SCALING_UNITS = ("m", "s")

Path = tuple[str | int, ...]
Given = dict[Path, tuple[str, Any]]  # key and value as written, by the path in SI units


def sections_of(section: type[Section]) -> Iterator[type[Section]]:
    """A section of a scene and all sections below it."""
    yield section
    for field in section.model_fields.values():
        for sub in sections_in(field.annotation):
            yield from sections_of(sub)


def sections_in(annotation: Any) -> Iterator[type[Section]]:
    """Sections that a type annotation names, however deep in unions, lists and tables."""
    if isinstance(annotation, type) and not get_args(annotation) and issubclass(annotation, Section):
        yield annotation
    for inner in get_args(annotation):
        yield from sections_in(inner)


@cache
def scaling_names() -> frozenset[str]:
    """Names of all quantities in m or s that a scene declares."""
    fields = (entry for section in sections_of(Scene) for entry in section.model_fields.items())
    return frozenset(name for name, field in fields if unit_of(field) in SCALING_UNITS)


def expand_diameters(table: dict[str, Any]) -> Given | None:
    """Replace every `NAME_d` of a raw scene by NAME in SI units; None without a valid diameter."""
    diameter = readable_diameter(table)
    if diameter is None:
        return None
    found: Given = {}
    names = scaling_names()
    for section in SECTIONS:
        expand(table.get(section), (section,), diameter, names, found)
    return found


@cache
def size_adapter() -> TypeAdapter[Size]:
    """Validator of size laws, which takes longer to make than to use."""
    return TypeAdapter(Size)


def readable_diameter(table: dict[str, Any]) -> float | None:
    """Nominal diameter [m], None where the size law is invalid."""
    grains = table.get("grains")
    try:
        size = size_adapter().validate_python(grains["size"]) if isinstance(grains, dict) else None
        return nominal_diameter(size) if size else None
    except (ValidationError, KeyError):
        return None


def expand(part: Any, path: Path, diameter: float, names: frozenset[str], found: Given) -> None:
    """Expand one table or list in place."""
    if isinstance(part, tuple):
        for place, entry in enumerate(part):
            expand(entry, (*path, place), diameter, names, found)
    if not isinstance(part, dict):
        return
    for key in list(part):
        name = key.removesuffix(DIAMETERS)
        if name != key and name in names and is_numeric(part[key]):
            if name in part:
                raise BadInput(f"{'.'.join(map(str, path))}: {name} and {key} name the same quantity")
            found[(*path, name)] = (key, part[key])
            part[name] = times(part.pop(key), diameter)
        else:
            expand(part[key], (*path, key), diameter, names, found)


def is_numeric(value: Any) -> bool:
    """Whether a value is a number or a list of numbers."""
    if isinstance(value, tuple):
        return len(value) > 0 and all(is_numeric(entry) for entry in value)
    return isinstance(value, int | float) and not isinstance(value, bool)


def times(value: Any, diameter: float) -> Any:
    """A number or a vector in diameters, converted to SI units."""
    if isinstance(value, tuple):
        return tuple(times(entry, diameter) for entry in value)
    try:
        return float(value) * diameter
    except OverflowError:
        return float("inf")
