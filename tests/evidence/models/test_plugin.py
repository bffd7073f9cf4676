"""A model function that says how far off it may be: nothing is blamed on an effect that its errors can be."""

from pathlib import Path

import numpy as np
import pytest

from taichi_erosion.core.errors import BadInput
from taichi_erosion.evidence.data.problem import Observable
from taichi_erosion.evidence.models.load_study import load_study
from taichi_erosion.evidence.race.posterior import raced
from taichi_erosion.evidence.race.summary import summary

VALUE, SHARE = 0.3, 0.1  # m/s; error that all rows share, over the value [1]
MODEL = f"""
import numpy as np
READS = ("level.txt",)

def predict(observable, conditions, parameters, effects, seeds):
    return np.full((len(seeds), len(conditions["diameter"])), {VALUE})

def predict_covariance(observable, conditions, parameters, effects):
    return np.full(2 * (len(conditions["diameter"]),), ({SHARE} * {VALUE}) ** 2)

def sure(observable, conditions, parameters, effects, seeds):
    return predict(observable, conditions, parameters, effects, seeds)
"""
STUDY = """
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
def study(tmp_path: Path):
    """Function that reads a study on one of the functions."""
    (tmp_path / "table.py").write_text(MODEL, encoding="utf-8")
    (tmp_path / "level.txt").write_text("0.3\n", encoding="utf-8")
    lines = ["observable,value,sd,n,unit,diameter [mm]"]
    for size, value in enumerate(MEASURED, 1):
        lines.append(f"threshold_u_star,{value:.6g},{0.02 * value:.6g},1,m/s,{0.1 * size}")
    (tmp_path / "sands.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")

    def read(function: str):
        path = tmp_path / f"{function}.toml"
        path.write_text(STUDY.format(function=function), encoding="utf-8")
        return load_study(path)

    return read


def test_errors_are_carried_to_the_scale_of_the_comparison(study):
    at = {"diameter": np.array([1e-4, 2e-4])}
    found = study("predict").problem.uncertainty([(Observable("threshold_u_star", "log"), at, {})], {}, {})
    assert found == pytest.approx(np.full((2, 2), SHARE**2))


def test_a_misfit_that_the_own_errors_of_a_model_can_be_is_none(study):
    # every row a tenth too high: one sd of the shared error, five of every laboratory
    sure, unsure = (summary(raced(study(name).problem, 1)) for name in ("sure", "predict"))
    assert sure.fit.p_before < 1e-6
    assert [level.observable for level in sure.levels] == ["threshold_u_star"]
    assert unsure.fit.p_before > 0.1
    assert unsure.levels == ()


def test_a_model_whose_file_has_changed_is_another_model(study, tmp_path):
    before = study("predict").model
    (tmp_path / "level.txt").write_text("0.4\n", encoding="utf-8")
    assert study("predict").model != before
    (tmp_path / "level.txt").unlink()
    with pytest.raises(BadInput, match=r"READS names .*level.txt: no such file"):
        study("predict")
