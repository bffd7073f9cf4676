"""Headings of columns as laboratories write them, `Korngröße [µm]` or `Feuchte in %`, and what they mean.

The known words stand in `vocabulary.toml`. A heading means what its longest known word means. Words are
compared without accents and capitals.
"""

import re
import tomllib
import unicodedata
from dataclasses import dataclass, replace
from difflib import get_close_matches
from functools import cache
from importlib.resources import files
from typing import Literal

from taichi_erosion.scene.schema.units import UnknownUnit, parse_scale

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
COMPOUND = 5  # letters of a word that may be the part of a compound
KINDS: dict[str, Role] = {  # of words for what is measured or set
    "observables": "observable",
    "halved": "observable",
    "conditions": "condition",
}

BRACKETED = (
    re.compile(r"(?P<name>.*?)\s*\[(?P<unit>[^\[\]]*)\]\s*(?P<rest>.*)"),
    re.compile(r"(?P<name>.*)\((?P<unit>[^()]*(?:\([^()]*\))?[^()]*)\)\s*(?P<rest>.*)"),
)
TRAILING = re.compile(r"(?P<name>.+?)(?:\s+in|\s*/|\s*,|\s*:|\s)\s*(?P<unit>\S+(?:\s*/\s*\S+)?)")
SAFE = frozenset(
    ("mm", "cm", "km", "um", "deg", "rad", "Pa", "kPa", "hPa", "mbar", "degC", "degF", "Grad", "kg/kg")
)
MASS_SHARE = re.compile(
    r"(?:gew|gewichts|masse?n?|mass|m|wt|w|w/w|m/m|gravimetric|gravimetrisch)?[.\s-]*%"
    r"(?:\s*\(?(?:w/w|m/m|wt|mass|by mass|by weight|gravimetric|grav|r\.?f|rh|rF)\.?\)?)?",
    re.IGNORECASE,
)
VOLUME_SHARE = re.compile(
    r"vol(?:ume|umen)?[.\s-]*%|%\s*\(?(?:vol|v/v|by volume)\.?\)?|[cm]+3/[cm]+3", re.IGNORECASE
)
VOLUMETRIC = "vol%"


@dataclass(frozen=True)
class Heading:
    """Name and unit of a column."""

    text: str  # as it stands in the file
    name: str
    unit: str = ""  # in the spelling of this program; empty: none is stated
    unreadable: str = ""  # what stands in square brackets and is no unit


def read_heading(text: str) -> Heading:
    """Name and unit of a heading."""
    for form in BRACKETED:
        match = form.fullmatch(text)
        if match is not None:
            name = f"{match['name'].strip()} {match['rest'].strip()}".strip() or text
            unit = unit_in(match["unit"])
            wrong = unit is None and form is BRACKETED[0]  # round brackets may hold a remark
            return Heading(text, name, unit or "", unreadable=match["unit"].strip() if wrong else "")
    name, mark, rest = text.rpartition(" / ")
    if mark and name.strip() and unit_in(rest):
        return Heading(text, name.strip(), unit_in(rest) or "")
    match = TRAILING.fullmatch(text)
    if match is not None and evident(match["unit"], text):
        unit = unit_in(match["unit"])
        if unit is not None:
            return Heading(text, match["name"].strip(" ,/:"), unit)
    return Heading(text, text)


def stated_unit(heading: Heading, text: str) -> Heading:
    """The heading with the unit that the user states; one that cannot be read is kept as such."""
    unit = unit_in(text)
    return replace(heading, unit=unit or "", unreadable="" if unit else text)


def evident(unit: str, text: str) -> bool:
    """Whether a word behind a name can only be its unit."""
    stated = re.search(rf"(?:\sin\s|\s/\s|,\s){re.escape(unit)}$", text) is not None
    return stated or unit in SAFE or any(sign in "%°‰µμ" for sign in unit) or (len(unit) > 2 and "/" in unit)


def unit_in(text: str) -> str | None:
    """A unit in the spelling of this program, None for what is none."""
    plain = text.strip().strip("'\"").removeprefix("in ").strip()
    if not plain:
        return None
    plain = next((unit for unit, words in vocabulary()["units"].items() if plain in words), plain)
    if VOLUME_SHARE.fullmatch(plain):
        return VOLUMETRIC
    if MASS_SHARE.fullmatch(plain):
        return "%"
    try:
        parse_scale(plain)
    except UnknownUnit:
        return None
    return plain


@cache
def vocabulary() -> dict[str, dict[str, tuple[str, ...]]]:
    """Known words by kind and meaning, plain but for those of units."""
    text = (files("taichi_erosion.tables") / "vocabulary.toml").read_text(encoding="utf-8")
    return {
        kind: {
            name: tuple(word if kind == "units" else plain_words(word) for word in words)
            for name, words in meanings.items()
        }
        for kind, meanings in tomllib.loads(text).items()
    }


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


def longest_word(heading: str, *kinds: str) -> tuple[int, str, str]:
    """Length of the longest known word of some kinds in a heading, its kind, and its meaning."""
    plain = plain_words(heading)
    best = (0, "", "")
    for kind in kinds:
        for name, words in vocabulary()[kind].items():
            length = max(found_length(word, plain) for word in words)
            if kind in KINDS and heading.strip() == name.rpartition(".")[2]:
                length = len(heading) + 1
            if length > best[0]:
                best = (length, kind, name)
    return best


def meaning_of(heading: str) -> tuple[Role, str]:
    """Role of a column and what it measures or sets; unknown for a heading without known words.

    A word for scatter or repeats at either end of a heading makes it one, whatever else is known in it:
    `SD repose angle`. The sd of a condition is its error; any other scatter of it is a remark.
    """
    plain = plain_words(heading)
    whole = next((role for role, words in vocabulary()["whole"].items() if plain in words), None)
    if whole is not None:
        return whole, ""  # pyright: ignore[reportReturnType]
    length, kind, meant = longest_word(heading, *KINDS)
    scatter = scatter_role(plain)
    if scatter is not None and len(plain) > length:
        if kind == "conditions":
            return ("condition_sd", meant) if scatter == "sd" else ("remark", "")
        return scatter, ""
    other, _, role = longest_word(heading, "roles")
    if other > length:
        return role, ""  # pyright: ignore[reportReturnType]
    return KINDS.get(kind, "unknown"), meant


def is_halved(heading: str) -> bool:
    """Whether a heading means twice an observable, such as the diameter of a heap."""
    return longest_word(heading, *KINDS)[1] == "halved"


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
