"""Every claim of the checks; one of each kind of physics that takes seconds, the others are marked slow."""

import json
from dataclasses import replace
from math import nan

import pytest

from doe.common.pages import MARKED
from taichi_erosion.cli import commands
from taichi_erosion.cli.main import main
from taichi_erosion.verification import closed_forms
from taichi_erosion.verification.claims import Claim, Ladder, Outcome, as_claim, verify_claims
from tests.verification.ladder import CHECKS, KNOWN, LADDER, is_known
from tests.verification.page import PAGE, claim_rows, renewed

# normal and oblique impacts; free fall is part of both
BRIEF = {"V04", "V05"}


@pytest.mark.parametrize(
    "ident", [pytest.param(i, marks=() if i in BRIEF else pytest.mark.slow) for i in CHECKS]
)
def test_every_claim_of_a_check_holds_or_is_known_to_fail(ident: str) -> None:
    broken = [c for c in verify_claims(LADDER, [ident]) if not c.passed and not is_known(c)]
    told = "{0.claim}: got {0.got:.6g}, want {0.want:.6g} +- {0.tolerance:.2g} ({0.precision})"
    failed = [told.format(claim) for claim in broken]
    assert not failed, "\n".join(failed)


def test_every_numbered_check_is_there() -> None:
    assert list(CHECKS) == [f"V{k:02d}" for k in (*range(1, 21), 22, 23, *range(25, 35), *range(36, 40))]
    assert closed_forms.LADDER.checks.keys() <= CHECKS.keys()


def test_an_installed_program_names_its_short_list_and_where_the_rest_is(monkeypatch, tmp_path, capsys):
    monkeypatch.setattr(commands, "ROOT", tmp_path)
    assert main(["verify", "V01"]) == 2
    assert (f"V01 is unknown; choose from {', '.join(closed_forms.LADDER.checks)}") in capsys.readouterr().err
    assert main(["bench"]) == 2
    assert "in the source tree" in capsys.readouterr().err


@pytest.mark.parametrize(("got", "passed"), [(1.5, True), (1.51, False), (nan, False)])
def test_a_result_within_its_tolerance_passes(got: float, passed: bool) -> None:
    assert as_claim("V01", Outcome("falls", got, 1.0, 0.5, "f64"), 0.0).passed == passed


def test_a_check_that_breaks_is_a_claim_that_fails_and_says_why() -> None:
    def broken():
        yield Outcome("first", 0.0, 0.0, 0.0, "f64")
        raise ValueError("spheres were cubes")

    seen: list[Claim] = []
    first, second = verify_claims(Ladder({"V01": broken}), on_claim=seen.append)
    assert seen == [first, second]
    assert (first.passed, second.passed) == (True, False)
    assert "spheres were cubes" in second.claim


HOLES = Claim("Beverloo, round holes of 6 d: exponent", 2.64, 2.5, 0.1, "f32", "V33", False, 1.0)


def test_a_failure_is_known_as_far_as_it_was_found() -> None:
    assert is_known(HOLES)
    assert not is_known(replace(HOLES, got=2.9)), "worse than was found"
    assert not is_known(replace(HOLES, got=nan))
    assert not is_known(replace(HOLES, id="V01"))


def test_failed_rows_of_the_page_are_the_known_failures_and_have_a_reason() -> None:
    text = PAGE.read_text("utf-8")
    failed = [line for line in text.splitlines() if "**NO**" in line]
    expected = [[row for row in failed if f"| {known.id} |" in row and known.words in row] for known in KNOWN]
    assert all(expected)
    assert set().union(*expected) == set(failed)
    assert all(known.id in text.partition("## What does not ")[2] for known in KNOWN)


def test_known_failures_leave_exit_code_0_unless_strict(monkeypatch, capsys) -> None:
    holes = Outcome(HOLES.claim, HOLES.got, HOLES.want, HOLES.tolerance, "f32")
    monkeypatch.setitem(CHECKS, "V33", lambda: iter([holes]))
    assert main(["verify", "V33"]) == 0
    assert "note: 1 of those that fail are known to" in capsys.readouterr().out
    assert main(["verify", "V33", "--json"]) == 0
    (claim,) = json.loads(capsys.readouterr().out)["claims"]
    assert (claim["passed"], claim["known_failure"]) == (False, True)
    assert main(["verify", "V33", "--strict"]) == 1


@pytest.mark.docs
def test_claims_that_differ_in_a_number_share_a_row_unless_they_fail() -> None:
    got = {"a | b of 1 mm": 1.0, "a | b of 2 mm": 1.05, "a | b of 3 mm": 2.0}
    claims = [as_claim("V01", Outcome(claim, value, 1.0, 0.1, "f64"), 0.5) for claim, value in got.items()]
    first = r"| V01 | a \| b of 2 mm | 2 | 1.05 | 1 | 0.1 | yes |"
    assert claim_rows(claims) == [first, r"| V01 | a \| b of 3 mm | 1 | 2 | 1 | 0.1 | **NO** |"]


@pytest.mark.docs
def test_a_renewed_table_keeps_the_rows_of_other_checks() -> None:
    (mark,) = MARKED.finditer(PAGE.read_text(encoding="utf-8"))
    assert renewed(mark["table"], []) == mark["table"]
