"""Words of laboratories in four languages, units, and cells with numbers."""

import tomllib
from pathlib import Path
from typing import Any

WORDS: dict[str, Any] = tomllib.loads(Path(__file__).with_suffix(".toml").read_text(encoding="utf-8"))
QUANTITIES, CONDITIONS, EXTRAS = (WORDS[key] for key in ("quantities", "conditions", "extras"))
RANGES = {name: tuple(extra["range"]) for name, extra in EXTRAS.items() if "range" in extra}
SHARES, LABORATORY, FORMS, NUMBERS = (WORDS[k] for k in ("shares", "laboratory", "headings", "numbers"))


def heading(name: str, unit: str, form: str) -> str:
    """A name with its unit as a laboratory writes it."""
    form = "round" if "/" in unit and form in ("slash", "tight") else form
    return FORMS[form].format(name, unit) if unit else name


def written(value: float, decimals: int, comma: bool = False) -> str:
    """A number as a cell."""
    text = f"{value:.{max(decimals, 0)}f}"
    text = text.lstrip("-") if float(text) == 0.0 else text
    return text.replace(".", ",") if comma else text


def number(text: str) -> float:
    """The number that a cell says."""
    return float(text.replace(",", "."))
