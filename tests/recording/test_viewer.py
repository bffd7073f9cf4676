from collections.abc import Iterator
from pathlib import Path

import imageio.v3 as imageio
import numpy as np
import pytest
from recorded_heaps import MOVING, header, heap_snapshot, recorded, totals
from viewer_reports import drawing, view_reports

from taichi_erosion.core.errors import BadInput
from taichi_erosion.recording import pictures, viewer
from taichi_erosion.recording.air_recording import log_profile
from taichi_erosion.recording.blueprint import WIND_KINDS
from taichi_erosion.recording.pictures import silhouette_picture
from taichi_erosion.recording.stream import (
    Recording,
    log_colours,
    log_frame,
    log_image,
    log_text,
    log_totals,
    log_values,
)

pytestmark = pytest.mark.viewer
Colour = tuple[int, int, int]
SIZE = (1000, 700)  # px
MASK = np.tri(60, 120, dtype=bool)


def record(path: Path, kind: str = "repose") -> Iterator[Recording]:
    """A recording that fills every view."""
    with recorded(path, header(kind)) as recording:
        for frame in range(10):
            log_frame(recording, heap_snapshot(frame), MOVING)
            log_colours(recording, MOVING)
            log_totals(recording, totals(frame))
            if kind in WIND_KINDS:
                log_profile(recording, np.linspace(0.0, 8.0, 12), np.linspace(0.0, 0.06, 13))
                log_values(
                    recording, "transport", {"flux": 1e-3 * frame, "flying": 0.1, "friction_velocity": 0.4}
                )
        log_text(recording, "INFO", "at rest")
        log_image(recording, "silhouette", silhouette_picture(MASK, np.array([[[0.0, 0.0], [59.0, 59.0]]])))
        yield recording


@pytest.fixture(scope="module")
def heap(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A whole recording and beside it its picture, where a renderer is there to draw it."""
    path = tmp_path_factory.mktemp("viewer") / "heap.rrd"
    list(record(path))
    with drawing():
        viewer.render_picture(path, None, path.with_suffix(".png"), size=SIZE)
    return path


def share_like(image: np.ndarray, colour: Colour, tolerance: float = 0.12) -> float:
    """Share of pixels of about this hue: up to `tolerance` rad apart in colour space, dark ones left out."""
    pixels = image[..., :3].reshape(-1, 3).astype(float)
    lengths = np.linalg.norm(pixels, axis=1)
    cosine = pixels @ np.array(colour) / (np.maximum(lengths, 1.0) * np.linalg.norm(colour))
    return float(((cosine > np.cos(tolerance)) & (lengths > 60.0)).mean())


@pytest.mark.parametrize("kind", ["repose", "saltation"])
def test_every_view_draws_without_a_report(heap: Path, tmp_path: Path, kind: str):
    path = tmp_path / f"{kind}.rrd"
    list(record(path, kind))
    assert view_reports(path) == []


@pytest.mark.parametrize(
    ("rows", "colour", "least"),
    [
        ((0.0, 0.25), pictures.SAND, 0.02),  # silhouette, a quarter of whose mask is sand
        ((0.25, 0.5), pictures.EMBER, 0.001),  # one falling curve
        ((0.5, 0.75), pictures.SAND, 0.001),  # one rising curve
    ],
)
def test_every_view_beside_the_grains_shows_what_was_recorded(
    heap: Path, rows: tuple[float, float], colour: Colour, least: float
):
    image = imageio.imread(heap.with_suffix(".png"))
    low, high = (round(share * image.shape[0]) for share in rows)
    assert share_like(image[low:high, 5 * image.shape[1] // 8 :], colour) > least


def test_the_picture_has_the_size_asked_for_and_the_heap_in_its_middle(heap: Path):
    image = imageio.imread(heap.with_suffix(".png"))
    assert image.shape[1::-1] == SIZE
    left = image[:, : 5 * image.shape[1] // 8]
    # the legend of colours has the lowest ninth
    middle = left[left.shape[0] // 3 : -left.shape[0] // 4, left.shape[1] // 4 : -left.shape[1] // 4]
    assert share_like(middle, pictures.SAND) > 0.2


def test_a_machine_without_a_renderer_is_told_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    path = tmp_path / "heap.rrd"
    list(record(path))
    for variable in ("VK_ICD_FILENAMES", "VK_DRIVER_FILES"):  # the loader's old and new name
        monkeypatch.setenv(variable, str(tmp_path / "no_driver.json"))
    monkeypatch.setenv("WGPU_BACKEND", "vulkan")
    with pytest.raises(BadInput, match="mesa-vulkan-drivers and libvulkan1"):
        viewer.render_picture(path, 0.0, tmp_path / "out.png")
    assert not (tmp_path / "out.png").exists()
