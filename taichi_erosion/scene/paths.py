"""Dotted paths of a scene: those it has, the JSON schema that documents them, and `--set PATH=VALUE`."""

import json
import re
import tomllib
from collections.abc import Iterator, Mapping
from functools import cache, reduce
from math import inf
from operator import or_
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter

from taichi_erosion.core.errors import BadInput, did_you_mean
from taichi_erosion.core.files import one_line_name
from taichi_erosion.scene.schema.air import AirScene
from taichi_erosion.scene.schema.fields import DIAMETERS, PhysicalRange
from taichi_erosion.scene.schema.scene import Scene

DIALECT = "https://json-schema.org/draft/2020-12/schema"
NOMINAL_DIAMETER = "d"  # unit of the spheres of a clump
TITLE = "taichi_erosion scene"  # of the schema
BARE_WORD = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")


@cache
def scene_schema() -> dict[str, Any]:
    """Schema of a scene file, every number with its unit and range."""
    schema = TypeAdapter[Scene | AirScene](Scene | AirScene).json_schema()
    whole = [schema["$defs"].pop(option["$ref"].rpartition("/")[2]) for option in schema["anyOf"]]
    return {"$schema": DIALECT, "title": TITLE, "anyOf": whole, "$defs": schema["$defs"]}


def schema_text() -> str:
    return json.dumps(scene_schema(), indent=1, ensure_ascii=False) + "\n"


def write_schema(path: str | Path) -> None:
    """Write the schema file that scene files name on their first line."""
    Path(path).write_text(schema_text(), encoding="utf-8")


def leaf_entries(table: Any, above: str = "") -> Iterator[tuple[str, Any]]:
    """Dotted paths and values of all entries below a table."""
    for key, value in table.items():
        path = f"{above}.{key}" if above else key
        if isinstance(value, dict):
            yield from leaf_entries(value, path)
        else:
            yield path, value


def describe_entry_at_path(path: str) -> str:
    """Meaning, unit and range of an entry; of a section also the entries below it, one line each.

    Raises BadInput for a path that no scene has.
    """
    schema = scene_schema()
    node: Any = schema
    for key in path.split("."):
        above, node = node, next(entry_schemas_below(schema, node, key), None)
        if node is None:
            names = [name for option in options(schema, above) for name in option.get("properties", {})]
            raise BadInput(f"no scene has an entry '{path}'{did_you_mean(key, names)}")
    meanings = [o["description"] for o in options(schema, node.get("items", node)) if "description" in o]
    nameless = meanings[0].partition("\n")[0] if len(meanings) == 1 else "a part"
    return "\n".join([f"{path}: {describe_entry(node, nameless)}", *entry_lines(schema, node)])


def describe_entry(entry: Mapping[str, Any], nameless: str = "") -> str:
    """Meaning, unit, range, default and choices of an entry, as its schema states them."""
    entry = {key: value for option in entry.get("anyOf", ()) for key, value in option.items()} | dict(entry)
    bounds = [f"{a} {entry[b]:g}" for a, b in (("from", "minimum"), ("to", "maximum")) if b in entry]
    if isinstance(entry.get("default"), (str, int, float)):
        bounds.append(f"; default {entry['default']}")
    if "enum" in entry:
        bounds.append(f"; one of {', '.join(map(str, entry['enum']))}")
    return " ".join(filter(None, [entry.get("description", nameless), *bounds])).replace(" ;", ";")


def entry_lines(schema: dict[str, Any], node: dict[str, Any]) -> Iterator[str]:
    """One line for every entry of a section; what chooses among its forms stands before each form.

    Lengths and times in nominal diameters (`NAME_d`) are left out: each has its twin in metres or seconds.
    """
    for option in options(schema, node):
        if isinstance(option.get("items"), dict) and (entries := list(entry_lines(schema, option["items"]))):
            yield "  a list, each entry a section with"
            yield from (f"  {line}" for line in entries)
        within = option.get("properties", {})
        if (has_names := schema_of_user_named_sections(option)) is not None:
            yield "  names of your own, each a section with"
            yield from (f"  {line}" for line in entry_lines(schema, has_names))
        for name, entry in sorted(within.items(), key=lambda item: "const" not in item[1]):
            if "const" in entry:
                yield f'  {name} = "{entry["const"]}", with'
            elif not (name.endswith("_d") and name.removesuffix("_d") in within):
                yield f"  {name}: {describe_entry(entry)}".rstrip(": ")


def schema_of_user_named_sections(node: dict[str, Any]) -> dict[str, Any] | None:
    """Schema of the sections of a table under names of the user's own; None where there are none."""
    tables = [node.get("additionalProperties"), *node.get("patternProperties", {}).values()]
    return next((table for table in tables if isinstance(table, dict)), None)


def options(schema: dict[str, Any], node: dict[str, Any]) -> Iterator[dict[str, Any]]:
    """The node with references resolved, and the options of its unions."""
    if "$ref" in node:
        yield from options(schema, schema["$defs"][node["$ref"].rsplit("/", 1)[-1]])
        return
    yield node
    for word in ("anyOf", "oneOf", "allOf"):
        for other in node.get(word, ()):
            yield from options(schema, other)


@cache
def section_schema(name: str) -> dict[str, Any]:
    """Schema of one section of scenes, quicker than the whole; empty where no scene has it."""
    kinds: list[Any] = [k.model_fields[name].annotation for k in (Scene, AirScene) if name in k.model_fields]
    return TypeAdapter[Any](reduce(or_, kinds)).json_schema() if kinds else {}


@cache
def number_entry_at_path(path: str) -> PhysicalRange | None:
    """Unit and range of the number at a dotted path; None where no scene has the path, or it is no number.

    A component has unit and range of its vector. What is counted in nominal diameters is a pure number.
    """
    section, *keys = path.split(".")
    schema, number = section_schema(section), None
    nodes = [schema]
    for key in keys:
        nodes = [below for node in nodes for below in entry_schemas_below(schema, node, key)]
        numbers = (option for node in nodes for option in options(schema, node) if "unit" in option)
        number = next(numbers, number) if nodes else None
    if number is None:
        return None
    unit = "1" if number["unit"] == NOMINAL_DIAMETER else str(number["unit"])
    return PhysicalRange(unit, float(number.get("minimum", -inf)), float(number.get("maximum", inf)))


def unit_at_path(path: str) -> str | None:
    """Unit of the number that a dotted path sets; None where there is none."""
    number = number_entry_at_path(path)
    return number and number.unit


def entry_schemas_below(schema: dict[str, Any], node: dict[str, Any], key: str) -> Iterator[dict[str, Any]]:
    """Schemas of an entry below a section, a table or a list, of every option of a union."""
    for option in options(schema, node):
        branch: Any = option.get("properties", {}).get(key)
        if branch is None and key.isdigit():
            components = option.get("prefixItems", ())
            branch = components[int(key)] if int(key) < len(components) else option.get("items")
        elif branch is None:
            items = option.get("items", {})
            has_names = any("name" in each.get("properties", ()) for each in options(schema, items))
            branch = items if has_names else schema_of_user_named_sections(option)
        if isinstance(branch, dict):
            yield branch


def set_value_by_override(table: dict[str, Any], override: str) -> None:
    """Set one value of a raw scene; `override` is PATH=VALUE, VALUE as TOML writes it or a bare word.

    What was given of the same quantity in the other unit, metres or diameters, is dropped. Raises BadInput.
    """
    try:
        path, equals, text = override.partition("=")
        *above, last = path.strip().split(".")
        if not equals or not all((*above, last)):
            raise ValueError("write it as PATH=VALUE, for example grains.count=3000")
        value = parse_toml_value(text.strip())
        holder: Any = table
        for depth, key in enumerate(above):
            if isinstance(holder, dict):
                holder = holder.setdefault(key_in_table(holder, key, above[:depth]), {})
            else:
                holder = holder[index_in_list(holder, key)]
        if isinstance(holder, dict):
            holder.pop(last.removesuffix(DIAMETERS) if last.endswith(DIAMETERS) else last + DIAMETERS, None)
            holder[key_in_table(holder, last, above)] = value
        else:
            holder[index_in_list(holder, last)] = value
    except ValueError as error:
        raise BadInput(one_line_name(f"--set {override[:80]}: {error}")) from None


def parse_toml_value(text: str) -> Any:
    """Value of a TOML expression, or the word itself. Raises ValueError."""
    try:
        table = tomllib.loads(f"value = {text}")
    except (ValueError, RecursionError):
        table = {}
    if set(table) == {"value"}:
        return table["value"]
    if BARE_WORD.fullmatch(text):
        return text
    raise ValueError("the value is not a TOML value: a plain number with a decimal point, or text in quotes")


def key_in_table(holder: dict[str, Any], key: str, above: list[str]) -> str:
    """Key of a table; a contact pair in the order of the scene."""
    turned = "-".join(reversed(key.split("-")))
    return turned if above == ["contact"] and key not in holder and turned in holder else key


def index_in_list(holder: Any, key: str) -> int:
    """Position in a list, counted from 0, of a place or of a section by its name. Raises ValueError."""
    if not isinstance(holder, list):
        raise ValueError(f"'{key}' lies below a value that is not a table")
    names = [entry.get("name") for entry in holder if isinstance(entry, dict)]
    if key in names:
        return names.index(key)
    if not key.isascii() or not key.isdigit() or len(key) > 9 or int(key) >= len(holder):
        near = did_you_mean(key, [name for name in names if isinstance(name, str)])
        raise ValueError(f"'{key}' is not a place in a list of {len(holder)}{near}")
    return int(key)
