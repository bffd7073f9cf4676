"""What device code writes, read from the syntax tree."""

import ast
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parent.parent
PACKAGE = ROOT / "taichi_erosion"
WRITING_METHODS = {"append", "deactivate", "fill"}  # of Taichi fields

Place = tuple[str, str]  # module and name of a device function


@cache
def nodes(tree: ast.AST) -> tuple[ast.AST, ...]:
    """All nodes of a tree, walked once for every rule that reads them."""
    return tuple(ast.walk(tree))


@cache
def functions(tree: ast.AST) -> tuple[ast.FunctionDef, ...]:
    return tuple(node for node in nodes(tree) if isinstance(node, ast.FunctionDef))


def dotted(expression: ast.AST) -> str:
    """`a.b.c` of names and members, empty for any other expression."""
    if isinstance(expression, ast.Attribute):
        return f"{dotted(expression.value)}.{expression.attr}"
    return expression.id if isinstance(expression, ast.Name) else ""


def decorators(node: ast.FunctionDef | ast.ClassDef) -> set[str]:
    return {dotted(each.func if isinstance(each, ast.Call) else each) for each in node.decorator_list}


def is_device_function(function: ast.FunctionDef) -> bool:
    return bool(decorators(function) & {"ti.kernel", "ti.func", "ti.pyfunc", "ti.real_func"})


@cache
def tree_of(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


@cache
def trees() -> dict[str, ast.Module]:
    """Syntax trees of the package by module name."""
    paths = sorted(PACKAGE.rglob("*.py"))
    return {".".join(path.relative_to(ROOT).with_suffix("").parts): tree_of(path) for path in paths}


@cache
def device_functions() -> dict[Place, ast.FunctionDef]:
    found = ((module, f) for module, tree in trees().items() for f in functions(tree))
    return {(module, f.name): f for module, f in found if is_device_function(f)}


def path_of(expression: ast.expr, aliases: dict[str, tuple[str, ...]]) -> tuple[str, ...] | None:
    """Argument and members that an expression reaches, up to the first index: `a.b.c[i].x` is (a, b, c)."""
    members: list[str] = []
    while isinstance(expression, ast.Attribute | ast.Subscript):
        if isinstance(expression, ast.Subscript):
            members.clear()
        else:
            members.append(expression.attr)
        expression = expression.value
    if not isinstance(expression, ast.Name):
        return None
    return (*aliases.get(expression.id, (expression.id,)), *reversed(members))


def static_content(value: ast.expr) -> ast.expr | None:
    """What `ti.static(content)` or `ti.static(content)[k]` stands for: another name of it, not a copy."""
    if isinstance(value, ast.Call) and ast.unparse(value.func) == "ti.static":
        return value.args[0]
    if isinstance(value, ast.Subscript) and isinstance(value.slice, ast.Constant):
        content = static_content(value.value)
        return content.elts[value.slice.value] if isinstance(content, ast.Tuple) else content
    return None


def aliases_of(function: ast.FunctionDef) -> dict[str, tuple[str, ...]]:
    """Names that `ti.static` makes for something reached from another name."""
    found: dict[str, tuple[str, ...]] = {}
    for node in ast.walk(function):
        if not isinstance(node, ast.Assign) or (content := static_content(node.value)) is None:
            continue
        contents = content.elts if isinstance(content, ast.Tuple) else [content]
        for target, origin in zip(getattr(node.targets[0], "elts", node.targets), contents, strict=False):
            if isinstance(target, ast.Name) and (path := path_of(origin, found)):
                found[target.id] = path
    return found


def written_places(function: ast.FunctionDef) -> list[ast.expr]:
    """Every expression that the function changes in place itself."""
    found: list[ast.expr] = []
    annotations = {each.arg: ast.unparse(each.annotation) for each in function.args.args if each.annotation}
    # assigning to the bare name of such an argument changes the caller's variable
    templates = {name for name, text in annotations.items() if "ti.template" in text}
    for node in ast.walk(function):
        if isinstance(node, ast.Name | ast.Attribute | ast.Subscript) and isinstance(node.ctx, ast.Store):
            found += [node] if not isinstance(node, ast.Name) or node.id in templates else []
        elif isinstance(node, ast.Call):
            if ast.unparse(node.func).startswith("ti.atomic_"):
                found.append(node.args[0])
            elif isinstance(node.func, ast.Attribute) and node.func.attr in WRITING_METHODS:
                found.append(node.func.value)
    return found
