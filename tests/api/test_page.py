"""The page of a live session over HTTP: who may steer, what is steered, what is left behind."""

import json
from contextlib import closing
from http.client import HTTPConnection
from pathlib import Path
from threading import Lock
from time import monotonic
from urllib.parse import urlencode

import numpy as np
import pytest

from taichi_erosion.api import page as pages
from taichi_erosion.api.page import Page, serve_page
from taichi_erosion.api.prompt import execute_line
from taichi_erosion.core.snapshot import Failure, Status
from taichi_erosion.execution import session as live
from taichi_erosion.simulation import snapshot

SCENES = Path(__file__).parents[2] / "scenes"
FRICTION = "contact.grain-grain.friction_rolling"
LONG = 120.0  # s of wall time: what takes longer will not come


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    """A page of a small scene, with its state at the beginning."""
    session = live.open_session(SCENES / "column_collapse.toml", ("grains.count=60",))
    live.save_state_as(session, "begin")
    return serve_page(session, tmp_path_factory.mktemp("page") / "session.txt", Lock())


@pytest.fixture(autouse=True)
def at_the_beginning(request):
    """The page paused at the beginning, steered by the tests."""
    if "page" not in request.fixturenames:
        return
    page: Page = request.getfixturevalue("page")
    page.playing, page.owner, page.latest_request = False, "test", monotonic()
    page.speed, page.error = pages.inf, ""
    with page.turn:
        live.restore_saved_state(page.session, "begin")
        page.session.states.clear()
        page.session.keep_at = 0.0


def request(page: Page, what: str, body: str | None = None, owner="test", headers=(), token=None, **query):
    path = f"/{token or page.token}/{what}?{urlencode({'owner': owner, **query})}"
    with closing(HTTPConnection("127.0.0.1", page.port)) as connection:
        connection.request("GET" if body is None else "POST", path, body, dict(headers))
        answer = connection.getresponse()
        return answer.status, answer.read(), answer.headers


def send(page: Page, line: str) -> str:
    status, text, _ = request(page, "command", line)
    assert status == 200, text
    return text.decode()


def state(page: Page, **query) -> dict:
    return json.loads(request(page, "state", **query)[1])


def wait_until(page: Page, condition) -> dict:
    """The state of the page once it meets a condition."""
    end = monotonic() + LONG
    while not condition(now := state(page)):
        assert monotonic() < end, now
    return now


@pytest.mark.parametrize(
    ("what", "line", "query"),
    [("anything", None, {}), ("state", None, {"after": "abc"})]
    + [("command", line, {}) for line in ("speed nan", "speed 1 2", "speed 1e-9", "run nan", b"\xff")],
)
def test_a_request_that_means_nothing_is_refused_and_the_page_goes_on(page, what, line, query):
    assert request(page, what, line, **query)[0] == 400
    assert (state(page)["playing"], page.owner) == (False, "test")


@pytest.mark.parametrize(
    ("options", "status"),
    [
        ({}, 200),
        ({"headers": {"Origin": "http://127.0.0.1:{port}"}}, 200),
        ({"token": "A" * 22}, 403),
        ({"headers": {"Origin": "http://elsewhere.org"}}, 403),
        ({"headers": {"Origin": "http://127.0.0.1:1"}}, 403),
        ({"headers": {"Host": "elsewhere.org:{port}"}}, 403),  # a name that was made to point here
        ({"owner": "a second tab"}, 409),
        ({"owner": ""}, 409),
    ],
)
def test_only_its_own_page_steers_a_session_and_one_at_a_time(page, options, status):
    headers = {name: value.format(port=page.port) for name, value in options.get("headers", {}).items()}
    found, text, _ = request(page, "command", "step 3", **options | {"headers": headers})
    assert found == status
    assert (page.session.time > 0.0) == (status == 200), "what is refused changes nothing"
    assert text.count(b"\n") == 0


def test_the_page_loads_nothing_from_another_server(page):
    status, content, headers = request(page, "")
    assert status == 200
    assert headers["Content-Security-Policy"].startswith("default-src 'self'")
    assert b"//" not in content.replace(b"\n//", b"").replace(b"  //", b""), "no address of another server"


def test_it_plays_to_a_time_pauses_and_notes_what_it_did(page):
    send(page, "run to 0.0105")
    assert wait_until(page, lambda now: not now["playing"])["time"] == 0.0105
    send(page, "play")
    wait_until(page, lambda now: now["time"] > 0.012)
    send(page, "pause")
    with page.turn:
        there = page.session.time
    assert wait_until(page, lambda now: not now["playing"])["time"] == there
    assert page.session.history == [f"run to {there!r}"]


def test_run_until_rest_ends_at_rest(page):
    send(page, "run until rest")
    wait_until(page, lambda now: not now["playing"])
    assert live.is_session_at_rest(page.session)
    assert send(page, "stage") == "stage collapse begins"
    assert state(page)["stage"] == 1


def test_a_slow_run_takes_its_time(page, monkeypatch):
    monkeypatch.setattr(pages, "sleep", lambda _: None)
    page.speed, page.pace, page.goal = 1e-3, 1.0, pages.inf
    assert page.advance_portion() <= max(1e-3 * pages.PORTION, 1.01 * page.session.time_step)


def test_a_change_acts_at_once_is_a_typed_command_and_is_undone_bit_for_bit(page, monkeypatch):
    monkeypatch.setattr(live, "KEEP_EVERY", 0.0)
    monkeypatch.setattr(live, "KEEP_SHARE", pages.inf)
    page.session.same_change = LONG
    send(page, "step 50")
    before = snapshot(page.session.sim, 0)
    assert send(page, f"set {FRICTION} 0.4").startswith(f"{FRICTION} = 0.4 at once")
    assert page.session.history[-1] == f"set {FRICTION} 0.4"
    shown = {row["path"]: row for row in json.loads(request(page, "controls")[1])}
    assert (shown[FRICTION]["value"], shown[FRICTION]["low"]) == (0.4, 0.0)
    send(page, "step 50")
    there = live.session_status(page.session)["time_s"]
    send(page, f"set {FRICTION} 0.5")
    send(page, f"back to {there}")
    assert page.session.scene.contact["grain-grain"].friction_rolling == 0.5, "the last of those at a time"
    send(page, "undo")
    assert page.session.scene.contact["grain-grain"].friction_rolling == 0.12, "a slider is drawn in one go"
    after = snapshot(page.session.sim, 0)
    assert np.array_equal(after.position, before.position)
    assert np.array_equal(after.velocity, before.velocity)
    assert page.session.history[-1].startswith("run to")


def test_an_earlier_state_is_shown_and_the_run_starts_there_again(page, monkeypatch):
    monkeypatch.setattr(live, "KEEP_EVERY", 0.0)
    monkeypatch.setattr(live, "KEEP_SHARE", pages.inf)
    for _ in range(4):
        send(page, "step 20")
    times = state(page)["kept"]
    late = page.session.time
    send(page, f"back to {times[1]!r}")
    assert state(page)["time"] == times[1]
    assert state(page)["kept"][-1] == late, "later ones stay until it runs on"
    send(page, f"set {FRICTION} 0.5")
    send(page, "step 20")
    assert state(page)["kept"] == [*times[:2], times[1]], "of those before, and before the change"
    assert [line.split()[0] for line in page.session.history] == ["run", "set", "run"]


def test_kept_states_thin_out_where_they_fill_the_memory(page, monkeypatch):
    monkeypatch.setattr(live, "KEEP_EVERY", 0.0)
    monkeypatch.setattr(live, "KEEP_SHARE", pages.inf)
    send(page, "step 5")
    monkeypatch.setattr(live, "KEEP_BYTES", 6.5 * live.bytes_of_kept_states(page.session.states))
    for _ in range(30):
        send(page, "step 5")
    times = [kept[0].time for kept in page.session.states]
    assert live.bytes_of_kept_states(page.session.states) <= live.KEEP_BYTES
    assert times[0] == 0.0
    assert times == sorted(times)


def test_a_failure_pauses_tells_and_leaves_the_last_good_state(page):
    send(page, "step 30")
    with page.turn:
        live.keep_state_if_due(page.session, is_due=True)
    good = page.session.time
    page.session.state.failure = Failure(Status.OVERLAP, good, 7, 9, 0.31)
    status, text, _ = request(page, "command", "play")
    assert (status, page.playing) == (400, False)
    assert b"grain 7 overlaps grain 9" in text
    page.playing = True
    page.advance_portion()
    now = state(page)
    assert not now["playing"]
    assert "grain 7 overlaps grain 9" in now["error"]
    send(page, f"back to {now['kept'][-1]}")
    assert state(page)["error"] == ""
    send(page, "step 10")
    assert page.session.time > good


@pytest.mark.parametrize("is_told", [True, False], ids=["closed", "killed"])
def test_a_page_that_is_gone_leaves_the_run_paused_saved_and_as_a_script(page, is_told, monkeypatch):
    send(page, "play")
    wait_until(page, lambda now: now["time"] > 0.003)
    send(page, f"set {FRICTION} 0.3")
    send(page, "save")
    saved = page.session.saved["last"]
    if is_told:
        request(page, "leave", "")
    else:
        page.latest_request -= pages.ABSENT
    end = monotonic() + LONG
    while page.owner and monotonic() < end:
        pages.sleep(0.01)
    with page.turn:
        there = snapshot(page.session.sim, 0)
        assert not page.playing
        assert page.session.saved["left"][0].time == page.session.time
        assert page.session.saved["last"] is saved
        live.restore_saved_state(page.session, "begin")
        execute_line(page.session, f"script {page.script}")
        assert np.array_equal(snapshot(page.session.sim, 0).position, there.position)
    assert request(page, "state", owner="another tab")[0] == 200, "the next page steers"


def test_a_frame_has_the_grains_and_a_grain_tells_its_numbers_and_contacts(page):
    send(page, "step 200")
    status, content, _ = request(page, "frame", after=0, colour="contacts", grain=5)
    assert status == 200
    assert b"RRF" in content[4:8], "a stream of messages of the viewer"
    assert int.from_bytes(content[:4], "little") == page.version
    assert send(page, "pick 7").startswith("grain 7: radius")
    live.run_until_rest(page.session)
    told = [send(page, f"grain {number}") for number in range(60)]
    assert "touches plate" in "".join(told)
    (first,) = [text for text in told if "touches grain" in text][:1]
    number, partner = first.split()[1].rstrip(":"), first.partition("touches grain ")[2].split()[0]
    assert f"touches grain {number} with" in told[int(partner)], "a contact has two ends"
    assert request(page, "command", "grain 600")[0] == 400


def test_a_curve_is_sent_piece_by_piece_and_anew_after_a_return(page):
    for _ in range(3):
        send(page, "step 10")
    first = state(page, name="kinetic_J")
    times = [point[0] for point in first["points"]]
    assert (first["begin"], len(times)) == (0, 3)
    send(page, "step 10")
    more = state(page, name="kinetic_J", count=3, latest=times[-1])
    assert (more["begin"], len(more["points"])) == (3, 1)
    send(page, "back begin")
    assert state(page, name="kinetic_J", count=4, latest=more["points"][-1][0])["begin"] == 0
