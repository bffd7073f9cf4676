"""The verification page: its table of claims, and how many hold."""

from pathlib import Path

import pytest

from docs.build import count
from docs.verification_curves import markdown_table
from taichi_erosion.verification.claims import Outcome, as_claim

pytestmark = pytest.mark.docs
DOCS = Path(__file__).resolve().parents[2] / "docs"


def test_claims_that_differ_in_a_number_share_a_row_unless_they_fail() -> None:
    got = {"a | b of 1 mm": 1.0, "a | b of 2 mm": 1.05, "a | b of 3 mm": 2.0}
    claims = [as_claim("V01", Outcome(claim, value, 1.0, 0.1, "f64"), 0.5) for claim, value in got.items()]
    table = markdown_table(claims).splitlines()
    assert table[2:] == [
        r"| V01 | a \| b of 2 mm | 2 | 1.05 | 1 | 0.1 | yes |",
        r"| V01 | a \| b of 3 mm | 1 | 2 | 1 | 0.1 | **NO** |",
    ]
    assert "2 of 3 outcomes hold" in count(table)


def test_the_page_counts_the_rows_of_its_table() -> None:
    text = (DOCS / "verification.md").read_text(encoding="utf-8")
    assert count(text.splitlines()) in text
