"""Headings of columns as laboratories write them: `Korngröße [µm]`, `Feuchte in %`, `d / mm`."""

import re
from contextlib import suppress
from dataclasses import dataclass, replace
from math import isfinite, nan

from taichi_erosion.core.errors import BadInput
from taichi_erosion.evidence.data.tables.vocabulary import unit_words
from taichi_erosion.scene.schema.units import UnknownUnit, parse_scale, parse_unit

BRACKETED = (
    re.compile(r"(?P<name>.*?)\s*\[(?P<unit>[^\[\]]*)\]\s*(?P<rest>.*)"),
    re.compile(r"(?P<name>.*?)\s*\{(?P<unit>[^{}]*)\}\s*(?P<rest>.*)"),
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
            return bracketed_heading(text, match, square=form is BRACKETED[0])
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


def bracketed_heading(text: str, match: re.Match[str], square: bool) -> Heading:
    """Heading with brackets; round ones may hold a remark in place of a unit."""
    before, after = match["name"].strip(), match["rest"].strip()
    unit = unit_in(match["unit"])
    name = f"{before} {after}".strip() or text
    if unit is None and square and match["unit"].strip():
        return Heading(text, name, unreadable=match["unit"])
    return Heading(text, name, unit or "")


def evident(unit: str, text: str) -> bool:
    """Whether a word behind a name can only be its unit."""
    stated = re.search(rf"(?:\sin\s|\s/\s|,\s){re.escape(unit)}$", text) is not None
    return stated or unit in SAFE or any(sign in "%°‰µμ" for sign in unit) or (len(unit) > 2 and "/" in unit)


def unit_in(text: str) -> str | None:
    """A unit in the spelling of this program, None for what is none."""
    plain = text.strip().strip("'\"").removeprefix("in ").strip()
    if not plain:
        return None
    plain = unit_words().get(plain, plain)
    if VOLUME_SHARE.fullmatch(plain):
        return VOLUMETRIC
    if MASS_SHARE.fullmatch(plain):
        return "%"
    try:
        parse_scale(plain)
    except UnknownUnit:
        return None
    return plain


def stated_number(text: str, unit: str, name: str, example: str) -> float:
    """A number with its unit as the user states it, `0.03 mm`, in another unit; raises BadInput."""
    number, _, behind = text.strip().replace(",", ".").partition(" ")
    match = re.fullmatch(r"([\d.]+(?:[eE][+-]?\d+)?)([a-zµμ]*)", number)
    value, wanted = nan, parse_unit(unit)
    with suppress(UnknownUnit, ValueError):
        scale = parse_scale(behind.strip() or (match[2] if match else "") or "?")
        if match and scale.kind == wanted.kind:
            value = float(match[1]) * scale.factor / wanted.factor
    if not isfinite(value):
        raise BadInput(f"{name} '{text}': write a number and its unit, such as '{example}'")
    return value
