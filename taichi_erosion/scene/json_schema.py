"""JSON schema of scene files, by which editors complete and check them while one types."""

import json
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter

from taichi_erosion.scene.entries import DIAMETERS, SCALING_UNITS
from taichi_erosion.scene.schema import air
from taichi_erosion.scene.schema.air import AirScene
from taichi_erosion.scene.schema.scene import Scene

DIALECT = "https://json-schema.org/draft/2020-12/schema"
IN_METRES_ONLY = {
    "Monodisperse",
    "Lognormal",
    "Sieve",
    "GrainStart",
    "Conditions",
}  # they define the diameter


def scene_schema() -> dict[str, Any]:
    """Schema of a scene file, every number with its unit and range."""
    schema = TypeAdapter[Scene | AirScene](Scene | AirScene).json_schema()
    parts = (part for part in vars(air).values() if isinstance(part, type))
    air_alone = {part.__name__ for part in parts if part.__module__ == air.__name__}
    for name, part in schema["$defs"].items():
        if name not in IN_METRES_ONLY | air_alone:
            allow_diameters(part)
    whole = [schema["$defs"].pop(option["$ref"].rpartition("/")[2]) for option in schema["anyOf"]]
    return {"$schema": DIALECT, "title": "taichi_erosion scene", "anyOf": whole, "$defs": schema["$defs"]}


def allow_diameters(part: dict[str, Any]) -> None:
    """Let every length and time of a section also be given in nominal diameters, as `NAME_d`."""
    either = []
    for name, entry in list(part.get("properties", {}).items()):
        if entry.get("unit") not in SCALING_UNITS:
            continue
        unit = "1" if entry["unit"] == "m" else "s m-1"
        unbounded = {k: v for k, v in entry.items() if k not in ("minimum", "maximum", "default")}
        meaning = f"{entry['description'].rpartition(' [')[0]}, over the nominal grain diameter [{unit}]"
        part["properties"][name + DIAMETERS] = unbounded | {"description": meaning, "unit": unit}
        if name in part.get("required", []):
            part["required"] = [required for required in part["required"] if required != name]
            either.append({"oneOf": [{"required": [name]}, {"required": [name + DIAMETERS]}]})
    if either:
        part["allOf"] = either


def schema_text() -> str:
    """The schema as it is written to a file."""
    return json.dumps(scene_schema(), indent=1, ensure_ascii=False) + "\n"


def write_schema(path: str | Path) -> None:
    """Write the schema where scene files name it on their first line."""
    Path(path).write_text(schema_text(), encoding="utf-8")
