"""Pages that show what the program prints show it word for word, and number for number within rounding."""

import re
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path

import pytest

DOCS = Path(__file__).parents[2] / "docs"
NUMBER = re.compile(r"\d+\.?\d*(?:e-?\d+)?")
pytestmark = pytest.mark.docs
ROUNDING = 0.01  # by which a printed number may differ where a processor rounds otherwise


@pytest.mark.parametrize(("name", "steps"), [("discover.md", 3), ("threshold.md", 2), ("your_table.md", 5)])
def test_every_output_on_a_page_is_what_its_command_prints(name, steps):
    spec = spec_from_file_location("tutorial", DOCS / "tutorial.py")
    assert spec is not None
    assert spec.loader is not None
    tutorial = module_from_spec(spec)
    spec.loader.exec_module(tutorial)
    page = (DOCS / name).read_text("utf-8")
    assert len(tutorial.STEP.findall(page)) == steps
    made = tutorial.fill(page)
    assert NUMBER.sub("#", made) == NUMBER.sub("#", page), "python docs/tutorial.py writes it afresh"
    shown, printed = ([float(number) for number in NUMBER.findall(text)] for text in (page, made))
    assert printed == pytest.approx(shown, rel=ROUNDING)
