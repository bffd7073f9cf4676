"""Whatever a file holds, it is read or refused in one line: no traceback, no hang, nothing written or run.

The default tests try a few damaged files of every kind; all 2,100 take minutes:
`./erosion test tests/hostile -m slow -n 0`.
"""

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import damaged_files as files
import pytest
from audit_hook import watched
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from taichi_erosion.campaign.study_file import read_calibration_study, read_evidence_study
from taichi_erosion.cli.main import ExitCode, main
from taichi_erosion.core.errors import BadInput
from taichi_erosion.evidence.data.measured import read_measured_table

FEW, MANY = 12, 300  # files of a kind by default, and when asked for all: seven kinds
SECTIONS = ["scene", "grains", "geometry", "fill", "stages"]


def tried(strategy: Any) -> Callable[[Any], Any]:
    """Run a test over a few generated files, and, marked slow, over many."""

    def decorate(check: Callable[..., None]) -> Any:
        @pytest.mark.parametrize("count", [FEW, pytest.param(MANY, marks=pytest.mark.slow)])
        def test(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any, count: int) -> None:
            monkeypatch.chdir(tmp_path)
            calm = [HealthCheck.too_slow, HealthCheck.data_too_large, HealthCheck.filter_too_much]

            @settings(max_examples=count, suppress_health_check=calm)
            @given(strategy)
            def every(example: Any) -> None:
                check(example, tmp_path, capsys)

            every()

        return test

    return decorate


def read_or_refused(act: Callable[[Path], Any], path: Path) -> None:
    """A function that reads a file returns, or raises BadInput with one line that names the file."""
    with watched(path.parent) as watch:
        try:
            act(path)
            line = None
        except BadInput as error:
            line = str(error)
    assert not watch.trespasses
    assert line is None or ("\n" not in line and path.name in line), line


def command_ends_well(words: list[str], folder: Path, capsys: Any) -> None:
    """A command ends with its result, or with exit code 2, one line for each fault, and no file."""
    before = set(os.listdir(folder))
    with watched(folder) as watch:
        code = main(words)
    said = capsys.readouterr()
    assert not watch.trespasses
    assert code in (ExitCode.SUCCESS, ExitCode.BAD_INPUT), said.err
    if code == ExitCode.BAD_INPUT:
        assert said.err
        assert set(os.listdir(folder)) == before


def put(folder: Path, name: str, content: bytes) -> Path:
    path = folder / Path(name).name
    path.write_bytes(content)
    return path


@tried(files.damaged_file(files.SCENES))
def test_a_damaged_scene(example: tuple[str, bytes], folder: Path, capsys: Any) -> None:
    command_ends_well(["run", str(put(folder, "scene.toml", example[1])), "--check"], folder, capsys)


@tried(
    st.tuples(
        st.sampled_from(sorted(files.SCENES)),
        st.dictionaries(files.WORDS | st.sampled_from(SECTIONS), files.VALUES, max_size=2),
        files.VALUES,
    )
)
def test_an_order_that_changes_a_scene(example: Any, folder: Path, capsys: Any) -> None:
    name, entries, value = example
    orders = [f"{key}={entry}" for key, entry in (entries | {"run": value, "grains.size": value}).items()]
    words = [word for order in orders for word in ("--set", order.replace("\0", ""))]
    command_ends_well(["run", str(files.ROOT / name), "--check", *words], folder, capsys)


@tried(files.damaged_file(files.STUDIES))
def test_a_damaged_study(example: tuple[str, bytes], folder: Path, capsys: Any) -> None:
    path = put(folder, "study.toml", example[1])
    read_or_refused(read_evidence_study, path)
    read_or_refused(read_calibration_study, path)


@tried(files.damaged_file(files.MEASURED) | st.tuples(st.just("table.csv"), files.tables))
def test_a_damaged_table_of_measurements(example: tuple[str, bytes], folder: Path, capsys: Any) -> None:
    read_or_refused(read_measured_table, put(folder, "measured.csv", example[1]))


@tried(files.damaged_file(files.PUBLISHED) | st.tuples(st.just("table.csv"), files.tables))
def test_a_damaged_table_of_runs(example: tuple[str, bytes], folder: Path, capsys: Any) -> None:
    command_ends_well(["audit", str(put(folder, "published.csv", example[1]))], folder, capsys)


def test_a_level_beyond_all_integers_is_audited(tmp_path: Path) -> None:
    table = files.PUBLISHED["doe/hao2022/table_8.csv"].replace(b"\n1,-1,-1,", b"\n1,-11e9,-1,", 1)
    assert table not in files.PUBLISHED.values()
    assert main(["audit", str(put(tmp_path, "published.csv", table))]) == ExitCode.SUCCESS


def with_mesh(folder: Path, name: str, content: bytes) -> list[str]:
    """Words that check a scene with this mesh as a wall."""
    put(folder, name, content)
    path = put(folder, "scene.toml", files.SCENES["scenes/incline.toml"])
    wall = f'geometry.wall={{ shape = "mesh", material = "steel", file = "{name}" }}'
    return ["run", str(path), "--check", "--set", wall]


@tried(files.damaged_file(files.MESHES))
def test_a_damaged_mesh(example: tuple[str, bytes], folder: Path, capsys: Any) -> None:
    command_ends_well(with_mesh(folder, *example), folder, capsys)


def test_a_mesh_whose_corners_are_flat_is_refused(tmp_path: Path, capsys: Any) -> None:
    words = with_mesh(tmp_path, "flat.obj", b"v 0 0\nv 1 0\nv 0 1\nf 1 2 3\n")
    assert main(words) == ExitCode.BAD_INPUT
    assert "flat.obj" in capsys.readouterr().err


@tried(files.damaged_file(files.PICTURES))
def test_a_damaged_picture(example: tuple[str, bytes], folder: Path, capsys: Any) -> None:
    command_ends_well(["measure", "repose", str(put(folder, *example))], folder, capsys)
