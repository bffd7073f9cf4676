"""The one import of Taichi, with its front end patched so that kernels compile faster; no number changes.

Taichi inlines every device function where it is called, and on each call reads and tokenizes its source,
describes every source position, inspects the stack around decorators, and keeps the stack of every field
declaration: for the 600 calls of a run's kernels that costs more than their translation. Here syntax trees
and descriptions are cached and stack inspection is skipped. Sums and products of small vectors and matrices,
which Taichi compiles from sources of its own at every use, are emitted directly in the same order of
operations.
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
# Taichi aborts the process where HOME is not set, as under cron or in a container; any folder will do
os.environ.setdefault("HOME", os.path.expanduser("~") if os.path.isabs(os.path.expanduser("~")) else os.sep)


@contextmanager
def frames_without_source() -> Iterator[None]:
    """Frame information without source lines, which Taichi reads only to find kernels inside classes."""
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

OWNER = "source"  # attribute of a tree: the Source whose cache it returns to, or None


@dataclass(frozen=True)
class Source:
    """Text of one device function."""

    file: str
    first_line: int
    lines: list[str]  # as they stand in the file
    text: str  # without the indentation that they share
    trees: list[ast.Module]  # parsed from the text, not in use


def read_source(function: FunctionType) -> Source:
    """Text of a device function, from its file."""
    lines, first_line = inspect.getsourcelines(function)
    bare = [line.rstrip().expandtabs(4) for line in lines]
    file = inspect.getsourcefile(function) or inspect.getfile(function)
    return Source(file, first_line, bare, textwrap.dedent("\n".join(bare)), [])


def source_of(function: Any, known_out: dict[Any, Source]) -> Source:
    """Cached source of a function; functions of one closure share their code."""
    code = function.__code__
    return known_out.get(code) or known_out.setdefault(code, read_source(function))


def unused_tree(source: Source, is_kernel: bool) -> ast.Module:
    """Syntax tree of a source; the tree of a function returns to the cache once it has been transformed.

    Taichi annotates the nodes of a function's tree and changes nothing else. It removes the arguments from
    the tree of a kernel, which is therefore not cached.
    """
    if source.trees and not is_kernel:
        return source.trees.pop()
    tree = ast.parse(source.text)
    setattr(tree.body[0], "decorator_list", [])  # noqa: B010
    setattr(tree, OWNER, None if is_kernel else source)
    return tree


def cache_syntax_trees() -> None:
    """Parse the source of every device function once, however often it is inlined."""
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
        return unused_tree(source, is_kernel), ASTTransformerContext(
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

    def transform_and_return(tree: ast.Module, context: ASTTransformerContext) -> Any:
        answer = transform(tree, context)
        owner = getattr(tree, OWNER)
        if owner is not None:
            owner.trees.append(tree)
        return answer

    setattr(kernel_impl, "_get_tree_and_ctx", tree_and_context)  # noqa: B010
    setattr(kernel_impl, "transform_tree", transform_and_return)  # noqa: B010


def cache_positions() -> None:
    """Describe every compiled source position once; a statement by its first line."""
    known: dict[tuple[Any, ...], str] = {}

    def position_info(context: Any, node: Any) -> str:
        span = (node.lineno, node.col_offset, node.end_lineno, node.end_col_offset)
        key = (context.file, context.lineno_offset, *span)
        return known.get(key) or known.setdefault(key, describe(context, node))

    setattr(ASTTransformerContext, "get_pos_info", position_info)  # noqa: B010


def describe(context: Any, node: Any) -> str:
    """File, line and function of a node, its source line, and marks below it."""
    line = context.src[node.lineno - 1]
    first = context.indent + node.col_offset
    last = context.indent + node.end_col_offset if node.lineno == node.end_lineno else len(line)
    where = (
        f'File "{context.file}", line {node.lineno + context.lineno_offset}, in {context.func.func.__name__}:'
    )
    return f"{where}\n{line}\n{' ' * first}{'^' * (last - first)}\n"


def caller_position(stacklevel: int = 1) -> str:
    """File and line of the call that declares a field."""
    frame = sys._getframe(stacklevel + 1)
    return f"{frame.f_code.co_filename}:{frame.f_lineno}"


def skip_stack_inspection() -> None:
    """Treat decorated functions as free ones, and keep one line for a declaration instead of the stack."""
    setattr(kernel_impl, "_inside_class", lambda level_of_class_stackframe: False)  # noqa: B010
    for module in (impl, snode):
        setattr(module, "get_traceback", caller_position)  # noqa: B010


def elements(matrix: Any) -> Callable[..., Any]:
    """Function that returns one element of a device matrix, whose expression is evaluated once."""
    known: Any = impl.expr_init_func(matrix)
    callable_now: Any = impl.get_runtime().compiling_callable
    return lambda *index: impl.subscript(callable_now.ast_builder(), known, *index)


def emit_reduction(matrix: Any, add: Any) -> Any:
    """All elements of a device matrix joined by an operation, from the first to the last."""
    element = elements(matrix)
    total, *rest = [element(*index) for index in np.ndindex(*matrix.get_shape())]
    for number in rest:
        total = add(total, number)
    return total


def emit_product(first: Any, second: Any) -> Any:
    """Product of two device matrices, or of a matrix and a vector."""
    (rows, inner), columns = first.get_shape(), second.get_shape()[1:]
    left, right = elements(first), elements(second)
    # the first operation of Taichi's own product, which gives it its type
    zero = impl.expr_init(left(0, 0) * right(0, *(0 for _ in columns)) * 0)

    def number(row: int, *column: int) -> Any:
        total = zero
        for k in range(inner):
            total = total + left(row, k) * right(k, *column)
        return total

    table = [[number(row, *column) for column in np.ndindex(*columns)] for row in range(rows)]
    return ti.Matrix(table) if columns else ti.Vector([row[0] for row in table])


def are_on_device(*operands: Any) -> bool:
    """Whether a kernel is being compiled and all operands are device matrices or vectors."""
    return impl.inside_kernel() and all(isinstance(operand, Expr) for operand in operands)


def emit_matrix_operations() -> None:
    """Emit sums and products within kernels directly; elsewhere they stay Taichi's."""
    own_reduction, own_product = (getattr(matrix_ops, name) for name in ("_reduce", "_matmul_helper"))

    @functools.wraps(own_reduction)
    def reduction(matrix: Any, add: Any) -> Any:
        return (emit_reduction if are_on_device(matrix) else own_reduction)(matrix, add)

    @functools.wraps(own_product)
    def product(first: Any, second: Any) -> Any:
        emitted = are_on_device(first, second) and len(first.get_shape()) > 1
        return (emit_product if emitted else own_product)(first, second)

    setattr(matrix_ops, "_reduce", reduction)  # noqa: B010
    setattr(matrix_ops, "_matmul_helper", product)  # noqa: B010


cache_syntax_trees()
cache_positions()
skip_stack_inspection()
emit_matrix_operations()
