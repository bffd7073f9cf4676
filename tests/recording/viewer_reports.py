"""What a viewer without a window fails to draw of a recording."""

import copy
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from taichi_erosion.core.errors import BadInput
from taichi_erosion.recording import viewer

REPORT_SIZE = (1280, 1600)  # px, room for every view
LATE = "Failed to render screenshot"  # a call that took too long; it was made again


@contextmanager
def drawing() -> Iterator[None]:
    """Skips the test where there is no renderer."""
    try:
        yield
    except BadInput as error:
        if str(error) == viewer.NO_RENDERER:
            pytest.skip(viewer.NO_RENDERER)
        raise


def view_reports(path: Path) -> list[str]:
    """What the views failed to draw at the end of the recording, and errors of the viewer's log."""
    with drawing(), viewer.headless_viewer(path, REPORT_SIZE) as client:
        # a view behind a tab is not drawn and so has nothing to report
        client.set_blueprint(without_tabs(client.get_blueprint("recording").blueprint), "recording")
        client.set_time(viewer.TIMELINE, duration=viewer.last_moment(client), play_state="paused")
        time.sleep(viewer.DRAW_TIME)
        viewer.screenshot(client)
        views = client.get_state().views
        if not views:
            return [f"{path}: the viewer shows no view"]
        reports = [f"{view.name}: {report.summary}" for view in views for report in view.reports]
        told = [entry.message for entry in client.get_logs() if entry.level == "ERROR"]
        return reports + [f"viewer: {message}" for message in told if LATE not in message]


def without_tabs(blueprint: dict[str, Any]) -> dict[str, Any]:
    """A blueprint whose tabs lie below each other, all in sight."""
    opened = copy.deepcopy(blueprint)
    for parts in opened.values():
        container = parts.get("ContainerBlueprint", {})
        if container.get("container_kind") == "Tabs":
            container["container_kind"] = "Vertical"
            container.pop("active_tab", None)
    return opened
