"""The page of a live session in headless Chromium, from the command line; skips where there is no browser."""

import json
import os
import re
import subprocess
import sys
from base64 import b64decode
from contextlib import closing
from pathlib import Path
from signal import SIGKILL
from time import monotonic, sleep

import pytest

from tests.report.browser import BROWSER

ROOT = Path(__file__).parents[2]
PATCH = "grains.count=160 wind.length_d=10 wind.width_d=8 wind.height=0.02 run.check_interval=2e-3".split()
LONG = 400.0  # s of wall time: what takes longer will not come
FLAGS = "--headless --no-sandbox --disable-gpu-sandbox --use-angle=swiftshader --enable-unsafe-swiftshader"
pytestmark = [pytest.mark.slow, pytest.mark.skipif(not BROWSER, reason="no chromium on the path")]


class Tab:
    """A page in a browser of its own, driven through pipes by the DevTools protocol."""

    def __init__(self, address: str, folder: Path) -> None:
        (down, self.write), (self.read, up) = os.pipe(), os.pipe()
        words = f"exec {BROWSER} {FLAGS} --user-data-dir={folder} --remote-debugging-pipe 3<&{down} 4>&{up}"
        quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
        self.process = subprocess.Popen(
            ["bash", "-c", words], pass_fds=(down, up), start_new_session=True, **quiet
        )
        os.close(down)
        os.close(up)
        self.number, self.rest, self.session, self.events = 0, b"", {}, []
        target = self.call("Target.createTarget", url="about:blank")["targetId"]
        attached = self.call("Target.attachToTarget", targetId=target, flatten=True)
        self.session = {"sessionId": attached["sessionId"]}
        self.call("Network.enable")
        self.call("Page.navigate", url=address)

    def call(self, method: str, **params) -> dict:
        """Result of a method; what comes before it is kept in `events`."""
        self.number += 1
        message = {"id": self.number, "method": method, "params": params} | self.session
        os.write(self.write, json.dumps(message).encode() + b"\0")
        while True:
            while b"\0" not in self.rest:
                part = os.read(self.read, 1 << 16)
                assert part, "the browser has ended"
                self.rest += part
            text, _, self.rest = self.rest.partition(b"\0")
            found = json.loads(text)
            if found.get("id") == self.number:
                assert "error" not in found, found
                return found["result"]
            self.events.append(found)

    def value(self, expression: str):
        """Value of an expression of JavaScript on the page."""
        found = self.call("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True)
        assert "exceptionDetails" not in found, found
        return found["result"].get("value")

    def wait(self, expression: str):
        """The value of an expression once it is neither false nor an error."""
        end = monotonic() + LONG
        while True:
            found = self.call("Runtime.evaluate", expression=expression, returnByValue=True)["result"]
            if found.get("value") and found.get("subtype") != "error":
                return found["value"]
            assert monotonic() < end, f"{expression}: {self.value('document.body.innerText')}"
            sleep(0.1)

    def picture(self, width: int, height: int) -> bytes:
        """PNG of the page at a size [px]."""
        size = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": False}
        self.call("Emulation.setDeviceMetricsOverride", **size)
        sleep(1.0)
        return b64decode(self.call("Page.captureScreenshot")["data"])

    @property
    def hosts(self) -> set[str]:
        """Schemes and hosts of all that the page has asked for."""
        sent = [each for each in self.events if each.get("method") == "Network.requestWillBeSent"]
        return {re.split(r"(?<=[\w:])/(?=\w)", each["params"]["request"]["url"])[0] for each in sent}

    def close(self) -> None:
        """End the browser at once, as a crash would."""
        os.killpg(self.process.pid, SIGKILL)
        self.process.wait()
        os.close(self.read)
        os.close(self.write)


@pytest.fixture
def served(tmp_path):
    """Command line of a small bed of sand with a page: its address, and the process."""
    changes = [word for change in PATCH for word in ("--set", change)]
    words = [sys.executable, "-m", "taichi_erosion", "live", "scenes/saltation.toml", "--web", *changes]
    words += ["--record", str(tmp_path / "sand.rrd")]
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    with subprocess.Popen(words, cwd=ROOT, **pipes) as process:
        line = next(text for text in process.stderr if text.startswith("page: "))
        assert process.stderr.readline().startswith("from another machine: ssh -L ")
        yield line.split()[1], process
        process.terminate()
        process.communicate()


def test_a_teacher_raises_the_wind_scrubs_back_and_goes_on_from_there(served, tmp_path):
    address, _ = served
    with closing(Tab(address, tmp_path / "one")) as tab:
        tab.wait("now.version")
        tab.wait("document.getElementById('note').hidden")  # the picture has come
        tab.wait("frames")
        # play, then raise the wind by its slider until grains fly
        tab.value("name = 'speed_largest_m_s', $('play').click()")
        tab.wait("now.time > 0.004")
        calm = tab.value("now.numbers.speed_largest_m_s")
        slider = "rows.find(r => r.path === 'wind.friction_velocity').element.querySelector('[type=range]')"
        tab.value(f"{slider}.value = 500, {slider}.oninput()")
        tab.wait(f"now.numbers.speed_largest_m_s > {max(3.0 * calm, 0.1)}")
        assert re.search(r"set wind\.friction_velocity 1\.25", tab.value("$('log').innerText"))
        # pause
        tab.value("$('play').click()")
        tab.wait("!now.playing")
        late = tab.value("now.time")
        assert tab.value("new Promise(done => setTimeout(() => done(now.time), 700))") == late
        # scrub back, start there, and compare the curves
        tab.value("$('scrub').value = 1, $('scrub').onchange()")
        tab.wait(f"now.time < {late} && !$('here').hidden")
        assert tab.value("now.kept.at(-1)") == late
        tab.value("$('here').click()")
        tab.wait("now.playing && now.kept.at(-1) !== undefined && earlier.length === 1 && points.length > 1")
        tab.value("$('play').click()")
        tab.wait("!now.playing")
        # a mistyped command is answered, a grain tells its numbers
        tab.value("send('fly')")
        tab.wait("$('log').innerText.includes('is not a command')")
        tab.value("send('grain 12')")
        tab.wait("$('log').innerText.includes('grain 12: radius')")
        for width, height in ((1280, 860), (390, 844)):
            assert tab.picture(width, height).startswith(b"\x89PNG")
            assert tab.value("document.documentElement.scrollWidth <= innerWidth"), "nothing is cut off"
        assert tab.hosts == {address.rstrip("/").rpartition("/")[0]}, "nothing is asked of another server"


def test_a_second_tab_is_told_to_wait_and_a_killed_tab_leaves_the_run_paused_and_saved(served, tmp_path):
    address, _ = served
    with closing(Tab(address, tmp_path / "one")) as first:
        first.wait("now.version")
        first.value("$('play').click()")
        first.wait("now.time > 0.002")
        second = Tab(address, tmp_path / "two")
        second.wait("$('error').innerText.includes('another page steers this session')")
    with closing(second):
        second.wait("now.version")  # after a while it goes on where the first was
        assert second.value("now.playing") is False
        assert second.value("now.time") > 0.002
    assert (tmp_path / "sand.txt").read_text().splitlines()[-1].startswith("run to ")
