"""The walk in Python: page, notebook and program say the same; the interface is that of its docstrings."""

import json
import re
import runpy
from pathlib import Path
from typing import Any

import pytest

from doe.common.pages import fill_tables
from taichi_erosion.core.device import stop_device

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"
PAGE = (DOCS / "live_and_python.md").read_text(encoding="utf-8")
CELLS = [cell.strip() for cell in re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)]
OF_NOTEBOOK = 10  # cells of the walk; the later ones simulate
pytestmark = pytest.mark.docs


def test_the_notebook_has_the_cells_of_the_page_and_what_they_give():
    notebook = json.loads((DOCS / "from_python.ipynb").read_text(encoding="utf-8"))
    cells = [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]
    assert ["".join(cell["source"]).strip() for cell in cells] == CELLS[:OF_NOTEBOOK]
    shown = [set().union(*(output["data"] for output in cell["outputs"])) for cell in cells]
    assert all(shown[1:]), "run python docs/make.py again"
    assert sum("text/html" in kinds for kinds in shown) >= 3, "tables"
    assert sum("image/png" in kinds for kinds in shown) == 1, "the figure"
    (named,) = [cell for cell in cells if "".join(cell["source"]) == "discovery.named"]
    assert "".join(named["outputs"][0]["data"]["text/plain"]) == "['liquid_bridge']"


def test_the_cells_lead_from_a_table_to_a_lower_error_and_a_heap(tmp_path, monkeypatch):
    monkeypatch.chdir(runpy.run_path(str(DOCS / "tutorial.py"))["copy_tree"](tmp_path))
    names: dict[str, Any] = {}
    for cell in CELLS:
        exec(cell, names)
    assert names["discovery"].named == ["liquid_bridge"]
    error = names["adoption"].table["held_out"]
    assert error["after"] < 0.1 * error["before"]
    assert list(tmp_path.rglob("windkanal.report.html"))
    session = names["session"]
    assert session.table.loc["angle_of_repose", "unit"] == "deg"
    assert list(session.diff("at rest").index) == ["contact.grain-grain.friction_rolling"]
    assert len(session.plot("pile_height").axes[0].lines[0].get_xdata()) > 2
    stop_device()


def test_the_interface_is_that_of_its_docstrings():
    text = (DOCS / "json_and_python.md").read_text(encoding="utf-8")
    made = runpy.run_path(str(DOCS / "api.py"))["interface"]()
    assert fill_tables(text, {"python": made}) == text, "run python docs/make.py again"
