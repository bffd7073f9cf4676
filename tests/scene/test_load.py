"""Reading of scene files: hash, resolved scene, kinds of files, and one clear line for every mistake."""

import copy
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scene_tables import ABSENT, SCENES, TUNNEL, changed, complaint, good_table, refusal, wrong_places

from taichi_erosion.cli.main import main
from taichi_erosion.core.errors import BadInput
from taichi_erosion.scene import load_scene, parse_scene, replica_setup, resolve, scene_hash
from taichi_erosion.scene.load import load_air_scene

FUNNEL = SCENES / "funnel_repose.toml"
IDLE = (
    "run.replicas=9 run.seed=99 record.every=0.5 scene.title='other' scene.notes='why' "
    "measured.repose_angle.value=20.0 gravity.magnitude=9.81 run.skin=0.05 stages.0.until=rest"
).split()
PHYSICS = (
    "grains.count=61 contact.soil-soil.restitution=0.61 conditions.moisture=0.02 run.precision=f64 "
    "run.time_step_fraction=0.1 laws.friction_cap=edem effects.plain_pull.strength=0.0 "
    "stages.2.duration_max=2.0 geometry.plate.radius=0.11"
).split()
ROOT = Path(__file__).parents[2]
STUDY, SCENE = str(ROOT / "doe" / "my_lab.toml"), str(ROOT / "scenes" / "saltation.toml")
MISTAKEN = {
    "a scene for a study": (("discover", SCENE), f"./erosion run {SCENE}"),
    "a folder for a study": (("adopt", str(ROOT / "doe"), "gusts"), "is a folder; name a study"),
    "a study for a scene": (("run", STUDY), f"./erosion compare {STUDY}"),
    "a study for a table": (("study", "new", STUDY), f"./erosion study check {STUDY}"),
    "a folder for a table": (("study", "new", "."), "is a folder; name a table"),
    "a scene to validate as a study": (("study", "check", SCENE), f"./erosion run {SCENE}"),
    "a table to report on": (("report", "t.csv"), "./erosion study new t.csv"),
    "a table to view": (("view", "t.csv"), "./erosion study new t.csv"),
    "an effect file for a study": (("compare", "pull.py"), "--effect pull.py"),
    "a recording for a study": (("next", "run.rrd"), "./erosion view run.rrd"),
}


def test_the_order_of_sections_and_comments_leave_the_hash_and_every_bit(tmp_path: Path):
    sections = re.split(r"\n(?=\[)", FUNNEL.read_text(encoding="utf-8"))
    path = tmp_path / "scene.toml"
    path.write_text("# another comment\n" + "\n".join(reversed(sections)), encoding="utf-8")
    straight, turned = load_scene(FUNNEL), load_scene(path)
    assert list(turned.geometry) == list(reversed(straight.geometry))
    assert scene_hash(turned) == scene_hash(straight)
    first, other = replica_setup(straight, 1), replica_setup(turned, 1)
    assert (first.materials, first.surfaces) == (other.materials, other.surfaces)
    assert np.array_equal(first.primitives.shape, other.primitives.shape)
    assert np.array_equal(first.grains.position, other.grains.position)


@pytest.mark.parametrize("order", [*IDLE, *PHYSICS])
def test_the_hash_changes_with_the_physics_alone(order: str):
    plain, changed = (scene_hash(parse_scene(good_table(), overrides=each)) for each in ((), (order,)))
    assert (plain == changed) == (order in IDLE)


def test_the_resolved_scene_is_complete_and_reads_back_as_itself():
    table = resolve(parse_scene(good_table()))
    assert (table["gravity"]["magnitude"], table["laws"]["friction_cap"]) == (9.81, "thornton")
    assert table["stages"][0]["rest_energy"] == 1e-5
    assert resolve(parse_scene(table)) == table


def test_an_apparatus_in_diameters_grows_with_its_grains_and_the_given_table_stays():
    table = changed("geometry.plate", {"shape": "disc", "material": "steel", "radius_d": 40.0})
    table["run"] |= {"time_step_d": 2e-3}
    kept = copy.deepcopy(table)
    sizes = ["grains.size.low=2e-3", "grains.size.median=3e-3", "grains.size.high=4e-3"]
    scene = parse_scene(table, overrides=sizes)
    assert table == kept
    assert scene.geometry["plate"].radius == pytest.approx(0.12)
    assert scene.run.time_step == pytest.approx(6e-6)


def test_a_length_in_diameters_is_told_as_the_user_wrote_it():
    table = changed("geometry.plate", {"shape": "disc", "material": "steel", "radius_d": -9.0})
    # the median of the good scene is 2 mm
    assert "geometry.plate.radius_d = -9.0 diameters: -0.018" in complaint(table)
    # without a diameter only the grains are judged
    table["grains"]["size"]["median"] = "2 mm"
    assert complaint(table) == "scenes/bad.toml: grains.size.median = '2 mm' must be a number"


def test_the_hash_of_a_mesh_follows_its_content(tmp_path: Path):
    facet = "facet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex {x} 0 0\nvertex 0 1 0\nendloop\nendfacet\n"
    names = []
    for x in (1.0, 2.0):
        (tmp_path / "wall.stl").write_text(f"solid wall\n{facet.format(x=x)}endsolid wall\n")
        wall = {"shape": "mesh", "material": "steel", "file": "wall.stl", "scale": 0.1}
        scene = parse_scene(changed("geometry.plate", wall), "scene.toml", tmp_path)
        names.append(scene_hash(scene))
        shape = replica_setup(scene, 1).primitives.shape
        assert shape[-1, :9] == pytest.approx([0.0, 0.0, 0.0, 0.1 * x, 0.0, 0.0, 0.0, 0.1, 0.0])
    assert names[0] != names[1]


@pytest.mark.parametrize(
    ("content", "word"),
    [
        (b"\xff\xfe\x00", "cannot be read as text: 'utf-8' codec"),
        (b"a = " + b"[" * 5000, "not a TOML file"),
        (b"a = 1" + b"0" * 5000, "not a TOML file"),
        (b"[scene]\nkind = 'repose'\nkind = 'drum'", "not a TOML file"),
    ],
)
def test_a_file_that_holds_no_scene_is_told_in_one_line(tmp_path: Path, content: bytes, word: str):
    path = tmp_path / "bad.toml"
    path.write_bytes(content)
    line = refusal(load_scene, path)
    assert line.startswith(f"{path}: ")
    assert word in line


def test_a_path_that_no_file_can_have_is_told(tmp_path: Path):
    with pytest.raises(BadInput, match="cannot be read"):
        load_scene(tmp_path / "nul\0byte.toml")


def test_the_hash_follows_the_flow_and_not_its_title():
    orders = ([], ["scene.title='other'"], ["air.inlet.speed=7.0"])
    scenes = (load_air_scene(TUNNEL, order) for order in orders)
    plain, titled, faster = map(scene_hash, scenes)
    assert plain == titled != faster


@pytest.mark.parametrize("name", MISTAKEN)
def test_a_file_of_another_kind_is_told_with_its_own_command(tmp_path, monkeypatch, capsys, name):
    words, remedy = MISTAKEN[name]
    monkeypatch.chdir(tmp_path)
    Path("t.csv").write_bytes("Korngröße [µm];u*t (cm/s)\n90;13,8\n".encode("cp1252"))
    Path("pull.py").write_text("", encoding="utf-8")
    Path("run.rrd").write_bytes(b"RRF2")
    assert main(list(words)) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert remedy in line
    assert " is " in line


@pytest.mark.parametrize(
    ("path", "value"), list(wrong_places()), ids=lambda part: "absent" if part is ABSENT else str(part)[:40]
)
def test_every_mistake_gives_one_line_that_names_the_file_and_the_section(path: str, value: Any):
    line = complaint(changed(path, value))
    assert line.startswith("scenes/bad.toml: ")
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
    with pytest.raises(BadInput, match=r"lies outside \[1, 5e\+06\] \(and 2 more\)$") as caught:
        parse_scene(table, "scenes/bad.toml")
    faults = [fault.split(" = ")[0].removeprefix("scenes/bad.toml: ") for fault in caught.value.faults]
    assert faults == ["grains.count", "contact.soil-soil.restitution", "contact.soil-soil.friction_sliding"]
