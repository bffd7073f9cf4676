"""A campaign of 120 runs ends with the table of the undisturbed one, whatever is killed, full or doubled."""

import os
import signal
import sqlite3
import subprocess
import sys
import time
from collections import Counter
from pathlib import Path

import pytest
from stand_in import carry_out, opened, processes, requests, starts, table

from taichi_erosion.campaign import ledger
from taichi_erosion.campaign.execute import run_requests
from taichi_erosion.campaign.ledger import open_ledger, process_exists
from taichi_erosion.core.errors import BadInput

RUNS = 120
PATIENCE = 600.0  # s; the cores may be busy
SLOW = 0.05  # s of a run that is to be interrupted

Table = list[tuple[str, float, str | None]]


def carried_out(folder: Path, mishaps: dict[int, str] | None = None) -> Table:
    return table(carry_out(folder, requests(folder, RUNS, mishaps=mishaps)))


def start_parent(folder: Path, pause: float) -> subprocess.Popen[str]:
    program = [sys.executable, str(Path(__file__).with_name("stand_in.py")), str(folder), str(pause)]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    return subprocess.Popen(program, stdout=subprocess.PIPE, text=True, env=environment)


def assert_goes_on(folder: Path, undisturbed: Table) -> None:
    """Some runs were kept; a second call makes the others and repeats none."""
    keys, before = [key for key, _, _ in undisturbed], Counter(starts(folder))
    with opened(folder) as store:
        kept = ledger.finished_runs(store, keys).keys()
    assert 0 < len(kept) < RUNS
    assert carried_out(folder) == undisturbed
    assert not {f"scene-{seed}" for seed in Counter(starts(folder)) - before} & kept


def wait_for(condition: object) -> None:
    end = time.monotonic() + PATIENCE
    while not condition():  # type: ignore[operator]
        assert time.monotonic() < end, "nothing happened"
        time.sleep(0.02)


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory) -> Table:
    """The table of runs that are done once each and stand in the order asked for."""
    folder = tmp_path_factory.mktemp("undisturbed")
    found = carried_out(folder)
    assert sorted(starts(folder)) == list(range(RUNS))
    assert [key for key, _, _ in found] == [f"scene-{seed}" for seed in range(RUNS)]
    assert {failure for _, _, failure in found} == {None}
    return found


def test_a_killed_worker_costs_only_the_run_it_was_at(tmp_path, undisturbed):
    assert carried_out(tmp_path, mishaps={37: "kills once", 90: "kills once"}) == undisturbed
    assert {seed for seed, times in Counter(starts(tmp_path)).items() if times > 1} == {37, 90}


def test_after_a_killed_parent_its_workers_end_and_nothing_finished_is_repeated(tmp_path, undisturbed):
    (tmp_path / "journal").touch()
    parent = start_parent(tmp_path, SLOW)
    wait_for(lambda: len(starts(tmp_path)) > 20)
    parent.send_signal(signal.SIGKILL)
    parent.communicate()
    wait_for(lambda: not any(process_exists(process) for process in processes(tmp_path)))
    assert_goes_on(tmp_path, undisturbed)


def test_a_full_disk_is_named_and_a_second_call_goes_on(tmp_path, undisturbed):
    listed = requests(tmp_path, RUNS)
    with opened(tmp_path) as store:
        ledger.add_requests(store, listed)
        pages = store.database.connection.execute("PRAGMA page_count").fetchone()[0]
        # SQLite answers a file that may not grow with the error it gives for a disk that is full
        store.database.connection.execute(f"PRAGMA max_page_count = {pages + 1}")
        line = r"ledger\.sqlite: the ledger cannot be used \(database or disk is full"
        with pytest.raises(BadInput, match=line):
            run_requests(listed, store, workers=2, function="stand_in:without_ledger")
    assert_goes_on(tmp_path, undisturbed)


def test_two_parents_at_once_share_the_work_and_repeat_none_of_it(tmp_path, undisturbed):
    (tmp_path / "journal").touch()
    parents = [start_parent(tmp_path, 2.0 * SLOW) for _ in range(2)]
    assert [parent.communicate(timeout=PATIENCE)[0].strip() for parent in parents] == [str(RUNS)] * 2
    assert Counter(starts(tmp_path)) == Counter(range(RUNS))
    assert len(processes(tmp_path)) > 2  # workers of both parents
    assert carried_out(tmp_path) == undisturbed


def test_a_lease_lapses_when_its_owner_on_another_machine_is_silent(tmp_path, monkeypatch):
    (request,), now = requests(tmp_path, 1), time.time()
    with opened(tmp_path) as near, opened(tmp_path) as far:
        elsewhere = ledger.Ledger(far.database, "other-machine:1")
        ledger.add_requests(near, [request])
        assert ledger.lease_runs(elsewhere, [request.key]) == [request.key]
        for passed, leased in ((0.9, []), (1.8, []), (2.9, [request.key])):
            monkeypatch.setattr(ledger.time, "time", lambda passed=passed: now + passed * ledger.LEASE)
            ledger.release_stale_leases(near)
            assert ledger.lease_runs(near, [request.key]) == leased
            ledger.renew_leases(elsewhere)


def test_the_first_result_of_a_run_stays(tmp_path):
    (request,) = requests(tmp_path, 1)
    with opened(tmp_path) as store:
        ledger.add_requests(store, [request])
        for value in (1.0, 2.0):
            ledger.record_result(store, request.key, {"measures": {"angle": {"value": value}}})
        assert ledger.read_results(store, [request.key])[0].value("angle") == 1.0


def test_failed_runs_are_results_with_their_reason(tmp_path):
    found = carried_out(tmp_path, mishaps={3: "fails", 5: "raises", 8: "kills"})
    reasons = {key: failure for key, _, failure in found if failure}
    assert "3 workers died of it; the last: killed by signal 9" in reasons.pop("scene-8")
    assert reasons == {"scene-3": "grains overlap", "scene-5": "ValueError: no such soil"}
    assert len(found) == RUNS


@pytest.mark.parametrize("share", [0.02, 0.5, 0.99])
def test_a_ledger_cut_anywhere_is_refused_in_one_line_or_read_rightly(tmp_path, share):
    listed = requests(tmp_path, RUNS)
    with opened(tmp_path) as store:
        ledger.add_requests(store, listed)
        for request in listed:
            ledger.record_result(store, request.key, {"measures": {"angle": {"value": 1.0}}})
    path = tmp_path / ledger.LEDGER
    path.write_bytes(path.read_bytes()[: int(share * path.stat().st_size)])
    try:
        found = ledger.read_results(open_ledger(tmp_path), [request.key for request in listed])
    except BadInput as refusal:
        line = str(refusal)
        assert line.startswith(f"{path}: the ledger cannot be used (")
        assert "\n" not in line
    else:
        assert all(result.value("angle") == 1.0 for result in found)


def test_a_database_of_another_program_is_refused_and_left_alone(tmp_path):
    foreign = sqlite3.connect(tmp_path / ledger.LEDGER)
    foreign.execute("CREATE TABLE run (name TEXT, pace REAL)")
    foreign.close()
    before = (tmp_path / ledger.LEDGER).read_bytes()
    with opened(tmp_path) as store, pytest.raises(BadInput, match="the ledger cannot be used"):
        ledger.add_requests(store, requests(tmp_path, 1))
    assert (tmp_path / ledger.LEDGER).read_bytes() == before
