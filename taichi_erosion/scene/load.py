"""Reading a scene file: TOML, overrides, validation, and one clear line when something is wrong."""

import json
import tomllib
from collections.abc import Collection, Mapping, Sequence
from copy import deepcopy
from hashlib import sha256
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from taichi_erosion.core.errors import BadInput
from taichi_erosion.scene.checks import cross_checks
from taichi_erosion.scene.entries import apply_override, expand_diameters
from taichi_erosion.scene.schema.geometry import Mesh
from taichi_erosion.scene.schema.scene import Scene
from taichi_erosion.scene.validation_messages import problem_lines

LARGEST_FILE = 4_000_000  # a scene is text written by people; more is some other file [bytes]
HASH_LENGTH = 12  # hexadecimal digits
NOT_HASHED = {"scene": {"title", "notes"}, "run": {"replicas", "seed"}, "record": True, "measured": True}


def load_scene(
    path: str | Path,
    overrides: Sequence[str] = (),
    *,
    effects: Mapping[str, Collection[str]] | None = None,
    observables: Collection[str] | None = None,
) -> Scene:
    """Validated scene of a TOML file; raises BadInput with one line.

    `overrides` are PATH=VALUE. `effects` (name -> its parameters) and `observables` are what the other rooms
    know; left out, those names are not checked.
    """
    name = str(path).replace("\n", "?")
    try:
        table = tomllib.loads(file_text(Path(path), name))
    except (ValueError, RecursionError) as error:
        raise BadInput(f"{name}: not a TOML file: {first_line(error)}") from None
    return parse_scene(table, name, Path(path).parent, overrides, effects=effects, observables=observables)


def file_text(path: Path, name: str) -> str:
    """Content of a text file of reasonable size."""
    try:
        if not path.is_file():
            raise BadInput(f"{name}: {'is not a file' if path.exists() else 'no such file'}")
        size = path.stat().st_size
        if size > LARGEST_FILE:
            raise BadInput(f"{name}: {size} bytes is too large for a scene; at most {LARGEST_FILE}")
        return path.read_bytes().decode("utf-8")
    except UnicodeDecodeError as error:
        raise BadInput(f"{name}: byte {error.start} is not UTF-8 text") from None
    except (OSError, ValueError) as error:
        raise BadInput(f"{name}: cannot be read: {first_line(error)}") from None


def parse_scene(
    table: Mapping[str, Any],
    name: str = "scene",
    folder: Path = Path(),
    overrides: Sequence[str] = (),
    *,
    effects: Mapping[str, Collection[str]] | None = None,
    observables: Collection[str] | None = None,
) -> Scene:
    """Validated scene of a raw table, as TOML or `resolved` gives it."""
    try:
        scene = validated(deepcopy(dict(table)), overrides)
        scene._folder = folder
        scene._file = name
        lines = list(cross_checks(scene, effects, observables))
    except BadInput as error:
        raise BadInput(f"{name}: {first_line(error)}") from None
    if lines:
        raise BadInput(f"{name}: {summary(lines)}")
    return scene


def validated(table: dict[str, Any], overrides: Sequence[str]) -> Scene:
    """Scene whose every entry is right by itself."""
    for order in overrides:
        apply_override(table, order)
    frozen = with_tuples(table)
    given = expand_diameters(frozen)
    try:
        return Scene.model_validate(frozen)
    except ValidationError as error:
        raise BadInput(summary(problem_lines(error, frozen, given))) from None
    except (OverflowError, RecursionError) as error:
        raise BadInput(f"cannot be used: {first_line(error)}") from None


def with_tuples(value: Any) -> Any:
    """The same tree with tuples for lists, as frozen records hold them."""
    if isinstance(value, dict):
        return {key: with_tuples(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return tuple(with_tuples(entry) for entry in value)
    return value


def summary(lines: Sequence[str]) -> str:
    """The first problem, and how many more there are."""
    return lines[0] if len(lines) == 1 else f"{lines[0]} (and {len(lines) - 1} more)"


def first_line(error: Exception) -> str:
    """What an exception says, on one line."""
    lines = str(error).splitlines()
    return lines[0] if lines else type(error).__name__


def resolved(scene: Scene) -> dict[str, Any]:
    """The scene with all defaults filled, as plain lists, tables and numbers; `parse_scene` reads it back."""
    return scene.model_dump(mode="json", exclude_none=True)


def scene_hash(scene: Scene) -> str:
    """Name of the physical situation: 12 hexadecimal digits of a SHA-256.

    Independent of seeds, number of replicas, recording, titles, measured values, comments, order of keys.
    """
    table = scene.model_dump(mode="json", exclude_none=True, exclude=NOT_HASHED)
    table["contact"] = {"-".join(sorted(pair.split("-"))): row for pair, row in table["contact"].items()}
    table["meshes"] = {
        name: mesh_digest(scene, wall) for name, wall in scene.geometry.items() if isinstance(wall, Mesh)
    }
    canonical = json.dumps(table, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return sha256(canonical.encode()).hexdigest()[:HASH_LENGTH]


def mesh_digest(scene: Scene, wall: Mesh) -> str:
    """Digest of a mesh file's bytes, so that the hash follows the content and not the name."""
    return sha256((scene.folder / wall.file).read_bytes()).hexdigest()
