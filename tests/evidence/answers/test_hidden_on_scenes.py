"""Hidden effects in the simulator itself: another process makes the data, commands alone find what acts.

The laboratories differ from the models in seeds, time step, packing and friction. Three studies: grains that
stick when moist, grains that fall through thinner air, and heaps in which nothing acts. The truth is drawn
and its digest written before anything is measured; it is opened at the end only.
"""

import json
import subprocess
import sys
from contextlib import redirect_stdout
from hashlib import sha256
from io import StringIO
from pathlib import Path

import pytest

from taichi_erosion.cli.main import main
from tests.evidence.small_scenes import HIDDEN, STUDIES

ROOT = Path(__file__).parents[3]
SEED = 7


def ask(*words: str) -> dict:
    told = StringIO()
    with redirect_stdout(told):
        assert main([*words, "--json"]) == 0
    return json.loads(told.getvalue())


@pytest.fixture(scope="module")
def laboratory(tmp_path_factory) -> Path:
    """Folder of studies whose tables another process has made."""
    folder = tmp_path_factory.mktemp("laboratory")
    words = [sys.executable, "-m", "tests.evidence.small_scenes", str(folder), str(SEED)]
    subprocess.run(words, cwd=ROOT, check=True, timeout=1200.0)
    return folder


@pytest.fixture(scope="module")
def found(laboratory) -> dict[str, dict]:
    """What the commands say; all runs of a study are made by the first of them."""
    answers = {}
    for name in STUDIES:
        path = str(laboratory / f"{name}.toml")
        answers[name] = {
            "discover": ask("discover", path, "--budget", "quick"),
            "compare": ask("compare", path),
        }
    return answers


def truth_in(folder: Path) -> dict[str, float]:
    sealed = (folder / "sealed" / "truth.json").read_text("utf-8")
    assert sha256(sealed.encode()).hexdigest() == (folder / "truth.sha256").read_text("utf-8")
    return json.loads(sealed)["strengths"]


@pytest.mark.parametrize(("name", "axis"), [("heap_moist", "moisture"), ("grain_high", "altitude")])
def test_a_hidden_effect_is_found_named_and_adopted(laboratory, found, name, axis):
    compared, discovered = found[name]["compare"], found[name]["discover"]
    assert compared["p"] < 0.01
    assert axis in {place["axis"] for place in compared["where"] if place["p"] < 0.05}
    assert (discovered["verdict"], discovered["named"]) == ("present", [HIDDEN[name]])

    adopted = ask("adopt", str(laboratory / f"{name}.toml"), discovered["named"][0])
    vault = adopted["vault"]
    assert vault["chi2_after"] < 0.5 * vault["chi2_before"]
    assert vault["chi2_wrong_effect"] > 2.0 * vault["chi2_after"]

    fitted = adopted["added"]["strengths"][HIDDEN[name]]
    half = 0.5 * (fitted["high"] - fitted["low"])
    # the laboratory's other packing and time step move a heap too: five half-widths, not three
    assert abs(fitted["value"] - truth_in(laboratory)[name]) < 5.0 * half


def test_a_null_stays_a_null(laboratory, found):
    assert found["heap_plain"]["compare"]["p"] > 0.01
    assert found["heap_plain"]["discover"]["verdict"] in ("none_detected", "not_testable")
    assert found["heap_plain"]["discover"]["named"] == []
    assert truth_in(laboratory)["heap_plain"] == 0.0
