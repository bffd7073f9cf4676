"""Studies from Python, on the closed form."""

from pathlib import Path
from types import SimpleNamespace

import pandas as pd
import pytest
from ten_records import VOC, curved

import taichi_erosion as te
from taichi_erosion.api.results import DiscoveryResult

SCENE = Path(__file__).parents[2] / "scenes" / "incline.toml"
TABLE = Path(__file__).parents[2] / "doe" / "windkanal.csv"


@pytest.fixture(scope="module")
def wet(tmp_path_factory) -> te.Study:
    return te.new_study(TABLE, tmp_path_factory.mktemp("wet") / "sand", closed_form=True)


def test_a_comparison_has_the_rows_of_the_table_in_its_units(wet):
    comparison = wet.compare()
    rows = comparison.rows
    assert len(rows) == comparison.document["rows_visible"] == 18
    assert set(rows["unit"]) == {"cm/s"}
    first = rows.loc[0, ["measured", "diameter [µm]", "moisture [%]"]]
    assert first.to_list() == pytest.approx([13.9, 90, 0])
    assert rows["moisture [%]"].max() == pytest.approx(1.2)
    assert comparison.p < 1e-5
    assert comparison.found[0].startswith("The calibrated model fails (all 18 rows")
    assert comparison.found[-1].startswith("`study.discover()` asks")
    assert comparison.table.loc["threshold_u_star", ["n", "unit"]].to_list() == [18, "cm/s"]
    off = rows["measured"] - rows["before"]
    assert comparison.table.loc["threshold_u_star", "rmse"] == pytest.approx((off**2).mean() ** 0.5)
    assert comparison.table.loc["threshold_u_star", "bias"] == pytest.approx(off.mean())


def test_a_discovery_lists_the_likeliest_candidate_first_and_adoption_lowers_the_error(wet):
    discovery = wet.discover()
    assert discovery.named == [discovery.effects.index[0]] == ["liquid_bridge"]
    found = discovery.table.loc["liquid_bridge"]
    assert found["low"] < found["strength"] < found["high"] < found["limit"]
    assert sum(discovery.probabilities.values()) == pytest.approx(1.0)
    assert discovery.law is None
    draws = discovery.posterior
    assert draws.sizes == {"chain": 1, "draw": 2000}
    assert float(draws["liquid_bridge"].median()) == pytest.approx(found["strength"], rel=0.05)
    assert (draws["dry_cohesion"] == 0.0).mean() > 0.8
    assert float(draws["threshold_coefficient"].min()) > 0.0
    adoption = wet.adopt(["liquid_bridge"])
    assert adoption.table.loc["after", "held_out"] < 0.1 * adoption.table.loc["before", "held_out"]
    assert adoption.table.loc["control", "held_out"] > 10.0
    assert adoption.files[0].is_file()
    assert "liquid_bridge" in discovery._repr_html_()
    assert repr(adoption).startswith(f"AdoptionResult({wet.path}: The error falls with liquid_bridge")
    values, residuals = adoption.figure().axes
    assert values.get_title("left") == "threshold friction velocity [cm/s]"
    assert residuals.lines


def test_experiments_a_page_and_predictions_in_the_units_of_the_table_follow(wet):
    wet.compare()
    assert {"observable", "unit", "chance", "cost"} <= set(wet.next().table.columns)
    assert wet.report().read_text("utf-8").count("<h2>") == 4
    asked = {"diameter [µm]": [200.0, 300.0], "moisture [%]": [0.5, 0.9]}
    table = wet.predict(asked).table
    assert (table[list(asked)].to_dict("list"), set(table["unit"])) == (asked, {"cm/s"})
    assert table["value"].between(table["low"], table["high"]).all()
    assert table["value"].between(10.0, 60.0).all()  # cm/s: sand of this size, moist


def test_a_study_is_made_again_and_an_unknown_word_is_refused(tmp_path):
    columns = {"diameter [um]": [100, 250, 400], "threshold friction velocity [cm/s]": [20, 30, 40]}
    columns |= {"sd [cm/s]": [1, 1, 1]}
    ways, place = (False, False, True), tmp_path / "mine"
    first, again, anew = (te.new_study(columns, place, closed_form=True, anew=way) for way in ways)
    assert first.path == again.path == anew.path
    with pytest.raises(TypeError, match="unexpected keyword argument 'grain'"):
        te.new_study(columns, tmp_path / "mine", closed_form=True, grain=100)  # pyright: ignore


def test_a_printed_table_has_all_columns_in_a_narrow_terminal(wet, monkeypatch):
    monkeypatch.setenv("COLUMNS", "60")
    comparison, discovery = wet.compare(), wet.discover()
    for table in (comparison.rows, comparison.table, discovery.table, discovery.table[["status", "low"]]):
        printed = str(table)
        assert "..." not in printed
        assert all(column in printed for column in table.columns)
        assert max(map(len, printed.splitlines())) <= 60


def test_a_data_frame_is_a_table(tmp_path):
    diameters, thresholds = [0.1, 0.2, 0.4, 0.8], [14.0, 17.0, 24.0, 34.0, 14.5, 17.4, 23.6, 34.7]
    table = pd.DataFrame({"diameter [mm]": 2 * diameters, "threshold_u_star [cm/s]": thresholds})
    table = table.set_index("diameter [mm]")  # an index with a name is a column
    study = te.new_study(table, tmp_path / "mine", closed_form=True)
    with pytest.raises(te.BadInput, match="has no answer yet"):
        study.report()
    assert set(study.compare().rows["measured"].round(6)) <= set(thresholds)


def test_wrong_input_raises_one_kind_of_error(tmp_path):
    with pytest.raises(te.BadInput, match=r"none\.toml"):
        te.study(tmp_path / "none.toml")
    with pytest.raises(te.BadInput, match=r"incline\.toml: is a scene; simulate it"):
        te.study(SCENE)
    for wrong in ("fast", 0, 1.5):
        with pytest.raises(te.BadInput, match=f"budget {wrong}: give quick, full, or the most runs"):
            te.study(TABLE.with_name("my_lab.toml"), budget=wrong)
    with pytest.raises(te.BadInput, match="out=FOLDER"):
        te.new_study(pd.DataFrame({"a": [1]}))
    with pytest.raises(AttributeError, match="no attribute 'sudy'"):
        te.sudy  # noqa: B018


def test_the_curve_of_something_unlisted_is_a_table_in_the_units_of_the_study():
    found = DiscoveryResult(Path("lab.toml"), SimpleNamespace(record=curved, units=VOC.units)).curves
    assert list(found["condition"].unique()) == ["moisture [%]"]
    assert found["at"].to_list() == pytest.approx([0.0, 2.0, 5.0])
    assert found["value"].to_list() == [0.0, 9.1, 3.2]
    assert (found["unit"] == "deg").all()
