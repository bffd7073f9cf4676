"""Hidden effects in the simulator itself: another process makes the data, commands alone find what acts.

The laboratories differ from the models in seeds, time step, packing and friction. Three studies: grains that
stick when moist, grains that fall through thinner air, and heaps in which nothing acts. The truth is drawn
and its digest written before anything is measured; it is opened at the end only. Marked slow: in every run of
the gates a stand-in for the simulator goes the same way through the commands (test_training_runs.py).
"""

import json
import subprocess
import sys
from collections.abc import Callable
from functools import cache
from hashlib import sha256
from pathlib import Path

import pytest

from taichi_erosion.evidence.models.load_study import StudyOptions
from taichi_erosion.evidence.race.record import Record
from tests.evidence.asking import SILENT, ask
from tests.evidence.small_scenes import HEAPS, HIDDEN

ROOT = Path(__file__).parents[3]
SEED = 7
QUICK = StudyOptions(budget="quick", workers=1)  # a second worker would compile the same kernels again
pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def laboratory(tmp_path_factory) -> Callable[[str], Path]:
    """Folder of a study whose table another process has made; the heap studies share one."""

    @cache
    def made(names: tuple[str, ...]) -> Path:
        folder = tmp_path_factory.mktemp("laboratory")
        words = [sys.executable, "-m", "tests.evidence.small_scenes", str(folder), str(SEED), *names]
        subprocess.run(words, cwd=ROOT, check=True, timeout=1200.0)
        return folder

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
