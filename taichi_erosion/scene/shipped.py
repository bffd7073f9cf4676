"""Folder of the scenes that come with the program: in the package where it is installed, else beside it."""

from pathlib import Path

INSTALLED, SOURCE = Path(__file__).parent / "shipped", Path(__file__).parents[2] / "scenes"
SCENES = INSTALLED if INSTALLED.is_dir() else SOURCE
