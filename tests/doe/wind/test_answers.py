"""The study of impact thresholds that the simulator answers: its model is what was simulated, no more."""

from pathlib import Path

import numpy as np
import pytest

from doe.common.cases import by_case, read_rows
from doe.wind import answers
from doe.wind.saturated_sand import STRESS_LINE, saturated_thresholds

ROOT = Path(__file__).parents[3]
FINE = 1e-4  # m, simulated without and with adhesion
NO_SEED = np.array([1])


@pytest.fixture(scope="module")
def simulated():
    """Thresholds of the table [m s-1] by group and label."""
    thresholds = saturated_thresholds(by_case(read_rows(ROOT / "doe" / "wind" / "saturated.csv")))
    return {name: case[STRESS_LINE].value for name, case in thresholds.items()}


def asked(diameter: float, density: float = np.nan, **effects: float) -> float:
    at = {"diameter": np.array([diameter]), "grain_density": np.array([density])}
    return float(answers.predict("threshold_u_star", at, {}, effects, NO_SEED)[0, 0])


def test_a_simulated_sand_has_the_simulated_threshold(simulated):
    for label in ("0.075", "0.24", "1"):
        assert asked(1e-3 * float(label)) == pytest.approx(simulated["impact", label])
    assert asked(FINE, dry_adhesion=1.0) == pytest.approx(simulated["adhesion", "0.1"])
    # half of an effect is half way in the logarithm
    both = simulated["impact", "0.1"] * simulated["adhesion", "0.1"]
    assert asked(FINE, dry_adhesion=0.5) == pytest.approx(np.sqrt(both))


def test_adhesion_fades_beyond_the_coarsest_sand_that_stuck():
    def moved(diameter: float) -> float:
        return float(np.log(asked(diameter, dry_adhesion=1.0) / asked(diameter)))

    # pull over weight goes as d^-2
    assert moved(1e-3) == pytest.approx(moved(5e-4) / 4.0)


def test_the_errors_of_the_laboratory_are_those_of_the_library_and_beyond_the_sands_nothing_is_said():
    assert asked(2e-4, sieve_diameter=1.0) == pytest.approx(asked(2.2e-4))
    told = asked(2e-4, friction_velocity_calibration=1.0)
    assert told == pytest.approx(1.07 * asked(2e-4))
    assert np.isnan(asked(5e-5))
    assert np.isnan(asked(2e-3))


def test_sands_err_by_themselves_and_what_lies_between_by_both():
    at = {"diameter": np.array([1.5e-4, 2.4e-4, np.sqrt(1.5e-4 * 2.4e-4)])}
    value = answers.predict("threshold_u_star", at, {}, {}, NO_SEED)[0]
    own = answers.predict_covariance("threshold_u_star", at, {}, {}) / np.outer(value, value)
    assert own[0, 1] == pytest.approx(0.0, abs=1e-12)
    assert own[2, 2] == pytest.approx(0.25 * (own[0, 0] + own[1, 1]))
    assert own[0, 2] == pytest.approx(0.5 * own[0, 0])


def test_light_grains_need_the_root_of_their_density(simulated):
    # simulated by itself; each of both lines through four winds is known to 3 or 4 %
    assert simulated["light", "0.24"] == pytest.approx(asked(2.4e-4, 1940.0), rel=0.1)
