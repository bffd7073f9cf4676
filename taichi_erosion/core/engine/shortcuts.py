"""Shortcuts through the front ends of both engines: kernels are built faster, and no number changes.

Both engines inline every device function where it is called, and on each call read and tokenize its source.
Taichi also describes every source position each time. quadrants builds every kernel twice, first to find the
members of dataclasses that nothing uses, and searches every syntax tree for them; kernels take no dataclass
here. So sources, syntax trees and descriptions are cached, the first building and the search are skipped, and
so is the inspection of the stack for classes around device functions and for declarations of fields.

All of it replaces internals of two versions; `docs/speed.md` says what each saves.
"""

import ast
import inspect
import sys
import textwrap
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from importlib import import_module
from types import FunctionType, SimpleNamespace
from typing import Any

OWNER = "source"  # attribute of a tree: the Source whose cache it returns to, or None


@contextmanager
def frames_without_source() -> Iterator[None]:
    """Frame information without source lines, which an engine that is imported reads to look for classes."""
    describe_frame = inspect.getframeinfo
    setattr(inspect, "getframeinfo", lambda frame, context=1: describe_frame(frame, context=0))  # noqa: B010
    try:
        yield
    finally:
        setattr(inspect, "getframeinfo", describe_frame)  # noqa: B010


def take_shortcuts(engine: str) -> None:
    """Replace internals of the front end of an engine that has been imported."""
    skip_stack_inspection(engine)
    if engine == "taichi":
        cache_syntax_trees()
        cache_positions()
    else:
        cache_sources()
        build_once()


def caller_position(stacklevel: int = 1) -> str:
    """File and line of the call that declares a field."""
    frame = sys._getframe(stacklevel + 1)
    return f"{frame.f_code.co_filename}:{frame.f_lineno}"


def skip_stack_inspection(engine: str) -> None:
    """Treat decorated functions as free ones, and keep one line for a declaration instead of the stack."""
    kernel_impl = import_module(f"{engine}.lang.kernel_impl")
    setattr(kernel_impl, "_inside_class", lambda level_of_class_stackframe: False)  # noqa: B010
    for name in ("impl", "snode"):
        setattr(import_module(f"{engine}.lang.{name}"), "get_traceback", caller_position)  # noqa: B010


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
    """Taichi parses the source of every device function once, however often it is inlined."""
    kernel_impl = import_module("taichi.lang.kernel_impl")
    known: dict[Any, Source] = {}
    transform = kernel_impl.transform_tree

    def tree_and_context(
        owner: Any,
        excluded_parameters: Any = (),
        is_kernel: bool = True,
        arg_features: Any = None,
        args: Any = None,
        **others: Any,
    ) -> tuple[ast.Module, Any]:
        source = source_of(owner.func, known)
        names = getattr(kernel_impl, "_get_global_vars")(owner.func)  # noqa: B009
        if is_kernel or others.get("is_real_function"):
            names |= {owner.arguments[slot].name: args[slot] for slot in owner.template_slot_locations}
        return unused_tree(source, is_kernel), kernel_impl.ASTTransformerContext(
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

    def transform_and_return(tree: ast.Module, context: Any) -> Any:
        answer = transform(tree, context)
        owner = getattr(tree, OWNER)
        if owner is not None:
            owner.trees.append(tree)
        return answer

    setattr(kernel_impl, "_get_tree_and_ctx", tree_and_context)  # noqa: B010
    setattr(kernel_impl, "transform_tree", transform_and_return)  # noqa: B010


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
    where = (
        f'File "{context.file}", line {node.lineno + context.lineno_offset}, in {context.func.func.__name__}:'
    )
    return f"{where}\n{line}\n{' ' * first}{'^' * (last - first)}\n"


def cache_sources() -> None:
    """Quadrants reads the source of every device function once, and does not wrap its lines."""
    module = import_module("quadrants.lang._func_base")
    read = module.get_source_info_and_src
    known: dict[Any, Any] = {}

    def info_and_lines(function: FunctionType) -> Any:
        code = function.__code__
        return known.get(code) or known.setdefault(code, read(function))

    setattr(module, "get_source_info_and_src", info_and_lines)  # noqa: B010
    setattr(module, "textwrap", SimpleNamespace(fill=bare_line, dedent=textwrap.dedent))  # noqa: B010


def bare_line(line: str, tabsize: int, width: int) -> str:
    """A line of source without its end, tabs as spaces."""
    return line.rstrip().expandtabs(tabsize)


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
