"""A sealed set beyond the list: truths outside the tree, targets met by their bounds."""

import json
import pickle
from math import hypot, log
from typing import Any

import numpy as np
import pytest
from scipy import stats

from doe.beyond.page import Opened, median, met_by_bound, metric_table
from doe.beyond.trial import DIGITS, opened, seal, sealed
from doe.common.sealed_set import SealedSet
from doe.sealed.score import share
from taichi_erosion.core.files import write_atomic

NULLS = (0.0, 1.0, 0.0)
SILENT: dict[str, Any] = {"method": "m", "verdict": "none_detected", "named": [], "seconds": 0.5}


@pytest.fixture
def trial(tmp_path) -> SealedSet:
    made = SealedSet("few", tmp_path / "secret", tmp_path / "work", tmp_path / "tables", DIGITS)
    seal(made, 2, NULLS)
    write_atomic(made.answer(0), json.dumps(SILENT).encode())
    return made


def test_an_answered_case_is_opened_with_its_method(trial):
    row = opened(trial, 0, sealed(trial)[0])
    truth, problem = json.loads(row["truth"]), pickle.loads(trial.problem(0).read_bytes())
    assert row["method"] == "m"
    assert truth["kind"] == "null"
    prior = [
        log(truth["parameters"][each.path] / each.start) / each.prior_sd_log for each in problem.parameters
    ]
    assert float(row["ratio"]) <= 1.001 * hypot(*prior), "at its own numbers a null leaves their prior alone"


def test_a_truth_that_was_changed_after_its_seal_is_refused(trial):
    trial.truth(0).write_text(trial.truth(0).read_text().replace('"null"', '"listed"'), encoding="utf-8")
    with pytest.raises(ValueError, match="not the one that was sealed"):
        opened(trial, 0, sealed(trial)[0])


def test_a_set_is_sealed_once_and_its_problems_hold_no_truth(trial):
    with pytest.raises(FileExistsError):
        seal(trial, 2, NULLS)
    hidden = json.loads(trial.truth(0).read_text(encoding="utf-8"))
    problem = trial.problem(0).read_bytes()
    assert hidden["seed"].encode() not in problem
    assert not hasattr(pickle.loads(problem), "truth")
    assert json.loads(trial.truth(1).read_text(encoding="utf-8"))["seed"] != hidden["seed"]


def test_a_target_counts_as_met_by_its_bound():
    silent = [False] * 100
    assert not met_by_bound(share("m", silent, ("<=", 0.02))).met, "100 silent nulls leave room for 3.6 %"
    assert met_by_bound(share("m", silent * 2, ("<=", 0.02))).met


def test_bounds_of_a_median_hold_it_as_often_as_they_say():
    generator, held = np.random.default_rng(3), 0
    for _ in range(2000):
        found = median("m", generator.standard_normal(11).tolist(), ("<=", 1.0))
        held += found.low <= 0.0 <= found.high
    exact = 1.0 - 2.0 * float(stats.binom.cdf(1, 11, 0.5))
    assert held / 2000 == pytest.approx(exact, abs=0.015)


def case(told: tuple[str, ...], exponent: tuple[float, float]) -> Opened:
    law = {"exponents": {"diameter": {"low": exponent[0], "high": exponent[1]}}}
    truth = {"kind": "outside", "name": "drag", "form": "power", "condition": "diameter", "exponent": 0.8}
    answer = {"verdict": "outside_library", "named": [], "seconds": 1.0, "mechanisms": list(told), "law": law}
    return Opened(truth, 10.0, answer | {"beyond": "group", "held_out": [10.0, 1.0]})


def test_gain_and_offset_of_one_instrument_count_as_one_member_of_a_group():
    instrument = ("reading_gain:flux", "reading_offset:flux")
    table = metric_table([case(("drag", "lift", *instrument), (-1.0, -0.5))])
    (told,) = [row for row in table.splitlines() if "at most three" in row]
    assert "| 1.000 |" in told
    (held,) = [row for row in table.splitlines() if "exponent" in row]
    assert "| 1.000 | 0.025 to 1.000 | 1 |" in held
