"""What a discovery says in sentences."""

from dataclasses import replace

import pytest

from taichi_erosion.evidence.autopsy import Autopsy, autopsy
from taichi_erosion.evidence.discover import worded
from taichi_erosion.evidence.examination import examine
from taichi_erosion.evidence.loop import opened
from tests.evidence.small_study import write_study

FAILS = "Even with liquid_bridge the model fails"
SEED = 1


@pytest.fixture(scope="module")
def wet(tmp_path_factory) -> Autopsy:
    """A study in whose world liquid bridges act."""
    with opened(write_study(tmp_path_factory.mktemp("wet"), {"liquid_bridge": 1.0})) as study:
        return autopsy(examine(study.problem, study.problem.visible(), SEED), SEED, lambda stage, share: None)


def test_a_name_that_describes_the_measurements_stands_without_a_warning(wet):
    assert wet.decision.named == ("liquid_bridge",)
    assert wet.p_misfit < 1e-6 < 0.01 < wet.p_misfit_after
    assert not any(FAILS in sentence for sentence in worded(wet, SEED, 0.0).sentences)


def test_a_name_that_leaves_a_misfit_is_told_with_it(wet):
    left = worded(replace(wet, p_misfit_after=1e-4), SEED, 0.0)
    assert left.p_misfit_after == 1e-4
    assert left.sentences[1].startswith(f"{FAILS} (p = 0.0001)")


def test_without_a_name_there_is_nothing_that_could_fail(wet):
    bare = worded(replace(wet, final=wet.base, p_misfit_after=1e-4), SEED, 0.0)
    assert not any("Even with" in sentence for sentence in bare.sentences)
