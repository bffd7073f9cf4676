"""`predict`: rows against a refitted race, and which model of a study answers."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from taichi_erosion.evidence.answers.commands import adopt_study, no_progress
from taichi_erosion.evidence.answers.predictions import predict_study, prediction, read_prediction
from taichi_erosion.evidence.models.table_columns import NewConditions
from taichi_erosion.evidence.race.outlook import elsewhere, forecast, left_out, new_rows
from taichi_erosion.evidence.race.posterior import raced
from tests.evidence.linear_study import linear_problem
from tests.evidence.small_study import write_study


def test_a_row_is_predicted_from_the_others_as_if_it_had_not_been_measured():
    """The closed form against a race without the row; every row is a batch of its own."""
    problem = linear_problem({}, {}, seed=3)
    table = replace(problem.measurements, group=tuple(map(str, range(24))))
    shares = left_out(raced(problem, 1, table))
    for i in (0, 9, 12, 21):
        rest = raced(problem, 1, table.rows(np.delete(np.arange(table.size), i)))
        place = elsewhere(
            rest.race, new_rows(rest.race.prepared, NewConditions(("y",), {"x": table.conditions["x"][[i]]}))
        )
        told = forecast(rest, place)
        share = told.weight @ (told.measured[:, 0] < table.value[i]) / told.weight.sum()
        assert shares[i] == pytest.approx(share, abs=0.04)


def test_a_setting_beyond_the_measured_ones_is_told_and_less_certain():
    wanted = NewConditions(("y", "y", "z"), {"x": np.array([0.5, 2.0, 0.0])})
    found = prediction(raced(linear_problem({}, {}, seed=1), 1), wanted)
    near, far = found.rows
    assert near.outside == {}
    assert far.outside == {"x": 1.0}
    assert far.high - far.low > near.high - near.low
    assert near.measured_high - near.measured_low > near.high - near.low
    assert found.lost == ("z",), "an observable without a fitted row"
    assert found.fitted.inside / found.fitted.n == pytest.approx(0.9, abs=3.0 * (0.9 * 0.1 / 24) ** 0.5)


@pytest.fixture(scope="module")
def study(tmp_path_factory) -> Path:
    return write_study(tmp_path_factory.mktemp("study"), {"liquid_bridge": 1.0})


def asked(study: Path, **words):
    table = study.with_name("at.csv")
    table.write_text("moisture [%],diameter [um]\n0,300\n2,300\n", encoding="utf-8")
    return predict_study(study, table, no_progress, **words)


def test_the_adopted_model_answers_until_the_table_changes(study):
    before = asked(study)
    assert before.about["adopted"] == []
    assert before.record.held_out is None
    assert any("stay unseen for `adopt`" in line for line in before.answer().lines)
    adopt_study(study, ["liquid_bridge"], no_progress)
    after = asked(study)
    assert after.about["adopted"] == ["liquid_bridge"]
    assert 0 < after.record.held_out.n < 2 * after.record.held_out.inside
    assert [asked(study).about["vault_opened"] for _ in range(2)] == [2, 2], "one opening for one model"
    assert read_prediction(Path(after.about["results"]), Path(after.about["study"]).stem) is not None
    assert asked(study, bare=True).about["adopted"] == []
    dry, wet = (
        [row for row in reply.record.rows if row.observable == "threshold_u_star"][1]
        for reply in (before, after)
    )
    assert (wet.conditions["moisture"], wet.condition_units["moisture"]) == (2.0, "%")
    assert (wet.conditions["diameter"], wet.condition_units["diameter"]) == (300.0, "um")
    assert wet.high - wet.low < dry.high - dry.low, "what was missing is known now"
    measured = study.with_name("heap.csv")
    lines = measured.read_text("utf-8").splitlines(keepends=True)
    measured.write_text("".join(lines[:-1]), encoding="utf-8")
    found = asked(study)
    assert found.record.outdated == ("liquid_bridge",)
    assert any(line.startswith("Left out: liquid_bridge, adopted before") for line in found.answer().lines)
    assert read_prediction(Path(found.about["results"]), study.stem) == found, "as it was given"
    assert len(found.answer().lines) <= 8
