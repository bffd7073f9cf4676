"""Blind cases on the closed-form model: another process makes the data, commands alone find what it hid.

The truth is drawn and its digest written before the first command runs; it is opened at the end only.
"""

import json
import subprocess
import sys
from hashlib import sha256
from pathlib import Path

import pytest

from taichi_erosion.cli.main import main
from tests.evidence.small_study import study_text

ROOT = Path(__file__).parents[3]
MAKER = """
import json, random, sys
from hashlib import sha256
from pathlib import Path
from tests.evidence.small_study import DRY, MOIST, table_text
folder, kind, seed = Path(sys.argv[1]), sys.argv[2], int(sys.argv[3])
drawn = random.Random(seed)
hidden = {"moist": ["liquid_bridge"], "fine": ["dry_cohesion"], "null": []}[kind]
truth = {name: drawn.uniform(0.8, 1.5) for name in hidden}
sealed = json.dumps({"effects": truth, "salt": drawn.random()})
(folder / "truth.sha256").write_text(sha256(sealed.encode()).hexdigest())
(folder / "heap.csv").write_text(table_text(truth, seed, DRY if kind == "fine" else MOIST))
(folder / "sealed").mkdir()
(folder / "sealed" / "truth.json").write_text(sealed)
"""


def blind_study(folder: Path, kind: str, seed: int) -> Path:
    """Study on a table that another process has made."""
    words = [sys.executable, "-c", MAKER, str(folder), kind, str(seed)]
    subprocess.run(words, cwd=ROOT, check=True, timeout=600.0)
    path = folder / "heap.toml"
    path.write_text(study_text(), encoding="utf-8")
    return path


def ask(capsys, *words: str) -> dict:
    capsys.readouterr()
    assert main([*words, "--json"]) == 0
    return json.loads(capsys.readouterr().out)


def opened_truth(folder: Path) -> dict[str, float]:
    sealed = (folder / "sealed" / "truth.json").read_text("utf-8")
    assert sha256(sealed.encode()).hexdigest() == (folder / "truth.sha256").read_text("utf-8")
    return json.loads(sealed)["effects"]


@pytest.mark.parametrize(("kind", "axis"), [("moist", "moisture"), ("fine", "diameter")])
def test_a_hidden_effect_is_found_named_and_adopted(tmp_path, capsys, kind, axis):
    path = blind_study(tmp_path, kind, seed=20)
    compared = ask(capsys, "compare", str(path))
    assert compared["p"] < 0.01
    assert axis in {place["axis"] for place in compared["where"] if place["p"] < 0.05}

    found = ask(capsys, "discover", str(path))
    assert found["verdict"] in ("present", "group")
    (name,) = found["named"] or found["group"]

    adopted = ask(capsys, "adopt", str(path), name)
    vault = adopted["vault"]
    assert vault["chi2_after"] < 0.5 * vault["chi2_before"]
    # a wrong effect with a free strength may gain a little by chance, not half of the error
    assert vault["chi2_wrong_effect"] > 0.5 * vault["chi2_before"]

    truth = opened_truth(tmp_path)
    assert list(truth) == [name]
    fitted = adopted["added"]["strengths"][name]
    # the 90 % interval misses one time in ten; three times its half-width misses once in a million
    half = 0.5 * (fitted["high"] - fitted["low"])
    assert abs(fitted["value"] - truth[name]) < 3.0 * half
    # three repeats at sixteen settings fix a strength of 1.4 to 0.09; an interval that holds anything is none
    assert half < 0.15


@pytest.mark.parametrize("seed", [20, 21])
def test_a_null_stays_a_null(tmp_path, capsys, seed):
    path = blind_study(tmp_path, "null", seed)
    assert ask(capsys, "compare", str(path))["p"] > 0.01
    found = ask(capsys, "discover", str(path))
    assert found["verdict"] in ("none_detected", "not_testable")
    assert found["named"] == []
    assert opened_truth(tmp_path) == {}
