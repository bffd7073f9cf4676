"""Survey of one's own sand: its scenes, its comparison with a table, and what is refused."""

import json
import tomllib
from math import exp, sin

import pytest

from taichi_erosion.cli.main import main
from taichi_erosion.core.errors import BadInput, SimulationStopped
from taichi_erosion.execution.checks import check_scene
from taichi_erosion.measures.result import as_record
from taichi_erosion.measures.threshold import Bracket, pool_beds, threshold_from_bracket
from taichi_erosion.measures.wind_formulas import Sand
from taichi_erosion.wind import survey as wind_survey
from taichi_erosion.wind.survey import Survey, survey_scenes, survey_winds
from taichi_erosion.wind.words import survey_notes

SAND = Sand(0.18e-3, 2600.0)
STOPPED = 5  # seed of a bed that gives no measures
TABLE = "u* [cm/s];Flux [g/(m s)]\n30;10\n40;20,5\n40;21,5\n"


@pytest.fixture
def measured(tmp_path):
    path = tmp_path / "flux.csv"
    path.write_text(TABLE, encoding="utf-8")
    return path, wind_survey.flux_by_wind(path)


def test_all_scenes_of_a_survey_have_one_sand_one_contact_one_drag_law_and_the_same_forces():
    texts = survey_scenes(Survey(SAND, (0.3, 0.5), 0.01, 4))
    assert list(texts) == ["flux_0.3", "flux_0.5", "thresholds"]
    scenes = [tomllib.loads(texts[name]) for name in ("thresholds", "flux_0.3", "flux_0.5")]
    for name in ("grains", "contact", "effects", "conditions", "laws", "fill"):
        assert scenes[0][name] == scenes[1][name] == scenes[2][name], name
    assert scenes[0]["wind"]["drag"] == scenes[1]["wind"]["drag"]
    assert scenes[0]["grains"]["size"]["median"] == 0.18e-3
    assert scenes[0]["materials"]["sand"]["density"] == 2600.0
    assert scenes[0]["conditions"] == {"moisture": 0.01}
    assert scenes[0]["effects"]["liquid_bridge"] == {"strength": 1.0}
    assert scenes[0]["threshold"]["hold"] == 5.0  # a tunnel watches its bed, whatever the grains
    assert [scene["stages"][2]["friction_velocity"] for scene in scenes[1:]] == [0.3, 0.5]
    assert all(scene["run"]["replicas"] == 4 for scene in scenes)


@pytest.mark.parametrize("diameter", [0.1e-3, 0.25e-3, 1e-3])
def test_scenes_of_fine_and_coarse_sands_are_valid_without_a_warning(diameter, tmp_path):
    for name, text in survey_scenes(Survey(Sand(diameter), (0.4,), 0.0, 2)).items():
        path = tmp_path / f"{name}.toml"
        path.write_text(text, encoding="utf-8")
        assert check_scene(path)["limits"].get("warnings", []) == []


def test_a_table_is_compared_in_its_own_winds_and_in_no_other(measured):
    _, rows = measured
    assert [r[:2] for r in rows] == [pytest.approx(p) for p in ((0.3, 0.01), (0.4, 0.0205), (0.4, 0.0215))]
    survey = Survey(SAND, (0.3, 0.4, 0.5), 0.0, 2, rows)
    assert survey.flux_at(0.4)["value"] == pytest.approx(0.021)
    assert (survey.flux_at(0.4)["n"], survey.flux_at(0.5)) == (2, {})
    texts = survey_scenes(survey)
    assert tomllib.loads(texts["flux_0.4"])["measured"]["flux"]["value"] == pytest.approx(0.021)
    assert "measured" not in tomllib.loads(texts["flux_0.5"])
    assert survey_winds(None, SAND, rows) == (0.3, 0.4)


def test_the_speed_of_a_tunnel_is_not_taken_for_a_friction_velocity():
    assert survey_winds("0.3,0.4m/s", SAND, ()) == (0.3, 0.4)
    for text, told in (("6,8", "not the speed of the wind"), ("fast", "write friction velocities")):
        with pytest.raises(BadInput, match=told):
            survey_winds(text, SAND, ())
    with pytest.raises(BadInput, match="200% of its dry mass"):
        Survey(SAND, (0.3,), 2.0)


def test_the_command_leaves_scenes_numbers_and_a_picture(measured, tmp_path, monkeypatch, capsys):
    def run(path, options):
        table = tomllib.loads(path.read_text(encoding="utf-8"))
        name = "fluid_threshold" if "threshold" in table else "flux"
        value = {"value": 0.02, "sd": 0.002, "n": 2, "unit": "", "details": {}, "shortfalls": []}
        rest = {"wall_s": 1.0, "replicas": [], "limits": {"warnings": []}}
        return {"measures": {name: value}, "measured": table.get("measured", {}), **rest}

    monkeypatch.setattr(wind_survey, "run_scene", run)
    folder, (table, _) = tmp_path / "out", measured
    words = ["wind", "--sand", "0.18 mm", "--table", str(table), "--out", str(folder)]
    assert main(words) == 0
    printed = capsys.readouterr()
    assert "core-minutes" in printed.err  # before the runs
    assert "fluid threshold u* 0.243 to 0.252 m/s, impact threshold u* 0.17 m/s, flux at" in printed.err
    assert "flux_0.4: sand flux 20.0 ± 2.0 (n = 2) g/(m s) after 1 s" in printed.err
    files = {"thresholds.toml", "flux_0.3.toml", "flux_0.4.toml", "wind.json", "wind.png"}
    assert {path.name for path in folder.iterdir()} == files
    document = json.loads((folder / "wind.json").read_text())
    assert document["runs"]["flux_0.4"]["measured"]["flux"]["value"] == pytest.approx(0.021)
    assert "flux_0.3: The sand flux is" in printed.out
    (folder / "thresholds.toml").write_text("# mine\n")
    assert main(words) == 2  # what a user has changed stays
    assert main(["wind", "--sand", "0.18mm", "--formulas"]) == 0
    assert (printed.out.count("brackets:"), capsys.readouterr().out.count("brackets:")) == (2, 0)
    assert main(["wind", "--sand", "5um", "--formulas"]) == 0
    assert "dust" in capsys.readouterr().out
    assert main(["wind", "--sand", "0.18mm", "--formulas", "--json"]) == 0
    formulas = json.loads(capsys.readouterr().out)
    assert formulas["runs"] == {}
    assert formulas["fluid_threshold"]["Iversen & White (1982)"] == pytest.approx(0.243, abs=5e-4)


@pytest.mark.parametrize(("share", "told"), [("5%", False), ("0.1%", True)])
def test_beds_are_added_until_a_threshold_is_known(share, told, tmp_path, monkeypatch, capsys):
    """The first three beds are close by chance; a seed gives the same bed in any group; one stops."""

    def measure(seed):
        value = 0.25 * exp(0.11 * sin(7.0 * seed))
        return threshold_from_bracket("fluid_threshold", Bracket(value, 1.001 * value))

    def run(path, options):
        name = "fluid_threshold" if path.stem == "thresholds" else "flux"
        count, first = options.replicas or 3, options.seed or 1
        if first == 40:  # the last group is a bed that stops
            raise SimulationStopped("overlap")
        seeds = range(first, first + count)
        beds = [{"seed": k, "measures": {name: as_record(measure(k))} if k != STOPPED else {}} for k in seeds]
        pooled = as_record(pool_beds([measure(k) for k in seeds if k != STOPPED]))
        return {"seed": first, "replicas": beds, "measures": {name: pooled}, "measured": {}, "wall_s": 1.0}

    monkeypatch.setattr(wind_survey, "run_scene", run)
    words = ["wind", "--sand", "0.25mm", "--wind", "0.4", "--out", str(tmp_path / "out"), "--precision"]
    assert main([*words, share, "--json"]) == 0
    printed = capsys.readouterr()
    assert "at most 40 beds, 115 core-minutes" in printed.err  # 40 x 170 s + 3 x 30 s
    document = json.loads(printed.out)
    thresholds, seeds = document["runs"]["thresholds"], [*range(1, 41)]
    assert len(document["runs"]["flux_0.4"]["replicas"]) == 3
    done = [bed["seed"] for bed in thresholds["replicas"]]
    assert done == seeds[: len(done)]
    assert len(done) > 3
    for count in range(3, len(done) + 1, 3):
        pooled = as_record(pool_beds([measure(seed) for seed in seeds[:count] if seed != STOPPED]))
        off = wind_survey.relative_half_width({"measures": {"fluid_threshold": pooled}}, "fluid_threshold")
        assert (off <= 0.05) == (count == len(done)) or told
    assert (len(done) == 39) == told == any("was asked" in line for line in survey_notes(document))
    pooled = as_record(pool_beds([measure(seed) for seed in done if seed != STOPPED]))
    assert thresholds["measures"]["fluid_threshold"]["details"] == pooled["details"]
    assert main([*words, "5"]) == 2  # no share


def test_the_progress_of_groups_of_beds_never_goes_back(tmp_path, monkeypatch):
    def run(path, options):
        for share in (0.5, 1.0):
            options.progress(share, "")
        return {"seed": 1, "replicas": [], "measures": {}, "wall_s": 1.0}

    shares: list[float] = []
    monkeypatch.setattr(wind_survey, "run_scene", run)
    wind_survey.run_beds(tmp_path, Survey(SAND, (), beds=7), 0.01, lambda share, _: shares.append(share))
    assert shares == sorted(shares)
    assert (len(shares), shares[-1]) == (12, 1.0)


def test_a_row_without_a_scatter_states_none():
    assert "sd" not in Survey(SAND, (0.3,), 0.0, 2, ((0.3, 0.01, float("nan"), "own"),)).flux_at(0.3)
