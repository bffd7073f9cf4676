"""Self-contained HTML pages: templates, formats of numbers, embedded picture files."""

import base64
from collections.abc import Mapping
from datetime import date
from math import isfinite
from pathlib import Path
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined

from taichi_erosion.evidence.data.number_words import heading, plain
from taichi_erosion.evidence.inference.verdict_levels import p_number
from taichi_erosion.report.words import effect_words

LEAST_SHARE = 1e-3  # that is printed
MEDIA_TYPES = {".png": "image/png", ".gif": "image/gif", ".jpg": "image/jpeg", ".svg": "image/svg+xml"}


def render(template: str, fields: Mapping[str, Any]) -> str:
    """HTML page of a template. Texts are escaped; a missing field is an error."""
    environment = Environment(
        loader=PackageLoader("taichi_erosion.report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
    )
    environment.filters |= {
        "number": number,
        "percent": percent,
        "words": effect_words,
        "heading": heading,
        "chance": chance,
    }
    return environment.get_template(template).render(**fields)


def made(versions: Mapping[str, str], seeds: str) -> str:
    """When and with what a page was made."""
    return f"Made on {date.today().isoformat()} with taichi_erosion {versions['taichi_erosion']}, {seeds}."


def number(value: float | None) -> str:
    """Number in three significant digits; "-" for None and NaN."""
    return "-" if value is None or not isfinite(value) else plain(value)


def chance(p: float | None) -> str:
    """Probability of a misfit; one too small to be computed is not called zero."""
    return number(p) if p is None else p_number(p)


def percent(value: float | None) -> str:
    """Share in percent; "-" for None."""
    if value is None:
        return "-"
    if 0.0 < value < LEAST_SHARE:
        return f"< {100.0 * LEAST_SHARE:g} %"
    return f"{100.0 * value:.0f} %" if value >= 0.1 else f"{100.0 * value:.1f} %"


def address_of(file: Path) -> str:
    """Picture file as data address."""
    return f"data:{MEDIA_TYPES[file.suffix.lower()]};base64," + base64.b64encode(file.read_bytes()).decode()
