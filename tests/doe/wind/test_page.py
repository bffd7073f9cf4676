"""The page on sand under wind: what its tables say about simulations whose answers are known."""

from math import isnan, nan, sqrt

import numpy as np
import pytest

from doe.common.cases import Row
from doe.wind import blown_sand
from doe.wind import page as threshold
from taichi_erosion.measures.threshold import Bracket


def row(group: str, label: str, observable: str, value: float, sd: float = nan, n: int = 1) -> Row:
    return Row(group, label, observable, value, sd, n, "m s-1", "hash", 1, 1e-5, 0.1, 100, 1.0, "run", "0")


def impact(ratio: float) -> blown_sand.Found:
    """Sands whose thresholds go with the root of the diameter."""
    found = []
    for size in (0.1, 0.25, 1.0):
        scale = sqrt((blown_sand.QUARTZ / blown_sand.AIR - 1.0) * blown_sand.GRAVITY * 1e-3 * size)
        found += [row("impact", f"{size:g}", name, ratio * scale) for name in blown_sand.IMPACT]
    return blown_sand.by_case(found)


def test_a_threshold_that_goes_with_the_root_is_predicted_between_diameters_and_for_other_densities():
    sand = blown_sand.simulated_thresholds(impact(0.08), "impact_threshold")
    for size, density in ((0.1e-3, 2650.0), (0.4e-3, 2650.0), (0.7e-3, 1800.0)):
        want = 0.08 * sqrt((density / blown_sand.AIR - 1.0) * blown_sand.GRAVITY * size)
        assert blown_sand.predicted(size, density, sand) == pytest.approx(want, rel=1e-9)
    assert isnan(blown_sand.predicted(0.02e-3, 2650.0, sand))


def test_a_model_that_differs_by_more_than_laboratories_do_is_said_to_fail():
    line = {"diameter [mm]": "0.25", "grain_density [g/cm3]": "", "sd": "0.006", "source": "Somebody 1950"}
    scale = sqrt((blown_sand.QUARTZ / blown_sand.AIR - 1.0) * blown_sand.GRAVITY * 0.25e-3)
    near, far, fine = (line | {"value": f"{ratio * scale:g}"} for ratio in (0.083, 0.06, 0.08))
    table = blown_sand.impact_table(impact(0.08), [near, far, fine | {"diameter [mm]": "0.02"}])
    # the sands were given the same threshold by each way to read it
    assert table.count("holds") == 3
    assert table.count("**fails**") == 3
    assert table.count("not simulated") == 3


def test_adhesion_is_judged_by_what_is_left_between_simulated_and_measured_sands():
    found = impact(0.08)
    plain = [(label, name, case[name].value) for (_, label), case in found.items() for name in case]
    found |= blown_sand.by_case([row("adhesion", label, name, 1.25 * value) for label, name, value in plain])
    scale = sqrt((blown_sand.QUARTZ / blown_sand.AIR - 1.0) * blown_sand.GRAVITY * 0.25e-3)
    line = {"diameter [mm]": "0.25", "grain_density [g/cm3]": "", "sd": "0.006", "value": f"{0.1 * scale:g}"}
    last = blown_sand.adhesion_table(found, [line, line | {"diameter [mm]": "9"}]).splitlines()[-1]
    # without: ln(0.08 / 0.1); with: 1.25 * 0.08 is what was measured
    cells = [float(cell) for cell in last.split("|")[2:-1]]
    assert cells == pytest.approx([abs(np.log(0.8)), 0.0] * 3, abs=1e-3)
    # and the plain impact table does not see the sticky cases
    assert blown_sand.scaling_table(found, []).count("\n") == 2 + 3


def test_the_speed_in_the_tunnel_has_the_errors_of_the_bed_and_of_the_map():
    speed, half = threshold.tunnel_speed(0.3, 0.006)
    low, high = (threshold.tunnel_speed(0.3 + part, nan)[0] for part in (-0.006, 0.006))
    # two standard deviations of the map, 5.62 %, and half of the interval, as squares
    assert half == pytest.approx(
        np.hypot(0.5 * (high - low), 2.0 * 0.0562 * 0.3 * (high - low) / 0.012), rel=0.02
    )
    assert low < speed < high


def test_a_threshold_is_compared_with_that_of_drag_alone():
    rows = [
        row(*name, observable, value, 0.02, 5)
        for name, value in ((("forces", threshold.ALONE), 0.26), (("grain density", "lighter"), 0.208))
        for observable in (threshold.FLUID, threshold.ROLLING)
    ]
    lines = threshold.fluid_table(blown_sand.by_case(rows)).splitlines()[2:]
    assert [line.split("|")[7].strip() for line in lines] == ["1.00", "0.80"]
    # onset of rolling and fluid threshold are the same here, and so are their speeds
    assert all(line.split("|")[5] == line.split("|")[8] for line in lines)


def test_a_floor_that_feels_more_of_the_wind_starts_moving_in_less_of_it():
    line = {"choice": "rougher", "friction_velocity": "0.3", "relative_change": "0.25"}
    assert "| +25.0 % | -20.0 % |" in threshold.choice_table([line])


def test_the_line_of_a_linear_flux_starts_at_its_threshold():
    winds = (0.25, 0.35, 0.45, 0.55)
    measured = [
        {"u_star [m/s]": f"{u:g}", "value": f"{1e3 * 0.2 * (u**2 - 0.04):.9g}", "sd": "0.5"} for u in winds
    ]
    found = blown_sand.by_case([row("flux", f"{u:g}", "flux", 0.3 * (u**2 - 0.04)) for u in winds])
    lines = blown_sand.line_table(found, measured).splitlines()[2:]
    assert [line.split("|")[2].strip() for line in lines] == ["0.2", "0.2"]
    assert [line.split("|")[5].strip() for line in lines] == ["1.000", "1.000"]
    # a linear flux has no power of the wind beyond its stress
    known = blown_sand.line_table(found, measured, Bracket(0.2 - 1e-9, 0.2 + 1e-9)).splitlines()[2:]
    assert all(abs(float(line.split("|")[6].split("±")[0])) < 1e-3 for line in known)
