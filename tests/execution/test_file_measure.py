"""A measure of the user's own: one file that sees grains, contacts and walls."""

import json
from pathlib import Path

import numpy as np
import pytest
from scene_tables import refusal

from taichi_erosion.cli.main import main
from taichi_erosion.execution import RunOptions, run_scene
from taichi_erosion.execution.checks import read_scene
from taichi_erosion.recording.readback import read_contacts, read_grains
from taichi_erosion.scene import scene_hash
from taichi_erosion.scene.load import SCENES

pytestmark = pytest.mark.usefixtures("start_device")  # which stops what a test has started
UNLIKE = '''
"""Share of the contacts between grains that join two kinds."""

UNIT = "1"


def measure(grains, contacts, walls):
    kind = grains.kind.to_series()
    pairs = contacts.where(contacts.second >= 0, drop=True)
    return float((kind[pairs["first"]].to_numpy() != kind[pairs["second"]].to_numpy()).mean())
'''
LOAD = """
UNIT = "N"


def measure(grains, contacts, walls):
    return float(-walls.force.sel(wall="floor", axis="z")), 0.25
"""
SMALL = ("grains.count=250", "domain.period=[0.014, 0.014]", "record.contacts=true")


@pytest.fixture
def files(tmp_path: Path) -> Path:
    broken = UNLIKE.replace("grains.kind", "grains.kid")
    unitless = "def measure(grains, contacts, walls): return 1.0"
    for name, text in {"unlike": UNLIKE, "load": LOAD, "broken": broken, "unitless": unitless}.items():
        (tmp_path / f"{name}.py").write_text(text, encoding="utf-8")
    return tmp_path


def test_own_measures_read_kinds_contacts_and_walls_and_a_failing_one_says_where(files: Path):
    orders = [f"measure.{name}.file='{files / name}.py'" for name in ("unlike", "load", "broken")]
    record = files / "two.rrd"
    document = run_scene(SCENES / "two_soils.toml", RunOptions((*SMALL, *orders), threads=1, record=record))
    measures = document["measures"]
    network, kind = read_contacts(record)[-1], read_grains(record)[-1].state["kind"]
    pairs = network.second >= 0
    unlike = kind[network.first[pairs]] != kind[network.second[pairs]]
    assert measures["unlike"] | {"value": 0.0} == measures["unlike"] | {"value": 0.0, "unit": "1"}
    assert measures["unlike"]["value"] == pytest.approx(unlike.mean(), abs=1e-9)
    weight = network.force[~pairs, 2].sum()
    assert (measures["load"]["value"], measures["load"]["sd"]) == (pytest.approx(weight, rel=1e-5), 0.25)
    assert measures["load"]["unit"] == "N"
    assert not np.isfinite(measures["broken"]["value"] or np.nan)
    assert any("broken.py, line 8" in line for line in document["replicas"][0]["warnings"])


def test_a_measure_is_an_option_and_its_content_counts(files: Path, capsys: pytest.CaptureFixture[str]):
    words = ["run", str(SCENES / "two_soils.toml"), "--measure", str(files / "load.py"), "--check", "--json"]
    assert main(words) == 0
    out = capsys.readouterr()
    assert json.loads(out.out)["resolved"]["measure"]["load"]["file"].endswith("load.py")
    assert "executes" in out.err
    order = (f"measure.load.file='{files / 'load.py'}'",)
    before = scene_hash(read_scene(SCENES / "two_soils.toml", order))
    (files / "load.py").write_text(LOAD.replace("0.25", "0.5"), encoding="utf-8")
    assert scene_hash(read_scene(SCENES / "two_soils.toml", order)) != before


def test_a_file_that_is_no_measure_is_refused(files: Path):
    for name, told in (("unitless", 'it needs UNIT = "..."'), ("none", "no such Python file")):
        order = f"measure.mine.file='{files / name}.py'"
        assert told in refusal(read_scene, SCENES / "two_soils.toml", (order,))
