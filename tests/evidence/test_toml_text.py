"""One number of a file changes, and nothing else."""

import tomllib
from pathlib import Path

import pytest

from taichi_erosion.core.errors import BadInput
from taichi_erosion.evidence.data.toml_edit import with_entry

SCENE = (Path(__file__).parents[2] / "scenes" / "column_collapse.toml").read_text("utf-8")


def changed_lines(before: str, after: str) -> list[str]:
    old = before.splitlines()
    return [line for line in after.splitlines() if line not in old]


@pytest.mark.parametrize(
    ("path", "line"),
    [
        (("contact", "grain-grain", "friction_rolling"), "friction_rolling = 0.25"),
        (("materials", "grain", "density"), "density = 0.25"),
        (("grains", "size", "diameter"), 'size = { law = "monodisperse", diameter = 0.25 }'),
    ],
)
def test_an_entry_changes_where_it_stands(path, line):
    assert changed_lines(SCENE, with_entry(SCENE, path, 0.25)) == [line]


def test_a_comment_behind_the_entry_stays():
    after = with_entry("[a]\nb = 1.0   # why\n", ("a", "b"), 2.0)
    assert after == "[a]\nb = 2.0   # why\n"


def test_an_entry_of_the_same_name_elsewhere_stays():
    after = tomllib.loads(with_entry(SCENE, ("contact", "grain-plate", "friction_sliding"), 0.25))
    assert after["contact"]["grain-grain"]["friction_sliding"] == 0.55
    assert after["contact"]["grain-plate"]["friction_sliding"] == 0.25


def test_what_is_not_there_gets_its_section():
    after = with_entry(SCENE, ("effects", "liquid_bridge", "strength"), 1.5)
    assert changed_lines(SCENE, after) == ["[effects.liquid_bridge]", "strength = 1.5"]
    again = with_entry(after, ("effects", "liquid_bridge", "strength"), 0.5)
    assert changed_lines(SCENE, again) == ["[effects.liquid_bridge]", "strength = 0.5"]


def test_a_quoted_heading_is_the_section_that_it_names():
    after = with_entry('[parameters."a.b-c"]\nstart = 1.0\n', ("parameters", "a.b-c", "start"), 2.0)
    assert after == '[parameters."a.b-c"]\nstart = 2.0\n'


def test_a_file_that_cannot_be_changed_so_is_told():
    with pytest.raises(BadInput, match="set it by hand"):
        with_entry("a = { b = 1.0 }\n", ("a", "c"), 2.0)
