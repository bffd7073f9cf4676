"""Begins a file with an effect of one's own: a pull that keeps the contract already, or a discovered law.

The pull may be one that remembers something of every grain.
"""

import json
import re
from importlib.resources import files
from pathlib import Path
from typing import Any

from jinja2 import Environment

from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.plain_file import plain_text

NEW = "new"  # first word that asks for a new file, so no effect can be called so
FILE_NAME = re.compile(r"[a-z][a-z0-9_]{0,59}")
FACTOR = re.compile(r"\((?P<name>\w+) / (?P<typical>[-+.\deE]+)\)\^(?P<power>[-+.\deE]+)")
WIDEST = 10.0  # range of a coefficient over the one that was found [1]


def begin_file(name: str, discovery: Path | None = None, memory: bool = False) -> Path:
    """Write a file that keeps the contract of effects, for the user to change."""
    from taichi_erosion.effects import load_library

    path = Path(f"{name}.py")
    if not FILE_NAME.fullmatch(name) or name == NEW or name in load_library():
        raise BadInput(f"effects new {name}: give a new name of small letters, digits and _")
    if path.exists():
        raise BadInput(f"{path}: exists already")
    begun = scaffold("memory" if memory else "effect").replace("NAME", name)
    path.write_text(law_file(name, discovery) if discovery else begun)
    return path


def scaffold(kind: str) -> str:
    """Text that a new file begins with."""
    return (files("taichi_erosion.cli") / "scaffold" / f"{kind}.txt").read_text(encoding="utf-8")


def law_file(name: str, discovery: Path) -> str:
    """An effect that is the law which a discovery proposed; raises BadInput where it proposed none."""
    law = proposed_law(discovery)
    environment = Environment(trim_blocks=True, lstrip_blocks=True, keep_trailing_newline=True)
    page = environment.from_string(scaffold("law"))
    title = name.replace("_", " ").capitalize()
    return page.render(**law_words(law), name=name, title=title, source=discovery.name)


def proposed_law(discovery: Path) -> dict[str, Any]:
    """First law among the clues of a discovery's result, worst misfit first."""
    try:
        clues = json.loads(plain_text(discovery))["clues"]
    except (OSError, ValueError, KeyError, TypeError):
        raise BadInput(f"{discovery}: is not the result of a discovery (STUDY.discover.json)") from None
    laws = [clue["law"] for clue in clues if clue["law"] is not None]
    if not laws:
        raise BadInput(
            f"{discovery}: proposes no law; it does so where no effect of the library explains a misfit"
        )
    return laws[0]


def law_words(law: dict[str, Any]) -> dict[str, Any]:
    """What the scaffold needs to know of a law. Raises BadInput for a condition that no scene can state."""
    from taichi_erosion.scene.schema import Conditions

    typical = {found["name"]: float(found["typical"]) for found in FACTOR.finditer(law["expression"])}
    for name in typical:
        if name not in Conditions.model_fields:
            raise BadInput(f"the law reads '{name}', which is not among the conditions of a scene")
    logarithm = f"ln {law['observable']}" in law["expression"]
    numbers = [f"term_{k + 1}" for k in range(len(law["terms"]))]
    terms = [
        term_words(powers, coefficient, typical) | {"alone": alone(numbers, k)}
        for k, (powers, coefficient) in enumerate(zip(law["terms"], law["coefficients"], strict=True))
    ]
    return {
        "observable": law["observable"],
        "left": "y exp(strength c)" if logarithm else "y + strength c",
        "formula": law["expression"].partition(" = ")[2],
        "logarithm": logarithm,
        "unit": "1" if logarithm else "unit of the observable",
        "share": f"{law['held_out_share']:.0%}",
        "conditions": ", ".join(f'"{name}"' for name in typical),
        "typical": ", ".join(f'"{name}": {value:g}' for name, value in typical.items()),
        "terms": terms,
    }


def term_words(powers: dict[str, float], coefficient: float, typical: dict[str, float]) -> dict[str, str]:
    """One term: its coefficient with a range, and its factors as code and in words."""
    factors = [f'(conditions["{name}"] / {typical[name]:g}) ** {power:g}' for name, power in powers.items()]
    words = [f"({name} / {typical[name]:g})^{power:g}" for name, power in powers.items()]
    widest = WIDEST * abs(coefficient)
    return {
        "coefficient": f"{coefficient:.6g}",
        "low": f"{-widest:.3g}",
        "high": f"{widest:.3g}",
        "words": f"coefficient of {' '.join(words)}",
        "code": " * ".join(factors),
    }


def alone(numbers: list[str], chosen: int) -> str:
    """Coefficients of a check in which one term acts alone, as code."""
    return ", ".join(f'"{name}": {0.2 if k == chosen else 0.0}' for k, name in enumerate(numbers))
