"""Whatever a scene file holds, the answer is a scene or one clear line."""

import string
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scene_tables import ABSENT, NUMBERS, TABLES, WORDS, changed, good_table, wrong_places

from taichi_erosion.core.errors import BadInput
from taichi_erosion.scene import load_scene, parse_scene

MISTAKES = list(wrong_places())
INCLINE = (Path(__file__).parents[2] / "scenes" / "incline.toml").read_bytes()


def complaint(table: dict[str, Any], **known: Any) -> str:
    with pytest.raises(BadInput) as caught:
        parse_scene(table, "scenes/bad.toml", **known)
    return str(caught.value)


def test_there_are_at_least_two_hundred_different_mistakes():
    assert len({(path, repr(value)) for path, value in MISTAKES}) == len(MISTAKES) >= 200


def test_the_scene_that_the_mistakes_start_from_is_right():
    parse_scene(good_table())


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


@pytest.mark.parametrize("path", [path for path in NUMBERS if "measured" not in path])
def test_a_word_for_a_number_is_told_with_its_dotted_path(path: str):
    assert complaint(changed(path, "much")).startswith(f"scenes/bad.toml: {path} = 'much' must be a ")


@pytest.mark.parametrize(
    ("path", "value", "line"),
    [
        ("contact.soil-soil.restitution", 7.0, "contact.soil-soil.restitution = 7.0 lies outside [0, 1]"),
        (
            "materials.soil.density",
            2.13e9,
            "materials.soil.density = 2130000000.0 lies outside [1, 30000] kg m-3",
        ),
        (
            "contact.soil-soil.restituton",
            0.5,
            "contact.soil-soil.restituton is unknown; did you mean 'restitution'?",
        ),
        ("materials.soil.density", ABSENT, "materials.soil.density is missing"),
        ("laws.normal", "hetrz", "laws.normal = 'hetrz' is not one of 'hertz' or 'jkr'"),
        ("contact.steel-soil", ABSENT, "contact.soil-steel is missing"),
        ("grains.material", "sand", "grains.material = 'sand' is not among [materials]: soil, steel"),
        ("fill.law", ABSENT, "fill.law is missing"),
        ("stages.2.remove", ["lid"], "stages.2.remove: 'lid' is not standing: funnel, plate"),
    ],
)
def test_the_line_says_what_is_allowed(path: str, value: Any, line: str):
    assert complaint(changed(path, value)) == f"scenes/bad.toml: {line}"


def test_several_mistakes_give_the_first_and_their_number():
    table = changed("contact.soil-soil.restitution", 7.0)
    table["contact"]["soil-soil"]["friction_sliding"] = -1.0
    table["grains"]["count"] = 0
    assert complaint(table).endswith("lies outside [1, 5e+06] (and 2 more)")


def test_a_length_in_diameters_is_told_as_the_user_wrote_it():
    table = good_table()
    table["geometry"]["plate"] = {"shape": "disc", "material": "steel", "radius_d": -9.0}
    # the median of the good scene is 2 mm
    assert "geometry.plate.radius_d = -9.0 diameters: -0.018" in complaint(table)


def test_without_a_diameter_only_the_grains_are_judged():
    table = changed("grains.size.median", "2 mm")
    table["run"] = {"time_step_d": 1e-2}
    assert complaint(table) == "scenes/bad.toml: grains.size.median = '2 mm' must be a number"


def test_an_unknown_effect_or_observable_is_told_with_those_that_exist():
    line = complaint(good_table(), effects={"lift": ("strength",), "drag": ()})
    assert line == "scenes/bad.toml: effects.plain_pull is unknown; known effects: drag, lift"
    line = complaint(good_table(), effects={"plain_pull": ("force",)})
    assert line == "scenes/bad.toml: effects.plain_pull.strength is unknown; allowed: force"
    line = complaint(good_table(), observables=("pile_height",))
    assert line == "scenes/bad.toml: measure.repose_angle is unknown; known observables: pile_height"


def test_two_grains_in_one_place_are_refused():
    table = good_table()
    table["grains"]["count"] = 2
    table["fill"] = {"law": "positions", "grains": [{"position": [0.0, 0.0, z]} for z in (0.010, 0.011)]}
    assert "fill.grains.1 overlaps fill.grains.0 by 0.001 m" in complaint(table)


@pytest.mark.parametrize(
    ("content", "word"),
    [
        (b"", "grains is missing"),
        (b"\xff\xfe\x00", "byte 0 is not UTF-8 text"),
        (b"[scene\nkind = 1", "not a TOML file"),
        (b"a = " + b"[" * 5000, "not a TOML file"),
        (b"a = 1" + b"0" * 5000, "not a TOML file"),
        (b"[scene]\nkind = 'repose'\nkind = 'drum'", "not a TOML file"),
        (b"x" * 5_000_000, "5000000 bytes is too large"),
    ],
)
def test_a_file_that_holds_no_scene_is_told_in_one_line(tmp_path: Path, content: bytes, word: str):
    path = tmp_path / "bad.toml"
    path.write_bytes(content)
    with pytest.raises(BadInput) as caught:
        load_scene(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert word in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("name", ["nowhere.toml", ".", "nul\0byte.toml"])
def test_a_path_without_a_file_is_told_in_one_line(tmp_path: Path, name: str):
    with pytest.raises(BadInput, match=r"no such file|is not a file|cannot be read"):
        load_scene(tmp_path / name)


def test_a_mesh_that_is_none_is_told_with_its_path(tmp_path: Path):
    (tmp_path / "wall.stl").write_bytes(b"solid nothing")
    for file, word in (
        ("wall.stl", "triangle"),
        ("no.stl", "no such file"),
        ("../x.stl", "beside"),
        ("a", "no such"),
    ):
        table = changed("geometry.plate", {"shape": "mesh", "material": "steel", "file": file})
        with pytest.raises(BadInput, match=rf"geometry\.plate.*{word}"):
            parse_scene(table, "bad.toml", tmp_path)


VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8) | st.dates() | st.times(),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=6), inner, max_size=3),
    max_leaves=6,
)


@settings(max_examples=300)
@given(st.lists(st.tuples(st.sampled_from(NUMBERS + TABLES + WORDS), VALUES), min_size=1, max_size=2))
def test_random_values_anywhere_give_a_scene_or_one_line(mistakes: list[tuple[str, Any]]):
    table = changed(*mistakes[0])
    for path, value in mistakes[1:]:
        if path.split(".")[0] != mistakes[0][0].split(".")[0]:
            place = path.split(".")
            table[place[0]] = changed(path, value).get(place[0])
    told_or_loaded(table)


@settings(max_examples=100)
@given(st.dictionaries(st.sampled_from(sorted(good_table())), VALUES, max_size=12))
def test_random_tables_give_one_line(table: dict[str, Any]):
    told_or_loaded(table)


@settings(max_examples=100)
@given(st.text(string.printable, max_size=40), st.text(string.printable, max_size=20))
def test_random_orders_give_a_scene_or_one_line(path: str, value: str):
    told_or_loaded(good_table(), f"{path}={value}")
    told_or_loaded(good_table(), f"grains.size.{value}={path}")


@settings(max_examples=100, deadline=None)
@given(st.integers(0, len(INCLINE) - 1), st.binary(max_size=6))
def test_a_file_damaged_anywhere_gives_a_scene_or_one_line(tmp_path_factory: Any, place: int, damage: bytes):
    path = tmp_path_factory.mktemp("damaged") / "scene.toml"
    path.write_bytes(INCLINE[:place] + damage + INCLINE[place + len(damage) :])
    line = outcome(lambda: load_scene(path))
    assert line is None or (line.startswith(f"{path}: ") and "\n" not in line)


def told_or_loaded(table: dict[str, Any], *orders: str) -> None:
    line = outcome(lambda: parse_scene(table, "scenes/bad.toml", Path(), orders))
    assert line is None or (line.startswith("scenes/bad.toml: ") and "\n" not in line)


def outcome(load: Callable[[], Any]) -> str | None:
    try:
        load()
    except BadInput as error:
        return str(error)
    return None
