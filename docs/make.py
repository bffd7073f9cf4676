"""Makes everything of the book that a program prints: `python docs/make.py`.

Outputs of commands in the pages, the Python interface of docs/json_and_python.md, and the notebook.
`python docs/pictures.py` draws the pictures.
"""

import sys
from pathlib import Path

DOCS = Path(__file__).resolve().parent
sys.path[:0] = [str(DOCS.parent), str(DOCS)]

from api import interface  # noqa: E402
from notebook import NOTEBOOK, notebook  # noqa: E402
from tutorial import fill  # noqa: E402

from doe.common.pages import fill_tables  # noqa: E402


def main() -> None:
    """Make pages and notebook anew."""
    for page in (DOCS.parent / "README.md", *sorted(DOCS.glob("*.md"))):
        text = page.read_text(encoding="utf-8")
        if "<!-- output:" in text:
            page.write_text(fill(text), encoding="utf-8")
    reference = DOCS / "json_and_python.md"
    text = fill_tables(reference.read_text(encoding="utf-8"), {"python": interface()})
    reference.write_text(text, encoding="utf-8")
    NOTEBOOK.write_text(notebook(), encoding="utf-8")


if __name__ == "__main__":
    main()
