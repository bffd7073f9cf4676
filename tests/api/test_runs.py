"""Runs and live sessions from Python, on the smallest scene."""

import operator
import subprocess
import sys
from pathlib import Path
from pkgutil import iter_modules
from urllib.error import HTTPError
from urllib.request import urlopen

import numpy as np
import pytest

import taichi_erosion as te
from taichi_erosion.api.runs import changes_as_overrides

pytestmark = pytest.mark.usefixtures("start_device")  # which stops what a test has started
SCENE = Path(__file__).parents[2] / "scenes" / "terminal_velocity.toml"


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    file = tmp_path_factory.mktemp("run") / "drop.rrd"
    return te.run(SCENE, record=file, replicas=1, gravity__magnitude=5.0)


def test_a_run_has_its_measures_with_units_and_its_changes(run):
    assert run.document["resolved"]["gravity"]["magnitude"] == 5.0
    assert set(run.table["unit"]) == {run.document["measures"][name]["unit"] for name in run.table.index}
    assert list(run.seeds["seed"].unique()) == [run.document["seed"]]
    assert "<table" in run._repr_html_()
    assert repr(run).startswith("Run(")
    assert len(repr(run)) < 300
    assert "\n" not in repr(run)


def test_recorded_grains_fall_in_an_xarray_also_when_opened_again(run):
    assert te.open_run(run.recording).document["hash"] == run.document["hash"]
    height = run.grains["position"].sel(axis="z").mean("grain")
    assert run.grains["position"].attrs["units"] == "m"
    assert run.grains["time"].size > 2
    assert float(run.grains["velocity"].sel(axis="z").mean("grain")[-1]) < 0.0
    assert float(height[-1]) < float(height[0])
    assert np.isfinite(run.grains["radius"].values).all()


def test_a_session_runs_changes_and_returns_bit_for_bit():
    session = te.live(SCENE, gravity__magnitude=5.0)
    assert session.session.scene.gravity.magnitude == 5.0
    session.run(1e-3).save("here").run(1e-3)
    late = session.status
    session.set("gravity.magnitude", 3.0).restore("here").run(1e-3)
    assert session.status == late


def test_a_notebook_shows_the_page_of_a_session_which_ends_where_another_begins():
    session = te.live(SCENE)
    session.page.playing, session.page.owner = True, ""
    assert f'<iframe src="{session.page.address}"' in session._repr_html_()
    session.save("here")
    te.live(SCENE).step()
    calls = {"save": ["x"], "restore": ["here"], "remove": [0], "watch": ["flux"], "insert": [1, (0, 0, 1)]}
    calls |= {name: [] for name in "table status contacts walls grains fields step".split()}
    for name, words in calls.items():
        with pytest.raises(te.BadInput, match="another run or session has begun"):
            operator.methodcaller(name, *words)(session)
    with pytest.raises(HTTPError, match="410"):
        urlopen(session.page.address + "state?owner=1")


def test_a_session_tells_entries_differences_and_curves():
    session = te.live(SCENE)
    with pytest.raises(te.BadInput, match="has no samples"):
        session.plot("kinetic_J")
    assert session.diff().empty
    session.run(1e-3).save("before").set("gravity.magnitude", 3.0).run(1e-3)
    assert (session.get("gravity.magnitude"), session.get("gravity")["magnitude"]) == (3.0, 3.0)
    assert list(session.diff("before").loc["gravity.magnitude"]) == [9.81, 3.0]
    (line,) = session.plot("kinetic_J").axes[0].lines
    assert line.get_xdata()[-1] == pytest.approx(2e-3)
    assert (session.samples.index[-1], repr(session).count("\n")) == (pytest.approx(2e-3), 0)
    session.set("effects.dry_adhesion.strength", 4.0)
    assert any("effects.dry_adhesion.strength = 4 is more than 3" in each for each in session.warnings)
    assert "source: " in session.help("effects.dry_adhesion.beta")


def test_the_package_offers_the_interface_and_no_room_bears_a_name_of_it():
    names = "{name for name in dir(te) if name[0] != '_'}"
    code = f"import taichi_erosion as te; assert {names} == set(te.api.__all__)"
    subprocess.run([sys.executable, "-c", code], check=True)
    assert not set(te.api.__all__) & {room.name for room in iter_modules(te.__path__)}


def test_an_unknown_option_is_named_values_become_toml_and_the_library_is_a_table():
    with pytest.raises(te.BadInput, match="no option 'replica'; there are seed, replicas"):
        te.run(SCENE, replica=1)
    assert changes_as_overrides({"a.b": 3}, {}, ()) == ("a.b=3",)
    assert changes_as_overrides({"a.b": "hertz"}, {}, ()) == ('a.b="hertz"',)
    for values in ([1.0, 2.0], np.array([1.0, 2.0], np.float32)):
        assert changes_as_overrides({}, {"a__b": values}, ()) == ("a.b=[1.0, 2.0]",)
    with pytest.raises(te.BadInput, match="None is no value"):
        changes_as_overrides({"a.b": None}, {}, ())
    assert te.effects().loc["liquid_bridge", "place"] == "pair"


def test_a_session_gives_grains_contacts_and_walls_whose_forces_carry_the_weight(tmp_path):
    session = te.live(SCENE.with_name("column_collapse.toml"), grains__count=60).run(0.2)
    grains, contacts, walls = session.grains, session.contacts, session.walls
    weight = 9.81 * float(grains["mass"].sum())
    assert grains["position"].shape == (60, 3)
    assert bool(walls["present"].all())
    assert float(walls["force"].sum("wall").sel(axis="z")) == pytest.approx(-weight, rel=0.02)
    on_plate = contacts["force"].isel(contact=contacts["second"].values == -1).sum("contact")
    np.testing.assert_allclose(on_plate, -walls["force"].sel(wall="plate"))
    assert session.chains(tmp_path / "chains.png").stat().st_size > 1000
