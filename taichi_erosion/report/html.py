"""Self-contained HTML pages: templates, formats of numbers, embedded picture files."""

import base64
import re
from collections.abc import Mapping
from datetime import date
from math import isfinite
from mimetypes import guess_type
from pathlib import Path
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup, escape

from taichi_erosion import __version__
from taichi_erosion.core.files import mark_html, refuse_foreign_file, write_atomic
from taichi_erosion.tables.number_words import plain


def write_page(to: Path, source: Path, force: bool, template: str, fields: Mapping[str, Any]) -> Path:
    """Write the page of a source; a file that is not its page stays unless forced. Raises BadInput."""
    refuse_foreign_file(to, source, force)
    return write_atomic(to, mark_html(to, source, render_template(template, fields)))


def render_template(template: str, fields: Mapping[str, Any]) -> str:
    """HTML page of a template. Texts are escaped; a missing field is an error.

    Filters: a number in three significant digits, `-` for None and NaN; a line with its commands marked.
    """
    rules = {"autoescape": True, "undefined": StrictUndefined, "trim_blocks": True}
    environment = Environment(loader=PackageLoader("taichi_erosion.report"), **rules)
    environment.filters |= {
        "number": lambda value: "-" if value is None or not isfinite(value) else plain(value),
        "commands": lambda line: Markup(re.sub("`(.+?)`", r"<code>\1</code>", str(escape(line)))),
    }
    return environment.get_template(template).render(**fields)


def origin_line(seeds: str, version: str = __version__) -> str:
    """When and with what a page was made."""
    return f"Made on {date.today().isoformat()} with taichi_erosion {version}, {seeds}."


def picture_address(file: Path) -> str:
    return f"data:{guess_type(file)[0]};base64,{base64.b64encode(file.read_bytes()).decode()}"
