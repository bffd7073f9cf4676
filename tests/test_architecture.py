"""The house rules a linter cannot express.

A device function is a Taichi kernel or function. It may write to its own variables, and to what can be
reached from an argument whose name ends in `_out`; a reader of a signature then knows what a call changes.
"""

import ast
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path

import pytest
from device_code import (
    PACKAGE,
    ROOT,
    aliases_of,
    decorators,
    dotted,
    functions,
    is_device_function,
    nodes,
    path_of,
    tree_of,
    written_places,
)

LONGEST_FUNCTION = {False: 60, True: 40}  # lines of a host and of a device function, docstring excluded
LONGEST_FILE = 500  # lines
MOST_ARGUMENTS, MOST_DEVICE_ARGUMENTS = 7, 14
# a command has one argument for every word that can be typed
TYPED = {PACKAGE / "cli" / name for name in ("commands.py", "evidence.py", "wind.py")}
MOST_MODULES = 15  # of a folder; one effect or mechanism is one file, so theirs may hold more

SOURCES = [*sorted(PACKAGE.rglob("*.py")), ROOT / "erosion"]


def each_file(broken: Callable[[Path], Iterator[str]]) -> Callable[[], None]:
    """Test that no file breaks a rule; `broken` yields what breaks it in one file."""

    def test() -> None:
        found = {str(path.relative_to(ROOT)): list(broken(path)) for path in SOURCES}
        assert {path: problems for path, problems in found.items() if problems} == {}

    return test


@cache
def device_signatures() -> dict[str, list[str]]:
    """Argument names of every Taichi function whose name occurs once in the package."""
    found: dict[str, list[list[str]]] = {}
    for tree in map(tree_of, SOURCES):
        for function in filter(is_device_function, functions(tree)):
            found.setdefault(function.name, []).append([argument.arg for argument in function.args.args])
    return {name: signatures[0] for name, signatures in found.items() if len(signatures) == 1}


def handed_over(function: ast.FunctionDef, signatures: dict[str, list[str]]) -> Iterator[ast.expr]:
    """Arguments of calls that the called function writes to."""
    for node in ast.walk(function):
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
            positional = list(zip(signatures.get(node.func.id, []), node.args, strict=False))
            named = [(keyword.arg or "", keyword.value) for keyword in node.keywords]
            yield from (argument for name, argument in positional + named if name.endswith("_out"))


def silent_writes(function: ast.FunctionDef, signatures: dict[str, list[str]]) -> set[str]:
    """What the function changes although no name says so."""
    aliases, names = aliases_of(function), [node for node in ast.walk(function) if isinstance(node, ast.Name)]
    # names that belong to the function alone: writing to them is nobody else's concern
    own = {node.id for node in names if isinstance(node.ctx, ast.Store)} - set(aliases)
    own -= {argument.arg for argument in function.args.args}
    changed = [*written_places(function), *handed_over(function, signatures)]
    paths = {ast.unparse(expression): path_of(expression, aliases) for expression in changed}
    return {t for t, p in paths.items() if p and p[0] not in own and not p[0].endswith("_out")}


@each_file
def test_files_and_functions_stay_short(path):
    if len(path.read_text(encoding="utf-8").splitlines()) > LONGEST_FILE:
        yield "the file"
    for function in functions(tree_of(path)):
        first = function.body[ast.get_docstring(function) is not None and len(function.body) > 1]
        assert function.end_lineno is not None
        if function.end_lineno - first.lineno >= LONGEST_FUNCTION[is_device_function(function)]:
            yield function.name


@each_file
def test_signatures_stay_short(path):
    for function in functions(tree_of(path)):
        count = len([*function.args.posonlyargs, *function.args.args, *function.args.kwonlyargs])
        most = MOST_DEVICE_ARGUMENTS if is_device_function(function) else MOST_ARGUMENTS
        if count > most and path not in TYPED:
            yield function.name


def test_folders_stay_small():
    free = {PACKAGE / "effect_library", PACKAGE / "mechanisms" / "basis"}
    counts = {path.parent: len(list(path.parent.glob("[!_]*.py"))) for path in PACKAGE.rglob("*.py")}
    assert {folder for folder, count in counts.items() if count > MOST_MODULES} - free == set()


@each_file
def test_kernels_are_free_functions(path):
    for node in nodes(tree_of(path)):
        if isinstance(node, ast.ClassDef):
            owned = [f.name for f in node.body if isinstance(f, ast.FunctionDef) and is_device_function(f)]
            yield from (f"{node.name} owns the kernel {name}" for name in owned)
            if "ti.data_oriented" in decorators(node):
                yield node.name


@each_file
def test_kernels_are_nested_only_where_a_choice_is_compiled(path):
    for owner in functions(tree_of(path)):
        nested = [f.name for f in functions(owner) if f is not owner and is_device_function(f)]
        if nested and not owner.name.startswith("compile_"):
            yield f"{owner.name} holds {nested}"


@each_file
def test_device_functions_say_what_they_write(path):
    for function in filter(is_device_function, functions(tree_of(path))):
        if silent := silent_writes(function, device_signatures()):
            yield f"{function.name} writes {sorted(silent)} without the _out suffix"


@each_file
def test_annotations_of_kernels_are_types_and_not_text(path):
    if any(map(is_device_function, functions(tree_of(path)))) and "__future__" in modules_of(path):
        yield "Taichi rejects annotations that are text"


def modules_of(path: Path) -> set[str]:
    found = {node.module or "" for node in nodes(tree_of(path)) if isinstance(node, ast.ImportFrom)}
    imports = (node for node in nodes(tree_of(path)) if isinstance(node, ast.Import))
    return found | {name.name for node in imports for name in node.names}


@each_file
def test_the_engine_is_started_and_text_is_run_as_code_in_one_file_each(path):
    calls = {dotted(node.func) for node in nodes(tree_of(path)) if isinstance(node, ast.Call)}
    named = {dotted(node) for node in nodes(tree_of(path)) if isinstance(node, ast.Attribute)}
    engines = {module.partition(".")[0] for module in modules_of(path)} & {"taichi", "quadrants"}
    alone = {
        "ti.py": engines | {name for name in named if name.startswith("ti.lang")},
        "device.py": calls & {"ti.init"},
        "effect_file.py": calls & {"eval", "exec", "compile", "__import__"},  # docs/trust.md
    }
    for name, found in alone.items():
        if path != PACKAGE / "core" / name:
            yield from found


@pytest.mark.parametrize("room", ["air", "coupling", "grains"])
def test_records_of_fields_are_no_dataclasses(room):
    records = [
        node.name
        for path in SOURCES
        for node in nodes(tree_of(path))
        if room in path.parts and isinstance(node, ast.ClassDef) and "dataclass" in decorators(node)
        if any(isinstance(e, ast.AnnAssign) and ast.unparse(e.annotation) == "Any" for e in node.body)
    ]
    assert records == [], "kernels take these; use core.transfer.device_record"


SILENT = {
    "a member of an argument": "def f(grains: ti.template()):\n    grains.velocity[0] += 1.0",
    "a component of an element": "def f(x: ti.template()):\n    x[0].z = 1.0",
    "an argument by its bare name": "def f(total: ti.template()):\n    total += 1.0",
    "a field of the surroundings": "def f():\n    counter[None] += 1",
    "an argument through an atomic": "def f(x: ti.template()):\n    ti.atomic_add(x[0], 1.0)",
    "another name of an argument": "def f(g: ti.template()):\n    v = ti.static(g.velocity)\n    v[0] = 1.0",
    "one of two other names": "def f(w: ti.template()):\n    a, b = ti.static((w.a, w.b))\n    b[0] = 1.0",
    "a picked other name": "def f(w: ti.template()):\n    a = ti.static((w.a,))[0]\n    a[0] = 1.0",
    "a list": "def f(found: ti.template()):\n    found.append(1)",
    "an argument through a call": "def f(x: ti.template()):\n    clear(x)",
}
SPOKEN = {
    "a member of a marked argument": "def f(grains_out: ti.template()):\n    grains_out.velocity[0] += 1.0",
    "its own vector": "def f(x: ti.template()):\n    y = x[0] + x[1]\n    y[0] = 1.0",
    "its own loop variable": "def f(x: ti.template()):\n    for y in range(3):\n        y += 1",
    "another name of a marked one": "def f(g_out: ti.template()):\n    v = ti.static(g_out.v)\n    v[0] = 1",
    "a marked argument through a call": "def f(x_out: ti.template()):\n    clear(x_out)",
}


@pytest.mark.parametrize("source", [*SILENT.values(), *SPOKEN.values()], ids=[*SILENT, *SPOKEN])
def test_a_write_is_silent_unless_the_signature_shows_it(source):
    (function,) = functions(ast.parse(source))
    assert bool(silent_writes(function, {"clear": ["field_out"]})) == (source in SILENT.values())
