"""A mechanism beyond the list in the simulator itself: found, written as a file and adopted; one null.

Another process makes the tables: its grains stick when wet, and the study lists nothing that does. The truth
is drawn and its digest written before anything is measured; it is opened at the end only. Marked slow: some
hundred runs of half a second each.
"""

import json
import subprocess
import sys
from dataclasses import replace
from hashlib import sha256
from pathlib import Path

import pytest

from taichi_erosion.cli.main import main
from taichi_erosion.evidence.models.load_study import StudyOptions
from tests.evidence.asking import SILENT, ask

ROOT = Path(__file__).parents[3]
SEED = 3
QUICK = StudyOptions(budget="quick")
pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def laboratory(tmp_path_factory) -> Path:
    """Folder of two studies whose tables another process has made."""
    folder = tmp_path_factory.mktemp("laboratory")
    words = [sys.executable, "-m", "tests.evidence.wet_laboratory", str(folder), str(SEED)]
    subprocess.run(words, cwd=ROOT, check=True, timeout=1200.0)
    return folder


def strengths_in(folder: Path) -> dict[str, float]:
    sealed = (folder / "sealed" / "truth.json").read_text("utf-8")
    assert sha256(sealed.encode()).hexdigest() == (folder / "truth.sha256").read_text("utf-8")
    return json.loads(sealed)["strengths"]


def test_a_pull_that_no_list_holds_is_found_and_adopted(laboratory, monkeypatch):
    monkeypatch.chdir(laboratory)
    wet = laboratory / "wet.toml"
    found = ask("discover", wet, options=QUICK).record
    assert found.decided.verdict == "outside_library"
    assert found.decided.mechanisms[0] == "contact_pull"
    assert found.law is not None
    doses = {at["moisture"]: dose.value for at, dose in found.law.doses}
    assert doses[max(doses)] > doses[min(doses)]
    results = str(laboratory / "wet-results" / "wet.discover.json")
    assert main(["effects", "new", "sticky", "--from-discovery", results]) == 0
    own = replace(QUICK, effect_files=(laboratory / "sticky.py",))
    held = ask("adopt", wet, "sticky", options=own).record.held_out
    assert held is not None
    assert held.after < 0.5 * held.before
    assert strengths_in(laboratory)["wet"] > 1.0


def test_in_a_null_no_mechanism_is_asked_for(laboratory):
    found = ask("discover", laboratory / "plain.toml", options=QUICK).record
    assert found.decided.verdict in SILENT
    assert found.law is None
    assert strengths_in(laboratory)["plain"] == 0.0
