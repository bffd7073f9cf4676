"""Resume after a kill or an interruption: the document is that of a run that nobody disturbed."""

import json
import signal
import time
import tomllib
from dataclasses import asdict, fields
from hashlib import sha256
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import tomli_w
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from small_scene import PATIENCE, start

from taichi_erosion.core.device import stop_device
from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.snapshot import AirProfile, Failure, Snapshot, Status
from taichi_erosion.execution import RunOptions, run_scene
from taichi_erosion.execution import scene_run as scene_run_module
from taichi_erosion.execution.checkpoint import Checkpointer, restore_run_state, run_state
from taichi_erosion.execution.ensemble_loop import EnsembleRun
from taichi_erosion.execution.stages import ReplicaState
from taichi_erosion.execution.threshold_search import ThresholdSearch, Trial
from taichi_erosion.measures.result import Measurement
from taichi_erosion.measures.threshold import Bracket
from taichi_erosion.recording.readback import read_grains
from taichi_erosion.scene import checkpoint_file, load_scene, scene_hash
from taichi_erosion.scene.checkpoint_file import load_checkpoint, save_checkpoint

OF_THIS_CALL = ("scene", "wall_s", "recording", "film", "silhouettes", "numerics")  # not of the physics
WINDY = Path(__file__).parents[2] / "scenes" / "wind_threshold.toml"
META = {"scene_hash": "5eed", "time": 0.125, "seeds": [1, 2, 3], "title": "Böschung"}
ONE_FILE = settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture])
DAY = 86400.0  # s
SLOW = pytest.mark.slow
CUTS = {"ramp": 0.055, "hold": 0.1, "fall": 0.17}  # s, by the phase in which the first bed is then


def fingerprint(document: dict[str, Any]) -> str:
    """Digest of all that a run's document says of its physics."""
    said = {name: entry for name, entry in document.items() if name not in OF_THIS_CALL}
    return sha256(json.dumps(said, sort_keys=True, default=str).encode()).hexdigest()


@pytest.fixture(scope="module")
def killed(scene, folder) -> Path:
    """Checkpoint of a run on two threads that was killed as soon as there was one."""
    kept = folder / "killed.npz"
    words = ("--checkpoint", str(kept), "--every", "0.02", "--record", str(folder / "killed.rrd"))
    run = start(scene, "--threads", "2", *words)
    end = time.monotonic() + PATIENCE
    while not kept.exists():
        assert run.poll() is None, run.communicate()
        assert time.monotonic() < end, "no checkpoint came"
        time.sleep(0.002)
    run.send_signal(signal.SIGKILL)
    run.communicate()
    return kept


def test_one_thread_goes_on_where_two_were_killed_and_ends_with_the_same_document(whole, killed, scene):
    assert not killed.with_suffix(".rrd").exists()
    assert not killed.with_suffix(".json").exists()
    read_grains(killed.with_suffix(".rrd.part"))
    arrays, meta = load_checkpoint(killed)
    assert 0 < meta["checks"] < 120  # the run has 120 of them
    assert 0.0 < meta["wall_s"] < DAY
    save_checkpoint(killed, arrays, meta | {"wall_s": DAY})
    resumed = run_scene(scene, RunOptions(threads=1, no_record=True, resume=killed))
    stop_device()
    assert fingerprint(resumed) == fingerprint(whole)
    assert resumed["wall_s"] > DAY  # its grain-steps count from the beginning too


def test_an_interrupted_run_names_its_checkpoint_which_goes_on_with_its_own_seeds_alone(scene, folder):
    run_ensemble = scene_run_module.run_ensemble

    def interrupt(now: EnsembleRun) -> None:
        raise KeyboardInterrupt

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(scene_run_module, "run_ensemble", lambda now, calls: run_ensemble(now, [interrupt]))
        with pytest.raises(KeyboardInterrupt, match=r"cut\.checkpoint\.npz"):
            run_scene(scene, RunOptions(threads=1, record=folder / "cut.rrd"))
    stop_device()
    kept = folder / "cut.checkpoint.npz"
    assert load_checkpoint(kept)[1]["checks"] == 1
    with pytest.raises(BadInput, match=r"cut\.checkpoint\.npz: holds seeds \[3, 4\], not \[8, 9\]"):
        run_scene(scene, RunOptions(threads=1, seed=8, no_record=True, resume=kept))


@pytest.fixture(scope="module")
def windy(folder) -> Path:
    """Two beds of a hundred grains: a search in coarse steps and short trials, means over its whole stage."""
    table = tomllib.loads(WINDY.read_text(encoding="utf-8"))
    del table["measured"]
    table["run"] |= {"replicas": 2, "time_step_fraction": 0.25}
    table["effects"] = {}
    table["grains"] |= {"count": 100, "size": {"law": "monodisperse", "diameter": 0.25e-3}}
    table["wind"]["height"] = 0.01
    table["threshold"] = {"first": 0.6, "rise": 0.4, "rise_hold": 0.01, "hold": 0.02, "levels": 0}
    table["threshold"] |= {"share": 0.02, "distance": 0.3, "excess": 1.0, "spin_up": 0.02}
    table["threshold"] |= {"fall": 0.5, "fall_hold": 0.02, "ceased": 0.5}
    table["stages"][0]["duration_max"], table["stages"][1]["duration_max"] = 0.05, 0.5
    thresholds = ("rolling_onset", "threshold_u_star", "impact_threshold")
    means = {name: {"every": 0.01} for name in ("flux", "bed_stress", "grain_stress")}
    table["measure"] = {name: {} for name in thresholds} | means
    path = folder / "windy.toml"
    path.write_text(tomli_w.dumps(table), encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def searched(windy, folder) -> dict[str, Any]:
    """The document of an uninterrupted search, which leaves a checkpoint in each of three phases."""
    run_ensemble = scene_run_module.run_ensemble
    meta = {"scene_hash": scene_hash(load_scene(windy))}

    def with_checkpoints(ensemble: EnsembleRun, callbacks: list[Any]) -> None:
        def save(now: EnsembleRun) -> None:
            for phase, cut in CUTS.items():
                if now.time == pytest.approx(cut):
                    Checkpointer(folder / f"{phase}.npz", 1.0, meta).save_ensemble(now)

        run_ensemble(ensemble, [*callbacks, save])

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(scene_run_module, "run_ensemble", with_checkpoints)
        document = run_scene(windy, RunOptions(threads=1, no_record=True))
    stop_device()
    return document


@pytest.mark.parametrize("phase", [*(pytest.param(k, marks=SLOW) for k in ("ramp", "hold")), "fall"])
def test_a_search_for_thresholds_goes_on_within_a_trial(phase, searched, windy, folder):
    kept = folder / f"{phase}.npz"
    resumed = run_scene(windy, RunOptions(threads=1, no_record=True, resume=kept))
    stop_device()
    missing = [name for name, measure in searched["measures"].items() if measure["value"] is None]
    assert missing == ["rolling_onset"], "its grains roll in the first wind"
    assert fingerprint(resumed) == fingerprint(searched)
    assert load_checkpoint(kept)[1]["replicas"][0]["search"]["phase"] == phase


def in_mid_search(windy: Path) -> ReplicaState:
    """A state in which no field, of its search and the trial neither, is empty or zero."""
    numbers = np.random.default_rng(5)
    trial = Trial(0.25, 0.4, *numbers.random((2, 3, 3)), *np.eye(2, 3, dtype=bool), 1e-7, [0.1])
    search = ThresholdSearch(load_scene(windy), {"origin": numbers.random((3, 3))}, trial, "fall", 0.2, 0.3)
    search.flux_at_start, search.brackets = 0.5, {"fluid_threshold": Bracket(0.2, 0.3)}
    search.fluxes, search.is_over = [(0.4, np.float64(1e-3))], True
    frames = [frame_of(count, numbers) for count in (2, 3)]
    airs = [AirProfile(*numbers.random((6, 4))) for _ in frames]
    measured = {"flux": Measurement("flux", 1.0, 0.1, "kg m-1 s-1", 2, ("a note",), {"blocks": [1.0, 2.0]})}
    failure = Failure(Status.OVERLAP, 0.3, 1, -1, 0.5)
    places, loads = (7, 1, 0.4, True, failure, 1e-3, 3, [[0.2, 1], [0.3, 4]]), [numbers.random((2, 6))]
    return ReplicaState(*places, frames, [0.1, 0.2], measured, ["a warning"], airs, loads, search, 0.4)


def frame_of(count: int, numbers: np.random.Generator) -> Snapshot:
    vectors, scalars = numbers.random((3, count, 3)), numbers.random((2, count))
    ranks = np.arange(count, dtype=np.int32)
    memory = {"ageing.age": numbers.random(count)}
    kinds = {"kind": ranks, "kinds": ("loam", "sand")}
    return Snapshot(0.1, 5, *vectors, *scalars, ranks, ranks, 1, memory, removed=2, **kinds)


def test_every_field_of_a_replica_is_in_the_checkpoint(windy, tmp_path):
    before = in_mid_search(windy)
    for record in (before, before.search, before.search.trial, before.frames[0]):
        for field in fields(record):
            if field.name == "force":
                continue  # frames of a stage are kept without it
            assert np.any(getattr(record, field.name)), f"{field.name} is not tested"
    scenes = [before.search.scene]
    saved = run_state(SimpleNamespace(states=[before], checks=80, grain_steps=1e3, wall_s=9.0))  # type: ignore[arg-type]
    save_checkpoint(tmp_path / "state.npz", *saved)
    resumed = SimpleNamespace(scenes=scenes)
    restore_run_state(resumed, *load_checkpoint(tmp_path / "state.npz"))  # type: ignore[arg-type]
    assert (resumed.checks, resumed.grain_steps, resumed.wall_s) == (80, 1e3, 9.0)
    np.testing.assert_equal(asdict(resumed.states[0]), asdict(before))


def test_a_checkpoint_that_cannot_be_written_is_told_once_and_the_run_goes_on(monkeypatch):
    def refuse(*_: Any) -> None:
        raise BadInput("run.npz: the checkpoint cannot be written (No space left on device)")

    monkeypatch.setattr(Checkpointer, "save_ensemble", refuse)
    checkpointer, state = Checkpointer(Path("run.npz"), 0.1, {}), ReplicaState(0)
    for now in (0.5, 0.6):
        checkpointer(SimpleNamespace(time=now, states=[state]))  # type: ignore[arg-type]
    assert state.warnings == ["run.npz: the checkpoint cannot be written (No space left on device)"]


def state() -> dict[str, np.ndarray]:
    """Arrays of every kind a simulation holds, with the values that are easily lost."""
    generator = np.random.default_rng(7)
    return {
        "velocity": generator.normal(size=(50, 3)).astype(np.float32),
        "random": generator.integers(0, 2**64, size=4, dtype=np.uint64),
        "extremes": np.array([-0.0, 5e-324, np.inf, -np.inf, np.nan]),
        "nothing": np.empty((0, 3), dtype=np.float32),
        "step": np.array(12345678901),
        "file": np.array([True, False]),
        "head": np.array([3]),
    }


@pytest.fixture
def saved(tmp_path: Path) -> Path:
    path = tmp_path / "run.npz"
    save_checkpoint(path, state(), META)
    return path


def test_a_checkpoint_returns_every_bit(saved: Path):
    arrays, meta = load_checkpoint(saved)
    assert meta == META
    assert arrays.keys() == state().keys()
    for name, values in state().items():
        assert arrays[name].dtype == values.dtype
        assert arrays[name].shape == values.shape
        assert arrays[name].tobytes() == values.tobytes()


@given(share=st.floats(0.0, 0.999))
@ONE_FILE
def test_a_checkpoint_cut_anywhere_is_refused_in_one_line(saved: Path, share: float):
    whole = saved.read_bytes()
    cut = saved.with_name("cut.npz")
    cut.write_bytes(whole[: int(share * len(whole))])
    with pytest.raises(BadInput, match=r"cut\.npz: damaged, or not a checkpoint") as refusal:
        load_checkpoint(cut)
    assert "\n" not in str(refusal.value)


@given(place=st.floats(0.0, 1.0, exclude_max=True), bit=st.integers(0, 7))
@ONE_FILE
def test_a_flipped_bit_is_refused_or_harmless(saved: Path, place: float, bit: int):
    damaged = bytearray(saved.read_bytes())
    damaged[int(place * len(damaged))] ^= 1 << bit
    flipped = saved.with_name("flipped.npz")
    flipped.write_bytes(damaged)
    try:
        arrays, meta = load_checkpoint(flipped)
    except BadInput:
        return
    # the bit lay where nothing is stored: in a date or an attribute of the archive
    assert meta == META
    for name, values in state().items():
        assert arrays[name].tobytes() == values.tobytes()


def test_foreign_files_headers_and_pickled_objects_are_refused_in_one_line(tmp_path: Path):
    (tmp_path / "zip").write_bytes(b"PK\x03\x04")
    np.savez(tmp_path / "other.npz", position=np.zeros(3))
    np.save(tmp_path / "plain.npy", np.zeros(3))
    head = json.dumps({"schema": checkpoint_file.SCHEMA, "meta": {}})
    members = {"head": np.frombuffer(head.encode(), dtype=np.uint8), "state/x": np.array([object()])}
    np.savez(tmp_path / "pickled.npz", **members)
    for name in ("zip", "other.npz", "plain.npy", "pickled.npz"):
        with pytest.raises(BadInput, match="damaged, or not a checkpoint"):
            load_checkpoint(tmp_path / name)
    for head in (b"[]", b"{}", b'{"schema": 1}', b"\xff\xfe"):
        np.savez(tmp_path / "odd.npz", head=np.frombuffer(head, dtype=np.uint8))
        with pytest.raises(BadInput, match=r"odd\.npz"):
            load_checkpoint(tmp_path / "odd.npz")


def test_a_checkpoint_of_another_program_is_refused(saved: Path, monkeypatch):
    monkeypatch.setattr(checkpoint_file, "SCHEMA", "checkpoint 7 of taichi_erosion 99.0")
    with pytest.raises(BadInput, match="cannot be resumed as 'checkpoint 7"):
        load_checkpoint(saved)
