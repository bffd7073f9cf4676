"""Sentences on mechanisms: what is told as one member of a group."""

from math import nan

from taichi_erosion.evidence.answers.finding_sentences import mechanism_sentences
from taichi_erosion.evidence.data.mechanism_findings import OF, BeyondList, MechanismFinding, told_members


def finding(name: str) -> MechanismFinding:
    kind, _, observable = name.partition(OF)
    title = f"a {kind}" + (f" of {observable}" if observable else "")
    numbers = {"log_bayes_factor": 9.0, "odds": 1.0, "p_left": 0.5, "p_one_dose": nan, "curvature": 0.0}
    return MechanismFinding(
        name, title, "", observable, moves=("flux",), axis="moisture", explains=True, **numbers
    )


def beyond(*names: str) -> BeyondList:
    verdict = "mechanism" if len(names) == 1 else "group"
    return BeyondList(verdict, tuple(map(finding, names)), names, 0.0, 0.0, "", (), None)


def test_gain_and_offset_of_one_instrument_are_told_as_one():
    names = ("reading_gain:flux", "reading_offset:flux")
    assert told_members(names) == ("instrument:flux",)
    (only,) = mechanism_sentences(beyond(*names))
    assert only.startswith("The misfit is consistent with")
    assert "a gain or an offset of the instrument of flux" in only


def test_instruments_of_two_observables_are_two_members():
    names = ("drag", "reading_gain:flux", "reading_offset:height", "reading_offset:flux")
    assert told_members(names) == ("drag", "instrument:flux", "reading_offset:height")
    words = " ".join(mechanism_sentences(beyond(*names)))
    assert "a gain or an offset of the instrument of flux or a reading_offset of height" in words


def test_a_lone_gain_keeps_its_own_title():
    (only,) = mechanism_sentences(beyond("reading_gain:flux"))
    assert "a reading_gain of flux" in only
