"""Audits the tables of Hao et al. (2022), draws the figures and fills docs/hao2022.md.

python doe/hao2022/page.py
"""

from pathlib import Path

from taichi_erosion.report.hao2022 import publish

FOLDER = Path(__file__).parent

if __name__ == "__main__":
    publish(FOLDER, FOLDER.parents[1] / "docs")
