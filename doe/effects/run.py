"""What each effect does where the answer is known; writes its table and the page of effects.

python -m doe.effects.run              all groups, then the page
python -m doe.effects.run GROUP...     some of: pocket flight bounce rolling reading
python -m doe.effects.run --page       only the tables of the page
"""

from pathlib import Path

from doe.common.cases import MEASURED, ROOT
from doe.common.command import words
from doe.effects.answers import GROUPS, write_answers
from doe.effects.page import publish

FOLDER = Path(__file__).parent
ANSWERS = MEASURED / "answers.csv"


def main(asked: list[str]) -> None:
    """Simulate what was asked for, then publish the tables."""
    if asked != ["--page"]:
        for group in (name for name in GROUPS if not asked or name in asked):
            write_answers(ANSWERS, list(GROUPS[group]()))
    publish(FOLDER.parent, ROOT / "docs")


if __name__ == "__main__":
    main(words(__doc__))
