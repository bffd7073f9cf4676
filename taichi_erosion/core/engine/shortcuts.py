"""Shortcuts through the front ends of both engines: kernels are built faster, and no number changes.

Both engines inline every device function where it is called, and on each call read its source; around each
they look through the stack for a class. Taichi also describes every source position each time. quadrants
builds every kernel twice, first to find the members of dataclasses that nothing uses, and searches every
syntax tree for them; kernels take no dataclass here. So sources and descriptions are cached, and the
inspection of the stack, the first building and the search are skipped.

All of it replaces internals of two versions.
"""

import ast
import textwrap
from collections.abc import Callable
from importlib import import_module
from types import SimpleNamespace
from typing import Any

READERS = {  # engine -> its module that reads sources of device functions, and the functions that do
    "taichi": ("taichi.lang.kernel_impl", ("getsourcefile", "getsourcelines")),
    "quadrants": ("quadrants.lang._func_base", ("get_source_info_and_src",)),
}


def take_shortcuts(engine: str) -> None:
    """Replace internals of the front end of an engine that has been imported."""
    kernel_impl = import_module(f"{engine}.lang.kernel_impl")
    # decorated functions are free ones here
    setattr(kernel_impl, "_inside_class", lambda level_of_class_stackframe: False)  # noqa: B010
    cache_sources(*READERS[engine])
    if engine == "taichi":
        cache_positions()
    else:
        build_once()


def cache_sources(path: str, readers: tuple[str, ...]) -> None:
    """Read the source of every device function once, and do not wrap its lines."""
    module = import_module(path)
    for name in readers:
        setattr(module, name, once_a_code(getattr(module, name)))
    setattr(module, "textwrap", SimpleNamespace(fill=bare_line, dedent=textwrap.dedent))  # noqa: B010


def once_a_code(read: Callable[[Any], Any]) -> Callable[[Any], Any]:
    """A function of a function with its answers cached; functions of one closure share their code."""
    known: dict[Any, Any] = {}

    def answer(function: Any) -> Any:
        code = function.__code__
        return known.get(code) or known.setdefault(code, read(function))

    return answer


def bare_line(line: str, tabsize: int, width: int) -> str:
    """A line of source without its end, tabs as spaces."""
    return line.rstrip().expandtabs(tabsize)


def cache_positions() -> None:
    """Taichi describes every compiled source position once; a statement by its first line."""
    context_type = import_module("taichi.lang.ast.ast_transformer_utils").ASTTransformerContext
    known: dict[tuple[Any, ...], str] = {}

    def position_info(context: Any, node: Any) -> str:
        span = (node.lineno, node.col_offset, node.end_lineno, node.end_col_offset)
        key = (context.file, context.lineno_offset, *span)
        return known.get(key) or known.setdefault(key, describe(context, node))

    setattr(context_type, "get_pos_info", position_info)  # noqa: B010


def describe(context: Any, node: Any) -> str:
    """File, line and function of a node, its source line, and marks below it."""
    line = context.src[node.lineno - 1]
    first = context.indent + node.col_offset
    last = context.indent + node.end_col_offset if node.lineno == node.end_lineno else len(line)
    place = f'File "{context.file}", line {node.lineno + context.lineno_offset}'
    return f"{place}, in {context.func.func.__name__}:\n{line}\n{' ' * first}{'^' * (last - first)}\n"


def build_once() -> None:
    """Quadrants leaves out what it does for dataclasses: the first building of a kernel, and a search."""
    kernel = import_module("quadrants.lang.kernel").Kernel
    dataclasses = import_module("quadrants.lang._kernel_impl_dataclass")
    look_up, flatten = kernel._try_load_fastcache, dataclasses.unpack_ast_struct_expressions

    def used_members(owner: Any, args: Any, key: Any) -> set[str]:
        """Members of dataclasses that a kernel uses: none. The answer None would ask for a first building."""
        look_up(owner, args, key)
        return owner.used_py_dataclass_parameters_by_key_enforcing.setdefault(key, set())

    def flattened(tree: ast.Module, struct_locals: set[str]) -> ast.Module:
        return flatten(tree, struct_locals) if struct_locals else tree

    setattr(kernel, "_try_load_fastcache", used_members)  # noqa: B010
    setattr(dataclasses, "unpack_ast_struct_expressions", flattened)  # noqa: B010
