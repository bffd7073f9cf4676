"""Effects of the user's own in scenes and runs: known by their content, carried to workers as text."""

from pathlib import Path

import pytest
from small_scene import write_scene

from taichi_erosion.campaign.request import request_of_scene, simulation_function
from taichi_erosion.cli.effects import effect_file_text
from taichi_erosion.execution import ensemble
from taichi_erosion.execution.checks import library_of, read_scene
from taichi_erosion.scene import scene_hash
from taichi_erosion.simulation import prepare

PULL = effect_file_text("pair_effect").replace("NAME", "constant_pull")
ON = ("effects.constant_pull.strength=1.0",)


@pytest.fixture
def scene(tmp_path) -> Path:
    """A scene that names an effect file beside it."""
    path = write_scene(tmp_path)
    text = path.read_text(encoding="utf-8")
    assert "[scene]\n" in text
    path.write_text(text.replace("[scene]\n", '[scene]\neffect_files = ["glue.py"]\n'), encoding="utf-8")
    (tmp_path / "glue.py").write_text(PULL, encoding="utf-8")
    return path


def test_a_file_changes_the_hash_where_its_effect_is_named_and_nowhere_else(scene):
    bare, pulled = scene_hash(read_scene(scene, ())), scene_hash(read_scene(scene, ON))
    (scene.parent / "glue.py").write_text(f"{PULL}\n# edited\n", encoding="utf-8")
    assert scene_hash(read_scene(scene, ())) == bare
    assert scene_hash(read_scene(scene, ON)) != pulled
    scene.write_text(scene.read_text("utf-8").replace('effect_files = ["glue.py"]\n', ""), encoding="utf-8")
    assert scene_hash(read_scene(scene, ())) == bare, "a file that is not used does not count"


def test_a_worker_without_the_file_runs_the_text_that_was_hashed(scene, monkeypatch):
    asked = request_of_scene(read_scene(scene, ON), 3)
    hashed = scene_hash(read_scene(scene, ON))
    (scene.parent / "glue.py").unlink()
    received = []
    monkeypatch.setattr(ensemble, "run_replicas_reusing_buffers", lambda _, runs, *__: received.extend(runs))
    with simulation_function() as run:
        run([asked.payload], lambda place, record: None)
    (part,) = received
    assert asked.key.startswith(scene_hash(part.scene))
    assert scene_hash(part.scene) == hashed
    (acting,) = prepare(part.scene, 3, library_of(part.scene)).effects
    assert acting.effect.name == "constant_pull"
