"""Pages with tables between `<!-- table: NAME -->` and `<!-- end -->`: in docs/, in full in READMEs."""

import re
from collections.abc import Mapping, Sequence
from pathlib import Path

from taichi_erosion.core.files import write_atomic

RESULTS = "results.md"  # page in docs/ of all studies
MARKED = re.compile(
    r"(?P<begin><!-- table: (?P<name>[\w ]+) -->\n)(?P<table>.*?)(?P<end><!-- end -->)", re.DOTALL
)


def fill_tables(page: str, tables: Mapping[str, str]) -> str:
    """Page with the tables that it marks; others stay. Raises ValueError for a table without a mark."""
    if lost := tables.keys() - {found["name"] for found in MARKED.finditer(page)}:
        raise ValueError(f"the page does not mark {sorted(lost)}")
    return MARKED.sub(
        lambda found: found["begin"] + tables.get(found["name"], found["table"]) + found["end"], page
    )


def filled(pages: Sequence[Path], tables: Mapping[str, str]) -> dict[Path, str]:
    """Texts of the pages, each with the tables that it marks. Raises ValueError for one without a mark."""
    texts = {page: page.read_text(encoding="utf-8") for page in pages}
    marks = {page: {found["name"] for found in MARKED.finditer(text)} for page, text in texts.items()}
    if lost := tables.keys() - set().union(*marks.values()):
        raise ValueError(f"no page marks {sorted(lost)}")
    return {
        page: fill_tables(texts[page], {name: tables[name] for name in tables.keys() & names})
        for page, names in marks.items()
    }


def write_pages(pages: Sequence[Path], tables: Mapping[str, str]) -> None:
    """Fill the tables of the pages."""
    for page, text in filled(pages, tables).items():
        write_atomic(page, text.encode())
