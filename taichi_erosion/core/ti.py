"""The one place that imports Taichi; every kernel file takes `ti` from here.

Taichi inlines every device function where it is called. Each time it reads the source of the function anew,
cuts it into tokens, and lays out the description of every source position: the 600 calls in the kernels of a
run cost more than their translation. It also looks around each decorator for a class, and keeps the stack of
calls that declared each field. Here sources and positions are remembered and the rest is left out. No kernel
changes by it.
"""

import ast
import inspect
import os
import sys
import textwrap
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from types import FunctionType
from typing import Any

os.environ.setdefault("ENABLE_TAICHI_HEADER_PRINT", "0")
# Taichi aborts the process where no home is named, as under cron or in a container; any folder will do
os.environ.setdefault("HOME", os.path.expanduser("~") if os.path.isabs(os.path.expanduser("~")) else os.sep)


@contextmanager
def frames_without_source() -> Iterator[None]:
    """Leave source lines out of what frames tell: no kernel stands in a class, here or in Taichi."""
    describe_frame = inspect.getframeinfo
    setattr(inspect, "getframeinfo", lambda frame, context=1: describe_frame(frame, context=0))  # noqa: B010
    try:
        yield
    finally:
        setattr(inspect, "getframeinfo", describe_frame)  # noqa: B010


with frames_without_source():
    import taichi as ti
    from taichi.lang import impl, kernel_impl, snode
    from taichi.lang.ast.ast_transformer_utils import ASTTransformerContext

__all__ = ["impl", "ti"]


@dataclass(frozen=True)
class Source:
    """Text of one device function."""

    file: str
    first_line: int
    lines: list[str]  # as they stand in the file
    text: str  # without the indentation that they share


def read_source(function: FunctionType) -> Source:
    """Text of a device function, from its file."""
    lines, first_line = inspect.getsourcelines(function)
    bare = [line.rstrip().expandtabs(4) for line in lines]
    file = inspect.getsourcefile(function) or inspect.getfile(function)
    return Source(file, first_line, bare, textwrap.dedent("\n".join(bare)))


def remember_sources() -> None:
    """Read the source of every device function once, however often it is inlined."""
    known: dict[Any, Source] = {}

    def tree_and_context(
        owner: Any,
        excluded_parameters: Any = (),
        is_kernel: bool = True,
        arg_features: Any = None,
        args: Any = None,
        **others: Any,
    ) -> tuple[ast.Module, ASTTransformerContext]:
        code = owner.func.__code__
        place = (code.co_filename, code)  # functions made anew by a closure share their code
        if place not in known:
            known[place] = read_source(owner.func)
        source = known[place]
        tree = ast.parse(source.text)
        setattr(tree.body[0], "decorator_list", [])  # noqa: B010
        names = getattr(kernel_impl, "_get_global_vars")(owner.func)  # noqa: B009
        if is_kernel or others.get("is_real_function"):
            names |= {owner.arguments[slot].name: args[slot] for slot in owner.template_slot_locations}
        return tree, ASTTransformerContext(
            excluded_parameters=excluded_parameters,
            is_kernel=is_kernel,
            func=owner,
            arg_features=arg_features,
            global_vars=names,
            argument_data=args,
            src=source.lines,
            start_lineno=source.first_line,
            file=source.file,
            **others,
        )

    setattr(kernel_impl, "_get_tree_and_ctx", tree_and_context)  # noqa: B010


def remember_positions() -> None:
    """Describe every source position that Taichi compiles once; a statement by its first line."""
    known: dict[tuple[Any, ...], str] = {}

    def recall(context: Any, node: Any) -> str:
        place = (
            context.file,
            context.lineno_offset,
            node.lineno,
            node.col_offset,
            node.end_lineno,
            node.end_col_offset,
        )
        if place not in known:
            known[place] = describe(context, node)
        return known[place]

    setattr(ASTTransformerContext, "get_pos_info", recall)  # noqa: B010


def describe(context: Any, node: Any) -> str:
    """File, line and function of a node, its source, and marks below it."""
    line = context.src[node.lineno - 1]
    first = context.indent + node.col_offset
    last = context.indent + node.end_col_offset if node.lineno == node.end_lineno else len(line)
    where = (
        f'File "{context.file}", line {node.lineno + context.lineno_offset}, in {context.func.func.__name__}:'
    )
    return f"{where}\n{line}\n{' ' * first}{'^' * (last - first)}\n"


def place_of_caller(stacklevel: int = 1) -> str:
    """File and line of a caller of Taichi, where a field is declared."""
    frame = sys._getframe(stacklevel + 1)
    return f"{frame.f_code.co_filename}:{frame.f_lineno}"


def look_around_less() -> None:
    """Take decorated functions for free ones, and keep one line for a declaration."""
    setattr(kernel_impl, "_inside_class", lambda level_of_class_stackframe: False)  # noqa: B010
    for module in (impl, snode):
        setattr(module, "get_traceback", place_of_caller)  # noqa: B010


remember_sources()
remember_positions()
look_around_less()
