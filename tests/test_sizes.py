"""Budgets of `[tool.sizes]` in pyproject.toml: the whole and its rooms may shrink, and not grow.

lines       of Python and templates below a folder (`*.py`)
files       Python files below a folder
constants   module-level names in capitals that are bound to a number
words       of a Markdown file, or of all below a folder
"""

import re
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
BUDGETS = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["sizes"]
CONSTANT = re.compile(r"(?m)^[A-Z][A-Z0-9_]* *(?::[^=\n]+)?= *\(?\s*-?[\d.]")
SLACK = 0.05  # of a budget that a shrunken place may leave open before its budget is lowered [1]


def texts(place: str, ending: str) -> Iterator[str]:
    """Text of a file, or of every file below a folder with this ending."""
    path = ROOT / place
    for file in [path] if path.is_file() else sorted(path.rglob(f"*{ending}")):
        yield file.read_text(encoding="utf-8")


def size(place: str, measure: str) -> int:
    """Size of a place, or of several with a blank between them."""
    ending = ".md" if measure == "words" else ".py"
    found = [text for each in place.split() for text in texts(each, ending)]
    count = {
        "lines": lambda text: text.count("\n"),
        "files": lambda text: 1,
        "constants": lambda text: len(CONSTANT.findall(text)),
        "words": lambda text: len(text.split()),
    }[measure]
    return sum(map(count, found))


@pytest.mark.parametrize("place", BUDGETS)
def test_a_place_keeps_its_budget_and_a_budget_follows_its_place_down(place: str):
    for measure, budget in BUDGETS[place].items():
        now = size(place, measure)
        assert now <= budget, f"{place}: {now} {measure}, {budget} allowed"
        assert now >= (1.0 - SLACK) * budget, f"{place}: lower its budget of {measure} to {now}"


def test_every_room_has_a_budget():
    rooms = {f"taichi_erosion/{path.name}" for path in (ROOT / "taichi_erosion").iterdir() if path.is_dir()}
    assert {room for room in rooms if "__pycache__" not in room} <= set(BUDGETS)
