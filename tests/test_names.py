"""A function is named by a noun of the field or a verb in the imperative, and so is what lasts."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from device_code import ROOT, functions, tree_of
from test_architecture import SOURCES

PARTICIPLES = set(
    """begun bound broken brought built caught chosen cut drawn driven fallen felt found given grown held kept
    known left lost made met paid seen sent shown shrunk split spent stood taken thrown told understood worn
    written""".split()
)
ADVERBS = {"afresh", "again", "alone", "apart", "beside", "beyond", "elsewhere", "only", "there", "where"}
NOUNS = {"bed", "feed", "seed", "speed"}  # that end like a participle
BRIEF = 6  # lines in which a vague name is understood


def is_bare(name: str) -> bool:
    """Whether a name is one participle or adverb."""
    name = name.strip("_")
    return name in PARTICIPLES | ADVERBS or (bool(re.fullmatch("[a-z]+ed", name)) and name not in NOUNS)


def vague_names(function: ast.FunctionDef) -> Iterator[str]:
    """Vague names that live longer than BRIEF lines of a function."""
    lines: dict[str, list[int]] = {}
    for node in ast.walk(function):
        name = node.id if isinstance(node, ast.Name) else node.arg if isinstance(node, ast.arg) else None
        if name in {"found", "told", "own", "known", "stated", "asked"}:
            lines.setdefault(name, []).append(node.lineno)
    yield from (name for name, at in lines.items() if max(at) - min(at) >= BRIEF)


@pytest.mark.parametrize("path", SOURCES, ids=lambda path: str(path.relative_to(ROOT)))
def test_names_say_what_they_are(path: Path):
    named = [f for f in functions(tree_of(path)) if is_bare(f.name)]
    bare = [f.name for f in named if not any("property" in ast.unparse(d) for d in f.decorator_list)]
    assert bare == []
    assert {f.name: names for f in functions(tree_of(path)) if (names := list(vague_names(f)))} == {}
