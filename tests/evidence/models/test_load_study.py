"""A study file becomes a problem; whatever is wrong with it or its model is told in one line."""

from pathlib import Path

import numpy as np
import pytest
from scene_tables import refusal

from taichi_erosion.core.errors import BadInput, SimulationStopped
from taichi_erosion.evidence.answers.summary import race_record
from taichi_erosion.evidence.data.comparison_rows import comparison_rows
from taichi_erosion.evidence.data.problem import Observable
from taichi_erosion.evidence.models import reduced
from taichi_erosion.evidence.models.load_study import load_study
from taichi_erosion.evidence.models.prepared_problem import condition_errors
from taichi_erosion.evidence.race.posterior import infer
from tests.evidence.small_study import MODEL, study_text, table_text, write_study

GOOD = study_text()
OWN_MODEL = """
import numpy as np
import constants_beside

def predict(observable, conditions, parameters, effects, seeds):
    print("a model that talks")
    return constants_beside.LEVEL + np.zeros((len(seeds), len(conditions["moisture"])))

def wrong_shape(observable, conditions, parameters, effects, seeds):
    return np.zeros(3)

def failing(observable, conditions, parameters, effects, seeds):
    raise ArithmeticError("no air")

number = 3
"""


@pytest.fixture
def own_study(tmp_path):
    """Function that writes a study with a model of its own beside it."""
    (tmp_path / "my_lab.py").write_text(OWN_MODEL, encoding="utf-8")
    (tmp_path / "constants_beside.py").write_text("LEVEL = 30.0\n", encoding="utf-8")
    return lambda function: write_study(tmp_path, {}, study=study_text(model=f"my_lab:{function}"))


def ask(path: Path):
    at = dict.fromkeys(("moisture", "diameter"), np.zeros(4))
    return load_study(path).problem.model("repose_angle", at, {}, {}, np.arange(2))


def test_a_model_beside_the_study_is_found_with_its_neighbours_and_may_talk(own_study, tmp_path, capsys):
    path = own_study("predict")
    assert np.all(ask(path) == 30.0)
    printed = capsys.readouterr()
    assert printed.out == ""
    assert "a model that talks" in printed.err
    before = load_study(path).model
    (tmp_path / "constants_beside.py").write_text("LEVEL = 31.0\n", encoding="utf-8")
    assert load_study(path).model != before, "an edited neighbour makes another model"


@pytest.mark.parametrize(
    ("function", "error", "told"),
    [
        ("wrong_shape", BadInput, r"returned shape \(3,\); \(2, 4\) is needed: \(seeds, conditions\)"),
        ("failing", SimulationStopped, "failing failed on repose_angle: ArithmeticError: no air"),
        ("number", BadInput, "my_lab has no function number"),
        ("nothing", BadInput, "my_lab has no function nothing"),
    ],
)
def test_a_model_that_breaks_its_contract_is_told(own_study, function, error, told):
    with pytest.raises(error, match=told):
        ask(own_study(function))


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ('measurements = "heap.csv"', "", "study.measurements is missing"),
        ('"heap.csv"', '"none.csv"', "none.csv: no such file"),
        (MODEL, "no_such_module_anywhere:f", "and no installed package of that name"),
        ('"log"', '"log_floor"', "transform = 'log_floor' needs floor"),
        ("moisture = ", "wetness = ", "conditions.wetness is not in heap.csv; conditions there: moist"),
        ("high = 0.2", "high = 0.01", "parameters.threshold_coefficient: low = 0.05 is not below high"),
        ("start = 0.5", "start = 5.0", "parameters.friction_sliding: start = 5 lies outside [0.2, 1]"),
        ('moisture = "moisture"\n', "", "column 'moisture' varies and is not under [conditions]"),
        ("fraction = 0.3", "fraction = 3", "vault.fraction = 3 lies outside [0, 0.9]"),
        ("fraction = 0.3", "ranges = { wind = [0, 1] }", "vault.ranges.wind is not under [conditions]"),
        ("fraction = 0.3", "ranges = { moisture = [0, 1] }", "hold out every row"),
        ('effects = "all"', 'effects = ["gusts"]', "candidates.liquid_bridge is not in candidates.effects"),
        ("[observables.repose_angle]", "[observables.repose_angle]\nunit = 'm'", "angle is counted in m"),
        ("[observables.repose_angle]", "[observables.repose_angle]\nscene = 'x'", "exactly one must answer"),
        ("[study]", "[study]\nfollows = 'heap.toml'", "leads in a circle"),
    ],
)
def test_what_is_wrong_with_a_study_is_told_in_one_line(tmp_path, old, new, told):
    assert old in GOOD
    path = write_study(tmp_path, {}, study=GOOD.replace(old, new, 1))
    assert told in refusal(load_study, path)
    assert not (tmp_path / "heap-results").exists()


def test_values_are_converted_to_the_unit_in_which_the_model_speaks(tmp_path):
    said = GOOD.replace("[observables.repose_angle]", "[observables.repose_angle]\nunit = 'rad'")
    problems = [load_study(write_study(tmp_path, {}, study=text)).problem for text in (said, GOOD)]
    angles, degrees = (problem.measurements.value[-1] for problem in problems)
    assert angles == pytest.approx(np.radians(degrees))
    assert not (tmp_path / "heap-results").exists(), "reading a study writes nothing"


def test_a_censored_value_without_a_limit_needs_the_floor_of_its_instrument(tmp_path):
    path = write_study(tmp_path, {})
    table = tmp_path / "heap.csv"
    table.write_text(table.read_text() + "threshold_u_star,no transport,,m/s,a,0.01,0.2,made\n", "utf-8")
    with pytest.raises(BadInput, match=r"row 98, value is empty: write '<' and the least value that is seen"):
        load_study(path)
    path.write_text(GOOD.replace('transform = "log"', 'transform = "log_floor"\nfloor = 0.05'), "utf-8")
    measurements = load_study(path).problem.measurements
    assert measurements.censored[-1]
    assert measurements.limit[-1] == 0.05


@pytest.mark.parametrize("kind", ["set ", ""])
def test_an_sd_of_a_condition_is_in_the_unit_of_the_model_and_told(tmp_path, kind):
    head, *lines = table_text({"liquid_bridge": 1.0}, 1).splitlines()
    head = head.replace("diameter [mm]", f"diameter [mm],sd of {kind}diameter")
    rows = [",".join([*line.split(",")[:7], "0.05", *line.split(",")[7:]]) for line in lines]
    (tmp_path / "heap.csv").write_text("\n".join([head, *rows]) + "\n", encoding="utf-8")
    (tmp_path / "heap.toml").write_text(study_text(), encoding="utf-8")
    study = load_study(tmp_path / "heap.toml")
    assert study.problem.measurements.condition_sd["diameter"] == pytest.approx(np.full(len(lines), 5e-5))
    notes = "\n".join(study.notes)
    assert "rows state its sd, at most 0.05 mm; it enters their errors" in notes
    assert ("slopes along it come out 11 % too small" in notes) == (not kind)
    errors, _ = condition_errors(comparison_rows(study.problem, study.problem.visible_rows()))
    assert errors["diameter"] == pytest.approx(5e-5)


VALUE, SHARE = 0.3, 0.1  # m/s; error that all rows share, over the value [1]
UNSURE_MODEL = f"""
import numpy as np
READS = ("level.txt",)

def predict(observable, conditions, parameters, effects, seeds):
    return np.full((len(seeds), len(conditions["diameter"])), {VALUE})

def predict_covariance(observable, conditions, parameters, effects):
    return np.full(2 * (len(conditions["diameter"]),), ({SHARE} * {VALUE}) ** 2)

def sure(*asked):
    return predict(*asked)
"""
SANDS = """
[study]
measurements = "sands.csv"
model = "table:{function}"
[observables.threshold_u_star]
transform = "log"
[conditions]
diameter = "diameter"
[vault]
fraction = 0.0
"""
MEASURED = 1.1 * VALUE * np.array([0.99, 1.01, 1.0, 0.98, 1.02, 1.0])  # a tenth above the model


@pytest.fixture
def sands(tmp_path: Path):
    """Function that reads a study on one of the functions."""
    (tmp_path / "table.py").write_text(UNSURE_MODEL, encoding="utf-8")
    (tmp_path / "level.txt").write_text("0.3\n", encoding="utf-8")
    rows = [f"threshold_u_star,{v:.6g},{0.02 * v:.6g},1,m/s,{0.1 * k}" for k, v in enumerate(MEASURED, 1)]
    table = "\n".join(["observable,value,sd,n,unit,diameter [mm]", *rows, ""])
    (tmp_path / "sands.csv").write_text(table, encoding="utf-8")

    def read(function: str):
        path = tmp_path / f"{function}.toml"
        path.write_text(SANDS.format(function=function), encoding="utf-8")
        return load_study(path)

    return read


def test_errors_are_carried_to_the_scale_of_the_comparison(sands):
    at = {"diameter": np.array([1e-4, 2e-4])}
    found = sands("predict").problem.uncertainty([(Observable("threshold_u_star", "log"), at, {})], {}, {})
    assert found == pytest.approx(np.full((2, 2), SHARE**2))


def test_a_misfit_that_the_own_errors_of_a_model_can_be_is_none(sands):
    # every row a tenth too high: one sd of the shared error, five of every laboratory
    sure, unsure = (race_record(infer(sands(name).problem, 1)) for name in ("sure", "predict"))
    assert sure.p_misfit < 1e-3
    assert [level.observable for level in sure.levels] == ["threshold_u_star"]
    assert unsure.p_misfit > 0.1
    assert unsure.levels == ()


def test_a_model_whose_file_has_changed_is_another_model(sands, tmp_path):
    before = sands("predict").model
    (tmp_path / "level.txt").write_text("0.4\n", encoding="utf-8")
    assert sands("predict").model != before
    (tmp_path / "level.txt").unlink()
    with pytest.raises(BadInput, match=r"READS names .*level.txt: no such file"):
        sands("predict")


def test_the_threshold_grows_with_the_root_of_the_submerged_weight():
    density = np.array([1050.0, reduced.GRAIN_DENSITY, 4000.0])
    given = reduced.model_mean("threshold_u_star", {"grain_density": density}, {}, {})
    usual = reduced.model_mean("threshold_u_star", {"diameter": np.full(3, reduced.MEDIAN_DIAMETER)}, {}, {})
    submerged = (density - reduced.AIR_DENSITY) / (reduced.GRAIN_DENSITY - reduced.AIR_DENSITY)
    assert given / usual == pytest.approx(np.sqrt(submerged))
