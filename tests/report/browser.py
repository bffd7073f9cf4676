"""Pages in a real browser: what a reader sees on a desk and on a phone, measured by the browser itself.

All pages are opened at once, each in frames of both sizes, so that a test starts one browser.
"""

import json
import re
import shutil
import subprocess
from collections.abc import Mapping
from html import unescape
from pathlib import Path

import pytest

NAMES = ("chromium", "chromium-browser", "google-chrome", "chrome")
BROWSER = next(filter(None, map(shutil.which, NAMES)), "")
SCREENS = {"desk": (1280, 800), "phone": (390, 844)}  # px
TOUCH = 1.0  # px by which boxes of two texts may reach into each other: boxes are higher than their letters

LOOK = """
<script>
addEventListener("load", () => setTimeout(() => {
  const all = (selector, where = document) => [...where.querySelectorAll(selector)];
  const boxes = (selector, where) => all(selector, where).map((one) => [one, one.getBoundingClientRect()])
    .filter(([one, box]) => box.width > 0 && one.textContent.trim());
  const overlaps = [], outside = [];
  for (const svg of document.querySelectorAll("svg")) {
    const texts = boxes("text", svg);
    texts.forEach(([one, a], place) => {
      if (a.right > innerWidth + 1 || a.left < -1) outside.push(one.textContent.trim());
      for (const [other, b] of texts.slice(place + 1)) {
        const wide = Math.min(a.right, b.right) - Math.max(a.left, b.left);
        const high = Math.min(a.bottom, b.bottom) - Math.max(a.top, b.top);
        if (wide > TOUCH && high > 0.35 * Math.min(a.height, b.height))
          overlaps.push(one.textContent.trim() + " | " + other.textContent.trim());
      }
    });
  }
  const drawn = all("figure svg, figure img, p img").map((one) => one.getBoundingClientRect());
  const box = drawn.find((one) => one.width > 0) || { bottom: 1e9, width: 0 };
  const wide = Math.max(document.documentElement.scrollWidth, document.body.scrollWidth);
  const letters = Math.min(99, ...boxes("svg text", document).map(([one, b]) => Math.max(b.height, b.width)));
  const hinted = (one) => one && one.classList.contains("hint") && one.getBoundingClientRect().height > 0;
  const cut = all(".scroll")
    .filter((one) => (one.scrollWidth > one.clientWidth + 1) !== Boolean(hinted(one.previousElementSibling)))
    .map((one) => one.textContent.trim().slice(0, 60));
  parent.postMessage({ name: "NAME", scroll: wide - innerWidth, bottom: box.bottom, width: box.width,
    overlaps, outside, letters, cut, errors: window.complaints }, "*");
}, 200));
</script>
"""
CATCH = """<script>
window.complaints = [];
addEventListener("error", (event) => window.complaints.push(event.message));
</script>"""
HARNESS = """<body><pre id="found"></pre><script>
const found = {};
addEventListener("message", (event) => {
  found[event.data.name] = event.data;
  document.getElementById("found").textContent = JSON.stringify(found);
});
</script>FRAMES</body>"""


def look_at(pages: Mapping[str, Path], folder: Path) -> dict[str, dict]:
    """What the browser measures of every page on every screen, by `PAGE SCREEN`."""
    if not BROWSER:
        pytest.skip("no browser is installed")
    frames = []
    for name, page in pages.items():
        text = page.read_text(encoding="utf-8")
        for screen, (width, height) in SCREENS.items():
            look = LOOK.replace("NAME", f"{name} {screen}").replace("TOUCH", str(TOUCH))
            copy = folder / f"{name}-{screen}.html"
            watched = text.replace("<head>", "<head>" + CATCH, 1).replace("</body>", look + "</body>")
            copy.write_text(watched, "utf-8")
            style = f"width:{width}px;height:{height}px;border:0"
            frames.append(f'<iframe src="{copy.name}" style="{style}"></iframe>')
    (folder / "harness.html").write_text(HARNESS.replace("FRAMES", "\n".join(frames)), encoding="utf-8")
    options = ["--headless", "--no-sandbox", "--disable-gpu", "--virtual-time-budget=8000"]
    options += ["--allow-file-access-from-files", f"--user-data-dir={folder / 'profile'}", "--dump-dom"]
    words = [BROWSER, *options, (folder / "harness.html").as_uri()]
    told = subprocess.run(words, capture_output=True, text=True, timeout=180, check=True)
    answer = re.search(r'<pre id="found">(.*?)</pre>', told.stdout, re.DOTALL)
    assert answer is not None, told.stdout[:500]
    return json.loads(unescape(answer[1]) or "{}")


def assert_readable(pages: Mapping[str, Path], folder: Path) -> None:
    """Every page fits its screen, shows its first figure there, and no text lies on another or is cut off."""
    found = look_at(pages, folder)
    assert set(found) == {f"{name} {screen}" for name in pages for screen in SCREENS}
    for key, page in found.items():
        height = SCREENS[key.rpartition(" ")[2]][1]
        assert page["errors"] == [], key
        assert page["scroll"] <= 0, f"{key} scrolls sideways by {page['scroll']} px"
        assert page["bottom"] <= height, f"{key}: its first figure ends at {page['bottom']:.0f} px"
        assert page["width"] > 200.0, f"{key}: its first figure is {page['width']:.0f} px wide"
        # wide tables have a hint, and narrow ones have none
        assert (page["overlaps"], page["outside"], page["cut"]) == ([], [], []), key
        assert page["letters"] >= 9.0, f"{key}: letters of {page['letters']:.1f} px"
