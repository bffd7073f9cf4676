"""Audits the tables of Hao et al. (2022), draws the figures and fills the tables of its README.

python -m doe.hao2022.page
"""

from pathlib import Path

from doe.common.command import words
from doe.hao2022.tables import publish

FOLDER = Path(__file__).parent

if __name__ == "__main__":
    words(__doc__)
    publish(FOLDER, FOLDER.parents[1] / "docs")
