"""Every mistake in a scene is told in one line, with its dotted path and what is allowed."""

from typing import Any

import pytest
from scene_tables import ABSENT, changed, complaint, wrong_places

from taichi_erosion.core.errors import BadInput
from taichi_erosion.scene import parse_scene

MISTAKES = list(wrong_places())


@pytest.mark.parametrize(
    ("path", "value"), MISTAKES, ids=lambda part: "absent" if part is ABSENT else str(part)[:40]
)
def test_every_mistake_gives_one_line_that_names_the_file_and_the_section(path: str, value: Any):
    line = complaint(changed(path, value))
    assert line.startswith("scenes/bad.toml: ")
    assert "\n" not in line
    assert len(line) < 400
    # a contradiction between sections may be told at either of them
    told_elsewhere = {"run", "grains", "stages", "contact", "materials", "fill", "measure"}
    section = path.split(".")[0]
    assert any(name in line for name in {section} | (told_elsewhere if section in told_elsewhere else set()))


@pytest.mark.parametrize(
    ("path", "value", "line"),
    [
        ("contact.soil-soil.restitution", 7.0, " = 7.0 lies outside [0, 1]"),
        ("materials.soil.density", 2.13e9, " = 2130000000.0 lies outside [25, 30000] kg m-3"),
        ("contact.soil-soil.restituton", 0.5, " is unknown; did you mean 'restitution'?"),
        ("materials.soil.density", ABSENT, " is missing"),
        ("geometry.funel", {"rim_radius": 0.05}, ".shape is missing"),
        ("laws.normal", "hetrz", " = 'hetrz' is not one of 'hertz' or 'jkr'"),
        ("grains.material", "sand", " = 'sand' is not among [materials]: soil, steel"),
        ("stages.2.remove", ["lid"], ": 'lid' is not standing: funnel, plate"),
    ],
)
def test_the_line_says_what_is_allowed(path: str, value: Any, line: str):
    assert complaint(changed(path, value)) == f"scenes/bad.toml: {path}{line}"


def test_the_first_of_several_mistakes_are_told_and_the_others_counted():
    table = changed("contact.soil-soil.restitution", 7.0)
    table["contact"]["soil-soil"]["friction_sliding"] = -1.0
    table["grains"]["count"] = 0
    assert complaint(table).endswith("lies outside [1, 5e+06] (and 2 more)")
    with pytest.raises(BadInput) as caught:
        parse_scene(table, "scenes/bad.toml")
    faults = [fault.split(" = ")[0].removeprefix("scenes/bad.toml: ") for fault in caught.value.faults]
    assert faults == ["grains.count", "contact.soil-soil.restitution", "contact.soil-soil.friction_sliding"]
