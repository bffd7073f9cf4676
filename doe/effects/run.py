"""What each effect does where the answer is known, and what it costs; writes tables and the page of effects.

python -m doe.effects.run              all groups, then the page
python -m doe.effects.run GROUP...     some of: pocket flight bounce rolling reading cost
python -m doe.effects.run --page       only the figure and the tables of the page
"""

from pathlib import Path

from doe.common.cases import MEASURED, ROOT
from doe.common.command import words
from doe.common.tables import write_table
from doe.effects.answers import GROUPS, write_answers
from doe.effects.cost import Cost, costs
from doe.effects.page import publish

FOLDER = Path(__file__).parent
ANSWERS, COSTS = MEASURED / "answers.csv", FOLDER / "cost.csv"


def main(asked: list[str]) -> None:
    """Simulate what was asked for, then publish the tables."""
    if asked != ["--page"]:
        for group in (name for name in GROUPS if not asked or name in asked):
            write_answers(ANSWERS, list(GROUPS[group]()))
        if not asked or "cost" in asked:
            write_table(COSTS, Cost, list(costs()), digits=4)
    publish(FOLDER.parent, ROOT / "docs")


if __name__ == "__main__":
    main(words(__doc__))
