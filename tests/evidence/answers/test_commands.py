"""Commands of the evidence loop: replies as stored, vault, adopted studies, runs of a killed command."""

import json
import sqlite3
import subprocess
import sys
from contextlib import closing, suppress
from pathlib import Path
from time import monotonic, sleep

import numpy as np
import pytest

from taichi_erosion.cli.main import main
from taichi_erosion.core.errors import BadInput
from taichi_erosion.evidence.answers.files import Command, Reply, answer_file, read_reply
from taichi_erosion.evidence.models.load_study import StudyOptions
from tests.evidence.asking import ask
from tests.evidence.small_study import LIBRARY, study_text, write_study

PATIENCE = 600.0  # s; the cores may be busy
NAME = "liquid_bridge"
DOE = Path(__file__).parents[3] / "doe"


@pytest.fixture(scope="module")
def wet(tmp_path_factory) -> Path:
    """A study in whose world liquid bridges act, examined once for all tests of this file."""
    return write_study(tmp_path_factory.mktemp("wet"), {NAME: 1.0})


@pytest.fixture(scope="module")
def replies(wet) -> dict[str, Reply]:
    """The reply of each command; `again`: the discovery after the vault was opened."""
    found = {"compare": ask("compare", wet), "discover": ask("discover", wet)}
    found["adopt"] = ask("adopt", wet, NAME)
    return found | {"next": ask("next", wet), "again": ask("discover", wet)}


@pytest.mark.parametrize("command", ["compare", "adopt", "next", "discover"])
def test_a_reply_is_read_as_it_was_stored(wet, replies, command: Command):
    found = read_reply(Path(replies[command].about["results"]), wet.stem, command)
    last = replies["again" if command == "discover" else command]
    assert (found.answer(), found.document) == (last.answer(), last.document)
    np.testing.assert_array_equal(found.record.rows.measured, last.record.rows.measured)
    json.dumps(found.document, allow_nan=False)


@pytest.mark.parametrize("command", ["compare", "predict"])
def test_a_stored_reply_that_is_damaged_is_told(tmp_path, wet, replies, command: Command):
    printed = json.dumps(replies["compare"].document)  # without the rows
    for damaged, told in ((printed, "holds no result"), ("{", "cannot be read")):
        answer_file(tmp_path, wet.stem, command).write_text(damaged, encoding="utf-8")
        with pytest.raises(BadInput, match=told):
            read_reply(tmp_path, wet.stem, command)


def test_the_vault_is_opened_by_adopt_alone_and_counted(replies):
    assert replies["discover"].record.vault is None
    adopted, again = replies["adopt"].record.vault, replies["again"].record.vault
    assert adopted.opened == 1
    assert adopted.chi2_after < 0.5 * adopted.chi2_before
    assert adopted.chi2_wrong_effect > 5.0 * adopted.chi2_after
    assert again == adopted, "a later discovery of the same name tells the test"
    assert replies["discover"].about["rows_hidden"] == 30


def test_misfit_and_strength_are_told_where_and_how_large_they_are(replies):
    compared, discovered = (replies[command].record for command in ("compare", "discover"))
    assert (compared.chi2_before, compared.p_misfit) == (discovered.chi2_before, discovered.p_misfit)
    assert compared.p_misfit < 0.01
    assert "moisture" in {place.axis for place in compared.where if place.p < 0.05}
    assert (discovered.verdict, discovered.named) == ("present", (NAME,))
    assert set(discovered.effects) == set(LIBRARY)
    fitted = replies["adopt"].record.effects[NAME].strength_range
    half = 0.5 * (fitted.high - fitted.low)
    # the 90 % interval misses one time in ten; three times its half-width misses once in a million
    assert abs(fitted.value - 1.0) < 3.0 * half
    # three repeats at sixteen settings fix a strength to 0.09; an interval that holds anything is none
    assert half < 0.15


def test_adoption_leaves_a_study_in_which_the_misfit_is_gone(wet, replies):
    after = Path(replies["adopt"].about["written"])
    assert after == wet.with_name(f"heap_with_{NAME}.toml")
    found = ask("compare", after)
    assert found.record.p_misfit > 0.01
    assert found.about["adopted"] == [NAME]
    assert NAME not in found.about["candidates"]
    assert list(wet.parent.glob("*-results")) == [wet.parent / "heap-results"], "a chain shares its vault"
    assert ask("discover", after).record.verdict == "none_detected"
    first, second = replies["adopt"].about["ladder"]
    assert (first["effects"], second["effects"]) == ([], [NAME])
    assert second["chi2_per_row_held_out"] < first["chi2_per_row_held_out"]


def test_adoptions_count_in_the_errors_of_the_likeliest_explanation(tmp_path):
    words = [str(DOE / "windkanal_fine.csv"), "--yes", "--closed-form", "--out", str(tmp_path)]
    assert main(["study", "new", *words]) == 0
    sets = {"some": (NAME,), "right": (NAME, "dry_cohesion"), "more": (NAME, "dry_cohesion", "saffman_lift")}
    found = {key: ask("adopt", tmp_path / "windkanal_fine.toml", *names) for key, names in sets.items()}
    before = [reply.record.vault.chi2_per_row_before for reply in found.values()]
    assert max(before) < 2.0 * min(before)
    assert "the model still fails: held-out rows" in found["some"].answer().lines[0]
    assert "what is left is chance" in found["right"].answer().lines[0]
    needless = ["The rows need no" in "".join(reply.answer().lines) for reply in found.values()]
    assert needless == [False, False, True]


def test_a_candidate_that_the_model_does_not_know_is_told(tmp_path):
    (tmp_path / "measured").mkdir()
    for name in ("my_lab.py", "my_lab.toml", "measured/my_lab.csv"):
        text = (DOE / name).read_text("utf-8").replace("candidates.side_walls", "candidates.wals")
        text = text.replace("SCATTER = 0.4", "SCATTER = 0.0")  # else a change of 0 hides in the scatter
        (tmp_path / name).write_text(text, encoding="utf-8")
    lines = ask("discover", tmp_path / "my_lab.toml").about["set_up"]
    assert any("wals changes nothing here" in line for line in lines)


def test_in_a_null_nothing_is_named_or_adopted(tmp_path):
    study = write_study(tmp_path, {})
    assert ask("compare", study).record.p_misfit > 0.01
    assert ask("discover", study).record.verdict == "none_detected"
    first = ask("adopt", study, "side_walls").answer().lines[0]
    assert "The model is no better with side_walls" in first
    assert "Do not adopt" in first


def test_a_file_of_the_user_and_no_candidate_are_refused_before_the_vault_is_opened(tmp_path):
    path = write_study(tmp_path, {})
    (tmp_path / "heap_with_gusts.toml").write_text("mine", encoding="utf-8")
    with pytest.raises(BadInput, match="this program did not write it"):
        ask("adopt", path, "gusts")
    with pytest.raises(BadInput, match=f"moonlight is no candidate; there are: {', '.join(LIBRARY)}"):
        ask("adopt", path, "moonlight")
    assert (tmp_path / "heap_with_gusts.toml").read_text("utf-8") == "mine"
    assert not (tmp_path / "heap-results" / "vault.json").exists()


def test_the_cost_of_an_answer_is_told_before_it_only_where_it_takes_long(tmp_path, monkeypatch):
    told: list[str] = []
    options, study = StudyOptions(announce=told.append), write_study(tmp_path, {})
    found = ask("discover", study, options=options)
    assert found.record.runs > found.record.settings > 0
    assert told == []
    monkeypatch.setattr("taichi_erosion.evidence.emulator.plan_cost.WORTH_TELLING", 0.0)
    ask("discover", study, options=options)
    assert len(told) == 1
    assert "runs" in told[0]


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
    with (
        suppress(sqlite3.OperationalError),
        closing(sqlite3.connect(f"file:{store}?mode=ro", uri=True)) as file,
    ):
        return file.execute("SELECT count(*) FROM run").fetchone()[0]
    return 0


def test_a_killed_command_goes_on_from_its_runs(tmp_path):
    path = write_study(tmp_path, {NAME: 1.0}, study=study_text(model="slow_lab:predict"))
    (tmp_path / "slow_lab.py").write_text(SLOW_LAB, encoding="utf-8")
    order = f"from pathlib import Path; from tests.evidence.asking import ask; ask('compare', Path('{path}'))"
    root, command = Path(__file__).parents[3], [sys.executable, "-c", order]
    with subprocess.Popen(command, cwd=root, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
        deadline = monotonic() + PATIENCE
        while not kept_runs(tmp_path) and monotonic() < deadline:
            sleep(0.05)
        process.kill()
    kept = kept_runs(tmp_path)
    assert kept > 0
    (tmp_path / "calls.txt").unlink()
    ask("compare", path)
    made = sum(int(line) for line in (tmp_path / "calls.txt").read_text("utf-8").split())
    assert made == kept_runs(tmp_path) - kept
