"""Tables as laboratories write them: drawn again from their seed, read back from their text, scored."""

import csv
from math import isclose
from typing import get_args

import pytest

from doe.trials.metrics import Case
from doe.trials.tables.draw import draw
from doe.trials.tables.outcome import WORDS, table_metrics, word
from doe.trials.tables.reading import misread
from doe.trials.tables.words import QUANTITIES, number
from taichi_erosion.evidence.record import Verdict

SEED = 2**100 + 7


def test_a_case_follows_from_its_seed(tmp_path):
    first, second = draw(SEED, 3), draw(SEED, 3)
    assert first.truth == second.truth
    assert first.truth != draw(SEED, 4).truth
    for place, case in (("a", first), ("b", second)):
        case.write(tmp_path / place)
    for file in (tmp_path / "a").glob("*.csv"):
        assert file.read_bytes() == (tmp_path / "b" / file.name).read_bytes()


def alone(case):
    """Whether a case has one quantity, in columns of its own."""
    truth = draw(SEED, case).truth
    return len(truth["observables"]) == 1 and truth["layout"] != "long"


@pytest.mark.parametrize("case", list(filter(alone, range(14))))
def test_the_right_reading_is_that_of_the_cells(case, tmp_path):
    drawn = draw(SEED, case)
    drawn.write(tmp_path)
    style, (name,) = drawn.truth["style"], drawn.truth["observables"]
    with (tmp_path / "plain.csv").open(encoding="utf-8", newline="") as file:
        heads, *rows = csv.reader(file, delimiter=";" if style["decimal_comma"] else ",")
    units = QUANTITIES[name]["units"][style["units"][name]]
    columns = [k for k, text in enumerate(heads) if text.startswith((QUANTITIES[name]["plain"], "angle"))]
    cells = [row[k].partition("±")[0].strip() for row in rows for k in columns]
    read = [number(text) * units[1] for text in cells if text[:1].isdigit() and number(text) > 0.0]
    meant = [each["value"] for each in drawn.truth["readings"] if each["kind"] == "exact"]
    assert len(read) == len(meant)
    assert all(isclose(one, other, rel_tol=1e-9) for one, other in zip(read, meant, strict=True))


def test_what_is_misread_is_found():
    for case in range(20):
        truth = draw(SEED, case).truth
        right = []  # what a program that reads everything right hands to the race
        for k, each in enumerate(truth["readings"]):
            row = {key: each[key] for key in ("observable", "value", "sd", "n", "at")}
            right.append(row | {"below": each["kind"] != "exact", "set_up": each["soil"], "line": k})
        assert misread(truth, right) == []
        first = truth["conditions"][0]
        changes = {
            "condition": [row | {"at": row["at"] | {first: float("nan")}} for row in right[:1]] + right[1:],
            "unit": [row | {"value": 10.0 * row["value"]} for row in right],
            "repeat": [row | {"set_up": str(row["line"])} for row in right],
        }
        for kind, rows in changes.items():
            can_be = kind != "repeat" or (truth["layout"] in ("rows", "columns") and truth["errors"]["n"] > 1)
            can_be &= kind != "unit" or all(not row["below"] for row in right)
            assert not can_be or kind in misread(truth, rows), (case, kind)


def answered(kind, effects, **told):
    truth = {"kind": kind, "effects": effects, "unknown_scatter": False, "may_refuse": [], "below": 0}
    truth |= {"soils": 1, "outside": None, "options": {"table": []}}
    answer = {"verdict": "none_detected", "agrees": False, "named": [], "group": [], "varying": []}
    answer |= dict.fromkeys(("refused", "refused_first", "refused_scatter", "law"), "")
    answer |= {"excluded": {}, "adopted": None, "p_lack_of_fit": None, "held_out_share": None} | told
    hard = {"ratio": 0.0 if kind == "null" else 9.0, "separation": 8.0}
    return Case({"truth": truth, "answer": answer, "misread": [], "difficulty": hard})


def test_a_table_is_read_and_answered_as_a_user_would():
    case = next(case for case in map(lambda k: draw(SEED, k), range(40)) if case.truth["kind"] == "listed")
    row = case.row(case.answer(0))
    assert row["misread"] == []
    assert row["answer"]["verdict"] in get_args(Verdict)
    assert word(Case(row)) in WORDS


@pytest.mark.parametrize(
    ("kind", "effects", "told", "expected"),
    [
        ("listed", {"gusts": 1.0}, {"verdict": "present", "named": ["gusts"]}, "right"),
        ("listed", {"gusts": 1.0}, {"verdict": "group", "group": ["gusts", "sheltering"]}, "part"),
        ("listed", {"gusts": 1.0}, {"verdict": "outside_library"}, "wrong"),
        ("listed", {"gusts": 1.0}, {"agrees": True}, "wrong"),
        ("listed", {"gusts": 1.0}, {}, "silent"),
        ("varying", {"gusts": 1.0}, {"verdict": "outside_library"}, "right"),
        ("outside", {}, {"verdict": "outside_library"}, "right"),
        ("outside", {}, {"law": "power", "held_out_share": 0.8}, "right"),
        ("outside", {}, {"verdict": "present", "named": ["gusts"]}, "wrong"),
        ("null", {}, {"verdict": "group", "group": ["gusts", "sheltering"]}, "wrong"),
        ("null", {}, {"agrees": True}, "right"),
        ("null", {}, {"refused": "no unit"}, "refused"),
    ],
)
def test_a_word_on_an_answer(kind, effects, told, expected):
    assert word(answered(kind, effects, **told)) == expected


def test_a_misread_table_is_counted():
    cases = [answered("null", {}) for _ in range(3)]
    cases[0].row["misread"].append("sd")
    found = {metric.name: metric for metric in table_metrics(cases)}
    assert found["misread in silence"].value == found["misread: sd"].value == pytest.approx(1.0 / 3.0)
