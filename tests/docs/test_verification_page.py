"""The verification page: its table of claims, and how many hold."""

from pathlib import Path

import pytest

from docs.build import count
from docs.verification_curves import markdown_table
from taichi_erosion.verification.claim import Outcome, as_claim

pytestmark = pytest.mark.docs
DOCS = Path(__file__).resolve().parents[2] / "docs"


def test_the_table_shows_of_two_precisions_the_outcome_nearer_to_its_tolerance() -> None:
    outcomes = (Outcome("a | b", 1.0, 1.0, 0.1, "f64"), Outcome("a | b", 1.05, 1.0, 0.1, "f32"))
    failed = as_claim("V02", Outcome("late", 2.0, 1.0, 0.1, "f32"), 0.5)
    table = markdown_table([*(as_claim("V01", each, 0.5) for each in outcomes), failed]).splitlines()
    assert table[2:] == [r"| V01 | a \| b | 1.05 | 1 | 0.1 | yes |", "| V02 | late | 2 | 1 | 0.1 | **NO** |"]
    assert "1 of 2 claims hold" in count(table)


def test_the_page_counts_the_rows_of_its_table() -> None:
    text = (DOCS / "verification.md").read_text(encoding="utf-8")
    assert count(text.splitlines()) in text
