"""Functions and classes of the Python interface from their docstrings, for docs/json_and_python.md."""

import inspect
from collections.abc import Iterator
from typing import Any

from taichi_erosion import api

WIDEST = 110  # characters of a line


def interface() -> str:
    """Markdown of the interface: functions first, then classes with what they have."""
    names = [name for name in api.__all__ if name not in ("BadInput", "SimulationStopped")]
    functions = [name for name in names if inspect.isfunction(getattr(api, name))]
    classes = [getattr(api, name) for name in names if inspect.isclass(getattr(api, name))]
    shared = dict.fromkeys(owner for kind in classes for owner in kind.__mro__[1:-1])
    parts = ["## Functions", *(function_part(f"te.{name}", getattr(api, name)) for name in functions)]
    parts += ["## Results and sessions", *map(class_part, [*shared, *classes])]
    return "\n\n".join(part.strip() for part in parts) + "\n"


def function_part(name: str, function: Any) -> str:
    """Heading, call and docstring of a function."""
    parameters = [p for p in inspect.signature(function).parameters.values() if p.name != "self"]
    arguments = ", ".join(argument(p) for p in parameters)
    call = f"{name}({arguments})"
    if len(call) > WIDEST:
        call = f"{name}(\n    {arguments}\n)"
    if any(len(line) > WIDEST for line in call.split("\n")):
        call = "\n".join([f"{name}(", *(f"    {argument(p)}," for p in parameters), ")"])
    return f"### `{name}`\n\n```python\n{call}\n```\n\n{described(function)}"


def argument(parameter: inspect.Parameter) -> str:
    """`seed=None`."""
    stars = {parameter.VAR_POSITIONAL: "*", parameter.VAR_KEYWORD: "**"}.get(parameter.kind, "")
    default = "" if parameter.default is parameter.empty else f"={parameter.default!r}".replace("'", '"')
    return f"{stars}{parameter.name}{default}"


def described(thing: Any) -> str:
    """Docstring as prose."""
    return inspect.cleandoc(thing.__doc__ or "")


def class_part(kind: type) -> str:
    """Heading, docstring, and a table of properties and methods; those of its base stand there."""
    rows = "\n".join(f"| `{member}` | {text} |" for member, text in members(kind))
    base = "".join(f" A `{owner.__name__}`." for owner in kind.__mro__[1:-1])
    return f"### `{kind.__name__}`\n\n{described(kind)}{base}\n\n| has | |\n|---|---|\n{rows}"


def members(kind: type) -> Iterator[tuple[str, str]]:
    """Public properties and methods of its own, with their docstrings."""
    for name, member in vars(kind).items():
        function = member.fget if isinstance(member, property) else member
        if name.startswith("_") or not inspect.isfunction(function) or not function.__doc__:
            continue
        call = name
        if not isinstance(member, property):
            parameters = list(inspect.signature(function).parameters.values())[1:]
            call = f"{name}({', '.join(map(argument, parameters))})"
        yield call, " ".join(described(function).split())
