"""The report of a calibration: its page in HTML, with the pictures inside."""

import re
from pathlib import Path

from markdown_it import MarkdownIt

from taichi_erosion.campaign.study import read_study
from taichi_erosion.core.errors import BadInput
from taichi_erosion.recording.whole_file import write_whole
from taichi_erosion.report.calibration import PAGE
from taichi_erosion.report.html import render
from taichi_erosion.report.picture import address_of

TEMPLATE = "calibration.html"
PICTURE = re.compile(r'<img src="([^":]+)"')


def write_report(study: Path, to: Path | None = None) -> Path:
    """Write the page of a calibration; raises BadInput where the calibration has not been finished."""
    file = read_study(study)
    source = file.folder / PAGE
    if not source.is_file():
        raise BadInput(f"{study}: not calibrated yet; run doe calibrate on it first")
    title, _, text = source.read_text(encoding="utf-8").partition("\n")
    words = MarkdownIt("commonmark", {"html": False}).enable("table").render(text)
    body = PICTURE.sub(lambda found: f'<img src="{address_of(file.folder / found[1])}"', words)
    about = f"{study}, calibrated by designed experiments"
    page = render(TEMPLATE, {"title": title.removeprefix("# "), "about": about, "body": body})
    return write_whole(to or file.folder / f"{study.stem}.report.html", page.encode())
