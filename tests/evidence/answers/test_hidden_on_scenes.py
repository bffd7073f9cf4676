"""Hidden effects in the simulator itself: another process makes the data, commands alone find what acts.

The laboratories differ from the models in seeds, and some in time step, packing and friction: grains that
stick when moist, and heaps in which nothing acts. Two more list nothing that water does: grains that stick
when wet, whose mechanism becomes an effect of its own, and a null. The truth is drawn and its digest written
before anything is measured; it is opened at the end only. Marked slow: in every run of the gates a stand-in
for the simulator goes the same way through the commands (test_training_runs.py). A grain that falls is in
tests/docs/test_own_effect_walk.py.
"""

import json
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from hashlib import sha256
from pathlib import Path

import pytest

from taichi_erosion.cli.main import main
from taichi_erosion.evidence.models.load_study import StudyOptions
from tests.evidence.asking import SILENT, ask
from tests.evidence.laboratories import HIDDEN, SEEDS

ROOT = Path(__file__).parents[3]
QUICK = StudyOptions(budget="quick", workers=1)  # a second worker would compile the same kernels again
MANY = StudyOptions(budget="quick")  # on all workers
pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def study_of(tmp_path_factory) -> Callable[[str], Path]:

    @cache
    def made(names: tuple[str, ...]) -> Path:
        folder = tmp_path_factory.mktemp("laboratory")
        order = [sys.executable, "-m", "tests.evidence.laboratories", str(folder), *names]
        subprocess.run(order, cwd=ROOT, check=True, timeout=1200.0)
        return folder

    return lambda name: made(next(names for names in SEEDS if name in names)) / f"{name}.toml"


def truth_of(study: Path) -> float:
    sealed = (study.parent / "sealed" / "truth.json").read_text("utf-8")
    assert sha256(sealed.encode()).hexdigest() == (study.parent / "truth.sha256").read_text("utf-8")
    return json.loads(sealed)["strengths"][study.stem]


def test_a_hidden_effect_is_found_named_and_adopted(study_of):
    study = study_of("heap_moist")
    discovered = ask("discover", study, options=QUICK).record
    compared = ask("compare", study, options=QUICK).record
    assert compared.p_misfit < 0.01
    assert "moisture" in {place.axis for place in compared.where if place.p_as_stated < 0.05}
    assert discovered.named == (HIDDEN,)

    adopted = ask("adopt", study, HIDDEN, options=QUICK).record
    held = adopted.vault
    assert held.chi2_per_row_after < 0.5 * held.chi2_per_row_before
    assert held.chi2_per_row_wrong_effect > 2.0 * held.chi2_per_row_after

    fitted = adopted.effects[HIDDEN].strength_range
    half = 0.5 * (fitted.high - fitted.low)
    # the laboratory's other packing and time step move a heap too: five half-widths, not three
    assert abs(fitted.value - truth_of(study)) < 5.0 * half


@pytest.mark.parametrize("name", ["heap_plain", "plain"])
def test_a_null_stays_a_null_and_no_mechanism_is_asked_for(study_of, name):
    study = study_of(name)
    discovered = ask("discover", study, options=MANY if name == "plain" else QUICK).record
    assert discovered.verdict in SILENT
    assert discovered.named == ()
    assert discovered.law is None
    if name == "heap_plain":
        assert ask("compare", study, options=QUICK).record.p_misfit > 0.01
    assert truth_of(study) == 0.0


def test_a_pull_that_no_list_holds_is_found_and_adopted(study_of, monkeypatch):
    study = study_of("wet")
    monkeypatch.chdir(study.parent)
    found = ask("discover", study, options=MANY).record
    assert (found.verdict, found.acting_mechanisms[0]) == ("outside_library", "contact_pull")
    doses = {each.conditions["moisture"]: each.dose for each in found.mechanisms["contact_pull"].doses}
    assert doses[max(doses)] > doses[min(doses)]
    results = str(study.parent / "wet-results" / "wet.discover.json")
    assert main(["effects", "new", "sticky", "--from-discovery", results]) == 0
    own = replace(MANY, effect_files=(study.parent / "sticky.py",))
    held = ask("adopt", study, "sticky", options=own).record.vault
    assert held.chi2_per_row_after < 0.5 * held.chi2_per_row_before
    assert truth_of(study) > 1.0
