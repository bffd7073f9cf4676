"""The tutorial shows what the program prints, word for word."""

from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path

DOCS = Path(__file__).parents[2] / "docs"


def test_every_output_of_the_tutorial_is_what_its_command_prints():
    spec = spec_from_file_location("tutorial", DOCS / "tutorial.py")
    assert spec is not None
    assert spec.loader is not None
    tutorial = module_from_spec(spec)
    spec.loader.exec_module(tutorial)
    page = (DOCS / "discover.md").read_text("utf-8")
    assert len(tutorial.STEP.findall(page)) == 3
    assert tutorial.fill(page) == page, "python docs/tutorial.py writes it afresh"
