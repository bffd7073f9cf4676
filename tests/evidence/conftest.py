"""An analysis that several tests look into; it takes seconds and is made once."""

import pytest

from taichi_erosion.evidence.answers.commands import open_study
from taichi_erosion.evidence.inference.pipeline import Analysis, analyse
from taichi_erosion.evidence.inference.prepared_problem import prepare
from tests.evidence.small_study import write_study


@pytest.fixture(scope="session")
def wet(tmp_path_factory) -> Analysis:
    """A study in whose world liquid bridges act."""
    with open_study(write_study(tmp_path_factory.mktemp("wet"), {"liquid_bridge": 1.0})) as study:
        return analyse(prepare(study.problem, study.problem.visible(), 1), 1, lambda stage, share: None)
