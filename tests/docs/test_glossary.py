"""The glossary stays short, and CONTRIBUTING.md explains the index letters of device code."""

import ast
import re

import pytest
from device_code import ROOT, device_functions

pytestmark = pytest.mark.docs

MOST_ROWS = 60


def test_every_index_letter_that_device_functions_take_or_count_with_is_explained():
    names = set()
    for function in device_functions().values():
        names |= {argument.arg for argument in function.args.args}
        loops = (node.target for node in ast.walk(function) if isinstance(node, ast.For))
        names |= {part.id for target in loops for part in ast.walk(target) if isinstance(part, ast.Name)}
    text = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    paragraph = text.partition("Index letters of device code")[2].partition("\n\n")[0]
    assert {name for name in names - {"_"} if len(name) == 1} <= set(re.findall(r"`(\w)`", paragraph))


def test_the_glossary_keeps_the_terms_that_a_reader_may_not_know():
    rows = re.findall(r"^\| (?!word|term)", (ROOT / "GLOSSARY.md").read_text(encoding="utf-8"), re.MULTILINE)
    assert 0 < len(rows) <= MOST_ROWS
