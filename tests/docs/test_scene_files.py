"""Parts of scenes in `docs/scene_files.md` are valid where they stand in the scene that the page names."""

import re
import tomllib
from pathlib import Path

import pytest

from taichi_erosion.run.observables import OBSERVABLES
from taichi_erosion.scene.load import parse_scene, toml_table

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "scene_files.md").read_text(encoding="utf-8")
PARTS = re.findall(r"<!-- part -->\n```toml\n(.*?)```", PAGE, re.DOTALL)
assert len(PARTS) >= 6, "the page has lost its parts"
FACET = "facet normal 0 0 1\nouter loop\nvertex -30 -30 -10\nvertex 30 -30 -5\nvertex 30 30 -5\n"
RAMP = f"solid ramp\n{FACET}endloop\nendfacet\nendsolid ramp\n"  # in millimetres, below the plate


@pytest.mark.parametrize("part", PARTS, ids=lambda part: part.splitlines()[0])
def test_a_part_of_a_scene_is_valid_in_the_scene_of_the_page(tmp_path, part):
    (tmp_path / "ramp.stl").write_text(RAMP, encoding="utf-8")
    table = toml_table(ROOT / "scenes" / "column_collapse.toml")
    for section, entries in tomllib.loads(part).items():
        table[section] = table.get(section, {}) | entries
    scene = parse_scene(table, folder=tmp_path, observables=tuple(OBSERVABLES))
    assert scene.grains.count > 0
