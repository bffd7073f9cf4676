"""Page of a live session: a browser steers it and sees its grains while it runs.

One thread plays the session in short portions; what a page asks for acts between two of them. A page has the
token of its address, and one page at a time steers; a page that is closed leaves the session paused. NiceGUI
brings 53 packages, viser a viewer of its own, rerun's widget needs Jupyter: Python's own server needs none.
"""

import json
from collections.abc import Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass, field
from hmac import compare_digest
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from math import inf
from pathlib import Path
from secrets import token_urlsafe
from threading import Lock, Thread
from time import monotonic, sleep
from typing import Any
from urllib.parse import parse_qsl, urlsplit

from taichi_erosion import simulation
from taichi_erosion.api.prompt import execute_line, parse_end_time
from taichi_erosion.api.session_entries import changeable_numbers
from taichi_erosion.core.errors import BadInput, SimulationStopped
from taichi_erosion.execution import session as live
from taichi_erosion.execution.recorder import Recorder, log_changed_walls, meshes_of, resting_speed, side_view
from taichi_erosion.execution.session import Session
from taichi_erosion.recording import stream
from taichi_erosion.recording.pictures import CHALK, colours_by_quantity
from taichi_erosion.recording.viewer import LOOPBACK, viewer_files

PORTION = 0.03  # s of wall time between two moments at which a page acts
REST = 0.004  # s between two portions, for requests that wait
ANSWER = 0.1  # s between two answers on the state
PATIENCE = 2.0  # s until an answer without news
SLOWEST = 1e-4  # simulated s per s
LEFT = "left"  # name of the state in which a page was left
ABSENT = 6.0  # s without a request, after which a page counts as closed
SAME_CHANGE = 1.0  # s between two changes of one entry, up to which they are one: a slider that is drawn
BODY_MOST = 10_000  # bytes of a command
HTML, TEXT = "text/html; charset=utf-8", "text/plain; charset=utf-8"
JSON, BYTES = "application/json", "application/octet-stream"
KINDS = {"re_viewer.js": "text/javascript", "re_viewer_bg.wasm": "application/wasm"}
HEADERS = {  # nothing is loaded from, sent to or told to another server
    "Content-Security-Policy": "default-src 'self' blob: data:; style-src 'self' 'unsafe-inline'; "
    "script-src 'self' 'unsafe-inline' 'wasm-unsafe-eval'",
    "Referrer-Policy": "no-referrer",
    "Cache-Control": "no-store",
    "X-Content-Type-Options": "nosniff",
}


PAGES: list["Page"] = []  # of this program; its device holds one session


@dataclass
class Page:
    """A session that plays until a time, the page that steers it, and what the page is shown."""

    session: Session
    script: Path  # of the commands, written when the page is left
    turn: Lock  # of whoever uses the session; who plays leaves it to others between two portions
    port: int = 0
    token: str = field(default_factory=lambda: token_urlsafe(16))
    owner: str = ""  # name of the page that steers; empty: the next one that asks does
    latest_request: float = 0.0  # s of the monotonic clock, its latest request
    playing: bool = False
    goal: float = inf  # s, of the simulation
    until_rest: bool = False
    speed: float = inf  # simulated s per s, at most
    pace: float = 0.0  # simulated s per s, of the latest portion
    error: str = ""
    version: int = 1  # grows with every change of what is shown
    view: tuple[Recorder, Any] | None = None  # and the stream of its bytes
    frames: int = 0
    idents: Any = ()  # of the grains in the latest frame
    files: "Future[dict[str, bytes]] | None" = None  # of the viewer

    @property
    def address(self) -> str:
        return f"http://{LOOPBACK}:{self.port}/{self.token}/"

    @property
    def tunnel_hint(self) -> str:
        """How to reach it from another machine."""
        here = f"{self.port}:{LOOPBACK}:{self.port}"
        return f"from another machine: ssh -L {here} THIS_MACHINE, then the same address"

    def advance_while_playing(self) -> None:
        """Advance while it plays, portion by portion, as long as the device holds the session."""
        while self.session.ensemble.sim.device_fields_exist:
            began, steps_taken = monotonic(), 0.0
            if self.owner and began - self.latest_request > ABSENT:
                self.save_and_leave()
            with self.turn:
                steps_taken = self.advance_portion() if self.playing else 0.0
            sleep(max(steps_taken / self.speed - (monotonic() - began), REST))

    def advance_portion(self) -> float:
        """Advance by a portion; returns its simulated time [s]. What stops a run pauses it."""
        session, began, checks = self.session, monotonic(), self.session.ensemble.checks
        start, portion = session.time, max(min(self.pace, self.speed) * PORTION, session.time_step)
        try:
            live.run_until_time(session, min(start + portion, self.goal))
        except Exception as error:  # whatever it is, who plays stays there for the next command
            self.playing, self.error = False, str(error) or type(error).__name__
        self.pace = (session.time - start) / (monotonic() - began)
        self.version += 1
        rests = self.until_rest and session.ensemble.checks > checks and live.is_session_at_rest(session)
        if rests or session.time > self.goal - session.time_step:
            self.playing = False
        return session.time - start

    def execute_command(self, line: str) -> str:
        """Text of a typed command; a run begins to play. Raises BadInput, SimulationStopped."""
        name, *words = line.split() or [""]
        self.playing &= name not in ("pause", "back", "undo")
        with self.turn:
            self.version, self.error = self.version + 1, ""
            if name == "pick":
                return execute_line(self.session, f"grain {self.idents[int(words[0])]}")
            if name not in ("play", "run", "pause", "speed"):
                return execute_line(self.session, line)
            if name == "speed":
                if not float(" ".join(words)) >= SLOWEST:
                    raise BadInput(f"speed: {SLOWEST:g} simulated seconds a second or more, or inf")
                self.speed = float(" ".join(words))
            elif name != "pause":
                live.raise_if_session_failed(self.session)
                self.until_rest = words == ["until", "rest"]
                self.goal = parse_end_time(self.session, *words) if words and not self.until_rest else inf
                self.playing = True
        return ""

    def shown_state(self, count: int, latest: float, name: str) -> dict[str, Any]:
        """What a page shows; of the curve of a number the samples behind those that it has."""
        session, samples = self.session, self.session.samples
        has_all = 0 < count <= len(samples) and samples[count - 1]["time_s"] == latest
        points = [(each["time_s"], each.get(name)) for each in samples[count if has_all else 0 :]]
        return {
            **{name: getattr(self, name) for name in ("version", "playing", "error")},
            **{"time": session.time, "time_step": session.time_step, "stage": session.state.stage},
            "title": session.scene.scene.title or session.path.stem,
            "stages": [stage.name for stage in session.scene.stages],
            "numbers": samples[-1] if samples else {},
            "names": [*(samples[-1] if samples else {}), *session.scene.measure],
            "begin": count if has_all else 0,
            "points": points,
            "kept": [state[0].time for state in session.states],
            "is_changed": session.revision > 0,
            "entries": str(hash(session.overrides)),
        }

    def viewer_messages(self, colour: str, grain: int, anew: bool) -> bytes:
        """The grains and walls as messages of the viewer; `anew` for a viewer that has none."""
        with self.turn:
            session, setup = self.session, self.session.sim.setups[0]
            slow = resting_speed(setup)
            if anew or self.view is None:
                walls = meshes_of(session.scene, setup)
                kind = session.scene.scene.kind or "own"
                recording, out = stream.open_view(kind, setup.grains.radius, walls)
                recorder = Recorder(0, recording, walls, side_view(setup), slow, inf, is_rewritten=True)
                self.view = recorder, out
            recorder, out = self.view
            self.frames += 1
            now = simulation.snapshot(session.sim, 0)
            colours = colours_by_quantity(colour, now, slow, max(stream.FASTEST_COLOUR, 2.0 * slow))
            self.idents, colours[now.ident == grain] = now.ident, CHALK
            stream.log_view(recorder.recording, self.frames, now, colours)
            log_changed_walls(recorder, session.sim)
        return out.read() or b""

    def steers_session(self, name: str) -> bool:
        """Whether a page steers; the first one does, until it is closed."""
        if name and self.owner in ("", name):
            self.owner, self.latest_request = name, monotonic()
        return bool(name) and name == self.owner

    def save_and_leave(self) -> None:
        """Pause, save the state as `left`, and write the commands that lead to it."""
        self.playing, self.owner = False, ""
        with self.turn:
            try:
                live.save_state_as(self.session, LEFT)
                if self.session.history:
                    live.write_session_commands(self.session, self.script)
            except BadInput as error:
                self.error = str(error)

    def answer(self, name: str, query: Mapping[str, str], body: str) -> tuple[int, str, bytes]:
        """Status, kind and content of the answer to a request of the page that steers."""
        try:
            return 200, *self.kind_and_content(name, query, body)
        except (BadInput, SimulationStopped, ValueError, IndexError, EOFError) as error:
            return 400, TEXT, (str(error) or "a session ends in its terminal").encode()

    def kind_and_content(self, name: str, query: Mapping[str, str], body: str) -> tuple[str, bytes]:
        """What a page asks for: picture, reply to a command, state, or entries that may change."""
        after, end = int(query.get("after", 0)), monotonic() + PATIENCE
        if name == "state":
            sleep(ANSWER)
        while name in ("state", "frame") and self.version == after and monotonic() < end:
            sleep(REST)
        if name == "frame":
            version = self.version.to_bytes(4, "little")
            grain, colour = int(query.get("grain", -1)), query.get("colour", "")
            return BYTES, version + self.viewer_messages(colour, grain, anew=after == 0)
        if name == "command":
            return TEXT, self.execute_command(body).encode()
        return JSON, json.dumps(self.state_or_controls(name, query)).replace("NaN", "null").encode()

    def state_or_controls(self, name: str, query: Mapping[str, str]) -> Any:
        """The state, or entries that may change; nothing once the page has been left."""
        if name == "state":
            count, latest = int(query.get("count", 0)), float(query.get("latest", 0.0))
            return self.shown_state(count, latest, query.get("name", ""))
        if name == "leave":
            return self.save_and_leave()
        if name != "controls":
            raise BadInput(f"the page asks for nothing that is called '{name}'")
        with self.turn:
            return changeable_numbers(self.session)


class Handler(BaseHTTPRequestHandler):
    """Answers to requests for /TOKEN/NAME."""

    protocol_version = "HTTP/1.1"
    page: Page

    def log_message(self, format: str, *args: Any) -> None:
        """Nothing: the address holds the token."""

    def do_GET(self) -> None:
        address = urlsplit(self.path)
        token, _, name = address.path[1:].partition("/")
        body = self.rfile.read(min(int(self.headers.get("Content-Length") or 0), BODY_MOST)).decode(
            errors="replace"
        )
        status, kind, content = self.answer(token, name, dict(parse_qsl(address.query)), body)
        self.send_response(status)
        lines = {"Content-Type": kind, "Content-Length": str(len(content))}
        if kind in KINDS.values():
            lines["Content-Encoding"] = "gzip"
        for line in (HEADERS | lines).items():
            self.send_header(*line)
        with suppress(ConnectionError):  # of a page that has gone
            self.end_headers()
            self.wfile.write(content)

    def do_POST(self) -> None:
        self.do_GET()

    def answer(self, token: str, name: str, query: Mapping[str, str], body: str) -> tuple[int, str, bytes]:
        """Status, kind and content of the answer; a refusal where the request is not of the page."""
        page, host, origin = self.page, self.headers.get("Host"), self.headers.get("Origin")
        hosts = {f"{each}:{page.port}" for each in (LOOPBACK, "localhost")}
        if host not in hosts or origin not in (None, f"http://{host}"):
            return 403, TEXT, b"this session answers its own page on this machine alone"
        if not compare_digest(token.encode(), page.token.encode()):
            return 403, TEXT, b"the address lacks the token that the program printed"
        if not name:
            return 200, HTML, Path(__file__).with_name("page.html").read_bytes()
        if name in KINDS and page.files is not None:
            return 200, KINDS[name], page.files.result()[name]
        if not page.steers_session(query.get("owner", "")):
            return 409, TEXT, b"another page steers this session; close it, then this one goes on"
        if not page.session.ensemble.sim.device_fields_exist:
            return 410, TEXT, b"another run or session has begun in this program; this one has ended"
        return page.answer(name, query, body)


def serve_page(session: Session, script: Path, turn: Lock, port: int = 0) -> Page:
    """Serve the page of a session on a port of this machine, 0 for a free one. Raises BadInput."""
    live.keep_sample(session)
    page, session.same_change = Page(session, script, turn), SAME_CHANGE
    try:
        server = ThreadingHTTPServer((LOOPBACK, port), type("PageHandler", (Handler,), {"page": page}))
    except OSError as error:
        raise BadInput(f"--port {port}: cannot be served ({error.strerror})") from None
    server.handle_error = lambda request, client_address: None  # a page that has gone is no news
    page.port, page.files = server.server_address[1], ThreadPoolExecutor(1).submit(viewer_files)
    for target in (server.serve_forever, page.advance_while_playing):
        Thread(target=target, daemon=True).start()
    PAGES.append(page)
    return page
