"""Reading a scene file: TOML, overrides, validation, hash; any problem raises BadInput with one line."""

import json
import tomllib
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from copy import deepcopy
from functools import lru_cache
from hashlib import sha256
from pathlib import Path
from typing import Any, TypeVar

from pydantic import TypeAdapter, ValidationError

from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.files import one_line_name, read_text_file
from taichi_erosion.scene.checks import air_checks, cross_checks
from taichi_erosion.scene.file_kind import refuse_other_name, refuse_other_sections
from taichi_erosion.scene.paths import apply_override
from taichi_erosion.scene.preparation.sizes import nominal_diameter
from taichi_erosion.scene.schema.air import AirScene
from taichi_erosion.scene.schema.fields import DIAMETER
from taichi_erosion.scene.schema.geometry import Mesh
from taichi_erosion.scene.schema.grains import Size
from taichi_erosion.scene.schema.scene import Scene
from taichi_erosion.scene.validation_messages import problem_lines

S = TypeVar("S", Scene, AirScene)

MOST_TREES = 16  # kept
MOST_FAULTS = 10  # of a file, told one by one
HASH_LENGTH = 12  # hexadecimal digits
NOT_HASHED = {
    "scene": {"title", "notes", "effect_files"},
    "run": {"replicas", "seed", "frames"},
    "record": True,
    "measured": True,
}


def load_scene(
    path: str | Path, overrides: Sequence[str] = (), observables: Collection[str] | None = None
) -> Scene:
    """Validated scene of a TOML file.

    `overrides` are PATH=VALUE. `observables` are those of the program; None: their names are not checked.
    """
    return parse_scene(toml_table(path), one_line_name(path), Path(path).parent, overrides, observables)


def load_air_scene(
    path: str | Path, overrides: Sequence[str] = (), observables: Collection[str] | None = None
) -> AirScene:
    """Validated scene of air alone of a TOML file."""
    return parse_air_scene(toml_table(path), one_line_name(path), overrides, observables)


def is_air_scene(path: Path) -> bool:
    """Whether a file describes air alone; an unreadable file does not."""
    try:
        table = toml_table(path)
    except BadInput:
        return False
    return "air" in table and "grains" not in table


def toml_table(path: str | Path) -> dict[str, Any]:
    """Raw table of a TOML file."""
    name = one_line_name(path)
    refuse_other_name(Path(path), "scene")
    try:
        table = deepcopy(dict(toml_tree(file_text(Path(path), name))))
    except (ValueError, RecursionError) as error:
        raise BadInput(f"{name}: not a TOML file: {first_line(error)}") from None
    refuse_other_sections(Path(path), table, "scene")
    return table


@lru_cache(maxsize=MOST_TREES)
def toml_tree(text: str) -> Mapping[str, Any]:
    """Tree of a TOML text, shared by all who read it: a plan reads one file for every run."""
    return tomllib.loads(text)


def file_text(path: Path, name: str) -> str:
    """Content of a text file."""
    try:
        return read_text_file(path)
    except FileNotFoundError:
        raise BadInput(f"{name}: no such file") from None
    except UnicodeDecodeError as error:
        raise BadInput(f"{name}: byte {error.start} is not UTF-8 text") from None
    except (OSError, ValueError) as error:
        raise BadInput(f"{name}: cannot be read: {first_line(error)}") from None


def parse_scene(
    table: Mapping[str, Any],
    name: str = "scene",
    folder: Path = Path(),
    overrides: Sequence[str] = (),
    observables: Collection[str] | None = None,
) -> Scene:
    """Validated scene of a raw table, as TOML or `resolved` gives it."""

    def problems(scene: Scene) -> Iterator[str]:
        scene._folder = folder
        return cross_checks(scene, observables)

    return parsed(Scene, table, name, overrides, problems)


def parse_air_scene(
    table: Mapping[str, Any],
    name: str = "scene",
    overrides: Sequence[str] = (),
    observables: Collection[str] | None = None,
) -> AirScene:
    """Validated scene of air alone of a raw table."""
    return parsed(AirScene, table, name, overrides, lambda scene: air_checks(scene, observables))


def parsed(
    kind: type[S],
    table: Mapping[str, Any],
    name: str,
    overrides: Sequence[str],
    problems: Callable[[S], Iterator[str]],
) -> S:
    """Scene without problems, of a raw table."""
    raw = deepcopy(dict(table))
    try:
        for override in overrides:
            apply_override(raw, override)
        scene = validated(kind, with_tuples(raw))
        scene._file = name
        lines = list(problems(scene))
    except BadInput as error:
        raise BadInput(*told(name, error.faults)) from None
    if lines:
        raise BadInput(*told(name, lines))
    return scene


def validated(kind: type[S], table: dict[str, Any]) -> S:
    """Scene whose every entry is right by itself."""
    diameter = readable_diameter(table) if kind is Scene else None
    try:
        return kind.model_validate(table, context={DIAMETER: diameter})
    except ValidationError as error:
        raise BadInput(*problem_lines(error, table, diameter)) from None
    except (OverflowError, RecursionError) as error:
        raise BadInput(f"cannot be used: {first_line(error)}") from None


SIZES: TypeAdapter[Size] = TypeAdapter(Size)


def readable_diameter(table: Mapping[str, Any]) -> float | None:
    """Nominal diameter [m], None where the size law is invalid."""
    try:
        return nominal_diameter(SIZES.validate_python(table["grains"]["size"]))
    except (ValidationError, KeyError, TypeError):
        return None


def with_tuples(value: Any) -> Any:
    """The same tree with tuples for lists, as frozen records hold them."""
    if isinstance(value, dict):
        return {key: with_tuples(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return tuple(with_tuples(entry) for entry in value)
    return value


def told(name: str, lines: Sequence[str]) -> list[str]:
    """Faults of a file, one line each; of many the first ones and the number of the others."""
    found = [f"{name}: {line}" for line in lines[:MOST_FAULTS]]
    others = len(lines) - MOST_FAULTS
    return [*found, f"{name}: {others} faults more"] if others > 0 else found


def first_line(error: Exception) -> str:
    """First line of an exception's message."""
    lines = str(error).splitlines()
    return lines[0] if lines else type(error).__name__


def scene_hash(scene: Scene | AirScene) -> str:
    """Name of the physical situation: 12 hexadecimal digits of a SHA-256.

    Independent of seeds, number of replicas, recording, titles, measured values, comments, order of keys.
    """
    table = scene.model_dump(mode="json", exclude_none=True, exclude=NOT_HASHED)
    if isinstance(scene, Scene):
        table["contact"] = {"-".join(sorted(pair.split("-"))): row for pair, row in table["contact"].items()}
        table["meshes"] = {  # the content of a mesh file counts, not its name
            name: sha256((scene.folder / wall.file).read_bytes()).hexdigest()
            for name, wall in scene.geometry.items()
            if isinstance(wall, Mesh)
        }
        if scene.effect_digests:  # likewise of a file with an effect
            table["effect_digests"] = scene.effect_digests
    canonical = json.dumps(table, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return sha256(canonical.encode()).hexdigest()[:HASH_LENGTH]
