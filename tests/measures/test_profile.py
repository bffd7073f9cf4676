"""Profiles of heaps: angle, height and radius of 90 % of a cone in closed form, and a table of them."""

from pathlib import Path

import numpy as np
import pytest

from taichi_erosion.cli.main import main
from taichi_erosion.core.errors import BadInput
from taichi_erosion.measures.profile import angle_height_and_radius, measure_heap_table
from taichi_erosion.tables.headings import meaning_of

TOP, BASE = 30.0, 50.0  # mm
SHARE = 0.8042  # of the radius of a cone, within which 3 x^2 - 2 x^3 = 0.9 of its volume lies
ANGLE = np.degrees(np.arctan(TOP / BASE))
P = np.arange(0.0, 60.0, 2.0)


def cone(place: np.ndarray, axis: float = 0.0) -> np.ndarray:
    return np.maximum(TOP - TOP / BASE * np.abs(place - axis), 0.0)


@pytest.mark.parametrize(("start", "end", "axis"), [(0.0, 60.0, 0.0), (-60.0, 60.0, 0.0), (0.0, 140.0, 63.5)])
def test_a_cone_has_its_angle_height_and_radius_along_a_radius_and_a_line(start, end, axis):
    place = np.arange(start, end + 0.1, 0.5)
    angle, top, radius = angle_height_and_radius(place, cone(place, axis))
    assert angle == pytest.approx(ANGLE, abs=0.05)
    assert top == pytest.approx(TOP, abs=0.2)
    assert radius == pytest.approx(SHARE * BASE, rel=0.01)


def test_a_layer_of_fallen_grains_is_no_flank():
    place = np.arange(0.0, 100.0, 0.5)
    height = np.maximum(cone(place), np.where(place < 90.0, 6.0, 0.0))  # 0.2 of the height
    angles = [angle_height_and_radius(place, height, grain)[0] for grain in (0.0, 6.0)]
    assert angles[1] == pytest.approx(ANGLE, abs=0.1)
    assert angles[0] < 0.8 * ANGLE, "else this tests nothing"


def test_a_crater_is_no_flank_and_a_heap_whose_foot_is_not_seen_is_refused():
    place = np.arange(-60.0, 60.1, 0.5)
    crater = np.minimum(cone(place), 8.0 + np.abs(place))
    assert angle_height_and_radius(place, crater)[0] == pytest.approx(ANGLE, abs=0.1)
    for seen in (cone(place) + 6.0, cone(place)[:140]):
        with pytest.raises(BadInput, match="down to the foot"):
            angle_height_and_radius(place[: seen.size], seen)


def test_a_table_of_profiles_becomes_one_with_a_row_a_heap_that_a_study_reads(tmp_path: Path, capsys):
    table = tmp_path / "scans.csv"
    rows = [f"{w};{k};{x};{z:.2f}" for w in (0, 4) for k in "12" for x, z in zip(P, cone(P) + w, strict=True)]
    table.write_text("\n".join(["moisture [%];heap;radius [mm];z [cm]", *rows]))
    assert [main(["measure", "profile", str(table)]) for _ in range(2)] == [0, 0], "it replaces its own table"
    lines = (tmp_path / "scans_heaps.csv").read_text().splitlines()
    columns, *heaps = [line.split(",") for line in lines if not line.startswith("#")]
    assert "study new" in capsys.readouterr().out.splitlines()[-1]
    assert columns[:3] == ["moisture [%]", "heap", "angle of repose [deg]"]
    assert [heap[:2] for heap in heaps] == [["0", "1"], ["0", "2"], ["4", "1"], ["4", "2"]]
    assert float(heaps[0][3]) == pytest.approx(TOP), "in the unit of the heights"
    names = [meaning_of(text.partition(" [")[0])[1] for text in columns[2:]]
    assert names == ["repose_angle", "pile_height", "radius_90"]


@pytest.mark.parametrize(
    ("heading", "words"),
    [
        ("a [mm];z [mm]", "--place"),
        ("x [mm];u [mm]", "--height"),
        ("x [s];z [mm]", "no unit of length"),
        ("x;z [mm]", "no unit of length"),
    ],
)
def test_a_column_that_is_not_known_is_asked_for(tmp_path: Path, heading: str, words: str):
    table = tmp_path / "scans.csv"
    table.write_text("\n".join([heading, *(f"{x};{10 - x}" for x in range(10))]))
    with pytest.raises(BadInput, match=words):
        measure_heap_table(table)
