"""Words of messages for callers in Python: calls and keywords in place of commands and their options.

Rooms below write messages for the command line; this module is the one place that puts them into words of
Python. Documents keep what the command line prints.
"""

import re
from collections.abc import Callable
from functools import wraps
from inspect import isfunction
from typing import ParamSpec, TypeVar

from taichi_erosion.core.errors import BadInput, SimulationStopped

Given = ParamSpec("Given")
Found = TypeVar("Found")
Kind = TypeVar("Kind", bound=type)
FILE = r"'?((?<=')[^']+|[^\s']+?)'?(?=;|$)"  # a file as a shell takes it
PROGRAM = r"(?:(?:\./erosion|taichi-erosion) )?"
TOML = r"(?:'[^']+\.toml'|\S+\.toml)"  # a study, likewise

KEYWORDS = {  # option of the command line with its value -> keyword of the call
    r"--set (\S+?)=([^\s;,]+)(?=$|[\s;,])": r'changes={"\1": \2}',
    r"--set ([^\s:]+)": r"changes: \1",
    r"--force\b": "force=True",
    r"--no-record\b": "record=False",
    r"--record another FILE": "record=FILE with another name",
    r"--effect (\S+?)(?=$|[\s,;`])": r"effect_files=[\1]",
    r"--replicas (\d+)": r"replicas=\1",
    r"--arch (\w+)": r'arch="\1"',
    r"--precision (\w+)": r'precision="\1"',
    r"larger --budget\b": "larger budget",
    r"--budget (\w+(?:\.\w+)?)": r'budget="\1"',
    r"--apparatus (\w+)": r'apparatus="\1"',
    r"--apparatus": "apparatus=NAME",
    r"--closed-form\b": "closed_form=True",
    r"--out\b": "out=FOLDER",
    r"--observable\s+'?([^'\s=]+)=(\w+)'?": r'observables={"\1": "\2"}',
    r"--condition\s+'?([^'\s=]+)=([\w.]+)'?": r'conditions={"\1": "\2"}',
}


def adopt_call(found: re.Match[str]) -> str:
    """`study.adopt("a", "b")`."""
    return "study.adopt({})".format(", ".join(f'"{name}"' for name in found[1].split()))


CALLS = {  # command -> call
    f"Go on with ({TOML}): ": r'Go on with study = te.study("\1"): ',
    rf"`?{PROGRAM}\b(compare|discover|next|report) {TOML}`?": r"study.\1()",
    r"`(compare|discover|next|report)`": r"study.\1()",
    rf"`{PROGRAM}adopt {TOML}((?: \w+)+)`": adopt_call,
    r"`adopt`": "study.adopt(...)",
    rf"\./erosion run {FILE}": r'te.run("\1")',
    rf"\./erosion study new {FILE}": r'te.new_study("\1")',
    r"`run ([\d.]+)s`": r"session.run(\1)",
    r"`watch (\w+)`": r'session.watch("\1")',
    r"`help effects`": "te.effects()",
}
RULES = [(re.compile(old), new) for old, new in (CALLS | KEYWORDS).items()]


def python_words(text: str) -> str:
    """A message of the command line in words of Python."""
    for old, new in RULES:
        text = old.sub(new, text)
    return text


def in_python(call: Callable[Given, Found]) -> Callable[Given, Found]:
    """The same call, with the messages of its exceptions in words of Python."""

    @wraps(call)
    def worded(*arguments: Given.args, **keywords: Given.kwargs) -> Found:
        try:
            return call(*arguments, **keywords)
        except BadInput as error:
            raise BadInput(*map(python_words, error.faults)) from None
        except SimulationStopped as error:
            raise SimulationStopped(python_words(str(error))) from None

    return worded


def all_in_python(kind: Kind) -> Kind:
    """The same class, with `in_python` on its methods."""
    for name, member in list(vars(kind).items()):
        if isfunction(member) and (not name.startswith("_") or name == "__init__"):
            setattr(kind, name, in_python(member))
    return kind
