"""Files of an adoption: named by study and effects, never written over those of others."""

import tomllib

import pytest

from taichi_erosion.core.errors import BadInput
from taichi_erosion.evidence.models.adopted_files import Adoption, write_adopted_files
from taichi_erosion.evidence.models.load_study import load_study
from taichi_erosion.evidence.record import Interval
from taichi_erosion.execution.checks import read_scene
from tests.evidence.models.test_simulator import FRICTION, STUDY, study


def adoption(*effects: str, friction: float = 0.2) -> Adoption:
    numbers = {FRICTION: Interval(friction, 0.1, 0.3), "contact.soil-steel.restitution": Interval(0.5, 0, 1)}
    return Adoption(effects, dict.fromkeys(effects, Interval(1.25, 0.5, 2.0)), numbers)


def test_study_and_scenes_are_named_by_the_study_and_all_effects(tmp_path):
    written = write_adopted_files(study(tmp_path), adoption("liquid_bridge", "dry_adhesion"))
    name = "study_with_liquid_bridge_and_dry_adhesion.toml"
    assert [path.name for path in written] == [name, f"heap_{name}"]
    after, scene = (tomllib.loads(path.read_text("utf-8")) for path in written)
    assert (after["study"]["measurements"], after["study"]["follows"]) == ("heap.csv", "study.toml")
    assert set(after["adopted"]) == {"liquid_bridge", "dry_adhesion"}
    assert scene["effects"]["liquid_bridge"]["strength"] == 1.25
    assert "soil-steel" not in scene["contact"], "a number that this scene has not stays out"
    assert read_scene(written[1], ()).contact["grain-grain"].friction_rolling == 0.2


def test_a_calibrated_scene_that_the_user_edited_is_not_replaced(tmp_path):
    found = study(tmp_path)
    _, scene = write_adopted_files(found, adoption("liquid_bridge"))
    edited = scene.read_text("utf-8") + "# my remark\n"
    scene.write_text(edited, "utf-8")
    with pytest.raises(BadInput, match="was changed after this program wrote it"):
        write_adopted_files(found, adoption("liquid_bridge", friction=0.25))
    assert scene.read_text("utf-8") == edited
    write_adopted_files(found, adoption("liquid_bridge", friction=0.25), force=True)
    assert "my remark" not in scene.read_text("utf-8")


def test_a_chain_names_every_step(tmp_path):
    first, _ = write_adopted_files(study(tmp_path, f"# my study{STUDY}"), adoption("liquid_bridge"))
    second, _ = write_adopted_files(load_study(first), adoption("dry_adhesion"))
    assert second.name == "study_with_liquid_bridge_with_dry_adhesion.toml"
    text = second.read_text("utf-8")
    assert text.count("made by taichi_erosion") == 1
    assert "# my study" in text
