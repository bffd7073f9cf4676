import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from taichi_erosion.core.errors import BadInput
from taichi_erosion.recording import checkpoint
from taichi_erosion.recording.checkpoint import load_checkpoint, save_checkpoint

META = {"scene_hash": "5eed", "time": 0.125, "seeds": [1, 2, 3], "title": "Böschung"}


def state() -> dict[str, np.ndarray]:
    """Arrays of every kind a simulation holds, with the values that are easily lost."""
    generator = np.random.default_rng(7)
    return {
        "position": generator.normal(size=(50, 3)),
        "velocity": generator.normal(size=(50, 3)).astype(np.float32),
        "history.key": generator.integers(0, 2**31, size=(50, 8), dtype=np.int32),
        "random": generator.integers(0, 2**64, size=4, dtype=np.uint64),
        "extremes": np.array([-0.0, 5e-324, np.inf, -np.inf, np.nan]),
        "present": np.array([True, False]),
        "nothing": np.empty((0, 3), dtype=np.float32),
        "step": np.array(12345678901),
        "file": np.array([1, 2]),
        "head": np.array([3]),
    }


@pytest.fixture
def saved(tmp_path: Path) -> Path:
    path = tmp_path / "run.npz"
    save_checkpoint(path, state(), META)
    return path


def test_a_checkpoint_returns_every_bit(saved: Path):
    arrays, meta = load_checkpoint(saved, "5eed")
    assert meta == META
    assert arrays.keys() == state().keys()
    for name, values in state().items():
        assert arrays[name].dtype == values.dtype
        assert arrays[name].shape == values.shape
        assert arrays[name].tobytes() == values.tobytes()


@given(share=st.floats(0.0, 0.999))
@settings(max_examples=40, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_a_checkpoint_cut_anywhere_is_refused_in_one_line(saved: Path, share: float):
    whole = saved.read_bytes()
    cut = saved.with_name("cut.npz")
    cut.write_bytes(whole[: int(share * len(whole))])
    with pytest.raises(BadInput, match=r"cut\.npz: damaged, or not a checkpoint") as refusal:
        load_checkpoint(cut)
    assert "\n" not in str(refusal.value)


@given(place=st.floats(0.0, 1.0, exclude_max=True), bit=st.integers(0, 7))
@settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture])
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
    contents = {"empty": b"", "text": b"[scene]\n", "recording": b"RRF2\0\0\0\0", "zip": b"PK\x03\x04"}
    for name, content in contents.items():
        (tmp_path / name).write_bytes(content)
    np.savez(tmp_path / "other.npz", position=np.zeros(3))
    np.save(tmp_path / "plain.npy", np.zeros(3))
    head = json.dumps({"schema": checkpoint.SCHEMA, "meta": {}})
    members = {"head": np.frombuffer(head.encode(), dtype=np.uint8), "state/x": np.array([object()])}
    np.savez(tmp_path / "pickled.npz", **members)
    for name in (*contents, "other.npz", "plain.npy", "pickled.npz"):
        with pytest.raises(BadInput, match="damaged, or not a checkpoint"):
            load_checkpoint(tmp_path / name)
    for head in (b"[]", b"3", b"{}", b"null", b'{"schema": 1}', b"\xff\xfe"):
        np.savez(tmp_path / "odd.npz", head=np.frombuffer(head, dtype=np.uint8))
        with pytest.raises(BadInput, match=r"odd\.npz"):
            load_checkpoint(tmp_path / "odd.npz")
    with pytest.raises(BadInput, match=r"missing\.npz: the checkpoint cannot be read"):
        load_checkpoint(tmp_path / "missing.npz")
    with pytest.raises(BadInput, match="cannot be read"):
        load_checkpoint(tmp_path)


def test_a_checkpoint_of_another_scene_or_program_is_refused(saved: Path, monkeypatch):
    with pytest.raises(BadInput, match="belongs to scene 5eed, not to beef"):
        load_checkpoint(saved, "beef")
    monkeypatch.setattr(checkpoint, "SCHEMA", "checkpoint 6 of taichi_erosion 99.0")
    with pytest.raises(BadInput, match="cannot be resumed as 'checkpoint 6"):
        load_checkpoint(saved)
