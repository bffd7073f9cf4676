"""What the words mean by which laboratories head their columns; the words stand in `vocabulary.toml`.

A heading means what its longest known word means. Words are compared without accents and capitals.
"""

import re
import tomllib
import unicodedata
from difflib import get_close_matches
from functools import cache
from importlib.resources import files
from typing import Literal

TidyRole = Literal["value", "unit", "vault", "repeat"]  # of columns that a tidy table alone has
Kept = Literal["observable", "condition", "condition_sd", "group", "source", "remark", "unknown"]
Role = Kept | Literal["sd", "se", "cv", "spread", "n"] | TidyRole
SCATTER = ("sd", "se", "cv", "spread", "n")  # roles of columns that belong to another one
FRICTION_VELOCITY = "conditions.friction_velocity"
DIAMETER = "grains.size.diameter"  # place of the grain diameter in the scenes that `study new` writes
GRAIN_DENSITY = "materials.soil.density"  # likewise; the material has the name that the scene gives it
GRAIN_CONTACT = "contact.soil-soil."  # begin of the places of contacts of grains on each other, likewise
IDEOGRAPHS = 0x2E80  # from here on a sign is a word, or half of one
NEAR = 0.8  # similarity of two words from which one may be the other misspelt [1]
QUANTITIES = ("observables", "halved")  # kinds of words for what is measured
COMPOUND = 5  # letters of a word that may be the part of a compound


@cache
def vocabulary() -> dict[str, dict[str, tuple[str, ...]]]:
    """Plain words by kind and meaning."""
    kinds = ("observables", "halved", "conditions", "roles", "asked", "whole", "rows")
    return {
        kind: {name: tuple(map(plain_words, words)) for name, words in words_of(kind).items()}
        for kind in kinds
    }


def words_of(kind: str) -> dict[str, list[str]]:
    """Words of one kind by meaning, as they stand in the file."""
    text = (files("taichi_erosion.evidence.data.tables") / "vocabulary.toml").read_text(encoding="utf-8")
    return tomllib.loads(text)[kind]


@cache
def unit_words() -> dict[str, str]:
    """Words for units, as they are written, with their units."""
    return {word: unit for unit, words in words_of("units").items() for word in words}


def plain_words(text: str) -> str:
    """A heading without accents, capitals and signs between words."""
    opened = unicodedata.normalize("NFKD", text.casefold().replace("ß", "ss"))
    opened = opened.replace("+/-", "±").replace("+-", "±")
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
    """Role of a column and what it measures or sets; unknown for a heading without known words.

    A word for scatter or repeats at either end of a heading makes it one, whatever else is known in it:
    `SD repose angle`. The sd of a condition is its error; any other scatter of it is a remark.
    """
    plain = plain_words(heading)
    whole = next((role for role, words in vocabulary()["whole"].items() if plain in words), None)
    if whole is not None:
        return whole, ""  # pyright: ignore[reportReturnType]
    length, role, meant = longest_meaning(heading, plain, (*QUANTITIES, "conditions"))
    scatter = scatter_role(plain)
    if scatter is not None and (length == 0 or len(plain) > length):
        if role == "condition":
            return ("condition_sd", meant) if scatter == "sd" else ("remark", "")
        return scatter, ""
    other, kind, _ = longest_meaning(heading, plain, ("roles",))
    return (kind, "") if other > length else (role, meant)


def longest_meaning(heading: str, plain: str, kinds: tuple[str, ...]) -> tuple[int, Role, str]:
    """Length of the longest known word of some kinds in a heading, its role, and its meaning."""
    best, role, meant = 0, "unknown", ""
    for kind in kinds:
        for name, words in vocabulary()[kind].items():
            length = max(found_length(word, plain) for word in words)
            if kind != "roles" and heading.strip() == name.rpartition(".")[2]:
                length = len(heading) + 1
            if length > best:
                role = "observable" if kind in QUANTITIES else "condition" if kind == "conditions" else name
                best, meant = length, name
    return best, role, meant  # pyright: ignore[reportReturnType]


def is_halved(heading: str) -> bool:
    """Whether a heading means twice an observable, such as the diameter of a heap."""
    plain = plain_words(heading)
    twice, *_ = longest_meaning(heading, plain, ("halved",))
    return twice > longest_meaning(heading, plain, ("observables", "conditions"))[0]


def scatter_role(plain: str) -> Role | None:
    """Kind of scatter, or repeats, of which a word stands at the beginning or the end of a heading."""
    found: list[tuple[int, Role]] = []
    for role in SCATTER:
        for word in vocabulary()["roles"][role]:
            if re.fullmatch(rf"{re.escape(word)}(?!\w).*|.*(?<!\w){re.escape(word)}", plain):
                found.append((len(word), role))
    return max(found)[1] if found else None


def near_meaning(heading: str) -> str:
    """Observable or condition that a heading seems to misspell, or may mean beside others; else empty."""
    plain, words = plain_words(heading), vocabulary()
    asked = [name for name, texts in words["asked"].items() if any(found_length(w, plain) for w in texts)]
    known = {
        word: name
        for kind in ("observables", "conditions")
        for name, texts in words[kind].items()
        for word in (*texts, plain_words(name.rpartition(".")[2]))
        if len(word) >= COMPOUND
    }
    parts = (plain, *(part for part in plain.split() if len(part) >= COMPOUND))
    near = [word for part in parts for word in get_close_matches(part, known, n=1, cutoff=NEAR)]
    return next(iter([*asked, *(known[word] for word in near)]), "")


def is_summary(cell: str) -> bool:
    """Whether a cell heads a row in which a spreadsheet sums up the others."""
    return plain_words(cell) in vocabulary()["rows"]["summary"]
