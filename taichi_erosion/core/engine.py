"""Engine that compiles kernels, Taichi or its fork quadrants: its choice, and shortcuts in its front end.

Neither is imported here. Taichi is the default where it is installed. It has no wheel for Python 3.14 and
later, where quadrants is installed in its place. An environment variable names one of the two; workers
inherit it.

Both engines inline every device function where it is called, and on each call read its source; around each
they look through the stack for a class. Taichi also describes every source position each time. quadrants
builds every kernel twice, first to find the members of dataclasses that nothing uses, and searches every
syntax tree for them; kernels take no dataclass here. So sources and descriptions are cached, and the
inspection of the stack, the first building and the search are skipped: 1.3 s of 3.5 s at the start of a run.
No number changes. All of it replaces internals of two versions.
"""

import os
import textwrap
from collections.abc import Callable
from functools import cache
from importlib import import_module
from importlib.metadata import version
from importlib.util import find_spec
from types import SimpleNamespace
from typing import Any

from taichi_erosion.core.errors import BadInput

SWITCH = "TAICHI_EROSION_ENGINE"  # environment variable: name of the engine
ENGINES = ("taichi", "quadrants")  # the first that is installed is the default
READERS = {  # engine -> its module that reads sources of device functions, and the functions that do
    "taichi": ("taichi.lang.kernel_impl", ("getsourcefile", "getsourcelines")),
    "quadrants": ("quadrants.lang._func_base", ("get_source_info_and_src",)),
}


@cache
def engine_name() -> str:
    """Name of the engine of this process. Raises BadInput where it is unknown or not installed."""
    choice = os.environ.get(SWITCH)
    if choice and choice not in ENGINES:
        raise BadInput(f"{SWITCH} = {choice}: the engines are {' and '.join(ENGINES)}")
    for name in [choice] if choice else ENGINES:
        if find_spec(name) is not None:
            return name
    raise BadInput(f"the engine {choice or ENGINES[0]} is not installed: pip install {choice or ENGINES[0]}")


def engine_version() -> str:
    return version(engine_name())


def engine_mark() -> str:
    """Mark of this engine in keys of results and kernels: its name, empty for the default engine."""
    return "" if engine_name() == ENGINES[0] else f"-{engine_name()}"


def is_device_function(function: Any) -> bool:
    """Whether a function was decorated with ti.func, which leaves the name of the engine on it."""
    return bool(getattr(function, f"_is_{engine_name()}_function", False))


def speed_up_front_end() -> None:
    """Replace internals of the front end of the engine, which has been imported."""
    engine = engine_name()
    kernel_impl: Any = import_module(f"{engine}.lang.kernel_impl")
    kernel_impl._inside_class = lambda level_of_class_stackframe: False  # decorated functions are free ones
    path, readers = READERS[engine]
    module: Any = import_module(path)
    for name in readers:
        setattr(module, name, cache_by_code(getattr(module, name)))
    module.textwrap = SimpleNamespace(  # a line is not wrapped: without its end, tabs as spaces
        fill=lambda line, tabsize, width: line.rstrip().expandtabs(tabsize), dedent=textwrap.dedent
    )
    if engine == "taichi":
        cache_positions()
    else:
        skip_first_build()


def cache_by_code(read: Callable[[Any], Any]) -> Callable[[Any], Any]:
    """A function of a function with its answers cached; functions of one closure share their code."""
    results: dict[Any, Any] = {}

    def cached_answer(function: Any) -> Any:
        code = function.__code__
        return results.get(code) or results.setdefault(code, read(function))

    return cached_answer


def cache_positions() -> None:
    """Taichi describes every compiled source position once; a statement by its first line."""
    transformer: Any = import_module("taichi.lang.ast.ast_transformer_utils")
    positions: dict[tuple[Any, ...], str] = {}

    def position_info(context: Any, node: Any) -> str:
        span = (node.lineno, node.col_offset, node.end_lineno, node.end_col_offset)
        key = (context.file, context.lineno_offset, *span)
        return positions.get(key) or positions.setdefault(key, position_text(context, node))

    transformer.ASTTransformerContext.get_pos_info = position_info


def position_text(context: Any, node: Any) -> str:
    """File, line and function of a node, its source line, and marks below it."""
    line = context.src[node.lineno - 1]
    first = context.indent + node.col_offset
    last = context.indent + node.end_col_offset if node.lineno == node.end_lineno else len(line)
    place = f'File "{context.file}", line {node.lineno + context.lineno_offset}'
    return f"{place}, in {context.func.func.__name__}:\n{line}\n{' ' * first}{'^' * (last - first)}\n"


def skip_first_build() -> None:
    """Quadrants leaves out what it does for dataclasses: the first building of a kernel, and a search."""
    kernel: Any = import_module("quadrants.lang.kernel").Kernel
    dataclasses: Any = import_module("quadrants.lang._kernel_impl_dataclass")
    look_up, flatten = kernel._try_load_fastcache, dataclasses.unpack_ast_struct_expressions

    def used_members(owner: Any, args: Any, key: Any) -> set[str]:
        """Members of dataclasses that a kernel uses: none. The answer None would ask for a first building."""
        look_up(owner, args, key)
        return owner.used_py_dataclass_parameters_by_key_enforcing.setdefault(key, set())

    def flatten_once(tree: Any, struct_locals: set[str]) -> Any:
        return flatten(tree, struct_locals) if struct_locals else tree

    kernel._try_load_fastcache = used_members
    dataclasses.unpack_ast_struct_expressions = flatten_once
