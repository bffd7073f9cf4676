"""Every claim of the checks that take seconds; those that pour heaps or drain silos are marked slow."""

from math import nan

import pytest

from taichi_erosion.core.errors import BadInput
from taichi_erosion.verification.claim import Claim, Outcome, as_claim
from taichi_erosion.verification.claims import CHECKS, verify

SLOW = {f"V{k}" for k in (11, 14, 15, 16, 17, 20, 21, 22, 23, 24, 25, 26, 27, 28, 29, 31, 32, 33, 34, 36, 38)}


@pytest.mark.parametrize(
    "ident", [pytest.param(i, marks=pytest.mark.slow if i in SLOW else ()) for i in CHECKS]
)
def test_every_claim_of_a_check_holds(ident: str) -> None:
    failed = [
        f"{c.claim}: got {c.got:.6g}, want {c.want:.6g} +- {c.tolerance:.2g} ({c.precision})"
        for c in verify([ident])
        if not c.passed
    ]
    assert not failed, "\n".join(failed)


def test_every_numbered_check_is_there() -> None:
    assert list(CHECKS) == [f"V{k:02d}" for k in (*range(1, 35), 36, 37, 38)]


def test_an_unknown_check_is_refused_by_name() -> None:
    with pytest.raises(BadInput, match="V99"):
        verify(["V01", "V99"])


def test_a_result_that_is_not_a_number_fails_its_claim() -> None:
    assert not as_claim("V01", Outcome("falls", nan, 0.0, 1.0, "f64"), 0.0).passed


def test_a_result_at_its_tolerance_passes_and_beyond_it_fails() -> None:
    assert as_claim("V01", Outcome("falls", 1.5, 1.0, 0.5, "f64"), 0.0).passed
    assert not as_claim("V01", Outcome("falls", 1.51, 1.0, 0.5, "f64"), 0.0).passed


def test_a_check_that_breaks_is_a_claim_that_fails_and_says_why(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken():
        yield Outcome("first", 0.0, 0.0, 0.0, "f64")
        raise ValueError("spheres were cubes")

    monkeypatch.setitem(CHECKS, "V01", broken)
    seen: list[Claim] = []
    first, second = verify(["V01"], seen.append)
    assert seen == [first, second]
    assert first.passed
    assert not second.passed
    assert "spheres were cubes" in second.claim
