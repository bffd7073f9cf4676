"""Execution of effect files, and the check that what they define is an effect of this interface.

A file that cannot be used ends in one line: file, line, what is wrong, what to do.
"""

import inspect
import linecache
import re
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import MISSING, fields, is_dataclass
from functools import lru_cache
from pathlib import Path
from types import ModuleType
from typing import Any, get_args

import numpy as np

from taichi_erosion.core.effect import Effect, Place
from taichi_erosion.core.engine import is_device_function
from taichi_erosion.core.errors import BadInput, nearest
from taichi_erosion.core.foreign_code import DIGITS, EffectFile

MEMBER = "EFFECT"  # name of the record in an effect's file
REMEDY = "`effects new NAME` writes a file of the present interface"
ON_DEVICE = ("pair", "first_contact", "grain")  # places of effects whose `act` is a ti.func
MOST_FILES = 64  # executed files that are kept
UNKNOWN_ENTRY = re.compile(r"unexpected keyword argument '(\w+)'")
ACT = {
    "pair": ("constants", "pair"),
    "first_contact": ("constants", "contact"),
    "grain": ("constants", "grain"),
    "scene": ("params", "strength", "conditions", "scene"),
    "instrument": ("params", "strength", "conditions", "observable", "value"),
}
COMPILED = re.compile(
    rf'File "([^"]+):[0-9a-f]{{{DIGITS}}}", line (\d+), in (\w+):'
)  # in a compiler's message
SOURCE = re.compile(rf"(.+):[0-9a-f]{{{DIGITS}}}")  # name under which the text of a file is compiled
EXECUTED = "effect_file_"  # first letters of the module of an effect file
STRUCT = re.compile(r"'Struct\d+' object")  # name of the compiler for what `act` reads
STATES = {"pair": ("state_i", "state_j"), "grain": ("state",)}
GIVES = {  # function of core/effect_device.py -> function of an effect, and what it must give
    "total_attraction": ("act", "one number, the attraction [N]; a vector needs vector=True"),
    "total_vector_force": ("act", "a vector, the force on grain i [N]; one number needs vector=False"),
    "any_passes": ("act", "one number: 1 where the two grains pass each other, else 0"),
    "total_grain_force": ("act", "two vectors, force [N] and torque [N m]"),
    "total_drag_factor": ("drag", "one number, the factor of the drag [1]"),
    "update_states": ("update_state", "the state, with every variable"),
}
USE = re.compile(r'effect_device\.py", line \d+, in (\w+):')  # where the result of an effect is used
ARGUMENTS = {
    "constants": ("params", "strength", "conditions"),
    "initial_state": ("params", "strength", "conditions"),
    "update_state": ("constants", "grain", "state"),
    "reach": ("constants", "radius"),
    "dose": ("params", "conditions"),
    "can_act": ("conditions",),
    "checks": ("probe",),
}


@lru_cache(maxsize=MOST_FILES)
def effect_in(file: EffectFile) -> Effect:
    """The effect that a file defines; the file is executed once. Raises BadInput."""
    effect = getattr(executed(file), MEMBER, None)
    return checked_effect(effect, str(file))


def checked_effect(effect: Any, origin: str) -> Effect:
    """The effect itself. Raises BadInput for anything else, or one of another interface."""
    if not isinstance(effect, Effect):
        raise BadInput(f"{origin}: holds no {MEMBER} = Effect(...); {REMEDY}")
    problem = interface_problem(effect)
    if problem is not None:
        raise BadInput(f"{origin}: {problem}; {REMEDY}")
    return effect


def executed(file: EffectFile) -> ModuleType:
    """Module of the text of a file; the compiler reads that text too, whatever becomes of the file."""
    name, source = f"{EXECUTED}{file.path.stem}_{file.digest}", f"{file.path}:{file.digest}"
    linecache.cache[source] = (len(file.text), None, file.text.splitlines(keepends=True), source)
    module = sys.modules[name] = ModuleType(name)  # dataclasses look their module up by name
    module.__file__ = str(file.path)
    try:
        exec(compile(file.text, source, "exec", dont_inherit=True), module.__dict__)
    except (Exception, SystemExit) as error:
        del sys.modules[name]
        raise BadInput(f"{file}: {failure(error, source)}") from None
    return module


def failure(error: BaseException, source: str) -> str:
    """Line of a file in which an error arose, the error, and what to do."""
    if isinstance(error, SyntaxError) and error.filename == source:
        return f"line {error.lineno}: is not Python: {error.msg}"
    line, trace = 0, error.__traceback__
    while trace is not None:
        line = trace.tb_lineno if trace.tb_frame.f_code.co_filename == source else line
        trace = trace.tb_next
    return f"line {line}: {' '.join(reason(error).split())}"


def reason(error: BaseException) -> str:
    """What went wrong in the user's words; an interface that has changed is named as such."""
    text = str(error)
    if isinstance(error, TypeError) and "Effect." in text:
        if unknown := UNKNOWN_ENTRY.search(text):
            names = [f.name for f in fields(Effect)]
            near = nearest(unknown[1], names)
            hint = f"did you mean '{near}'?" if near else f"it has {', '.join(names)}"
            return f"Effect has no entry '{unknown[1]}'; {hint}; {REMEDY}"
        return f"{text}; {REMEDY}"
    if isinstance(error, ImportError) and "taichi_erosion" in (error.name or ""):
        return f"{text}; effects import from taichi_erosion.core.effect; {REMEDY}"
    return f"{type(error).__name__}: {text}" if text else type(error).__name__


def interface_problem(effect: Effect) -> str | None:
    """In what an effect differs from the interface, None where it keeps it."""
    if effect.place not in get_args(Place):
        return f"place = '{effect.place}' is not one of {', '.join(get_args(Place))}"
    if not (is_dataclass(effect.params) and isinstance(effect.params, type)):
        return "params is not a dataclass"
    if any(f.default is MISSING for f in fields(effect.params)):
        return "a number of params has no default; declare it by quantity(default, unit, meaning)"
    if effect.place in ON_DEVICE and effect.constants is None:
        return f"an effect of place '{effect.place}' needs constants(params, strength, conditions)"
    if (effect.place in ON_DEVICE) != is_device_function(effect.act):
        must = "must be" if effect.place in ON_DEVICE else "runs on the host and must not be"
        return f"act {must} a ti.func for place '{effect.place}'"
    if isinstance(effect.reads, str) or not all(isinstance(name, str) for name in effect.reads):
        return "reads must be a tuple of names of conditions, such as ('moisture',)"
    return next(argument_problems(effect), None)


def argument_problems(effect: Effect) -> Iterator[str]:
    """Functions that do not take the arguments with which they are called."""
    wanted = {"act": ACT[effect.place], **ARGUMENTS}
    if effect.grain_state is not None:
        wanted["act"] += STATES[effect.place]
    for name, arguments in wanted.items():
        function = getattr(effect, name)
        if function is not None and not takes(function, len(arguments)):
            yield f"{name} must take ({', '.join(arguments)})"


@contextmanager
def failures_of(effect: Effect, function: str) -> Iterator[None]:
    """Raise BadInput with one line for an error in a function of an effect."""
    try:
        yield
    except BadInput:
        raise
    except KeyError as error:
        stated = f"[conditions.extra] {error.args[0]!s} = {{ unit = ..., value = ... }}"
        raise BadInput(
            f"effects.{effect.name}: its {function} reads {error}, which the scene does not state under "
            f"[conditions]; one of your own is declared as {stated}"
        ) from None
    except Exception as error:
        told = " ".join(f"{type(error).__name__}: {error}".split())
        reason = f"effects.{effect.name}: its {function} failed{line_of(error)}: {told}"
        raise BadInput(compile_failure(error) or reason) from None


def line_of(error: BaseException) -> str:
    """` (FILE, line N)` for the last line of an effect file that an error passed, else nothing."""
    place, trace = "", error.__traceback__
    while trace is not None:
        found = SOURCE.fullmatch(trace.tb_frame.f_code.co_filename)
        place = f" ({Path(found[1]).name}, line {trace.tb_lineno})" if found else place
        trace = trace.tb_next
    return place


def compile_failure(error: Exception) -> str | None:
    """File, line and reason where a device function of an effect file cannot be compiled, else None."""
    places = COMPILED.findall(str(error))
    if not places:
        return wrong_result(error)
    path, line, function = places[-1]
    last = [text for text in str(error).splitlines() if text.strip()][-1]
    last = STRUCT.sub("its argument", last)
    hint = "; core/effect.py lists the members of what `act` reads" if "has no attribute" in last else ""
    return f"{Path(path).name}: line {line}, in {function}: cannot be compiled: {last.strip()}{hint}"


def wrong_result(error: Exception) -> str | None:
    """Place and remedy where the result of a device function of an effect file cannot be used, else None."""
    uses = [name for name in USE.findall(str(error)) if name in GIVES]
    if not uses:
        return None
    member, wanted = GIVES[uses[-1]]
    places = [place for effect in effects_of_files() if (place := definition(getattr(effect, member)))]
    return f"{' or '.join(places) or 'an effect'}: {member} must give {wanted}"


def effects_of_files() -> list[Effect]:
    """Effects on the device of all files that were executed in this process."""
    modules = (module for name, module in list(sys.modules.items()) if name.startswith(EXECUTED))
    latest = {module.__file__: module for module in modules}  # of a file that was edited
    found = (getattr(module, MEMBER, None) for module in latest.values())
    return [one for one in found if isinstance(one, Effect) and one.place in ON_DEVICE]


def definition(function: Any) -> str:
    """`FILE: line N, in FUNCTION` of a function of an effect file; nothing for any other."""
    code = getattr(inspect.unwrap(function), "__code__", None) if function is not None else None
    found = SOURCE.fullmatch(code.co_filename) if code is not None else None
    return f"{Path(found[1]).name}: line {code.co_firstlineno}, in {code.co_name}" if code and found else ""


def checked_number(effect: Effect, value: Any) -> float:
    """The number that an instrument gives. Raises BadInput for anything else."""
    if isinstance(value, (int, float, np.integer, np.floating)) and not isinstance(value, bool):
        return float(value)
    raise BadInput(f"effects.{effect.name}: its act gives {value!r}, not a number{at(effect.act)}")


def at(function: Any) -> str:
    """` (FILE: line N, in FUNCTION)` for a function of an effect file, else nothing."""
    place = definition(function)
    return f" ({place})" if place else ""


def takes(function: Callable[..., Any], count: int) -> bool:
    """Whether a function can be called with so many arguments."""
    try:
        inspect.signature(function).bind(*range(count))
    except TypeError:
        return False
    except ValueError:  # built in, without a signature
        return callable(function)
    return True
