"""Draws the pictures of the pages by commands of the program: `python docs/pictures.py [NAME]...`.

sample   one moment of recordings/sample.rrd in the viewer
heap     its heap from the side, for docs/photograph.md
live     a live session in a terminal
study    the results of doe/funnel_soil.toml in the viewer
table    thresholds of doe/windkanal.csv, measured and calculated, for docs/your_table.md
benches  a hopper that empties, soil under a press and between plates, for docs/scene_files.md
"""

import io
import os
import pty
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from PIL import Image
from rich.console import Console
from rich.text import Text

import taichi_erosion as te
from taichi_erosion.cli.live import PROMPT
from taichi_erosion.cli.main import main as command
from taichi_erosion.recording.pictures import SideView, render_side, resting_colours, write_png
from taichi_erosion.recording.readback import read_grains

DOCS = Path(__file__).resolve().parent
PICTURES = DOCS / "pictures"
SAMPLE = DOCS.parent / "recordings" / "sample.rrd"
STUDY = DOCS.parent / "doe" / "funnel_soil.toml"
TABLE = DOCS.parent / "doe" / "windkanal.csv"
MOMENT = 1.0  # s, of the sample: grains flow out below the tube
MARGIN = 0.004  # m beside the heap
PAPER = 240  # grey level of the background
DARK = 0.55  # brightness of soil over that of dry sand [1]
HEAP_SIZE = (900, 360)  # px
FONT_FROM_AFAR = re.compile(r"@font-face \{.*?\}\s*", re.DOTALL)  # the picture needs no server
WIDTH = 88  # characters
BENCHES = {"hopper": 0.6, "uniaxial_press": 1.0, "plane_shear": 1.0}  # share of the run that is shown
SCENE = "scenes/column_collapse.toml"
CHANGES = ["grains.count=400", "geometry.tube.radius_d=5.0", "fill.radius_d=4.3"]
COMMANDS = (
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
    """One moment of the sample recording in the viewer."""
    command(["snapshot", str(SAMPLE), "--time", str(MOMENT), "-o", str(PICTURES / "sample.png"), "--force"])


def draw_heap() -> None:
    """Side view of the last frame, without lettering, in the form of a photograph."""
    heap = read_grains(SAMPLE)[-1]
    position, radius = heap.position.astype(np.float64), heap.radius.astype(np.float64)
    reach = float(np.abs(position[:, 0]).max()) + MARGIN
    view = SideView((-reach, 0.0), (reach, float(position[:, 2].max()) + MARGIN), HEAP_SIZE)
    soil = (DARK * resting_colours(heap.ident)).astype(np.uint8)
    drawn = np.array(render_side(position, radius, view, soil))
    empty = np.asarray(render_side(position[:0], radius[:0], view))
    drawn[(drawn == empty).all(axis=-1)] = PAPER
    write_png(PICTURES / "heap.png", Image.fromarray(drawn))


def draw_study() -> None:
    """Results of a study in the viewer."""
    command(["snapshot", str(STUDY), "-o", str(PICTURES / "study.png"), "--force"])


def draw_table() -> None:
    """Figure of an adopted effect."""
    with tempfile.TemporaryDirectory() as folder:
        study = te.new_study(TABLE, out=folder, closed_form=True)
        study.adopt(*study.discover().named).figure().savefig(PICTURES / "your_table.png", dpi=110)


def draw_live() -> None:
    """A live session as SVG of a terminal."""
    shown = "".join(terminal_output())
    console = Console(
        record=True, width=WIDTH, file=io.StringIO(), force_terminal=True, color_system="truecolor"
    )
    console.print(Text(f"$ ./erosion live {SCENE}\n") + Text.from_ansi(shown))
    page = FONT_FROM_AFAR.sub("", console.export_svg(title="./erosion live", unique_id="live"))
    (PICTURES / "live.svg").write_text(page, encoding="utf-8")


def terminal_output() -> Iterator[str]:
    """Output of a session on a terminal, with the typed commands."""
    master, slave = pty.openpty()
    changes = [word for change in CHANGES for word in ("--set", change)]
    words = [sys.executable, "-m", "taichi_erosion", "live", SCENE, *changes]
    environment = {**os.environ, "TERM": "dumb", "COLUMNS": str(WIDTH)}
    environment.pop("NO_COLOR", None)
    child = subprocess.Popen(
        words, stdin=slave, stdout=slave, stderr=subprocess.DEVNULL, cwd=DOCS.parent, env=environment
    )
    os.close(slave)
    for line in COMMANDS:
        yield until_prompt(master)
        os.write(master, f"{line}\n".encode())
    yield until_prompt(master)
    child.wait()
    os.close(master)


def until_prompt(terminal: int) -> str:
    """Output up to the next prompt, or up to the end."""
    read = b""
    while not read.endswith(PROMPT.encode()):
        try:
            part = os.read(terminal, 1 << 16)
        except OSError:  # the session has ended
            break
        if not part:
            break
        read += part
    return read.decode().replace("\r\n", "\n")


def draw_benches() -> None:
    """One moment of the film of each bench, side by side."""
    parts = []
    with tempfile.TemporaryDirectory() as folder:
        for bench, share in BENCHES.items():
            record = Path(folder) / f"{bench}.rrd"
            command(["run", f"scenes/{bench}.toml", "--replicas", "1", "--record", str(record)])
            with Image.open(record.with_suffix(".gif")) as film:
                film.seek(int(share * (getattr(film, "n_frames", 1) - 1)))
                parts.append(film.convert("RGB"))
    whole = Image.new("RGB", (sum(part.width for part in parts), max(part.height for part in parts)), "white")
    for place, part in enumerate(parts):
        whole.paste(part, (sum(each.width for each in parts[:place]), whole.height - part.height))
    whole.quantize(64).save(PICTURES / "benches.png", optimize=True)


DRAWN = {
    "sample": draw_sample,
    "heap": draw_heap,
    "live": draw_live,
    "study": draw_study,
    "table": draw_table,
    "benches": draw_benches,
}

if __name__ == "__main__":
    for name in sys.argv[1:] or DRAWN:
        DRAWN[name]()
