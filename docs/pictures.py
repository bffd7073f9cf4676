"""Draws the pictures of the pages from the program's own commands: `python docs/pictures.py [NAME]...`.

sample   a moment of recordings/sample.rrd in the viewer
heap     its heap from the side, for the page on photographs
live     a session in a terminal
study    doe/first_calibration.toml in the viewer, once it has been calibrated
funnel   scenes/funnel_repose.toml while it pours, in the viewer
"""

import io
import os
import pty
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.text import Text

from taichi_erosion.cli.live import PROMPT
from taichi_erosion.cli.main import main as command
from taichi_erosion.recording.pictures import SideView, render_side, resting_colours, write_png
from taichi_erosion.recording.readback import read_grains

DOCS = Path(__file__).resolve().parent
PICTURES = DOCS / "pictures"
SAMPLE = DOCS.parent / "recordings" / "sample.rrd"
STUDY = DOCS.parent / "doe" / "funnel_soil.toml"
FIRST = DOCS.parent / "doe" / "first_calibration.toml"
FUNNEL = DOCS.parent / "scenes" / "funnel_repose.toml"
MOMENT = 1.0  # s, of the sample: grains run out below the tube
POURING = 0.4  # s
MARGIN = 0.004  # m beside the heap
PAPER = 240  # grey of the wall behind the heap [1]
DARK = 0.55  # brightness of soil over that of dry sand [1]
HEAP_SIZE = (900, 360)  # px
FONT_FROM_AFAR = re.compile(r"@font-face \{.*?\}\s*", re.DOTALL)  # the picture asks no server for anything
WIDTH = 88  # characters
SCENE = "scenes/column_collapse.toml"
CHANGES = ["grains.count=400", "geometry.tube.radius_d=5.0", "fill.radius_d=4.3"]
ORDERS = (
    "run until rest",
    "stage",
    "run 0.03s",
    "show",
    "help contact.grain-grain.friction_rolling",
    "set contact.grain-grain.friction_rolling 0.4",
    "run until rest",
    "measure",
    "quit",
)


def draw_sample() -> None:
    """A moment in the viewer."""
    command(["snapshot", str(SAMPLE), "--time", str(MOMENT), "-o", str(PICTURES / "sample.png")])


def draw_heap() -> None:
    """The last frame from the side, without lettering: what a photograph would show."""
    heap = read_grains(SAMPLE)[-1]
    position, radius = heap.position.astype(np.float64), heap.radius.astype(np.float64)
    reach = float(np.abs(position[:, 0]).max()) + MARGIN
    view = SideView((-reach, 0.0), (reach, float(position[:, 2].max()) + MARGIN), HEAP_SIZE)
    soil = (DARK * resting_colours(heap.ident)).astype(np.uint8)
    drawn, empty = render_side(position, radius, view, soil), render_side(position[:0], radius[:0], view)
    drawn[(drawn == empty).all(axis=-1)] = PAPER
    write_png(PICTURES / "heap.png", drawn)


def draw_study() -> None:
    """A study that keeps figures and tables, in the viewer."""
    command(["snapshot", str(STUDY), "-o", str(PICTURES / "study.png")])


def draw_first() -> None:
    """A study that keeps recordings of its last step, in the viewer."""
    command(["snapshot", str(FIRST), "-o", str(PICTURES / "first_calibration.png")])


def draw_funnel() -> None:
    """The funnel test while soil runs."""
    record = DOCS.parent / "recordings" / "funnel_repose.rrd"
    command(["run", str(FUNNEL), "--replicas", "1", "--record", str(record)])
    command(["snapshot", str(record), "--time", str(POURING), "-o", str(PICTURES / "funnel_repose.png")])


def draw_live() -> None:
    """A session as a terminal shows it."""
    said = "".join(session())
    console = Console(
        record=True, width=WIDTH, file=io.StringIO(), force_terminal=True, color_system="truecolor"
    )
    console.print(Text(f"$ ./erosion live {SCENE}\n") + Text.from_ansi(said))
    page = FONT_FROM_AFAR.sub("", console.export_svg(title="./erosion live", unique_id="live"))
    (PICTURES / "live.svg").write_text(page, encoding="utf-8")


def session() -> Iterator[str]:
    """What a session on a terminal prints, typed orders included."""
    master, slave = pty.openpty()
    changes = [word for change in CHANGES for word in ("--set", change)]
    words = [sys.executable, "-m", "taichi_erosion", "live", SCENE, *changes]
    environment = {**os.environ, "TERM": "dumb", "COLUMNS": str(WIDTH)}
    environment.pop("NO_COLOR", None)
    child = subprocess.Popen(
        words, stdin=slave, stdout=slave, stderr=subprocess.DEVNULL, cwd=DOCS.parent, env=environment
    )
    os.close(slave)
    for order in ORDERS:
        yield until_prompt(master)
        os.write(master, f"{order}\n".encode())
    yield until_prompt(master)
    child.wait()
    os.close(master)


def until_prompt(terminal: int) -> str:
    """What is printed until the next prompt, or until the end."""
    said = b""
    while not said.endswith(PROMPT.encode()):
        try:
            part = os.read(terminal, 1 << 16)
        except OSError:  # the session has ended
            break
        if not part:
            break
        said += part
    return said.decode().replace("\r\n", "\n")


DRAWN = {
    "sample": draw_sample,
    "heap": draw_heap,
    "live": draw_live,
    "study": draw_study,
    "first": draw_first,
    "funnel": draw_funnel,
}

if __name__ == "__main__":
    for name in sys.argv[1:] or DRAWN:
        DRAWN[name]()
