"""The calibration to try first: valid, small, and safe to ask twice."""

import shutil
from pathlib import Path

import numpy as np
import pandas as pd

from taichi_erosion.cli.main import main

ROOT = Path(__file__).parents[2]
STUDY = Path("doe") / "first_calibration.toml"


def test_asking_for_the_design_again_keeps_the_responses_of_its_runs(tmp_path: Path, capsys) -> None:
    for name in ("scenes/column_collapse.toml", str(STUDY)):
        (tmp_path / name).parent.mkdir()
        shutil.copy(ROOT / name, tmp_path / name)
    words = ["doe", "design", str(tmp_path / STUDY), "--json"]
    assert main(words) == 0
    table = (tmp_path / STUDY).with_suffix("") / "screen.csv"
    planned = pd.read_csv(table)
    assert "centroid_height" not in planned
    planned.assign(centroid_height=np.arange(len(planned), dtype=float)).to_csv(table, index=False)
    kept = table.read_bytes()
    assert main(words) == 2, "the responses were not written by this program"
    assert table.read_bytes() == kept
    assert main([*words, "--force"]) == 0
    assert "centroid_height" not in pd.read_csv(table)
