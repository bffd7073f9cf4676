"""A sweep runs every value with the same seeds, pools them, and tells what gave no value."""

import csv
from pathlib import Path

import pytest

import taichi_erosion as te
from taichi_erosion.campaign import sweep as sweeps
from taichi_erosion.campaign.request import RunRequest, RunResult
from taichi_erosion.core.errors import BadInput

SCENE = Path(__file__).parents[2] / "scenes" / "column_collapse.toml"
OVER = "contact.grain-grain.friction_sliding=0.1,0.4"


def simulated(requests: list[RunRequest], ledger, workers, scheduler, progress) -> list[RunResult]:
    """Ten times the friction and a thousandth of the seed; one seed fails, one value says nothing."""
    results = []
    for request in requests:
        friction = request.payload["scene"]["contact"]["grain-grain"]["friction_sliding"]
        seed = request.payload["seed"]
        lacks = [{"blocks": friction > 0.2 and seed == 2, "stated": False, "sentence": "too small"}]
        one = {"value": 10.0 * friction + 1e-3 * seed, "sd": 0.5, "unit": "m", "notes": []}
        one |= {"shortfalls": lacks[:1]}
        measures = {} if seed == 1 else {"pile_height": one}
        failure = "lost grains" if seed == 1 else None
        results.append(RunResult(request.key, {"measures": measures, "warnings": ["3 left"]}, failure))
    return results


@pytest.fixture
def points(monkeypatch, tmp_path):
    monkeypatch.setattr(sweeps, "run_requests", simulated)
    found = sweeps.sweep_entry(SCENE, OVER, ("run.seed=1",), 4, where=(tmp_path / "out", None, None))
    return [one for one in found if one.measure == "pile_height"]


def test_every_value_has_its_mean_scatter_and_number_of_seeds(points):
    low, high = points
    assert (low.entry, high.entry) == ("0.1", "0.4")
    assert (low.value, low.sd, low.n) == pytest.approx((1.003, 1e-3, 3))  # seeds 2, 3 and 4
    assert (high.value, high.n) == pytest.approx((4.0035, 2))
    assert "lost grains; 3 left" in low.note
    assert "too small" in high.note


def test_python_has_the_same_points_by_the_values_of_the_entry(monkeypatch, tmp_path):
    monkeypatch.setattr(sweeps, "run_requests", simulated)
    path, values = "contact.grain-grain.friction_sliding", [0.1, 0.4]
    table = te.sweep(SCENE, path, values, {"run.seed": 1}, 4, folder=tmp_path)
    heights = table[table["measure"] == "pile_height"].set_index(path)
    assert heights["value"].to_dict() == pytest.approx({0.1: 1.003, 0.4: 4.0035})
    assert heights["n"].to_dict() == {0.1: 3, 0.4: 2}


def test_the_table_holds_the_points(points, tmp_path):
    table, figure = sweeps.write_sweep(tmp_path / "out", OVER, points, b"png")
    rows = list(csv.reader(table.read_text().splitlines()))
    assert rows[0][0] == "contact.grain-grain.friction_sliding"
    assert [float(row[2]) for row in rows[1:]] == pytest.approx([1.003, 4.0035])
    assert figure.read_bytes() == b"png"


@pytest.mark.parametrize("over", ["friction", "a=1", "a=1,", "a=1,1", "=1,2", "a=[1,2],[3,4]"])
def test_an_order_that_is_no_list_of_values_is_refused(over):
    with pytest.raises(BadInput, match="PATH=a,b,c"):
        sweeps.parse_sweep_values(over)


def test_a_wrong_path_is_refused_before_anything_runs(tmp_path):
    with pytest.raises(BadInput, match="friction_slidin"):
        sweeps.sweep_entry(SCENE, "contact.grain-grain.friction_slidin=0.1,0.2", where=(tmp_path, None, None))
    with pytest.raises(BadInput, match="repeats are --replicas"):
        sweeps.sweep_entry(SCENE, "run.seed=1,2", where=(tmp_path, None, None))
    assert not list(tmp_path.iterdir())
