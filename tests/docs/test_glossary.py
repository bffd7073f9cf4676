"""The glossary stays short, and CONTRIBUTING.md explains the index letters of device code."""

import ast
import re

import pytest
from device_code import ROOT, device_functions

pytestmark = pytest.mark.docs

MOST_ROWS = 60


def index_letters() -> set[str]:
    """Single letters that device functions take as arguments or count with."""
    letters = set()
    for function in device_functions().values():
        letters |= {argument.arg for argument in function.args.args if len(argument.arg) == 1}
        for node in ast.walk(function):
            if isinstance(node, ast.For):
                names = (part.id for part in ast.walk(node.target) if isinstance(part, ast.Name))
                letters |= {name for name in names if len(name) == 1}
    return letters - {"_"}


def test_every_index_letter_is_explained():
    text = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    paragraph = text.partition("Index letters of device code")[2].partition("\n\n")[0]
    assert index_letters() <= set(re.findall(r"`(\w)`", paragraph))


def test_the_glossary_keeps_the_terms_that_a_reader_may_not_know():
    rows = re.findall(r"^\| (?!word|term)", (ROOT / "GLOSSARY.md").read_text(encoding="utf-8"), re.MULTILINE)
    assert 0 < len(rows) <= MOST_ROWS
