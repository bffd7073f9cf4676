"""An audit finds what was planted in a sound table, and nothing in a table without a fault."""

import csv
import json
from itertools import product

import numpy as np
import pytest
from textbook import unit_factors

from taichi_erosion.cli.main import main
from taichi_erosion.core.errors import BadInput
from taichi_erosion.experiments import design
from taichi_erosion.experiments.audit import audit_document, audit_table
from taichi_erosion.experiments.published import parse_printed

LAW = np.array([3.0, -8.0, 0.5, 1.0, -2.0, 0.1, 4.0])
SOUND = "a,y\n1,2\n-1,3\n1,1\n-1,4\n"


def write(path, names, rows):
    with path.open("w", newline="", encoding="utf-8") as file:
        csv.writer(file).writerows([names, *rows])
    return path


def screening(count: int = 7) -> tuple[list[str], list[list[float]]]:
    """Heading and rows of a Plackett-Burman design with a response of known effects."""
    factors = unit_factors("ABCDEFG"[:count])
    made = design.plackett_burman(factors, centre_points=1)
    noise = np.random.default_rng(5).normal(0.0, 0.3, len(made))
    values = np.round(20.0 + made.coded @ LAW[: len(factors)] + noise, 2)
    rows = [[k + 1, *levels, y] for k, (levels, y) in enumerate(zip(made.natural, values, strict=True))]
    return ["run", *(f.path for f in factors), "angle"], rows


@pytest.mark.parametrize("seed", range(6))
def test_the_one_flipped_cell_of_a_screening_is_found(tmp_path, capsys, seed):
    names, rows = screening()
    rng = np.random.default_rng(seed)
    row, column = int(rng.integers(0, 8)), int(rng.integers(1, 8))
    rows[row][column] *= -1.0
    path = write(tmp_path / "t.csv", [*names, "later"], [[*line, k**2] for k, line in enumerate(rows)])
    assert main(["audit", str(path), "--response", "angle", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["response"] == "angle"
    assert not found["orthogonal"]
    assert (found["cell"]["row"], found["cell"]["column"]) == (row + 1, names[column])
    assert found["cell"]["restored_by"] == -rows[row][column]


def test_a_level_with_a_slipped_decimal_point_is_named(tmp_path):
    names, rows = screening()
    rows[3][2] = 10.0 * rows[3][2]
    found = audit_table(write(tmp_path / "t.csv", names, rows))
    (odd,) = [finding for finding in found.findings if finding.kind == "cell"]
    assert (odd.row, odd.column, odd.printed) == (4, "B", f"{rows[3][2]:g}")


def test_an_axial_run_out_of_place_a_blank_and_an_impossible_angle_are_named(tmp_path):
    points = [*product((-1, 1), repeat=2), (-1.5, 0), (2, 0), (0, -2), (0, 2), *[(0, 0)] * 3]
    rows = [[k, a, b, 30.0 + a + 2.0 * b + 0.1 * (k % 3)] for k, (a, b) in enumerate(points)]
    rows[0][3], rows[9][3] = 291.0, ""
    found = audit_table(write(tmp_path / "t.csv", ["run", "a", "b", "angle of repose [deg]"], rows)).findings
    words = " | ".join(finding.sentence for finding in found)
    assert "axial runs of a: -1.5 and 2 lie unlike far" in words
    assert "axial runs of b" not in words
    assert "1 of 11 runs have no response" in words
    assert "row 1: angle of repose [deg] is 291" in words


def test_a_sound_design_is_found_sound(tmp_path):
    names, rows = screening()
    found = audit_table(write(tmp_path / "t.csv", names, rows))
    assert found.structure.balanced
    assert found.structure.orthogonal
    assert {finding.kind for finding in found.findings} <= {"curvature"}


def test_a_flipped_cell_of_a_box_behnken_design_is_one_of_two(tmp_path):
    levels = design.box_behnken(unit_factors("ABC")).coded.copy()
    levels[5, 2] *= -1.0
    rows = [[*line, float(k)] for k, line in enumerate(levels)]
    found = audit_table(write(tmp_path / "t.csv", ["A", "B", "C", "y"], rows))
    # two rows of the printed table are now alike: either could be the wrong one
    assert {(cell.row, cell.column) for cell in found.structure.cells} > {(5, 2)}
    assert audit_document(found)["cell"] is None


def test_columns_behind_the_response_that_repeat_a_factor_are_set_aside(tmp_path):
    names, rows = screening(3)
    more = [[*row, 0.5 + 0.1 * row[1], -row[2], "a remark"] for row in rows]
    path = write(tmp_path / "t.csv", [*names, "natural_A", "B_again", "note"], more)
    found = audit_document(audit_table(path, "angle"))
    assert found["factors"] == ["A", "B", "C"]
    assert found["set_aside"] == ["run", "natural_A", "B_again", "note"]


@pytest.mark.parametrize(
    ("text", "found", "agrees"),
    [
        ("3.18", 3.1766, True), ("3.18", 3.1749, False), ("0.0104*", 0.01042, True), ("<0.0001", 2e-7, True),
        ("< 0.0001**", 2e-4, False), ("75.39", 75.385, True), ("1e3", 1400.0, True), ("5", 5.4, True),
        ("-0.8187", -0.81875, True), ("0.4675", -0.4675, False),
    ],
)  # fmt: skip
def test_a_printed_number_is_as_exact_as_its_last_digit(text, found, agrees):
    assert parse_printed(text).agrees(found) is agrees
    assert parse_printed("n.s.") is None


@pytest.mark.parametrize(
    ("text", "claims", "words"),
    [
        ("a,y\n1,2\n3,x\n1,1\n", "", "row 2, y = 'x' must be a number"),
        ("a,y\n1,2\n3,4,5\n1,1\n", "", "row 3 has 3 cells, the heading 2"),
        ("a,y\n1,2\n-1,3\n", "", "at least 3"),
        ("y\n1\n2\n5\n", "", "no column of factor levels"),
        (SOUND, "modle = 'linear'", "modle = 'linear': Extra inputs"),
    ],
)
def test_what_cannot_be_audited_is_refused_in_one_line(tmp_path, text, claims, words):
    path = tmp_path / "t.csv"
    path.write_text(text, encoding="utf-8")
    (tmp_path / "t.claims.toml").write_text(claims, encoding="utf-8")
    with pytest.raises(BadInput, match=words):
        audit_table(path)
