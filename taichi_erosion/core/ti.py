"""The one place that imports Taichi; every kernel file takes `ti` from here.

Taichi inlines every device function where it is called. Each time it reads the source of the function anew,
cuts it into tokens, and lays out the description of every source position: the 600 calls in the kernels of a
run cost more than their translation. It also looks around each decorator for a class, and keeps the stack of
calls that declared each field. Here sources and positions are remembered and the rest is left out. Sums and
products of small vectors and matrices, which Taichi reads from sources of its own as often as they occur, are
put down at once, in the same order of operations. No number changes by it.
"""

import ast
import functools
import inspect
import os
import sys
import textwrap
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from types import FunctionType
from typing import Any

import numpy as np

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
    from taichi.lang import impl, kernel_impl, matrix_ops, snode
    from taichi.lang.ast.ast_transformer_utils import ASTTransformerContext
    from taichi.lang.expr import Expr

__all__ = ["impl", "ti"]

OWNER = "source"  # attribute of a tree: to whom it is given back, or None


@dataclass(frozen=True)
class Source:
    """Text of one device function."""

    file: str
    first_line: int
    lines: list[str]  # as they stand in the file
    text: str  # without the indentation that they share
    trees: list[ast.Module]  # of the text, that nobody is reading now


def read_source(function: FunctionType) -> Source:
    """Text of a device function, from its file."""
    lines, first_line = inspect.getsourcelines(function)
    bare = [line.rstrip().expandtabs(4) for line in lines]
    file = inspect.getsourcefile(function) or inspect.getfile(function)
    return Source(file, first_line, bare, textwrap.dedent("\n".join(bare)), [])


def source_of(function: Any, known_out: dict[Any, Source]) -> Source:
    """Source of a function; functions made anew by a closure share their code."""
    code = function.__code__
    place = (code.co_filename, code)
    if place not in known_out:
        known_out[place] = read_source(function)
    return known_out[place]


def take_tree(source: Source, is_kernel: bool) -> ast.Module:
    """Syntax tree of a source, to be given back when it has been read.

    Taichi notes in the tree of a function what it finds there, and changes nothing else, so that it can be
    read again. A kernel's tree loses its arguments and is nobody's.
    """
    if source.trees and not is_kernel:
        return source.trees.pop()
    tree = ast.parse(source.text)
    setattr(tree.body[0], "decorator_list", [])  # noqa: B010
    setattr(tree, OWNER, None if is_kernel else source)
    return tree


def remember_sources() -> None:
    """Read the source of every device function once, however often it is inlined."""
    known: dict[Any, Source] = {}
    transform = kernel_impl.transform_tree

    def tree_and_context(
        owner: Any,
        excluded_parameters: Any = (),
        is_kernel: bool = True,
        arg_features: Any = None,
        args: Any = None,
        **others: Any,
    ) -> tuple[ast.Module, ASTTransformerContext]:
        source = source_of(owner.func, known)
        names = getattr(kernel_impl, "_get_global_vars")(owner.func)  # noqa: B009
        if is_kernel or others.get("is_real_function"):
            names |= {owner.arguments[slot].name: args[slot] for slot in owner.template_slot_locations}
        return take_tree(source, is_kernel), ASTTransformerContext(
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

    def transform_and_give_back(tree: ast.Module, context: ASTTransformerContext) -> Any:
        answer = transform(tree, context)
        owner = getattr(tree, OWNER)
        if owner is not None:
            owner.trees.append(tree)
        return answer

    setattr(kernel_impl, "_get_tree_and_ctx", tree_and_context)  # noqa: B010
    setattr(kernel_impl, "transform_tree", transform_and_give_back)  # noqa: B010


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


def elements(matrix: Any) -> Callable[..., Any]:
    """Function that picks elements of a matrix of the device, once it has been worked out."""
    known: Any = impl.expr_init_func(matrix)
    callable_now: Any = impl.get_runtime().compiling_callable
    return lambda *place: impl.subscript(callable_now.ast_builder(), known, *place)


def sum_at_once(matrix: Any, add: Any) -> Any:
    """All elements joined by an operation, from the first to the last."""
    element = elements(matrix)
    total, *rest = [element(*place) for place in np.ndindex(*matrix.get_shape())]
    for number in rest:
        total = add(total, number)
    return total


def multiply_at_once(first: Any, second: Any) -> Any:
    """Product of two matrices, or of a matrix and a vector, of the device."""
    (rows, inner), columns = first.get_shape(), second.get_shape()[1:]
    left, right = elements(first), elements(second)
    # as Taichi begins, which gives the product its type
    zero = impl.expr_init(left(0, 0) * right(0, *(0 for _ in columns)) * 0)

    def number(row: int, *column: int) -> Any:
        total = zero
        for k in range(inner):
            total = total + left(row, k) * right(k, *column)
        return total

    table = [[number(row, *column) for column in np.ndindex(*columns)] for row in range(rows)]
    return ti.Matrix(table) if columns else ti.Vector([row[0] for row in table])


def are_on_device(*words: Any) -> bool:
    """Whether a kernel is being read and its own matrices or vectors are meant."""
    return impl.inside_kernel() and all(isinstance(word, Expr) for word in words)


def put_down_at_once() -> None:
    """Sums and products within kernels without a reading of their source; elsewhere as they were."""
    add_up, multiply = (getattr(matrix_ops, name) for name in ("_reduce", "_matmul_helper"))

    @functools.wraps(add_up)
    def sum_anywhere(matrix: Any, add: Any) -> Any:
        return (sum_at_once if are_on_device(matrix) else add_up)(matrix, add)

    @functools.wraps(multiply)
    def multiply_anywhere(first: Any, second: Any) -> Any:
        at_once = are_on_device(first, second) and len(first.get_shape()) > 1
        return (multiply_at_once if at_once else multiply)(first, second)

    setattr(matrix_ops, "_reduce", sum_anywhere)  # noqa: B010
    setattr(matrix_ops, "_matmul_helper", multiply_anywhere)  # noqa: B010


remember_sources()
remember_positions()
look_around_less()
put_down_at_once()
