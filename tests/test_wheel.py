"""Contents and output of the wheel: product files only, and the same output as the source tree.

The wheel is installed into an empty environment outside the repository. Its dependencies come from the
environment of the tests through a path file, which does not follow the editable installation there.
"""

import json
import os
import re
import shutil
import subprocess
import sys
import sysconfig
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / "taichi_erosion"
SCENE, STUDY, PAGE = "lid_cavity.toml", "my_lab.toml", "page.html"
SHIPPED_SCENES = (  # those from which `study new` and `wind` start
    *("column_collapse.toml", "funnel_repose.toml", "impact_threshold.toml", "lifting_cylinder.toml"),
    *("quartz_flux.toml", "quartz_wind.toml", "rotating_drum.toml", "saltation.toml", "wind_threshold.toml"),
)
STUDY_FILES = (STUDY, "my_lab.py", "measured/my_lab.csv")
COMMANDS = {
    "effects NAME": ("effects", "liquid_bridge"),  # has rows in every table of measured values
    "run": ("run", SCENE, "--check", "--json"),
    "compare": ("compare", STUDY, "--json"),
    "report": ("report", STUDY, "-o", PAGE),
}
WALL_TIME = re.compile(r'\b[0-9.e+-]+ s\b|"wall_s": [0-9.e+-]+')
DRIVER = """
import io, json, sys
from contextlib import redirect_stdout
import taichi_erosion
from taichi_erosion.cli.main import main

printed = {"file": taichi_erosion.__file__}
for name, words in json.loads(sys.argv[1]).items():
    page = io.StringIO()
    with redirect_stdout(page):
        assert main(words) == 0, name
    printed[name] = page.getvalue()
print(json.dumps(printed))
"""


@pytest.fixture(scope="session")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("wheel")
    command = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(folder)]
    built = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert built.returncode == 0, built.stderr
    (file,) = folder.glob("*.whl")
    return file


def outputs(python: str | Path, path: str, work: Path) -> dict[str, str]:
    """What the commands print by a Python that finds the package on a path; with the page of `report`."""
    (work / "measured").mkdir(parents=True)
    for file in (*(ROOT / "doe" / name for name in STUDY_FILES), ROOT / "scenes" / SCENE):
        shutil.copy(file, work / ("measured" if file.suffix == ".csv" else ""))
    command = [str(python), "-c", DRIVER, json.dumps(COMMANDS)]
    environment = os.environ | {"PYTHONPATH": path}
    done = subprocess.run(command, cwd=work, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout) | {"page": (work / PAGE).read_text(encoding="utf-8")}


def test_the_wheel_holds_the_product_and_nothing_else(wheel: Path) -> None:
    with zipfile.ZipFile(wheel) as archive:
        names = [name for name in archive.namelist() if ".dist-info/" not in name]
        files = (path for path in PACKAGE.rglob("*") if path.is_file() and "__pycache__" not in path.parts)
        scenes = [f"taichi_erosion/scene/shipped/{name}" for name in SHIPPED_SCENES]
        assert sorted(names) == sorted([*(path.relative_to(ROOT).as_posix() for path in files), *scenes])
        for scene in scenes:
            assert archive.read(scene) == (ROOT / "scenes" / Path(scene).name).read_bytes()


def test_the_package_imports_no_study_and_no_test() -> None:
    forbidden = re.compile(r"^\s*(?:from|import) (?:doe|tests|benchmarks|docs)\b", re.MULTILINE)
    found = [path for path in PACKAGE.rglob("*.py") if forbidden.search(path.read_text(encoding="utf-8"))]
    assert found == []


def test_the_installed_program_prints_what_the_source_tree_prints(wheel: Path, tmp_path: Path) -> None:
    python = tmp_path / "environment" / "bin" / "python"
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", str(python.parents[1])], check=True)
    query = [str(python), "-c", "import sysconfig; print(sysconfig.get_path('purelib'))"]
    site = Path(subprocess.run(query, capture_output=True, text=True, check=True).stdout.strip())
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(site)
    (site / "dependencies.pth").write_text(sysconfig.get_path("purelib") + "\n")
    installed = outputs(python, "", tmp_path / "installed")
    from_source = outputs(sys.executable, str(ROOT), tmp_path / "source")
    assert Path(installed.pop("file")).is_relative_to(site)
    assert Path(from_source.pop("file")).is_relative_to(PACKAGE)
    assert set(installed) == {*COMMANDS, "page"}
    for name, text in from_source.items():
        assert text, name
        assert WALL_TIME.sub("", installed[name]) == WALL_TIME.sub("", text), name
