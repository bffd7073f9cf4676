from collections.abc import Iterator
from pathlib import Path

import imageio.v3 as imageio
import numpy as np
import pytest
from recorded_heaps import MOVING, header, heap_snapshot, recorded, totals
from viewer_reports import drawing, view_reports

from taichi_erosion.core.errors import BadInput
from taichi_erosion.recording import pictures, stream, viewer
from taichi_erosion.recording.air_recording import log_height_profile
from taichi_erosion.recording.blueprint import WIND_KINDS
from taichi_erosion.recording.pictures import silhouette_picture

pytestmark = pytest.mark.viewer
SIZE = (1000, 700)  # px
MASK = np.tri(60, 120, dtype=bool)


def record(path: Path, kind: str = "repose") -> Iterator[stream.Recording]:
    with recorded(path, header(kind)) as recording:
        for frame in range(10):
            stream.log_frame(recording, heap_snapshot(frame), MOVING)
            stream.log_colour_legend(recording, MOVING)
            stream.log_totals(recording, totals(frame))
            if kind in WIND_KINDS:
                log_height_profile(recording, np.linspace(0.0, 8.0, 12), np.linspace(0.0, 0.06, 13))
                told = {"flux": 1e-3 * frame, "flying": 0.1, "friction_velocity": 0.4}
                stream.log_curve_values(recording, "transport", told)
        stream.log_text(recording, "INFO", "at rest")
        flank = np.array([[[0.0, 0.0], [59.0, 59.0]]])
        stream.log_image(recording, "silhouette", silhouette_picture(MASK, flank))
        yield recording


@pytest.fixture(scope="module")
def heap(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A whole recording and beside it its picture, where a renderer is there to draw it."""
    path = tmp_path_factory.mktemp("viewer") / "heap.rrd"
    list(record(path))
    with drawing():
        viewer.render_picture(path, None, path.with_suffix(".png"), size=SIZE)
    return path


def share_like(image: np.ndarray, colour: tuple[int, int, int], tolerance: float = 0.12) -> float:
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


def test_the_picture_shows_the_heap_in_its_middle_and_what_was_recorded_beside_it(heap: Path):
    image = imageio.imread(heap.with_suffix(".png"))
    assert image.shape[1::-1] == SIZE
    height, edge = image.shape[0], 5 * image.shape[1] // 8
    # the legend of colours has the lowest ninth
    middle = image[height // 3 : -height // 4, edge // 4 : -(image.shape[1] - edge + edge // 4)]
    assert share_like(middle, pictures.SAND) > 0.2
    beside = np.array_split(image[:, edge:], 4)
    # a silhouette, a quarter of whose mask is sand; one falling curve; one rising curve
    views = ((pictures.SAND, 0.02), (pictures.EMBER, 0.001), (pictures.SAND, 0.001))
    for view, (colour, least) in zip(beside, views, strict=False):
        assert share_like(view, colour) > least


def test_a_machine_without_a_renderer_is_told_what_to_install(tmp_path, monkeypatch):
    path = tmp_path / "heap.rrd"
    list(record(path))
    for variable in ("VK_ICD_FILENAMES", "VK_DRIVER_FILES"):  # the loader's old and new name
        monkeypatch.setenv(variable, str(tmp_path / "no_driver.json"))
    monkeypatch.setenv("WGPU_BACKEND", "vulkan")
    with pytest.raises(BadInput, match="mesa-vulkan-drivers and libvulkan1"):
        viewer.render_picture(path, 0.0, tmp_path / "out.png")
    assert not (tmp_path / "out.png").exists()
