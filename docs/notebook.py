"""The notebook of docs/live_and_python.md: its walk in Python, executed, with outputs."""

import ast
import base64
import contextlib
import json
import os
import re
import tempfile
from collections.abc import Iterator
from io import BytesIO
from pathlib import Path
from typing import Any

DOCS = Path(__file__).resolve().parent
NOTEBOOK, PAGE = DOCS / "from_python.ipynb", DOCS / "live_and_python.md"
FENCE = re.compile(r"```python\n(.*?)```", re.DOTALL)
BEGIN, END = "## From a table to an answer in Python", "## Runs and sessions in Python"
DOTS_PER_INCH = 110
NEEDS = ("doe", "scenes")  # folders that the cells read

Cell = dict[str, Any]


def parts_of_page(text: str) -> Iterator[tuple[str, str]]:
    """(kind, source) of the cells: text and code in turn."""
    for place, part in enumerate(FENCE.split(text[text.index(BEGIN) : text.index(END)])):
        if part.strip():
            yield ("code" if place % 2 else "markdown"), part.strip()


def value_of(source: str, names: dict[str, Any]) -> Any:
    """Value of the last expression of a cell after its statements; None where it ends in a statement."""
    tree = ast.parse(source)
    last = tree.body[-1]
    if not isinstance(last, ast.Expr):
        exec(compile(tree, "cell", "exec"), names)
        return None
    exec(compile(ast.Module(tree.body[:-1], []), "cell", "exec"), names)
    return eval(compile(ast.Expression(last.value), "cell", "eval"), names)


def shown(value: Any) -> Cell:
    """What a notebook keeps of a value: text, HTML or a picture."""
    data: dict[str, Any] = {"text/plain": lines(repr(value))}
    if hasattr(value, "savefig"):
        page = BytesIO()
        value.savefig(page, format="png", dpi=DOTS_PER_INCH, metadata={"Software": None})
        data = {"image/png": base64.b64encode(page.getvalue()).decode(), "text/plain": ["Figure"]}
    elif (html := getattr(value, "_repr_html_", None)) is not None:
        data["text/html"] = lines(html())
    return {"output_type": "execute_result", "metadata": {}, "data": data}


def lines(text: str) -> list[str]:
    """Lines as a notebook keeps them."""
    return text.splitlines(keepends=True)


def cells(text: str) -> Iterator[Cell]:
    """Cells of the notebook; code is executed."""
    names: dict[str, Any] = {}
    for kind, source in parts_of_page(text):
        cell: Cell = {"cell_type": kind, "metadata": {}, "source": lines(source)}
        if kind == "code":
            value = value_of(source, names)
            outputs = [] if value is None else [shown(value) | {"execution_count": None}]
            cell |= {"execution_count": None, "outputs": outputs}
        yield cell


def notebook() -> str:
    """Text of the notebook, executed in an empty folder beside what its cells read."""
    about = {"name": "python3", "display_name": "Python 3", "language": "python"}
    with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
        for name in NEEDS:
            os.symlink(DOCS.parent / name, name)
        found = list(cells(PAGE.read_text(encoding="utf-8")))
    made = {"cells": found, "metadata": {"kernelspec": about}, "nbformat": 4, "nbformat_minor": 4}
    return json.dumps(made, indent=1, ensure_ascii=False) + "\n"
