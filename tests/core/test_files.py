"""A command replaces what it wrote from the same source, and nothing else."""

from collections.abc import Callable
from pathlib import Path

import imageio.v3 as imageio
import numpy as np
import pytest

from taichi_erosion.core import files
from taichi_erosion.core.errors import BadInput

TEXT = "[a]\nb = 1\n"
PICTURE = np.random.default_rng(1).integers(0, 256, (20, 30, 3), dtype=np.uint8)
PNG = imageio.imwrite("<bytes>", PICTURE, extension=".png")
MARKED: dict[str, Callable[[Path, Path], bytes]] = {
    "out.toml": lambda path, source: files.mark_toml(path, source, TEXT),
    "out.png": lambda path, source: files.mark_png(path, source, PNG),
    "out.html": lambda path, source: files.mark_html(path, source, "<html><head></head></html>"),
}
CHANGED = files.mark_toml(Path("out.toml"), Path("höhe, 1.toml"), TEXT).replace(b"b = 1", b"b = 2")


@pytest.fixture
def study(tmp_path: Path) -> Path:
    path = tmp_path / "here" / "höhe, 1.toml"
    path.parent.mkdir()
    path.write_text("[study]\n", encoding="utf-8")
    return path


@pytest.mark.parametrize("name", MARKED)
def test_a_file_is_written_again_from_its_source_alone(study, tmp_path, monkeypatch, name):
    path = study.with_name(name)
    path.write_bytes(MARKED[name](path, study))
    files.refuse_foreign_file(path, study)
    with pytest.raises(BadInput, match=r"made from höhe, 1\.toml, not from"):
        files.refuse_foreign_file(path, study.with_name("other.toml"))
    study.parent.rename(tmp_path / "moved")
    monkeypatch.chdir(tmp_path / "moved")
    files.refuse_foreign_file(Path(name), Path(study.name))
    files.refuse_foreign_file(Path("nothing.toml"), Path(study.name))


@pytest.mark.parametrize(
    ("content", "told"),
    [
        *((content, "this program did not write it; move it") for content in (b"", b"mine", b"\xff\x00")),
        (CHANGED, "was changed after this program wrote it"),
    ],
)
def test_what_a_user_wrote_or_changed_is_refused_unless_by_force(study, content, told):
    path = study.with_name("out.toml")
    path.write_bytes(content)
    with pytest.raises(BadInput, match=told):
        files.refuse_foreign_file(path, study)
    files.refuse_foreign_file(path, study, force=True)


def test_a_marked_text_and_a_marked_picture_hold_what_they_held(study):
    path = study.with_name("out.png")
    path.write_bytes(files.mark_png(path, study, PNG))
    assert np.array_equal(imageio.imread(path), PICTURE)
    assert files.remove_mark(files.mark_toml(path, study, TEXT).decode()) == files.remove_mark(TEXT) == TEXT


def test_tables_of_a_folder_are_known_by_its_list(tmp_path):
    folder = files.ListedFolder(tmp_path / "study")
    folder.write_file("screen.csv", b"a,b\n1,\n")
    folder.refuse_foreign_files(["screen.csv", "climb.csv"])
    (folder.path / "screen.csv").write_text("a,b\n1,31.5\n")
    (folder.path / "README.md").write_text("my notes")
    refusals = {"screen.csv": "was changed after", "README.md": "exists, and this program did not"}
    for name, told in refusals.items():
        with pytest.raises(BadInput, match=f"{name}: {told}"):
            folder.refuse_foreign_files([name])
    folder.refuse_foreign_files(["screen.csv", "README.md"], force=True)
