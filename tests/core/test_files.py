"""A command replaces what it wrote from the same source, and nothing else."""

from pathlib import Path

import imageio.v3 as imageio
import numpy as np
import pytest

from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.files import (
    ListedFolder,
    is_named,
    marked_html,
    marked_png,
    marked_toml,
    refuse_foreign,
    without_mark,
)


@pytest.fixture
def study(tmp_path: Path) -> Path:
    path = tmp_path / "höhe, 1.toml"
    path.write_text("[study]\n", encoding="utf-8")
    return path


def written(path: Path, source: Path, text: str = "[a]\nb = 1\n") -> Path:
    path.write_bytes(marked_toml(path, source, text))
    return path


def test_a_file_of_the_same_source_may_be_written_again_from_any_folder(study, tmp_path, monkeypatch):
    path = written(tmp_path / "out.toml", study)
    refuse_foreign(path, study)
    monkeypatch.chdir(tmp_path)
    refuse_foreign(Path("out.toml"), Path(study.name))
    refuse_foreign(tmp_path / "nothing.toml", study)


def test_a_tree_that_was_moved_is_still_its_own(study, tmp_path):
    (tmp_path / "here").mkdir()
    written(tmp_path / "here" / "out.toml", study)
    moved = tmp_path.with_name(tmp_path.name + "-moved")
    tmp_path.rename(moved)
    refuse_foreign(moved / "here" / "out.toml", moved / study.name)


@pytest.mark.parametrize("content", [b"", b"mine", b"# made by hand\n", b"\xff\x00"])
def test_a_file_of_the_user_is_refused_unless_by_force(study, tmp_path, content):
    path = tmp_path / "out.toml"
    path.write_bytes(content)
    with pytest.raises(
        BadInput, match="this program did not write it; move it away, or replace it with --force"
    ):
        refuse_foreign(path, study)
    refuse_foreign(path, study, force=True)


def test_what_another_study_wrote_is_refused_with_its_name(study, tmp_path):
    path = written(tmp_path / "out.toml", study)
    with pytest.raises(BadInput, match=r"made from höhe, 1\.toml, not from"):
        refuse_foreign(path, tmp_path / "other.toml")


def test_a_text_that_the_user_changed_is_refused(study, tmp_path):
    path = written(tmp_path / "out.toml", study)
    path.write_text(path.read_text("utf-8").replace("b = 1", "b = 2"), "utf-8")
    with pytest.raises(BadInput, match="was changed after this program wrote it"):
        refuse_foreign(path, study)


def test_a_text_is_marked_once_and_read_without_its_mark(study, tmp_path):
    text = marked_toml(tmp_path / "out.toml", study, "[a]\nb = 1\n").decode()
    assert without_mark(text) == "[a]\nb = 1\n"
    assert without_mark("[a]\nb = 1\n") == "[a]\nb = 1\n"


def test_a_marked_picture_is_the_same_picture(study, tmp_path):
    picture = np.random.default_rng(1).integers(0, 256, (20, 30, 3), dtype=np.uint8)
    path = tmp_path / "out.png"
    path.write_bytes(marked_png(path, study, imageio.imwrite("<bytes>", picture, extension=".png")))
    assert np.array_equal(imageio.imread(path), picture)
    refuse_foreign(path, study)
    with pytest.raises(BadInput, match="not from"):
        refuse_foreign(path, tmp_path / "other.rrd")


def test_a_marked_page_is_known(study, tmp_path):
    path = tmp_path / "page.html"
    path.write_bytes(marked_html(path, study, "<html><head><title>x</title></head></html>"))
    refuse_foreign(path, study)


def test_tables_of_a_folder_are_known_by_its_list(tmp_path):
    folder = ListedFolder(tmp_path / "study")
    folder.write("screen.csv", b"a,b\n1,\n")
    folder.refuse_foreign(["screen.csv", "climb.csv"])
    (folder.path / "screen.csv").write_text("a,b\n1,31.5\n")
    with pytest.raises(BadInput, match=r"screen\.csv: was changed after this program wrote it"):
        folder.refuse_foreign(["screen.csv"])
    (folder.path / "README.md").write_text("my notes")
    with pytest.raises(BadInput, match=r"README\.md: exists, and this program did not write it"):
        folder.refuse_foreign(["README.md"])
    folder.refuse_foreign(["screen.csv", "README.md"], force=True)


def test_an_open_file_that_was_renamed_is_no_longer_at_its_path(tmp_path):
    path = tmp_path / "runs.csv.part"
    with path.open("wb") as file:
        assert is_named(file, path)
        path.rename(tmp_path / "runs.csv")
        assert not is_named(file, path)
        path.touch()
        assert not is_named(file, path), "another file has the name"
