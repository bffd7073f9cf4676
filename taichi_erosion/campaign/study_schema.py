"""JSON schema of study files, with which editors complete and check them."""

import json
from math import isnan
from pathlib import Path
from typing import Any

from taichi_erosion.campaign.study_file import ALL, StudyFile
from taichi_erosion.scene.paths import DIALECT


def study_schema() -> dict[str, Any]:
    """Schema of a study file as it is written: single candidates stand beside the list of their names."""
    schema: dict[str, Any] = {"$schema": DIALECT} | StudyFile.model_json_schema()
    schema["title"] = "taichi_erosion study"
    candidates = schema["$defs"]["Candidates"]
    tables = candidates["properties"].pop("tables")
    names = candidates["properties"]["effects"]
    listed = {key: names[key] for key in ("type", "items")}
    candidates["properties"]["effects"] = {
        "anyOf": [{"const": ALL}, listed],
        "description": names["description"],
        "default": [],
    }
    candidates["additionalProperties"] = next(iter(tables["patternProperties"].values()))
    return without_nan_defaults(schema)


def without_nan_defaults(node: Any) -> Any:
    """The schema without defaults that are not numbers: such an entry has none."""
    if isinstance(node, dict):
        kept = {key: entry for key, entry in node.items() if not (isinstance(entry, float) and isnan(entry))}
        return {key: without_nan_defaults(entry) for key, entry in kept.items()}
    return [without_nan_defaults(entry) for entry in node] if isinstance(node, list) else node


def study_schema_text() -> str:
    """The schema as `write_study_schema` writes it."""
    return json.dumps(study_schema(), indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def write_study_schema(path: Path) -> None:
    """Write the schema file that study files name on their first line."""
    path.write_text(study_schema_text(), encoding="utf-8")
