"""Restart with a changed set-up: the same bits where nothing changed, other physics where something did."""

import tomllib
from math import isclose
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tomli_w
from small_scene import write_scene

from taichi_erosion import simulation
from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.setup import Numerics
from taichi_erosion.core.snapshot import ContactNetwork
from taichi_erosion.execution import RunOptions, run_scene
from taichi_erosion.execution.checkpoint import Checkpointer
from taichi_erosion.recording.readback import GrainFrame, read_contacts, read_grains
from taichi_erosion.scene import laws, load_scene

pytestmark = pytest.mark.usefixtures("start_device")  # which stops what a test has started
CUT, SETTLED = 0.03, 0.06  # s, within and at the end of the first stage of 0.06 s
MORE = """
[[stages]]
name = "more"
until = "time"
duration_max = 0.02
move.tube = { velocity = [0.0, 0.0, 0.5] }
"""


def run(scene: Path, record: Path, *overrides: str, **files: Path | None) -> dict[str, Any]:
    return run_scene(scene, RunOptions(overrides, threads=1, record=record, force=True, **files))


def frame_at(path: Path, time: float) -> GrainFrame:
    return next(frame for frame in read_grains(path) if isclose(frame.time, time, rel_tol=1e-3))


@pytest.fixture(scope="module")
def cut(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of a run (one replica, `few.toml`, `whole.rrd`) and of its checkpoint within the first stage."""
    folder = tmp_path_factory.mktemp("restart")
    scene = write_scene(folder, run={"replicas": 1})
    with pytest.MonkeyPatch.context() as patch:
        save = Checkpointer.save_ensemble
        patch.setattr(Checkpointer, "__call__", lambda own, now: isclose(now.time, CUT) and save(own, now))
        kept = {"checkpoint": folder / "cut.npz", "checkpoint_interval": 1.0}
        run_scene(scene, RunOptions(threads=1, record=folder / "whole.rrd", **kept))
    return folder


def friction_of_pairs(network: ContactNetwork) -> float:
    """Sum of the tangential forces between grains [N]."""
    return float(np.linalg.norm(network.tangential_force, axis=1)[network.second >= 0].sum())


def test_a_later_change_leaves_every_bit_before_it(cut: Path, tmp_path: Path):
    scene, kept = cut / "few.toml", cut / "cut.npz"
    changed = ("stages.1.duration_max=0.02", "measure.pile_height.plate=plate", "measured={}")
    document = run(scene, tmp_path / "later.rrd", *changed, resume=kept)
    for time in (CUT + 0.01, SETTLED, SETTLED + 0.02):
        before, after = frame_at(cut / "whole.rrd", time), frame_at(tmp_path / "later.rrd", time)
        assert before.position.tobytes() == after.position.tobytes()
        assert before.state["velocity"].tobytes() == after.state["velocity"].tobytes()
    replica = document["replicas"][0]
    assert replica["time"] == pytest.approx(SETTLED + 0.02, rel=1e-3)
    assert any("until 0.03 s" in line and "stages.1.duration_max" in line for line in replica["warnings"])


def test_contacts_gravity_and_walls_change_at_once_and_the_grains_stay(cut: Path, tmp_path: Path):
    scene, kept = cut / "few.toml", cut / "cut.npz"
    start = frame_at(cut / "whole.rrd", CUT)
    plain = frame_at(cut / "whole.rrd", SETTLED)
    bouncy = "contact.soil-soil.restitution=0.95", "contact.soil-steel.restitution=0.95"
    lid = "geometry.lid={shape='plane', material='steel', point=[0.0, 0.0, 0.2], normal=[0.0, 0.0, -1.0]}"
    for name, orders in {"bouncy": bouncy, "walls": (lid,), "light": ("gravity.magnitude=0.0",)}.items():
        path = tmp_path / f"{name}.rrd"
        run(scene, path, *orders, "record.every=0.01", resume=kept)
        first, end = read_grains(path)[0], frame_at(path, SETTLED)
        assert first.time == pytest.approx(CUT + 0.001, abs=0.0011)  # of the next check
        np.testing.assert_allclose(first.position, start.position, atol=1.5e-3)
        assert np.array_equal(end.ident, plain.ident)
        speed = np.linalg.norm(end.state["velocity"], axis=1).mean()
        usual = np.linalg.norm(plain.state["velocity"], axis=1).mean()
        if name == "walls":  # out of reach: the springs with walls alone begin anew
            np.testing.assert_allclose(end.position, plain.position, atol=5e-4)
        else:
            assert speed > 1.2 * usual, name
    fall = frame_at(tmp_path / "light.rrd", SETTLED).position[:, 2] - start.position[:, 2]
    assert fall.mean() > (plain.position[:, 2] - start.position[:, 2]).mean()


def test_a_finished_run_goes_on_with_a_further_stage(cut: Path, tmp_path: Path):
    scene = cut / "few.toml"
    kept, longer = tmp_path / "end.npz", tmp_path / "longer.toml"
    run_scene(scene, RunOptions(("stages.1.remove=[]",), threads=1, no_record=True, checkpoint=kept))
    with pytest.raises(BadInput, match="all stages had ended"):
        run_scene(scene, RunOptions(("stages.1.remove=[]", "gravity.magnitude=1.0"), resume=kept))
    text = scene.read_text(encoding="utf-8").replace('remove = [\n    "tube",\n]', "remove = []")
    head, _, tail = text.partition("[measure")
    longer.write_text(f"{head}{MORE}\n[measure{tail}", encoding="utf-8")
    document = run(longer, tmp_path / "longer.rrd", "measure.repose_angle.stage=collapse", resume=kept)
    assert document["replicas"][0]["time"] == pytest.approx(0.14, rel=1e-3)
    assert document["measures"]["pile_height"]["value"] > 0.0


def test_what_would_change_grains_clock_or_past_is_refused_by_name(cut: Path):
    numbers = ("grains.size.diameter=1.9e-3", "materials.soil.density=2000.0", "run.check_interval=2e-3")
    more = ("stages.0.move={tube={velocity=[0.0, 0.0, 0.1]}}", "measure.column_height.every=1e-3")
    for order in (*numbers, "laws.rolling=none", *more):
        with pytest.raises(BadInput, match=r"cut\.npz: .* differs .* law = 'bed'") as refused:
            run_scene(cut / "few.toml", RunOptions((order,), no_record=True, resume=cut / "cut.npz"))
        assert order.partition("=")[0].rpartition(".")[0] in str(refused.value)


def test_a_bed_of_another_run_stays_at_rest_with_its_forces_under_another_set_up(tmp_path: Path):
    stages = [{"name": "settle", "until": "rest", "duration_max": 0.5, "rest_energy": 1e-6}]
    table = tomllib.loads(write_scene(tmp_path, run={"replicas": 1}).read_text(encoding="utf-8"))
    height = {"column_height": {"plate": "plate"}}
    table |= {"stages": stages, "measure": height, "record": {"contacts": True}}
    bed = tmp_path / "bed.toml"
    bed.write_text(tomli_w.dumps(table), encoding="utf-8")
    run(bed, tmp_path / "bed.rrd", checkpoint=tmp_path / "bed.npz")
    kept = read_grains(tmp_path / "bed.rrd")[-1]
    held = {"until": "time", "duration_max": 0.02}
    table |= {"fill": {"law": "bed", "file": "bed.npz"}, "stages": [{"name": "hold", **held}]}
    table["record"] |= {"every": 0.001}
    later = tmp_path / "later.toml"
    later.write_text(tomli_w.dumps(table), encoding="utf-8")
    document = run(later, tmp_path / "later.rrd")
    frames = read_grains(tmp_path / "later.rrd")
    radius = kept.radius.min()
    for frame in frames:
        assert np.abs(frame.position - kept.position).max() < 2e-3 * radius
        assert np.linalg.norm(frame.state["velocity"], axis=1).max() < 5e-3
    setup = simulation.prepare(load_scene(later), 3, {})
    sim = simulation.assemble([setup], laws(load_scene(later)), Numerics("cpu", 1))
    simulation.advance(sim, [2.0 * setup.time_step])
    before, after = read_contacts(tmp_path / "bed.rrd")[-1], simulation.contact_network(sim, 0)
    assert friction_of_pairs(after) == pytest.approx(friction_of_pairs(before), rel=0.1)
    assert document["replicas"][0]["stopped"] is None
    for order, told in ("grains.count=29", "periods differ"), ("fill.file='none.npz'", "cannot be read"):
        with pytest.raises(BadInput, match=told):
            run_scene(later, RunOptions((order,), no_record=True))
