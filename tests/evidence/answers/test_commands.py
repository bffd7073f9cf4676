"""The commands of the evidence loop as a shell sees them: documents, sentences, exit codes, files."""

import json
import re
import sqlite3
import subprocess
import sys
from contextlib import closing, redirect_stdout
from io import StringIO
from pathlib import Path
from time import monotonic, sleep

import pytest

from taichi_erosion.cli.main import main
from tests.evidence.small_study import LIBRARY, STUDY, study_text, table_text, write_study

PATIENCE = 600.0  # s; the cores may be busy
STATUSES = {"present", "excluded", "not_testable"}
NUMBERS = (
    "strength",
    "strength_low",
    "strength_high",
    "log_bayes_factor",
    "power",
    "absorption",
    "signature_norm",
)
EFFECT = dict.fromkeys(NUMBERS, float)
PLACE = {"observable": str, "axis": str, "p": float, "sentence": str}


@pytest.fixture(scope="module")
def wet(tmp_path_factory) -> Path:
    """A study in whose world liquid bridges act, examined once for all tests of this file."""
    return write_study(tmp_path_factory.mktemp("wet"), {"liquid_bridge": 1.0})


@pytest.fixture(scope="module")
def printed(wet) -> dict[str, str]:
    """What each command prints of it; `again`: the discovery after the vault was opened."""
    words = {"compare": (), "discover": (), "adopt": ("liquid_bridge",), "next": (), "again": ("--json",)}
    said = {}
    for name, others in words.items():
        with redirect_stdout(StringIO()) as told:
            assert main(["discover" if name == "again" else name, str(wet), *others]) == 0
        said[name] = told.getvalue()
    return said


def document(capsys, *words: str) -> dict:
    capsys.readouterr()
    assert main([*words, "--json"]) == 0
    return strict(capsys.readouterr().out)


def strict(text: str) -> dict:
    return json.loads(text, parse_constant=lambda name: pytest.fail(f"{name} is not JSON"))


def check(record: dict, kinds: dict[str, type]) -> None:
    for key, kind in kinds.items():
        value = record[key]
        assert value is None or isinstance(value, (kind, int) if kind is float else kind), (key, value)


def test_the_document_of_compare_holds_what_was_promised(wet, capsys):
    found = document(capsys, "compare", str(wet))
    assert set(found["observables"]) == {"repose_angle", "threshold_u_star"}
    for misfit in found["observables"].values():
        check(misfit, {"n": int, "chi2": float, "rmse": float, "bias": float, "p": float})
    for place in found["where"]:
        check(place, PLACE)
    check(found, {"chi2": float, "dof": float, "p": float, "noise": dict})
    assert found["p"] < 1e-6


def test_the_document_of_discover_holds_what_was_promised(printed):
    found = strict(printed["again"])
    assert (found["verdict"], found["named"]) == ("present", ["liquid_bridge"])
    assert set(found["effects"]) == set(LIBRARY)
    assert {"none", "outside_library", *LIBRARY} <= set(found["probabilities"])
    assert sum(found["probabilities"].values()) == pytest.approx(1.0, abs=1e-6)
    for effect in found["effects"].values():
        assert effect["status"] in STATUSES
        check(effect, EFFECT)
    for parameter in found["parameters"].values():
        check(parameter, {"value": float, "low": float, "high": float})
    for place in found["where"]:
        check(place, PLACE)
    check(
        found["vault"], {"opened": int, "chi2_before": float, "chi2_after": float, "chi2_wrong_effect": float}
    )
    kinds = {"named": list, "group": list, "chi2_before": float, "chi2_after": float, "n": int}
    check(found, kinds | {"next_experiments": list, "runs": int, "wall_s": float, "seed": int})
    assert found["vault"]["opened"] >= 1
    assert found["vault"]["chi2_after"] < found["vault"]["chi2_before"]


def test_adoption_leaves_a_study_in_which_the_misfit_is_gone(wet, printed, capsys):
    assert "liquid_bridge" in printed["adopt"]
    after = wet.with_name("heap_with_liquid_bridge.toml")
    found = document(capsys, "compare", str(after))
    assert found["p"] > 0.01
    assert found["adopted"] == ["liquid_bridge"]
    assert "liquid_bridge" not in found["candidates"]
    assert list(wet.parent.glob("*-results")) == [wet.parent / "heap-results"], "a chain shares its vault"


def test_adoption_does_not_write_over_a_file_of_the_user(tmp_path, capsys):
    path = write_study(tmp_path, {})
    (tmp_path / "heap_with_gusts.toml").write_text("mine", encoding="utf-8")
    assert main(["adopt", str(path), "gusts"]) == 2
    assert "this program did not write it" in capsys.readouterr().err
    assert (tmp_path / "heap_with_gusts.toml").read_text("utf-8") == "mine"
    assert not (tmp_path / "heap-results" / "vault.json").exists(), "refused before the vault is opened"


def test_next_proposes_experiments_within_the_stated_ranges(tmp_path, capsys):
    study = STUDY.format(
        model="taichi_erosion.evidence.models.reduced:predict", candidates="[candidates.gusts]"
    )
    study += "\n[candidates.liquid_bridge]\n[laboratory]\nranges = { moisture = [0.0, 0.002] }\n"
    path = write_study(tmp_path, {}, study=study)
    for experiment in document(capsys, "next", str(path))["next_experiments"]:
        check(experiment, {"observable": str, "conditions": dict, "chance": float, "sentence": str})
        assert 0.0 <= experiment["conditions"]["moisture"] <= 0.002


@pytest.mark.usefixtures("printed")
def test_the_report_is_one_page_that_asks_nobody_for_anything(wet, capsys):
    capsys.readouterr()
    assert main(["report", str(wet)]) == 0
    page = Path(capsys.readouterr().out.strip()).read_text("utf-8")
    assert not re.findall(r"(?:src|href|url)\s*[=(]\s*[\"']?(?!data:)(?:https?:)?//", page)
    assert page.count("<script") == 1
    sections = (
        "Where the model fails",
        "Which effect is missing",
        "Vault (held-out measurements)",
        "What would change the answer",
        "Methods",
    )
    assert all(f">{section}</h2>" in page for section in sections)
    assert "<img" not in page, "figures are part of the page"
    assert page.index("<svg") < page.index("<h2"), "a figure stands on the first screen"
    assert "control: " in page
    assert "outside" not in page or "not in the list" in page


def test_the_report_says_where_it_lies_in_a_document_too(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("taichi_erosion.report.write_report", lambda *_: tmp_path / "page.html")
    study = write_study(tmp_path, {})
    assert document(capsys, "report", str(study)) == {"report": str(tmp_path / "page.html")}


def test_measurements_without_any_scatter_name_nothing_and_say_why(tmp_path, capsys):
    path = write_study(tmp_path, {"liquid_bridge": 1.0})
    (tmp_path / "heap.csv").write_text(table_text({"liquid_bridge": 1.0}, 1, repeats=1), encoding="utf-8")
    found = document(capsys, "discover", str(path))
    assert found["verdict"] == "not_testable"
    assert found["sentences"][0].startswith("Neither an sd nor repeated measurements are given")
    assert not any("stated sd" in words for words in found["warnings"]), "none is stated"


def test_an_observable_without_scatter_is_left_out_with_a_word(tmp_path, capsys):
    path = write_study(tmp_path, {})
    single = table_text({}, 1, repeats=1).splitlines()[1:]
    rows = [line for line in table_text({}, 1).splitlines() if not line.startswith("repose_angle")]
    rows += [line for line in single if line.startswith("repose_angle")]
    (tmp_path / "heap.csv").write_text("\n".join(rows) + "\n", encoding="utf-8")
    found = document(capsys, "compare", str(path))
    assert list(found["observables"]) == ["threshold_u_star"]
    assert any("repose_angle: the scatter of" in words and "not used" in words for words in found["warnings"])


def test_a_report_of_nothing_is_refused(tmp_path, capsys):
    assert main(["report", str(write_study(tmp_path, {}))]) == 2
    assert "no results yet" in capsys.readouterr().err


@pytest.mark.parametrize("command", ["compare", "discover", "next", "report"])
def test_bad_input_gets_one_line_and_exit_code_2_and_writes_nothing(tmp_path, capsys, command):
    path = write_study(tmp_path, {}, study=study_text().replace("fraction = 0.3", "fraction = 3"))
    assert main([command, str(path)]) == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    assert printed.err.strip() == f"{path}: vault.fraction = 3 lies outside [0, 0.9]"
    assert sorted(file.name for file in tmp_path.iterdir()) == ["heap.csv", "heap.toml"]


def test_an_effect_that_is_no_candidate_is_refused_with_those_that_are(tmp_path, capsys):
    assert main(["adopt", str(write_study(tmp_path, {})), "moonlight"]) == 2
    assert f"moonlight is no candidate; there are: {', '.join(LIBRARY)}" in capsys.readouterr().err


def test_a_model_that_fails_ends_with_exit_code_3(tmp_path, capsys):
    (tmp_path / "my_lab.py").write_text("def predict(*_):\n    raise ArithmeticError('no air')\n", "utf-8")
    assert main(["compare", str(write_study(tmp_path, {}, study=study_text(model="my_lab:predict")))]) == 3
    assert "no air" in capsys.readouterr().err


SLOW_LAB = """
import time
from pathlib import Path
from taichi_erosion.evidence.models.reduced import predict as fast

def predict(observable, conditions, parameters, effects, seeds):
    time.sleep(0.01)
    with Path(__file__).with_name("calls.txt").open("a") as log:
        log.write(f"{len(seeds)}\\n")
    return fast(observable, conditions, parameters, effects, seeds)
"""


def kept_runs(folder: Path) -> int:
    store = folder / "heap-results" / "runs.sqlite"
    if not store.exists():
        return 0
    with closing(sqlite3.connect(store)) as connection:
        tables = connection.execute("SELECT count(*) FROM sqlite_master WHERE name = 'run'").fetchone()[0]
        return connection.execute("SELECT count(*) FROM run").fetchone()[0] if tables else 0


def test_a_killed_command_goes_on_from_its_runs(tmp_path):
    path = write_study(tmp_path, {"liquid_bridge": 1.0}, study=study_text(model="slow_lab:predict"))
    (tmp_path / "slow_lab.py").write_text(SLOW_LAB, encoding="utf-8")
    command = [sys.executable, "-m", "taichi_erosion", "compare", str(path)]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
        deadline = monotonic() + PATIENCE
        while not kept_runs(tmp_path) and monotonic() < deadline:
            sleep(0.05)
        process.kill()
    kept = kept_runs(tmp_path)
    assert kept > 0
    (tmp_path / "calls.txt").unlink()
    assert main(["compare", str(path)]) == 0
    made = sum(int(line) for line in (tmp_path / "calls.txt").read_text("utf-8").split())
    assert made == kept_runs(tmp_path) - kept
