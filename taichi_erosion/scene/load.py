"""Reading a scene file: TOML, its kind, overrides, validation, hash; a problem raises BadInput in a line."""

import json
import shlex
import tomllib
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import suppress
from copy import deepcopy
from functools import lru_cache
from hashlib import sha256
from pathlib import Path
from typing import Any, Literal, TypeVar

from pydantic import TypeAdapter, ValidationError

from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.files import one_line_name, read_text_file
from taichi_erosion.scene.checks import air_faults, scene_contradictions
from taichi_erosion.scene.paths import set_value_by_override
from taichi_erosion.scene.preparation.sizes import nominal_diameter
from taichi_erosion.scene.schema.air import AirScene
from taichi_erosion.scene.schema.fields import DIAMETER, DIAMETERS, FOR_HASH
from taichi_erosion.scene.schema.geometry import Hull
from taichi_erosion.scene.schema.grains import Bed, Pour, Size
from taichi_erosion.scene.schema.scene import Scene

S = TypeVar("S", Scene, AirScene)
FileKind = Literal["table", "study", "scene"]
SIZES: TypeAdapter[Size] = TypeAdapter(Size)

INSTALLED, SOURCE = Path(__file__).parent / "shipped", Path(__file__).parents[2] / "scenes"
SCENES = INSTALLED if INSTALLED.is_dir() else SOURCE  # folder of the scenes that come with the program
MOST_TREES = 16  # kept
HASH_LENGTH = 12  # hexadecimal digits
NOT_HASHED = {
    "scene": {"title", "notes", "effect_files"},
    "run": {"replicas", "seed", "frames"},
    "record": True,
    "measured": True,
}
ENDINGS: Mapping[str, str] = {
    **dict.fromkeys((".csv", ".tsv", ".xlsx", ".xlsm", ".xls", ".ods"), "table"),
    ".rrd": "recording",
    ".py": "effect",
}
REMEDIES: Mapping[str, str] = {
    "table": "is a table of measurements; make a study of it: ./erosion study new {path}",
    "study": "is a study; the commands on it are: ./erosion study check {path}, ./erosion compare {path}",
    "scene": "is a scene; simulate it: ./erosion run {path}",
    "recording": "is the recording of a run; look at it: ./erosion view {path}",
    "effect": "is a Python file; an effect file is named beside a study or a scene: --effect {path}",
}
TAGS = ("law", "shape")  # entries that choose the form of a section
LONGEST_VALUE = 60  # characters of a value that a message repeats
SENTENCES = {  # by kind of error; pydantic tells the others
    "finite_number": "must be a finite number",
    "float_type": "must be a number",
    **dict.fromkeys(("int_type", "int_from_float"), "must be a whole number"),
    "bool_type": "must be true or false",
    "string_type": "must be text in quotes",
    "tuple_type": "must be a list",
    **dict.fromkeys(("dict_type", "model_type", "model_attributes_type"), "must be a table"),
    "string_pattern_mismatch": "must be a name of letters, digits and _ (a contact: two names joined by -)",
}


def refuse_other_kind(path: Path, ours: FileKind, *also: str) -> None:
    """Raise BadInput, with the right command, for a folder or a file that is certainly of another kind."""
    name = one_line_name(path)
    if path.is_dir():
        raise BadInput(f"{name}: is a folder; name a {ours}")
    kind = kind_of_file(path)
    if kind not in (None, ours, *also) and path.is_file():
        raise BadInput(f"{name}: {REMEDIES[kind].format(path=shlex.quote(name))}; a {ours} is wanted here")


def kind_of_file(path: Path) -> str | None:
    """Kind of a file by its ending or its sections; None where they do not tell, or it cannot be read."""
    if path.suffix.lower() != ".toml":
        return ENDINGS.get(path.suffix.lower())
    try:
        table = parse_toml(read_text_file(path))
    except (OSError, ValueError, RecursionError):
        return None
    if "study" in table or "observables" in table:
        return "study"
    return "scene" if "scene" in table or "grains" in table else None


def load_scene(
    path: str | Path, overrides: Sequence[str] = (), observables: Collection[str] | None = None
) -> Scene:
    """Validated scene of a TOML file.

    `overrides` are PATH=VALUE. `observables` are those of the program; None: their names are not checked.
    """
    return parse_scene(read_toml(path), one_line_name(path), Path(path).parent, overrides, observables)


def load_air_scene(
    path: str | Path, overrides: Sequence[str] = (), observables: Collection[str] | None = None
) -> AirScene:
    name = one_line_name(path)
    return validate(AirScene, read_toml(path), name, overrides, lambda scene: air_faults(scene, observables))


def is_air_scene(path: Path) -> bool:
    """Whether a file describes air alone; an unreadable file does not."""
    try:
        table = read_toml(path)
    except BadInput:
        return False
    return "air" in table and "grains" not in table


def read_toml(path: str | Path, kind: FileKind = "scene") -> dict[str, Any]:
    """Raw table of a TOML file of the wanted kind."""
    name = one_line_name(path)
    refuse_other_kind(Path(path), kind)
    try:
        return deepcopy(dict(parse_toml(read_text_of_file(Path(path), name))))
    except (ValueError, RecursionError) as error:
        rules = "text stands in quotes, and decimals have a point"
        raise BadInput(f"{name}: not a TOML file: {first_error_line(error)}; {rules}") from None


@lru_cache(maxsize=MOST_TREES)
def parse_toml(text: str) -> Mapping[str, Any]:
    """Tree of a TOML text, shared by all who read it: a plan reads one file for every run."""
    return tomllib.loads(text)


def read_text_of_file(path: Path, name: str) -> str:
    try:
        return read_text_file(path)
    except FileNotFoundError:
        raise BadInput(f"{name}: no such file") from None
    except (OSError, ValueError) as error:
        raise BadInput(f"{name}: cannot be read as text: {first_error_line(error)}") from None


def parse_scene(
    table: Mapping[str, Any],
    name: str = "scene",
    folder: Path = Path(),
    overrides: Sequence[str] = (),
    observables: Collection[str] | None = None,
) -> Scene:
    """Validated scene of a raw table, as TOML or `resolve` gives it."""

    def contradictions_of_scene(scene: Scene) -> Iterator[str]:
        scene._folder = folder
        return scene_contradictions(scene, observables)

    return validate(Scene, table, name, overrides, contradictions_of_scene)


def validate(
    kind: type[S],
    table: Mapping[str, Any],
    name: str,
    overrides: Sequence[str],
    problems: Callable[[S], Iterator[str]],
) -> S:
    """Scene without problems, of a raw table."""
    raw, diameter = deepcopy(dict(table)), None
    try:
        for override in overrides:
            set_value_by_override(raw, override)
        raw = lists_to_tuples(raw)
        with suppress(ValidationError, KeyError, TypeError):  # of the sizes: told below
            diameter = (
                nominal_diameter(SIZES.validate_python(raw["grains"]["size"])) if kind is Scene else None
            )
        scene = kind.model_validate(raw, context={DIAMETER: diameter})
        scene._file = name
        if lines := list(problems(scene)):
            raise BadInput(*lines)
        return scene
    except BadInput as error:
        lines = error.faults
    except ValidationError as error:
        lines = error_lines(error, raw, diameter)
    except (OverflowError, RecursionError) as error:
        lines = [f"cannot be used: {first_error_line(error)}"]
    raise BadInput(*fault_lines(name, lines)) from None


def error_lines(error: ValidationError, table: Any, diameter: float | None = None) -> list[str]:
    """One line for every error, in the order of the file's sections.

    Without a nominal diameter [m] lengths in diameters cannot be judged: of a scene only the grains are.
    """
    entries = error.errors(include_url=False)
    grains = [entry for entry in entries if entry["loc"][:1] == ("grains",)]
    return [error_line_of(entry, table) for entry in (grains if diameter is None and grains else entries)]


def error_line_of(entry: Any, table: Any) -> str:
    """`grains.count = -3 lies outside [1, 5e+06]`."""
    kind, context = entry["type"], entry.get("ctx", {})
    words, value_there = keys_and_value_of_place(entry["loc"], table)
    where, tag = join_dotted_path(words), context.get("discriminator", "").strip("'")
    if kind == "unknown":
        return f"{join_dotted_path([*words, context['key']])} is unknown; {context['hint']}"
    if kind == "contradiction":
        return f"{where}: {context['message']}"
    if kind == "missing":
        return f"{where} is missing"
    if kind == "union_tag_not_found":
        return f"{where}.{tag} is missing"
    if kind == "union_tag_invalid":
        return f"{where}.{tag} = {short_value(context['tag'])} is not one of {context['expected_tags']}"
    value = short_value(entry["input"])
    if words and words[-1].endswith(DIAMETERS):
        value = f"{short_value(value_there)} diameters: {value}"
    text = entry["msg"].replace("Input should be", "is not one of" if kind == "literal_error" else "must be")
    return f"{where} = {value} {SENTENCES.get(kind, text[:1].lower() + text[1:])}"


def keys_and_value_of_place(location: tuple[str | int, ...], table: Any) -> tuple[list[str], Any]:
    """Keys of a place as the file has them, and its value there.

    Left out are tags of unions (a section's own `law` or `shape`) and marks of keys; what was given in
    diameters keeps its suffix.
    """
    words: list[str] = []
    for key in location:
        spelling = key
        if isinstance(table, dict) and key not in table:
            if key in [table.get(name) for name in TAGS]:
                continue
            spelling = f"{key}{DIAMETERS}" if f"{key}{DIAMETERS}" in table else key
        if key != "[key]":
            words.append(str(spelling))
            try:
                table = table[spelling]
            except (KeyError, IndexError, TypeError):
                table = None
    return words, table


def join_dotted_path(words: list[str]) -> str:
    return ".".join(map(printable_line, words)) or "the file"


def short_value(value: Any) -> str:
    if isinstance(value, dict):
        return "a table"
    if isinstance(value, tuple):
        value = list(value)
    return printable_line(f"'{value}'" if isinstance(value, str) else repr(value))


def printable_line(text: str) -> str:
    """Printable text without line breaks, at most LONGEST_VALUE characters."""
    clean = "".join(c if c.isprintable() else "?" for c in text[: LONGEST_VALUE + 1])
    return clean if len(clean) <= LONGEST_VALUE else clean[: LONGEST_VALUE - 3] + "..."


def lists_to_tuples(value: Any) -> Any:
    """The same tree with tuples for lists, as frozen records hold them."""
    if isinstance(value, dict):
        return {key: lists_to_tuples(entry) for key, entry in value.items()}
    return tuple(map(lists_to_tuples, value)) if isinstance(value, list | tuple) else value


def fault_lines(name: str, lines: Sequence[str]) -> list[str]:
    return [f"{name}: {line}" for line in lines]


def first_error_line(error: Exception) -> str:
    lines = str(error).splitlines()
    return lines[0] if lines else type(error).__name__


def scene_hash(scene: Scene | AirScene) -> str:
    """Name of the physical situation: 12 hexadecimal digits of a SHA-256.

    Independent of seeds, number of replicas, recording, titles, measured values, comments, order of keys.
    """
    table = scene.model_dump(mode="json", exclude_none=True, exclude=NOT_HASHED, context=FOR_HASH)
    if isinstance(scene, Scene):
        table["contact"] = {"-".join(sorted(pair.split("-"))): row for pair, row in table["contact"].items()}
        inlets = scene.fill.parts if isinstance(scene.fill, Pour) else {}
        table["meshes"] = {  # the content of a mesh file counts, not its name
            name: sha256((scene.folder / mesh.file).read_bytes()).hexdigest()
            for name, mesh in [*scene.geometry.items(), *((path, each.mesh) for path, each in inlets.items())]
            if isinstance(mesh, Hull)
        }
        for name, order in scene.measure.items():
            if order.file is not None:
                table["measure"][name]["file"] = sha256((scene.folder / order.file).read_bytes()).hexdigest()
        if isinstance(scene.fill, Bed):
            table["bed"] = sha256((scene.folder / scene.fill.file).read_bytes()).hexdigest()
        if scene.effect_digests:  # likewise of a file with an effect
            table["effect_digests"] = scene.effect_digests
    canonical = json.dumps(table, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return sha256(canonical.encode()).hexdigest()[:HASH_LENGTH]
