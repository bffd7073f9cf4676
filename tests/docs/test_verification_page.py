"""The table of claims on the verification page."""

from dataclasses import fields

import pytest

from docs.verification_curves import markdown_table
from taichi_erosion.verification.claims import Claim, Outcome, as_claim

pytestmark = pytest.mark.docs


def test_the_table_shows_a_failing_claim_as_failing() -> None:
    claims = [
        as_claim("V01", Outcome("a | b", 1.0, 1.0, 0.1, "f64"), 0.5),
        as_claim("V02", Outcome("late", 2.0, 1.0, 0.1, "f32"), 0.5),
    ]
    table = markdown_table(claims)
    assert "**NO**" in table
    assert "a \\| b" in table
    assert "1 of 2 claims hold; 1 s." in table
    assert all(
        len(fields(Claim)) + 1 == line.replace("\\|", "").count("|") for line in table.splitlines()[:4]
    )
