"""What a discovery says in sentences: made from the record alone."""

from dataclasses import replace

import pytest

from taichi_erosion.evidence.answers.discover import discovery_of
from taichi_erosion.evidence.answers.documents import RED_FLAG, discovery_sentences
from taichi_erosion.evidence.data.findings import NearestHypothesis, OpposedSign

FAILS = "Even with liquid_bridge the model fails"
SEED = 1


@pytest.fixture(scope="module")
def found(wet):
    return discovery_of(wet, SEED)


def test_a_name_that_describes_the_measurements_stands_without_a_warning(wet, found):
    assert wet.decision.named == ("liquid_bridge",)
    assert wet.p_misfit < 1e-6 < 0.01 < wet.p_misfit_after
    assert not any(FAILS in sentence for sentence in found.sentences)


def test_a_name_that_leaves_a_misfit_is_told_with_it(wet):
    left = discovery_of(replace(wet, p_misfit_after=1e-4), SEED)
    assert left.p_misfit_after == 1e-4
    assert left.sentences[1].startswith(f"{FAILS} (p = 0.0001)")


def test_without_a_name_there_is_nothing_that_could_fail(wet):
    bare = discovery_of(replace(wet, final=wet.fitted.base, p_misfit_after=1e-4), SEED)
    assert not any("Even with" in sentence for sentence in bare.sentences)


def test_a_made_up_effect_that_fits_best_is_told_beside_a_name(found):
    assert found.decoy_rank > 1
    assert RED_FLAG not in discovery_sentences(found)
    assert RED_FLAG in discovery_sentences(replace(found, decoy_rank=1))
    assert RED_FLAG not in discovery_sentences(replace(found, decoy_rank=1, named=()))


def test_a_named_effect_that_goes_against_its_source_is_told(found):
    odd = OpposedSign("liquid_bridge", "flux", -1, 3.0, "In this model liquid_bridge raises flux.")
    assert odd.sentence in discovery_sentences(replace(found, opposed=(odd,)))
    assert odd.sentence not in discovery_sentences(replace(found, opposed=(replace(odd, effect="gusts"),)))


def test_an_unstable_verdict_gives_no_name(found):
    (first, *_) = discovery_sentences(replace(found, verdict="unstable"))
    assert "no name is given; more seeds are needed" in first
    assert "liquid_bridge" not in first


def test_as_many_numbers_as_rows_decide_nothing(found):
    (first, *_) = discovery_sentences(replace(found, n=3, calibrated=3))
    assert first.startswith("3 measured means of known scatter cannot decide where 3 numbers are calibrated")


def test_what_comes_closest_is_told_with_what_it_leaves(found):
    nearest = NearestHypothesis(("gusts", "saffman_lift"), 0.62, 1e-5)
    told = discovery_sentences(replace(found, verdict="outside_library", nearest=nearest))
    assert (
        "Of the list, gusts and saffman_lift comes closest: it takes away 62% of the misfit beyond chance "
        "(p = 1e-05 of what it leaves)." in told
    )


def test_a_group_of_one_effect_is_told_as_open_and_not_as_one_of_several(found):
    chances = {"liquid_bridge": 0.46, "none": 0.33, "outside_library": 0.2}
    alone = replace(found, verdict="group", named=(), group=("liquid_bridge",), probabilities=chances)
    assert (
        "liquid_bridge may be missing (probability 0.46); these measurements do not exclude that nothing is "
        "(probability 0.33) or something outside the list is (0.2)."
    ) in discovery_sentences(alone)


@pytest.mark.parametrize(("factor", "told"), [(1.04, False), (1.06, True)])
def test_a_scatter_that_is_as_stated_explains_nothing(found, factor, told):
    silent = replace(found, verdict="none_detected", named=(), p_misfit=1e-4, worst_row=None)
    sentences = " ".join(discovery_sentences(replace(silent, scatter_factor=factor)))
    assert "does not agree with the measurements" in sentences
    assert ("as large as stated would explain it" in sentences) == told
