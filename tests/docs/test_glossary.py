"""GLOSSARY.md explains every index letter of device code and every module name that no dictionary has."""

import ast
import re
from pathlib import Path

import pytest
from device_code import PACKAGE, ROOT, device_functions

pytestmark = pytest.mark.docs

GLOSSARY = (ROOT / "GLOSSARY.md").read_text(encoding="utf-8")
TERMS = set((Path(__file__).parent / "dictionary_terms.txt").read_text(encoding="utf-8").split())
MODULES = sorted(
    {path.stem for path in PACKAGE.rglob("*.py") if not path.stem.startswith("__")}
    | {path.name for path in PACKAGE.rglob("*") if (path / "__init__.py").exists()}
)


def rows_of(heading: str) -> set[str]:
    """Words in backticks in the first column of the table under a heading."""
    section = GLOSSARY.partition(f"## {heading}\n")[2].partition("\n## ")[0]
    cells = [line.split("|")[1] for line in section.splitlines() if line.startswith("|")]
    return {word for cell in cells for word in re.findall(r"`(\w+)`", cell)}


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
    assert index_letters() <= rows_of("Index letters")


@pytest.mark.parametrize("module", MODULES)
def test_a_module_has_a_dictionary_term_for_a_name_or_is_explained(module):
    unknown = set(module.split("_")) - TERMS
    assert not unknown or module in rows_of("Names of modules"), unknown
