"""Hidden effects in the simulator itself: another process makes the data, commands alone find what acts.

The laboratories differ from the models in seeds, time step, packing and friction. Three studies: grains that
stick when moist, grains that fall through thinner air, and heaps in which nothing acts. Two more list nothing
that water does: grains that stick when wet, whose mechanism becomes an effect of its own, and a null. The
truth is drawn and its digest written before anything is measured; it is opened at the end only. Marked slow:
in every run of the gates a stand-in for the simulator goes the same way through the commands
(test_training_runs.py).
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
from taichi_erosion.evidence.race.record import Record
from tests.evidence.asking import SILENT, ask
from tests.evidence.small_scenes import HEAPS, HIDDEN

ROOT = Path(__file__).parents[3]
SEED, WET_SEED = 7, 3
QUICK = StudyOptions(budget="quick", workers=1)  # a second worker would compile the same kernels again
MANY = StudyOptions(budget="quick")  # on all workers
pytestmark = pytest.mark.slow


def run_laboratory(name: str, folder: Path, *words: str) -> Path:
    """The folder into which another process has put studies and their tables."""
    order = [sys.executable, "-m", f"tests.evidence.{name}", str(folder), *words]
    subprocess.run(order, cwd=ROOT, check=True, timeout=1200.0)
    return folder


@pytest.fixture(scope="module")
def laboratory(tmp_path_factory) -> Callable[[str], Path]:
    """Folder of a study whose table another process has made; the heap studies share one."""

    @cache
    def made(names: tuple[str, ...]) -> Path:
        return run_laboratory("small_scenes", tmp_path_factory.mktemp("laboratory"), str(SEED), *names)

    return lambda name: made(HEAPS if name in HEAPS else (name,))


@pytest.fixture(scope="module")
def found(laboratory) -> Callable[[str], tuple[Record, Record]]:
    """What the commands say of a study; all of its runs are made by the first of them."""

    @cache
    def answers(name: str) -> tuple[Record, Record]:
        path = laboratory(name) / f"{name}.toml"
        discovered = ask("discover", path, options=QUICK).record
        return ask("compare", path, options=QUICK).record, discovered

    return answers


def truth_in(folder: Path) -> dict[str, float]:
    sealed = (folder / "sealed" / "truth.json").read_text("utf-8")
    assert sha256(sealed.encode()).hexdigest() == (folder / "truth.sha256").read_text("utf-8")
    return json.loads(sealed)["strengths"]


@pytest.mark.parametrize(("name", "axis"), [("heap_moist", "moisture"), ("grain_high", "altitude")])
def test_a_hidden_effect_is_found_named_and_adopted(laboratory, found, name, axis):
    compared, discovered = found(name)
    assert compared.fit.p_before < 0.01
    assert axis in {place.axis for place in compared.where if place.p < 0.05}
    assert discovered.decided.named == (HIDDEN[name],)

    adopted = ask("adopt", laboratory(name) / f"{name}.toml", HIDDEN[name], options=QUICK).record
    held = adopted.held_out
    assert held.after < 0.5 * held.before
    assert held.wrong > 2.0 * held.after

    fitted = adopted.effects[HIDDEN[name]].strength
    half = 0.5 * (fitted.high - fitted.low)
    # the laboratory's other packing and time step move a heap too: five half-widths, not three
    assert abs(fitted.value - truth_in(laboratory(name))[name]) < 5.0 * half


def test_a_null_stays_a_null(laboratory, found):
    compared, discovered = found("heap_plain")
    assert compared.fit.p_before > 0.01
    assert discovered.decided.verdict in SILENT
    assert discovered.decided.named == ()
    assert truth_in(laboratory("heap_plain"))["heap_plain"] == 0.0


@pytest.fixture(scope="module")
def wet_laboratory(tmp_path_factory) -> Path:
    """Folder of the two studies that list nothing that water does."""
    return run_laboratory("wet_laboratory", tmp_path_factory.mktemp("laboratory"), str(WET_SEED))


def test_a_pull_that_no_list_holds_is_found_and_adopted(wet_laboratory, monkeypatch):
    monkeypatch.chdir(wet_laboratory)
    wet = wet_laboratory / "wet.toml"
    found = ask("discover", wet, options=MANY).record
    assert found.decided.verdict == "outside_library"
    assert found.decided.mechanisms[0] == "contact_pull"
    doses = {at["moisture"]: dose.value for at, dose in found.law.doses}
    assert doses[max(doses)] > doses[min(doses)]
    results = str(wet_laboratory / "wet-results" / "wet.discover.json")
    assert main(["effects", "new", "sticky", "--from-discovery", results]) == 0
    own = replace(MANY, effect_files=(wet_laboratory / "sticky.py",))
    held = ask("adopt", wet, "sticky", options=own).record.held_out
    assert held.after < 0.5 * held.before
    assert truth_in(wet_laboratory)["wet"] > 1.0


def test_in_a_null_no_mechanism_is_asked_for(wet_laboratory):
    found = ask("discover", wet_laboratory / "plain.toml", options=MANY).record
    assert found.decided.verdict in SILENT
    assert found.law is None
    assert truth_in(wet_laboratory)["plain"] == 0.0
