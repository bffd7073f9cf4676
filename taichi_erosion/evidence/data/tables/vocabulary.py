"""What the words mean by which laboratories head their columns; the words stand in `vocabulary.toml`.

A heading means what its longest known word means. Words are compared without accents and capitals.
"""

import re
import tomllib
import unicodedata
from functools import cache
from importlib.resources import files
from typing import Literal

Role = Literal["observable", "condition", "sd", "se", "n", "group", "source", "remark", "unknown"]
DIAMETER = "grains.size.diameter"  # place of the grain diameter in the scenes that `study new` writes
IDEOGRAPHS = 0x2E80  # from here on a sign is a word, or half of one
COMPOUND = 5  # letters of a word that may be the part of a compound


@cache
def vocabulary() -> dict[str, dict[str, tuple[str, ...]]]:
    """Plain words by kind and meaning."""
    text = (files("taichi_erosion.evidence.data.tables") / "vocabulary.toml").read_text(encoding="utf-8")
    return {
        kind: {name: tuple(map(plain_words, words)) for name, words in table.items()}
        for kind, table in tomllib.loads(text).items()
    }


def plain_words(text: str) -> str:
    """A heading without accents, capitals and signs between words."""
    opened = unicodedata.normalize("NFKD", text.casefold().replace("ß", "ss"))
    bare = "".join(sign for sign in opened if not unicodedata.combining(sign))
    return " ".join(re.sub(r"[_\-./,:;]+", " ", bare).split())


def found_length(word: str, heading: str) -> int:
    """Length of a known word that a heading has; 0 where it has not.

    A short word must stand alone; a longer one may be the part of a compound, at its beginning or its end.
    """
    if any(ord(sign) >= IDEOGRAPHS for sign in word):
        return 3 * len(word) if word in heading else 0
    alone = rf"(?<!\w){re.escape(word)}(?!\w)"
    part = rf"(?<!\w){re.escape(word)}|{re.escape(word)}(?!\w)"
    return len(word) if re.search(alone if len(word) < COMPOUND or "*" in word else part, heading) else 0


def meaning_of(heading: str) -> tuple[Role, str]:
    """Role of a column and what it measures or sets; unknown for a heading without known words."""
    plain, best, role, meant = plain_words(heading), 0, "unknown", ""
    for kind in ("observables", "conditions", "roles"):
        for name, words in vocabulary()[kind].items():
            length = max(found_length(word, plain) for word in words)
            if kind != "roles" and heading.strip() == name.rpartition(".")[2]:
                length = len(heading) + 1
            if length > best:
                best, role, meant = length, name if kind == "roles" else kind.removesuffix("s"), name
    return role, "" if meant == role else meant  # pyright: ignore[reportReturnType]


def known_places() -> tuple[str, ...]:
    """Places that headings can mean."""
    return tuple(vocabulary()["conditions"])


def is_summary(cell: str) -> bool:
    """Whether a cell heads a row in which a spreadsheet sums up the others."""
    return plain_words(cell) in vocabulary()["rows"]["summary"]
