"""Impact over fluid threshold: tables whose answers are known."""

from math import exp, hypot, log, nan, sqrt

import numpy as np
import pytest
from scipy.stats import t as student

from doe.common.cases import ROOT, Row
from doe.fluid_threshold.page import iversen_white
from doe.wind import blown_sand, ratio
from doe.wind.answers import Sands, scale
from doe.wind.ratio import Data, Estimate

NUMBER = 0.08  # u* / sqrt((s - 1) g d) of the simulated sands
SIZES = (0.1, 0.25, 1.0)  # mm


def line(size: float, value: float, density: str = "", source: str = "Bagnold 1937") -> dict[str, str]:
    return {
        "diameter [mm]": f"{size:g}",
        "value": f"{value:.9g}",
        "grain_density [g/cm3]": density,
        "source": source,
    }


def threshold(size: float, density: float = blown_sand.QUARTZ) -> float:
    return NUMBER * sqrt((density / blown_sand.AIR - 1.0) * blown_sand.GRAVITY * 1e-3 * size)


def blown(group: str, sizes=SIZES, factor: float = 1.0) -> blown_sand.Found:
    """Four winds over sands whose thresholds go with the root of the diameter."""
    rows = []
    for size in sizes:
        kept = blown_sand.AIR * (factor * threshold(size)) ** 2
        for over in (1.7, 2.2, 2.7, 3.1):
            wind = over * threshold(size)
            borne = blown_sand.AIR * wind**2 - kept
            values = {"bed_stress": kept, "grain_stress": borne, "flux": 0.1 * borne}
            label = f"{size:g} mm, u* {wind:.3g}"
            rows += [
                Row(group, label, name, value, nan, 1, "Pa", "hash", 1, 1e-6, 0.2, 800, 1.0, "run", "")
                for name, value in values.items()
            ]
    return blown_sand.by_case(rows)


def data(measured: list[dict[str, str]]) -> Data:
    classes = [{"diameter [mm]": "0.25", "largest [mm]": "0.36"}]
    hopping = [{"diameter [mm]": f"{s:g}", blown_sand.OVER_BED: f"{threshold(s):.9g}"} for s in SIZES]
    return Data(blown("impact"), blown("impact"), measured, classes, hopping, [])


def cells(table: str) -> list[list[str]]:
    return [[cell.strip() for cell in row.split("|")[1:-1]] for row in table.splitlines()[2:]]


def test_intervals_of_a_ratio_add_as_squares_of_logarithms():
    found = Estimate(0.2, 0.18, 0.21).over(Estimate(0.4, 0.32, 0.5))
    assert found.value == pytest.approx(0.5)
    # the ratio is lowest where its numerator is low and its denominator high
    assert found.low == pytest.approx(0.5 * exp(-hypot(log(0.2 / 0.18), log(0.5 / 0.4))))
    assert found.high == pytest.approx(0.5 * exp(hypot(log(0.21 / 0.2), log(0.4 / 0.32))))


def test_a_simulated_threshold_has_the_interval_of_its_line():
    sands = Sands(np.log([1e-4, 4e-4]), np.log([NUMBER, NUMBER]), np.array([4e-4, 4e-4]))
    # eight degrees of freedom: two of a line and six of the prior
    factor = exp(student.ppf(0.975, 8) * 0.02)
    at, between = (ratio.impact_at(sands, size) for size in (1e-4, 2e-4))
    assert at is not None
    assert between is not None
    assert at.value == pytest.approx(NUMBER * float(scale(np.array(1e-4), 2650.0)))
    assert at.high == pytest.approx(factor * at.value)
    # half way, the mean of two independent logarithms
    assert log(between.high / between.value) == pytest.approx(log(factor) / sqrt(2.0))
    assert ratio.impact_at(sands, 6e-4) is None


def test_a_sand_measured_as_simulated_has_no_difference_and_a_lighter_one_that_of_its_root():
    light = line(0.25, threshold(0.25), "1.9", "Chepil 1945")
    first, second, *errors = cells(ratio.sand_table(data([line(0.1, threshold(0.1)), light])))
    assert first[4] == first[5] == first[8] == "+0 %"
    lighter = 100.0 * (sqrt((1900.0 / 1.225 - 1.0) / (2650.0 / 1.225 - 1.0)) - 1.0)
    assert second[4] == f"{lighter:+.0f} %"
    # as if it were of quartz it is met; its largest grains, 0.36 mm, need 1.2 times the wind
    assert second[8] == "+0 %"
    assert second[9] == f"{100.0 * (1.2 * (1.0 + lighter / 100.0) - 1.0):+.0f} %"
    assert second[10] == "100 %"
    assert [row[0] for row in errors] == ["rms of ln, all", "rms of ln, quartz", "rms of ln, Chepil 1945"]
    assert float(errors[1][4]) == pytest.approx(0.0, abs=1e-3)


def test_adhesion_counts_where_it_was_simulated_and_coarser_sands_stay_as_they_are():
    found = {
        (group, size): {
            blown_sand.STRESS_LINE: Row(
                group, size, blown_sand.STRESS_LINE, value, nan, 4, "m s-1", "", 1, 1e-6, 0.2, 1, 1.0, "", ""
            )
        }
        for group, size, value in (
            ("impact", "0.1", 0.13),
            ("impact", "0.5", 0.25),
            ("adhesion", "0.1", 0.15),
        )
    }
    sizes, values = ratio.fine_with(found, blown_sand.STICKY)
    assert sizes == pytest.approx([1e-4, 5e-4])
    assert values == pytest.approx([0.15, 0.25])


def test_a_sand_that_ceases_on_the_curve_has_the_ratio_one():
    lines = [line(0.25, 0.75 * iversen_white(0.25e-3)), line(0.5, iversen_white(0.5e-3, 1900.0), "1.9")]
    assert ratio.over_curve(lines) == pytest.approx([0.75, 1.0])


def test_the_measured_threshold_between_uniform_sands_is_that_of_the_sand_itself():
    known = ratio.read_data(ROOT / "doe")
    assert ratio.measured_impact(known, 0.24) == pytest.approx(0.192)
    assert ratio.measured_impact(known, 1.0) == pytest.approx(0.378681)


def test_the_line_of_a_flux_that_follows_the_stress_of_the_grains_meets_it():
    found = blown("impact")
    line_of = ratio.flux_line(found, 0.25)
    assert line_of is not None
    assert line_of.value == pytest.approx(threshold(0.25), rel=1e-6)
    # a sand of 0.24 mm stands for 0.25 mm, along the root of the diameter
    near = ratio.flux_line(blown("impact", (0.24,)), 0.25)
    assert near is not None
    assert near.value == pytest.approx(threshold(0.25), rel=1e-6)
    assert ratio.flux_line(found, 0.5) is None


def test_ratios_of_the_field_are_those_of_friction_velocities():
    known = ratio.read_data(ROOT / "doe")
    lines, ratios = ratio.field_ratios(known.field)
    assert [one["group"] for one in lines] == ["Jericoacoara", "RanchoGuadalupe", "Oceano"]
    # as the authors state them: 0.805, 0.851 and 0.798
    assert ratios == pytest.approx([0.805, 0.851, 0.798], abs=2e-3)
