"""Grains that are missing, doubled or nowhere; messages of failed replicas; what a command loads."""

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from grain_worlds import heap

from taichi_erosion.cli.main import main
from taichi_erosion.core.setup import Laws, Numerics
from taichi_erosion.core.snapshot import Failure, Status
from taichi_erosion.execution import ensemble_loop
from taichi_erosion.execution.stages import ReplicaState
from taichi_erosion.scene import laws, load_scene
from taichi_erosion.simulation import assemble, prepare, readback

pytestmark = pytest.mark.usefixtures("start_device")  # which stops what a test has started
ROOT = Path(__file__).parents[2]
DEAR = ["scipy." + name for name in ("special", "ndimage", "spatial", "optimize", "stats")]
DEAR += ["rerun", "matplotlib"]
COMPILER = ["taichi", "quadrants"]
CLOSED = [*COMPILER, "pint", "pandas", "scipy.stats", "scipy.optimize"]  # what no closed form needs
HEAVY = ["taichi", "rerun", "statsmodels", "scipy", "matplotlib", "numpy"]
QUESTION = """
import sys
from taichi_erosion.cli.main import main
{code}
print([name for name in {forbidden} if name in sys.modules], file=sys.stderr)
"""
DAMAGES = [  # how a snapshot differs, and what is noticed
    (lambda state: {}, None),
    (lambda state: {"ident": np.where(state.ident == 7, 6, state.ident)}, Status.COUNT),
    (lambda state: {"mass": 1.001 * state.mass}, Status.COUNT),
    (lambda state: {"velocity": np.nan * state.velocity}, Status.NOT_FINITE),
]


@pytest.mark.parametrize(
    ("code", "forbidden", "printed"),
    [
        ("main(['run', '--help'])", HEAVY, "--set"),
        ("main(['run', 'scenes/incline.toml', '--check'])", ["taichi"], "valid"),
        ("import taichi_erosion.execution.ensemble_loop", DEAR, ""),
    ],
    ids=["help", "check", "run before its first step"],
)
def test_no_dear_library_is_loaded_before_it_is_needed(code, forbidden, printed):
    assert_not_loaded(code, forbidden, printed)


def test_no_command_on_a_closed_form_loads_what_only_scenes_need(tmp_path):
    table = str(ROOT / "doe/windkanal.csv")
    assert main(["study", "new", table, "--yes", "--closed-form", "--out", str(tmp_path)]) == 0
    study = str(tmp_path / "windkanal.toml")
    assert_not_loaded(f"main(['compare', {study!r}]), main(['discover', {study!r}])", CLOSED, "Missing")


def assert_not_loaded(code, forbidden, printed):
    """A fresh interpreter runs the code, prints something, and has loaded none of some modules."""
    words = [sys.executable, "-c", QUESTION.format(code=code, forbidden=forbidden)]
    told = subprocess.run(words, capture_output=True, text=True, check=True, cwd=ROOT)
    assert printed in told.stdout
    assert told.stderr == "[]\n"


@pytest.mark.parametrize(
    ("end", "words"),
    [
        (Failure(Status.OVERLAP, 0.5, 7, 9, 0.31), ("grain 7 overlaps grain 9 by 0.31 radii", "0.5 s")),
        (Failure(Status.OVERLAP, 0.5, 7, -3, 0.31), ("grain 7 overlaps wall piece 2",)),
        (Failure(Status.LOST, 0.25, 4, -1, -1.5), ("grain 4 left the domain", "-1.5 m")),
        (Failure(Status.NOT_FINITE, 0.25, 4, -1, np.nan), ("grain 4", "not a number")),
        (Failure(Status.ENERGY, 0.25, -1, -1, 0.2), ("energy grew by 0.2",)),
    ],
)
def test_a_failure_is_told_in_one_line_with_place_time_and_cause(end, words):
    said = ensemble_loop.failure_message(end, 11)
    assert all(word in said for word in ("seed 11", "likely cause", *words))
    assert "\n" not in said


def test_a_check_of_falling_grains_asks_the_device_as_often_for_many_replicas_as_for_one(scene, monkeypatch):
    """A question takes a graphics processor as long as several steps."""
    scene, questions, counts = load_scene(scene), [], []
    first, *later = scene.stages
    scene = scene.model_copy(update={"stages": [first.model_copy(update={"until": "rest"}), *later]})
    ask = readback.download
    monkeypatch.setattr(readback, "download", lambda *rows: (questions.append(rows), ask(*rows))[1])
    for count in (1, 3):
        sim = assemble([prepare(scene, k, {}) for k in range(count)], laws(scene), Numerics("cpu", 1))
        ensemble = ensemble_loop.EnsembleRun([scene] * count, sim, [ReplicaState(k, 0) for k in range(count)])
        ensemble_loop.advance_to_next_check(ensemble)
        counts.append(len(questions))
    assert counts[1] == 2 * counts[0]


def test_a_grain_that_is_missing_doubled_or_nowhere_is_noticed(monkeypatch):
    sim = assemble([heap(20, 1)], Laws(), Numerics("cpu", 1))
    state, found = ensemble_loop.simulation.snapshot(sim, 0), []
    for damage, _ in DAMAGES:
        changed = replace(state, **damage(state))
        monkeypatch.setattr(ensemble_loop.simulation, "snapshot", lambda *place, changed=changed: changed)
        found.append(ensemble_loop.failure_of_lost_grains(sim, 0, 0.002))
    assert [end and end.status for end in found] == [status for _, status in DAMAGES]
