"""The page of a study from records of every kind: what a reader sees first, and that he sees all of it."""

import re
from dataclasses import replace
from html import unescape
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from ten_records import VOC, adopted, curved, group, mechanism, null, refuted, single, typo

from taichi_erosion.evidence.answers.files import with_adoption
from taichi_erosion.evidence.record import Interval, ParameterPart, RowsPart
from taichi_erosion.report.answer_figures import rows_by_mark
from taichi_erosion.report.html import render_template
from taichi_erosion.report.study_page import TEMPLATE, answer_page
from tests.report.browser import assert_readable

HOME = Path("/home/somebody/soils")
NARROW = {"k": ParameterPart(0.0972, 0.0966, 0.0977, 0.1, Interval(0.0981, 0.0974, 0.0988), 0.02, False)}


def many_rows() -> RowsPart:
    """Thirty heaps that a model without water does not follow; one row is far off."""
    wet, size = np.repeat(np.linspace(0.0, 0.08, 10), 3), np.tile([1e-4, 3e-4, 9e-4], 10)
    before, sd = 30.0 + 1e4 * size, np.full(30, 0.6)
    after = before + 60.0 * wet
    measured = after + sd * np.sin(np.arange(30.0))
    measured[4] = 400.0
    conditions = {"moisture": wet, "diameter": size}
    return RowsPart(("repose_angle",) * 30, conditions, measured, measured, measured, sd, before, after)


PAGES = {
    "adopted": {"compare": adopted, "discover": adopted, "adopt": adopted, "next": group},
    "group": {"discover": replace(group, rows=many_rows(), parameters=NARROW), "next": group},
    "law": {"compare": mechanism, "discover": replace(mechanism, rows=many_rows())},
    "typo": {"discover": typo},
    "compared": {"compare": single},
    "curved": {"discover": curved},
    "refuted": {"discover": with_adoption(single, refuted), "adopt": refuted},
    "compared_again": {"discover": adopted, "adopt": adopted, "compare": single},
    "unlisted": {"discover": replace(mechanism, effects={})},
}


@pytest.fixture(scope="module")
def pages(tmp_path_factory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("pages")
    voc = replace(VOC, study=str(HOME / "lab.toml"), results=str(HOME / VOC.results))
    files = {name: folder / f"{name}.html" for name in PAGES}
    for name, records in PAGES.items():
        files[name].write_text(render_template(TEMPLATE, answer_page("Heaps", records, voc)), "utf-8")
    return files


def lead(page: Path) -> list[str]:
    return [unescape(text) for text in re.findall('<p class="lead">(.*?)</p>', page.read_text("utf-8"))]


def test_a_page_stands_alone_with_missing_holding_and_next_in_this_order_and_the_method_last(pages):
    for page in pages.values():
        titles = re.findall("<h2>(.*?)</h2>", page.read_text("utf-8"))
        assert titles == ["What is missing", "Does it hold", "What next", "Methods"]
        method = page.read_text("utf-8").partition("<h2>Methods</h2>")[2]
        assert method.count("<p>") == 4
        assert "&tau;<sub>b</sub>" in method
        text = page.read_text("utf-8")
        assert str(HOME) not in text, "no folder of the machine"
        assert str(page.parent) not in text
        assert not re.search(r'(?:src|href)="(?!#|data:)', text), "no other file"
        assert not re.search(r"\bnan\b", text)


def test_every_figure_that_the_record_allows_is_there(pages):
    def drawn(name: str) -> set[str]:
        return set(re.findall(r'id="([a-z]+)\d*-figure_1"', pages[name].read_text("utf-8")))

    assert drawn("law") == {"rows", "posterior", "strengths", "doses", "ladder", "numbers"}
    assert drawn("adopted") == {"rows", "posterior", "strengths", "ladder", "numbers"}
    assert drawn("typo") == {"rows", "posterior", "strengths", "numbers"}
    assert drawn("curved") == {"rows", "curves", "posterior", "strengths", "ladder", "numbers"}
    assert drawn("compared") == {"rows", "ladder", "numbers"}
    assert "strengths" not in drawn("unlisted")


def test_headline_and_marked_rows_of_the_table_name_the_same(pages):
    known = {*null.effects, "rolling_friction", "contact_pull"}
    for name, acts in (("adopted", 1), ("group", 2), ("law", 1), ("typo", 0), ("refuted", 0)):
        text = pages[name].read_text("utf-8")
        marked = set(re.findall(r'<tr class="named"><td[^>]*>(\w+)<', text))
        said = next(iter(re.findall("Missing: .*", text)), "")
        assert marked == {each for each in known if each in said}
        assert len(marked) == acts
    assert "(moisture / 5 %)^1.2" in lead(pages["law"])[0]


def test_the_headline_is_that_of_the_last_command(pages):
    leads = {"adopted": "The error falls", "refuted": "The model is no better with liquid_bridge"}
    leads |= {"compared_again": "The calibrated model fails", "curved": "Missing: something not in the list"}
    assert all(lead(pages[name])[0].startswith(words) for name, words in leads.items())
    assert "Missing" not in pages["refuted"].read_text("utf-8")


def test_every_row_tells_what_was_measured_and_what_both_models_say(pages):
    rows = re.findall(r"<title>measured (.*?)</title>", pages["law"].read_text("utf-8"), re.DOTALL)
    told = {unescape(row) for row in rows if row.startswith("400 deg")}
    assert told
    for row in told:
        assert "the model as it is: 33 deg\nwith rolling_friction: 33.5 deg\nmoisture = 0.889 %" in row


def test_a_browser_shows_every_page_on_a_desk_and_on_a_phone(pages, tmp_path):
    assert_readable(pages, tmp_path)


def test_limits_are_marked_by_the_side_on_which_the_value_lies():
    limit = ["below", "", "above", "between", "", ""]
    points = pd.DataFrame({"measured": [20.0, 22.0, 25.0, 27.0, 30.0, 33.0], "limit": limit})
    found = {kind: own["measured"].to_list() for kind, own in rows_by_mark(points)}
    assert found == {"": [22.0, 30.0, 33.0], "below": [20.0], "above": [25.0], "between": [27.0]}
    assert list(found)[-1] == ""  # drawn last, above the others
