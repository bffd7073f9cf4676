"""Python files of the user's own that this program runs: effects and measures, read once, known by content.

A file is read when a command begins, and a line on stderr names it. All its runs, on workers of this machine
or of a cluster, execute that text, and its digest is part of what a run is known by. A file that cannot be
used, or an effect that is none of this interface, ends in one line: file, line, what is wrong, what to do.
"""

import linecache
import re
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import MISSING, dataclass, fields, is_dataclass
from functools import lru_cache
from hashlib import sha256
from numbers import Real
from pathlib import Path
from types import ModuleType
from typing import Any, get_args

from taichi_erosion.core.effect import Effect, Place
from taichi_erosion.core.engine import is_device_function
from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.files import one_line_name, read_text_file

SUFFIX = ".py"
DIGITS = 12  # hexadecimal, of a digest
OPTION = "--effect"  # what names a file that neither a scene nor a study names
NAMED: set[Path] = set()  # files that this process has named
MEMBER = "EFFECT"  # name of the record in an effect's file
REMEDY = "`effects new NAME` writes a file of the present interface"
ON_DEVICE = ("pair", "first_contact", "grain")  # places of effects whose `act` is a ti.func
MOST_FILES = 64  # executed files that are kept
# in a compiler's message
COMPILED = re.compile(rf'File "([^"]+):[0-9a-f]{{{DIGITS}}}", line (\d+), in (\w+):')
SOURCE = re.compile(rf"(.+):[0-9a-f]{{{DIGITS}}}")  # name under which the text of a file is compiled
STRUCT = re.compile(r"'Struct\d+' object")  # name of the compiler for what `act` reads
USE = 'effect_device.py", line'  # where functions of effects are called


@dataclass(frozen=True)
class EffectFile:
    """A Python file with an effect, as it was read."""

    path: Path  # absolute
    text: str

    @property
    def digest(self) -> str:
        """Name of the content."""
        return sha256(self.text.encode()).hexdigest()[:DIGITS]

    def __str__(self) -> str:
        """The path as messages show it."""
        return short_path(self.path)


def short_path(path: Path) -> str:
    """An absolute path, relative where it lies below the working folder."""
    here = Path.cwd()
    return str(path.relative_to(here) if path.is_relative_to(here) else path)


def announce_file(path: Path, named_by: str) -> None:
    """Write `executes FILE (named by SCENE-OR-STUDY)` on stderr, once a file, before it runs."""
    file = path.resolve()
    if file not in NAMED:
        NAMED.add(file)
        sys.stderr.write(f"executes {one_line_name(short_path(file))} (named by {one_line_name(named_by)})\n")


def read_effect_file(path: Path, named_by: str = OPTION) -> EffectFile:
    """The file at a path, which will be executed. Raises BadInput where there is no Python file."""
    name = one_line_name(path)
    try:
        if path.suffix != SUFFIX:
            raise BadInput(f"{name}: no such Python file; an effect is a file that ends in {SUFFIX}")
        file = EffectFile(path.resolve(), read_text_file(path, "utf-8-sig"))
    except FileNotFoundError:
        raise BadInput(f"{name}: no such Python file") from None
    except (OSError, ValueError) as error:
        raise BadInput(f"{name}: cannot be read: {error}") from None
    announce_file(path, named_by)
    return file


def read_effect_files(
    paths: Iterable[str | Path], folder: Path = Path(), named_by: str = OPTION
) -> tuple[EffectFile, ...]:
    """Files named relative to a folder; one that is named twice counts once. Raises BadInput."""
    return tuple(dict.fromkeys(read_effect_file(folder / path, named_by) for path in paths))


@lru_cache(maxsize=MOST_FILES)
def effect_in(file: EffectFile) -> Effect:
    """The effect that a file defines; the file is executed once. Raises BadInput."""
    return require_effect(getattr(execute_effect(file), MEMBER, None), str(file))


def require_effect(effect: Any, origin: str) -> Effect:
    """The effect itself. Raises BadInput for anything else, or one of another interface."""
    if not isinstance(effect, Effect):
        raise BadInput(f"{origin}: holds no {MEMBER} = Effect(...); {REMEDY}")
    if problem := interface_problem(effect):
        raise BadInput(f"{origin}: {problem}; {REMEDY}")
    return effect


def execute_effect(file: EffectFile, remedy: str = REMEDY) -> ModuleType:
    """Module of the text of a file; the compiler reads that text too, whatever becomes of the file."""
    name, source = f"effect_file_{file.path.stem}_{file.digest}", f"{file.path}:{file.digest}"
    linecache.cache[source] = (len(file.text), None, file.text.splitlines(keepends=True), source)
    module = sys.modules[name] = ModuleType(name)  # dataclasses look their module up by name
    module.__file__ = str(file.path)
    try:
        exec(compile(file.text, source, "exec", dont_inherit=True), module.__dict__)
    except (Exception, SystemExit) as error:
        del sys.modules[name]
        raise BadInput(f"{file}: cannot be executed{line_of(error)}: {error_text(error)}; {remedy}") from None
    return module


def error_text(error: BaseException) -> str:
    """Kind and text of an error in one line."""
    return " ".join(f"{type(error).__name__}: {error}".split())


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
    return None


@contextmanager
def failures_of(effect: Effect, function: str) -> Iterator[None]:
    """Raise BadInput with one line for an error in a function of an effect."""
    try:
        yield
    except BadInput:
        raise
    except Exception as error:
        message = f"its {function} failed{line_of(error)}: {error_text(error)}"
        if isinstance(error, KeyError):
            message = f"its {function} reads {error}, which the scene does not state under [conditions]"
        raise BadInput(compile_failure_text(error) or f"effects.{effect.name}: {message}") from None


def line_of(error: BaseException) -> str:
    """` (FILE, line N)` for the last line of an effect file that an error passed, else nothing."""
    place, trace = "", error.__traceback__
    while trace is not None:
        match = SOURCE.fullmatch(trace.tb_frame.f_code.co_filename)
        place = f" ({Path(match[1]).name}, line {trace.tb_lineno})" if match else place
        trace = trace.tb_next
    return place


def compile_failure_text(error: Exception) -> str | None:
    """Place and reason where a device function of an effect file cannot be compiled or used, else None."""
    places = COMPILED.findall(str(error))
    if not places and USE not in str(error):
        return None
    last = STRUCT.sub("its argument", [text for text in str(error).splitlines() if text.strip()][-1].strip())
    if not places:
        return f"what an effect takes or gives is not that of its place in core/effect.py: {last[:200]}"
    path, line, function = places[-1]
    hint = "; core/effect.py lists the members of what `act` reads" if "has no attribute" in last else ""
    return f"{Path(path).name}: line {line}, in {function}: cannot be compiled: {last}{hint}"


def require_number(effect: Effect, value: Any) -> float:
    """The number that an instrument gives. Raises BadInput for anything else."""
    if not isinstance(value, Real):
        raise BadInput(f"effects.{effect.name}: its act gives {value!r}, not a number")
    return float(value)
