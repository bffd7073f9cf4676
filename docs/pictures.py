"""Draws the pictures of the pages by commands of the program: `python docs/pictures.py [NAME]...`.

sample   one moment of recordings/sample.rrd in the viewer
heap     its heap from the side, for docs/photograph.md
page     a film of a live session in the browser, for docs/live_and_python.md; needs Chromium
study    the results of doe/funnel_soil.toml in the viewer
wind     thresholds and fluxes of fine sand beside formulas, for docs/quick_start.md; seven minutes
table    thresholds of doe/windkanal.csv, measured and calculated, for docs/your_table.md
million  the end of scenes/million_grains.toml from the side, for docs/speed.md; 54 minutes of one core
benches  a hopper, a press, a shear box and a heap between walls, for docs/scene_files.md
"""

import io
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw, ImageFont

import taichi_erosion as te
from taichi_erosion.cli.main import main as command
from taichi_erosion.execution.recorder import resting_speed
from taichi_erosion.execution.session import Session, present_wall_meshes
from taichi_erosion.recording.pictures import (
    SideView,
    grain_colours,
    render_side,
    resting_colours,
    scale_bar_length,
    speed_colours,
    write_png,
)
from taichi_erosion.recording.readback import read_grains
from taichi_erosion.recording.stream import FASTEST_COLOUR
from taichi_erosion.simulation import snapshot

DOCS = Path(__file__).resolve().parent
PICTURES = DOCS / "pictures"
SAMPLE = DOCS.parent / "recordings" / "sample.rrd"
STUDY = DOCS.parent / "doe" / "funnel_soil.toml"
TABLE = DOCS.parent / "doe" / "windkanal.csv"
MILLION = DOCS.parent / "recordings" / "million_grains.rrd"
MOMENT = 1.0  # s, of the sample: grains flow out below the tube
MARGIN = 0.004  # m beside the heap
PAPER = 240  # grey level of the background
DARK = 0.55  # brightness of soil over that of dry sand [1]
HEAP_SIZE = (900, 360)  # px
BED = 1.7e-3  # m, top of the bed of a million
PATCH = (0.0, -0.002), (0.121, 0.028), (1210, 300)  # m, m, px: all of its bed, and the air above it
BENCHES = {"hopper": (1, 0.2), "uniaxial_press": (4, 0.1), "shear_box": (3, 0.32), "hele_shaw": (0, 2.0)}
BENCH_SIZE, BENCH_ROOM = (480, 400), 0.004  # px; m around the grains
LIGHT = 1.25  # brightness of grains over that on a dark background [1]
PAGE_SIZE, PAGE_PICTURES = (1120, 760), 30  # px
PAGE_CHANGES = ("stages.0.duration_max=0.02", "run.check_interval=1e-3")
ROW = "rows.find(row => row.path === '{}').element.querySelector('[type=range]')"
WIND, GRAVITY = ROW.format("wind.friction_velocity"), ROW.format("gravity.magnitude")
PAGE_ORDERS = [  # what is done before a picture
    *(
        (5 + k, f"slider = {WIND}, slider.value = {value}, slider.oninput()")
        for k, value in enumerate((250, 330, 380, 420))
    ),
    (17, "$('play').click()"),
    (19, "$('scrub').value = Math.floor($('scrub').max / 3), $('scrub').onchange()"),
    (21, f"slider = {GRAVITY}, slider.value = 41, slider.oninput()"),
    (22, "$('here').click()"),
]


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


def draw_million() -> None:
    """Grains in flight above a bed of a million, coloured by height."""
    if not MILLION.exists():
        command(["run", str(DOCS.parent / "scenes" / "million_grains.toml"), "--record", str(MILLION)])
    last = read_grains(MILLION)[-1]
    position, radius = last.position.astype(np.float64), last.radius.astype(np.float64)
    flying = position[:, 2] > BED
    colours = resting_colours(last.ident)
    colours[flying] = speed_colours(position[flying, 2], BED, PATCH[1][1])
    drawn = render_side(position, radius, SideView(*PATCH), colours)
    drawn.quantize(200, dither=Image.Dither.NONE).save(PICTURES / "million_grains.png", optimize=True)


def draw_study() -> None:
    """Results of a study in the viewer."""
    command(["snapshot", str(STUDY), "-o", str(PICTURES / "study.png"), "--force"])


def draw_wind() -> None:
    """Survey of fine sand under two winds, in seven minutes on two cores."""
    with tempfile.TemporaryDirectory() as folder:
        command(["wind", "--sand", "0.18mm", "--wind", "0.3,0.4", "--out", folder])
        shutil.copy(Path(folder) / "wind.png", PICTURES)


def draw_table() -> None:
    """Figure of an adopted effect."""
    with tempfile.TemporaryDirectory() as folder:
        study = te.new_study(TABLE, out=folder, closed_form=True)
        study.adopt(*study.discover().named).figure().savefig(PICTURES / "your_table.png", dpi=110)


def draw_page() -> None:
    """Film of the page of a live session in headless Chromium: the wind rises, the run goes back and on."""
    from tests.api.test_page_in_chromium import Tab

    changes = [word for change in PAGE_CHANGES for word in ("--set", change)]
    with tempfile.TemporaryDirectory() as folder:
        words = [sys.executable, "-m", "taichi_erosion", "live", "scenes/saltation.toml", "--web", *changes]
        words += ["--record", f"{folder}/page.rrd"]
        pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.DEVNULL, "stderr": subprocess.PIPE}
        with subprocess.Popen(words, cwd=DOCS.parent, text=True, **pipes) as session:
            address = next(line for line in session.stderr or () if line.startswith("page: ")).split()[1]
            tab = Tab(address, Path(folder) / "profile")
            tab.wait("document.getElementById('note').hidden && frames")
            tab.value("$('name').value = 'speed_largest_m_s', $('name').onchange(), $('play').click()")
            film = []
            for number in range(PAGE_PICTURES):
                for order in (order for moment, order in PAGE_ORDERS if moment == number):
                    tab.value(order)
                film.append(Image.open(io.BytesIO(tab.picture(*PAGE_SIZE))).convert("RGB"))
            tab.close()
            session.terminate()
    options = {"duration": 350, "loop": 0, "quality": 60, "method": 6}
    film[0].save(PICTURES / "page.webp", save_all=True, append_images=film[1:], **options)


def draw_benches() -> None:
    """Each bench after a time in one of its stages, side by side, on a light background."""
    parts = []
    for bench, (number, seconds) in BENCHES.items():
        live = te.live(DOCS.parent / f"scenes/{bench}.toml")
        for stage in live.session.scene.stages[:number]:
            live.run_until_rest() if stage.until == "rest" else live.run(stage.duration_max)
            live.next_stage()
        live.run(seconds)
        parts.append(bench_picture(live.session))
    whole = Image.new("RGB", (sum(part.width for part in parts), parts[0].height))
    for place, part in enumerate(parts):
        whole.paste(part, (place * part.width, 0))
    whole.quantize(200, dither=Image.Dither.NONE).save(PICTURES / "benches.png", optimize=True)


def bench_picture(session: Session) -> Image.Image:
    """Grains and walls of a session seen from the side, with their scale, without lettering of a film."""
    now = snapshot(session.sim, 0)
    low, high = now.position.min(axis=0) - BENCH_ROOM, now.position.max(axis=0) + BENCH_ROOM
    view = SideView((low[0], low[2]), (high[0], high[2]), BENCH_SIZE)
    speeds = resting_speed(session.sim.setups[0]), FASTEST_COLOUR
    colours = np.minimum(LIGHT * grain_colours(now, *speeds), 255).astype(np.uint8)
    drawn = np.array(render_side(now.position, now.radius, view, colours, present_wall_meshes(session)))
    empty = np.asarray(render_side(now.position[:0], now.radius[:0], view))
    drawn[(drawn == empty).all(axis=-1)] = PAPER
    picture = Image.fromarray(drawn)
    length = scale_bar_length(1e3 * 0.25 * BENCH_SIZE[0] / view.scale)
    right, row = BENCH_SIZE[0] - 12, 16
    draw, left = ImageDraw.Draw(picture), right - 1e-3 * length * view.scale
    draw.line((left, row, right, row), "black", 2)
    draw.text((0.5 * (left + right), row + 5), f"{length:g} mm", "black", ImageFont.load_default(14), "mt")
    return picture


DRAWN = {
    "sample": draw_sample,
    "heap": draw_heap,
    "page": draw_page,
    "study": draw_study,
    "table": draw_table,
    "wind": draw_wind,
    "benches": draw_benches,
    "million": draw_million,
}

if __name__ == "__main__":
    for name in sys.argv[1:] or DRAWN:
        DRAWN[name]()
