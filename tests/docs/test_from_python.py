"""The page and the notebook of the Python interface run, and say the same."""

import json
import re
from pathlib import Path
from typing import Any

import pytest

from taichi_erosion.core.device import stop_device

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"
FENCE = re.compile(r"```python\n(.*?)```", re.DOTALL)
CELLS = 10  # of the walk; the later ones simulate
pytestmark = pytest.mark.docs


def cells_of_page() -> list[str]:
    return [cell.strip() for cell in FENCE.findall((DOCS / "from_python.md").read_text(encoding="utf-8"))]


def cells_of_notebook() -> list[str]:
    notebook = json.loads((DOCS / "from_python.ipynb").read_text(encoding="utf-8"))
    return ["".join(cell["source"]).strip() for cell in notebook["cells"] if cell["cell_type"] == "code"]


def test_the_notebook_has_the_cells_of_the_page():
    assert cells_of_notebook() == cells_of_page()[:CELLS]


def test_the_notebook_shows_what_its_cells_give():
    notebook = json.loads((DOCS / "from_python.ipynb").read_text(encoding="utf-8"))
    cells = [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]
    shown = [set().union(*(output["data"] for output in cell["outputs"])) for cell in cells]
    assert all(shown[1:]), "run python docs/notebook.py again"
    assert sum("text/html" in kinds for kinds in shown) >= 3, "tables"
    assert sum("image/png" in kinds for kinds in shown) == 1, "the figure"
    (named,) = [cell for cell in cells if "".join(cell["source"]) == "discovery.named"]
    assert "".join(named["outputs"][0]["data"]["text/plain"]) == "['liquid_bridge']"


def test_the_cells_lead_from_a_table_to_a_lower_error(tmp_path, monkeypatch):
    for name in ("doe", "scenes"):
        (tmp_path / name).symlink_to(ROOT / name)
    monkeypatch.chdir(tmp_path)
    names: dict[str, Any] = {}
    for cell in cells_of_page():
        exec(cell, names)
    stop_device()
    assert names["discovery"].named == ["liquid_bridge"]
    error = names["adoption"].table["held_out"]
    assert error["after"] < 0.1 * error["before"]
    assert (tmp_path / "sand" / "windkanal-results" / "report.html").is_file() or list(
        tmp_path.rglob("*.html")
    )


def test_the_page_of_the_interface_is_that_of_its_docstrings():
    import runpy

    made = runpy.run_path(str(DOCS / "api.py"))
    assert (DOCS / "api.md").read_text(encoding="utf-8") == made["page"](), "run python docs/api.py again"
