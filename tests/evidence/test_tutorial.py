"""Pages that show what the program prints show it word for word."""

from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path

import pytest

DOCS = Path(__file__).parents[2] / "docs"


@pytest.mark.parametrize(("name", "steps"), [("discover.md", 3), ("threshold.md", 3)])
def test_every_output_on_a_page_is_what_its_command_prints(name, steps):
    spec = spec_from_file_location("tutorial", DOCS / "tutorial.py")
    assert spec is not None
    assert spec.loader is not None
    tutorial = module_from_spec(spec)
    spec.loader.exec_module(tutorial)
    page = (DOCS / name).read_text("utf-8")
    assert len(tutorial.STEP.findall(page)) == steps
    assert tutorial.fill(page) == page, "python docs/tutorial.py writes it afresh"
