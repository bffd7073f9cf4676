"""The table of all claims."""

import pytest

from doe.common.pages import MARKED
from taichi_erosion.verification.claims import Outcome, as_claim
from tests.verification.page import PAGE, claim_rows, renewed

pytestmark = pytest.mark.docs


def test_claims_that_differ_in_a_number_share_a_row_unless_they_fail() -> None:
    got = {"a | b of 1 mm": 1.0, "a | b of 2 mm": 1.05, "a | b of 3 mm": 2.0}
    claims = [as_claim("V01", Outcome(claim, value, 1.0, 0.1, "f64"), 0.5) for claim, value in got.items()]
    assert claim_rows(claims) == [
        r"| V01 | a \| b of 2 mm | 2 | 1.05 | 1 | 0.1 | yes |",
        r"| V01 | a \| b of 3 mm | 1 | 2 | 1 | 0.1 | **NO** |",
    ]


def test_a_renewed_table_keeps_the_rows_of_other_checks() -> None:
    (mark,) = MARKED.finditer(PAGE.read_text(encoding="utf-8"))
    assert renewed(mark["table"], []) == mark["table"]
