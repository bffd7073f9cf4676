"""An audit reads tables as people publish them, accuses no sound one, and finds the one planted misprint."""

import csv
from itertools import combinations, product

import numpy as np
import pytest
from scipy import stats

from taichi_erosion.cli.main import main
from taichi_erosion.experiments.audit import Audit, audit_table

BOX = np.array([(a, b, 0) for b, a in product((-1, 1), repeat=2)])
BOX = np.vstack([BOX, BOX[:, [0, 2, 1]], BOX[:, [2, 0, 1]], np.zeros((3, 3))])
ANGLES = (33.25, 34.5, 34.75, 34, 36, 31.25, 28.75, 35, 34.75, 36, 33.25, 36.25, 36.25, 34.75, 35.5)
AXES = np.array([(-1, 0), (1, 0), (0, -1), (0, 1)])
STAR = np.vstack([list(product((-1, 1), repeat=2)), 2**0.5 * AXES, np.zeros((5, 2))])
NINE = np.array([(a, b, (a + b) % 3, (a + 2 * b) % 3) for a in range(3) for b in range(3)])
ACTUAL = {"1": 31.53, "A": 45.42, "B": -11.88, "C": -609.4, "AB": -66.67, "AC": 1833.3, "BC": 875.0}
ACTUAL |= {"A2": -81.94, "B2": 187.5, "C2": -9062.5}


def squares(coded: np.ndarray) -> dict[str, np.ndarray]:
    """Columns of a quadratic model, `A`, `AB`, `A²`."""
    single = dict(zip("ABC", np.hsplit(coded, coded.shape[1]), strict=False))
    found = single | {a + b: single[a] * single[b] for a, b in combinations(single, 2)}
    return found | {f"{name}²": column**2 for name, column in single.items()}


def printed(lines, y, sequential=False) -> list[list[str]]:
    """A printed analysis of variance, by least squares with and without each line."""

    def rest(names):
        matrix = np.column_stack([np.ones(len(y)), *(lines[name] for name in names)])
        return float(np.sum((y - matrix @ np.linalg.lstsq(matrix, y)[0]) ** 2))

    sizes = {name: column.shape[1] for name, column in lines.items()}
    df = len(y) - 1 - sum(sizes.values())
    rows, error = [["Source", "Sum of Squares", "df", "F-value", "p-value"]], rest(lines) / df
    for place, name in enumerate(lines):
        kept = list(lines)[: place + 1] if sequential else list(lines)
        ss = rest([other for other in kept if other != name]) - rest(kept)
        f = ss / sizes[name] / error
        p = stats.f.sf(f, sizes[name], df)
        rows.append([name, f"{ss:.2f}", str(sizes[name]), f"{f:.2f}", f"{p:.4f}"])
    return [*rows, ["Residual", f"{error * df:.4f}", str(df), "", ""]]


def audited(folder, heading, levels, y, anova=(), claims="", separator=",") -> Audit:
    """The audit of a table, with claims beside it."""
    rows = [[*row, value] for row, value in zip(levels, y, strict=True)]
    with (folder / "t.csv").open("w", newline="", encoding="utf-8") as file:
        csv.writer(file, delimiter=separator).writerows([heading, *rows])
    with (folder / "anova.csv").open("w", newline="", encoding="utf-8") as file:
        csv.writer(file).writerows(anova)
    text = ('anova = "anova.csv"\n' if anova else "") + claims
    (folder / "t.claims.toml").write_text(text, encoding="utf-8")
    return audit_table(folder / "t.csv")


def wrong(found: Audit) -> list[tuple[str, str, str]]:
    """Kind, column and print of what is called wrong."""
    kinds = ("number", "sign", "cell", "heading")
    return [(f.kind, f.column, f.printed) for f in found.findings if f.kind in kinds]


@pytest.mark.parametrize(("term", "text"), [("", ""), ("AC", "-1833.3"), ("B", "-13.88")])
def test_an_equation_in_actual_factors_is_held_against_the_fit_in_actual_factors(tmp_path, term, text):
    levels = (np.array([0.45, 0.1, 0.02]) + BOX * np.array([0.15, 0.05, 0.01])).round(3)
    equation = {name: f"'{value}'" for name, value in ACTUAL.items()} | ({term: f"'{text}'"} if term else {})
    claims = "\n".join(["[equation]", *(f"{name} = {cell}" for name, cell in equation.items())])
    lines = printed(squares(BOX), np.array(ANGLES))
    lines[1][0], lines[6][3] = "A-sliding friction", "1.22" if not term else lines[6][3]
    found = audited(tmp_path, ["A", "B", "C", "angle of repose"], levels, ANGLES, lines, claims)
    assert [column for _, column, _ in wrong(found)] == [term or "B*C"]
    assert "the equation is in actual factors" in found.assumptions


@pytest.mark.parametrize("planted", [False, True])
def test_rounded_star_points_are_no_misprints_and_squares_no_curvature(tmp_path, planted):
    y = np.round(30 + STAR @ [2, -1] - STAR[:, 0] ** 2 + 0.1 * np.cos(7.0 * np.arange(len(STAR))), 2)
    lines = printed(squares(STAR), y)
    if planted:
        lines[2][3] = f"{1.4 * float(lines[2][3]):.2f}"
    heading = ["A: friction", "B: rolling", "Response 1"]
    found = audited(tmp_path, heading, np.round(0.5 + 0.2 * STAR, 3), y, lines)
    assert wrong(found) == ([("number", "B: rolling", lines[2][3])] if planted else [])
    assert (found.structure.balanced, found.structure.orthogonal) == (True, True)
    assert not {f.kind for f in found.findings} & {"curvature", "not orthogonal"}


@pytest.mark.parametrize("sums", ["sequential", "partial", "reduced"])
def test_other_sums_of_squares_are_not_judged_and_the_terms_of_the_lines_are_the_model(tmp_path, sums):
    y, kept = np.array(ANGLES), [k for k in range(15) if k not in (2, 9)]
    terms = squares(BOX[kept])
    terms = {name: terms[name] for name in terms if sums != "reduced" or name not in ("AB", "B²")}
    lines = printed(terms, y[kept], sequential=sums == "sequential")
    lines[1][1] = f"{1.4 * float(lines[1][1]):.2f}"
    found = audited(tmp_path, "ABCy", BOX[kept], y[kept], lines, "model = 'quadratic'\n")
    assert wrong(found) == ([] if sums == "sequential" else [("number", "A", lines[1][1])])
    assert not [f for f in found.findings if f.kind == "cell"]


def test_an_array_of_three_levels_is_orthogonal_and_sums_by_names_are_not_judged(tmp_path):
    y = np.array((30.61, 31.61, 32.17, 32.05, 32.71, 34.44, 33.97, 35.58, 36.42))
    lines = {name: np.eye(3)[NINE[:, k]][:, :2] for k, name in enumerate("ABCD") if name != "C"}
    levels = [[a + 1, 0.1 * b, c, f"1e{d + 6}"] for a, b, c, d in NINE]
    found = audited(tmp_path, [*"ABCD", "repose angle"], levels, y, printed(lines, y))
    assert (found.structure.balanced, found.structure.orthogonal) == (True, True)
    assert {f.kind for f in found.findings} == {"not judged"}
    levels[4][2] = 0
    found = audited(tmp_path, [*"ABCD", "repose angle"], levels, y)
    assert [(f.row, f.column, f.found) for f in found.findings if f.kind == "cell"] == [(5, "C", 2.0)]


def test_equal_repeats_leave_lack_of_fit_open_and_other_tables_numbers_are_not_judged(tmp_path):
    lines = printed(squares(BOX), 10.0 * np.cos(np.arange(15.0)))
    found = audited(tmp_path, "ABCy", BOX, [*ANGLES[:12], 35.5, 35.5, 35.5], lines, "model = 'quadratic'\n")
    assert wrong(found) == []
    assert {f.kind for f in found.findings} == {"not judged"}


def test_levels_as_signs_or_with_their_code_and_columns_of_programs_are_read(tmp_path):
    cells = [[f"{0.45 + 0.15 * x:.2f} ({x:+.0f})" for x in row] for row in BOX]
    lines = [[str(k + 1), *row, f"{y:.2f}"] for k, (row, y) in enumerate(zip(cells, ANGLES, strict=True))]
    rows = [[cell.replace(".", ",") for cell in line] for line in lines]
    found = audited(tmp_path, ["Std", *"ABC", "Actual", "Predicted"], rows, range(15), separator=";")
    assert (found.table.response, found.table.values) == ("Actual", pytest.approx(ANGLES))
    assert found.table.coded == pytest.approx(BOX)
    signs = [["+" if x > 0 else "\N{MINUS SIGN}" for x in row] for row in product((-1, 1), repeat=3)]
    found = audited(tmp_path, [*"ABC", "angle"], signs, range(20, 28), separator="\t")
    assert found.table.coded == pytest.approx(np.array(list(product((-1, 1), repeat=3))))


def test_a_climb_is_not_judged(tmp_path, capsys):
    steps = np.round(np.array([0.3, 0.06, 0.03]) + np.arange(6.0)[:, None] * [0.05, 0.012, -0.003], 3)
    rows = [[*row, y] for row, y in zip(steps, (28.0, 29.1, 30.2, 31.0, 31.4, 31.2), strict=True)]
    names = [*"ABC", "angle of repose", "relative error"]
    found = audited(tmp_path, names, rows, (9.7, 6.1, 2.6, 0.0, 1.3, 0.6))
    assert found.table.response == "angle of repose"
    assert {f.kind for f in found.findings} == {"not judged"}
    assert main(["audit", str(tmp_path / "t.csv")]) == 0
    assert "orthogonal: not judged" in capsys.readouterr().out
