"""Pages in HTML that need nothing beside themselves."""

from collections.abc import Mapping
from math import isfinite
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined


def render(template: str, words: Mapping[str, Any]) -> str:
    """A page from its template; words are escaped, and one that is missing is an error."""
    environment = Environment(
        loader=PackageLoader("taichi_erosion.report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
    )
    environment.filters |= {"figure": figure, "share": share}
    return environment.get_template(template).render(**words)


def figure(value: float | None) -> str:
    """A number to three significant digits."""
    return "-" if value is None or not isfinite(value) else f"{value:.3g}"


def share(value: float | None) -> str:
    """A share in percent."""
    if value is None:
        return "-"
    return f"{100.0 * value:.0f} %" if value >= 0.1 else f"{100.0 * value:.1f} %"
