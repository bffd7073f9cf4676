"""Headings of columns as laboratories write them, `Korngröße [µm]` or `Feuchte in %`, and what they mean.

The known words stand in `vocabulary.toml`. A heading means what its longest known word means. Words are
compared without accents and capitals.
"""

import re
import tomllib
import unicodedata
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from difflib import SequenceMatcher, get_close_matches
from functools import cache
from importlib.resources import files
from itertools import zip_longest
from math import atan, degrees, nan
from typing import Literal

from taichi_erosion.scene.physical_ranges import is_other_kind
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
# of words for what is measured or set
KINDS: dict[str, Role] = {"observables": "observable", "halved": "observable", "conditions": "condition"}
AS_WRITTEN = ("units", "suffixes", "evident", "symbols", "remedies", "sieves", "conversions")  # as they are

BRACKETS = re.compile(r"\[(?P<square>[^\[\]]*)\]|\((?P<round>(?:[^()]|\([^()]*\))*)\)")
BRACKETED_UNIT = re.compile(r"\[[^\]]*\]|\([^()\d]*\)")  # of what the column measures
VALUE = re.compile(r"(?<![\w.,])\d+(?:[.,]\d+)?\s*([%‰°µμ]\w*|[^\W\d_]\w*)")  # a number and its unit
SEPARATOR = re.compile(r"\s+in\s+|\s*[/,:;]\s*|\s+")  # between a name and its unit
STATING = ("in", "/", ",")  # separators behind which a unit is meant, whatever it is
UNIT_SIGN = re.compile(r"[%°‰µμ]|.{2}/|[a-zA-Z][-−^]?\d|[⁻^·]")
NUMBER_LAST = re.compile(r"(?:.*[\s=_])?\d+(?:[.,]\d+)?")
COUNT = re.compile(  # of repeats behind every number of a column
    r"[,;]?\s*(?<!\w)n\s*[=:]\s*(\d+)|(?<=mean of )(\d+)|(?<=average of )(\d+)|(?<=mittel aus )(\d+)"
    r"|(?<![\w.,])(\d+) (?:repeats|replicates|repetitions|tests|trials|measurements|wiederholungen)\b",
    re.IGNORECASE,
)
EMPTY = re.compile(r"\(\s*\)|\[\s*\]|(?<=[(\[])\s*[,;]\s*")
PERCENT = re.compile(r"\b(?:percent(?:age)?|per cent|pct|prozent|pourcentage|porcentaje)\b", re.IGNORECASE)
UNIT_SPELLINGS = str.maketrans(dict.fromkeys("⋅∙•×", "·") | dict.fromkeys("{}$", ""))
FOOTNOTES = str.maketrans("", "", "¹²³⁴⁵⁶⁷⁸⁹⁽⁾")
RADIAN = (("radian", 1),)
SHARE = re.compile(r"(?P<before>[^\d%‰]*)(?P<unit>[%‰])(?P<behind>.*)")
VOLUMES = re.compile(r"m\^?3|m³|ml|cc|l")  # in a unit of a share: of volumes
WINDS = ("threshold_wind_speed", "conditions.wind_speed")
SYMBOL = re.compile(r"\s*[uUvV](?![\w*])|\s*[uUvV]_?\d")  # of a speed; u* is none
LENGTH = r"(?P<unit>mm|cm|m|(?P<foot>ft|feet|foot)|(?P<inch>inch|inches|in(?=\s*[(\[]|$)))"
HEIGHT = re.compile(rf"(?<![\w.,/^-])_?(?P<number>\d+(?:[.,]\d+)?)\s*{LENGTH}(?![\w/^-])")
RATIO = re.compile(  # u*t/u*td, AOR / AOR0, angle / dry angle
    r"^(\S{2,4}?)\S{0,2}\s*/\s*\1\S{0,3}\s*$|/\s*(?:bare|dry|smooth|control|untreated|reference|initial)\b"
)
INDEX = re.compile(r".*(?<!\w)[uUvV]_?(?P<number>\d+)\s*(?:m\b|$|[\s(\[])")  # U10, wind speed u_2
ANGLES = ("repose_angle", "dynamic_angle", "sliding_angle", "conditions.slope")
LAWS = {  # of numbers that are no multiple of what they measure: places, units of a column, unit of a result
    "phi": ((DIAMETER,), ("phi",), "mm"),
    "mesh": ((DIAMETER,), ("mesh", ""), "mm"),
    "tan": (ANGLES, ("", "1", "-"), "deg"),
    "grade": (("conditions.slope",), ("%",), "deg"),
    "rise": (("conditions.slope",), ("m/m",), "deg"),
    "wet": (("conditions.moisture",), ("%", "1", "-", "kg/kg", "g/g"), ""),
}


@dataclass(frozen=True)
class Heading:
    text: str  # as it stands in the file
    name: str
    unit: str = ""  # in the spelling of this program; empty: none is stated
    unreadable: str = ""  # what stands in brackets and is no unit
    law: str = ""  # of LAWS, by which the numbers become those of `unit`
    repeats: int = 0  # `(n = 5)`: of which every number is the mean; 0: none is stated


def read_heading(text: str) -> Heading:
    """Name and unit of a heading; words in brackets stay in the name."""
    if not re.search(r"[\s()\[\]]", text) and (parts := name_and_unit_suffix(text)):
        return add_number_law(Heading(text, *parts))
    count = COUNT.search(text)
    rest = EMPTY.sub(" ", text[: count.start()] + text[count.end() :]).strip() if count else ""
    if count and rest:
        return replace(read_heading(rest), text=text, repeats=int(count[count.lastindex or 0]))
    unreadable, (unit, bare) = "", unit_at_end(text) if "/(" in text else ("", text)  # `flux in kg/(m s)`
    for match in BRACKETS.finditer(text) if not unit else ():
        inner = next(part for part in match.groups() if part is not None).strip()
        inner_unit, words = unit_and_words(inner)
        if inner_unit and not unit:
            unit, inner = inner_unit, f" ({words}) " if words and words not in text[: match.start()] else " "
            bare = bare.replace(match[0], inner)
        elif not inner_unit and (match["round"] is None or looks_like_unit(inner)):
            unreadable, bare = inner, bare.replace(match[0], " ")
    if not unit and not unreadable:
        remarks = " ".join(match[0] for match in BRACKETS.finditer(text))
        unit, words = unit_at_end(BRACKETS.sub(" ", text).strip())
        bare = f"{words} {remarks}" if unit else text
        unit = unit or ("%" if PERCENT.search(text) else "")
    return add_number_law(Heading(text, " ".join(bare.split()) or text, unit, "" if unit else unreadable))


def name_and_unit_suffix(text: str) -> tuple[str, str] | None:
    """Name and unit of `d50_um`, of R's `d50..um.`, of the repeat `angle_deg_1`; None where none is last.

    `m` is a unit behind the name of a condition alone, `fetch_m`; `flux_10_cm` states a height.
    """
    suffixes = [(word, unit) for unit, words in known_words()["suffixes"].items() for word in words]
    for word, unit in sorted(suffixes, key=lambda each: -len(each[0])):
        parts = re.fullmatch(rf"(?i)(.+?)[._]+{word.replace('_', '[._]')}([._]\d+)?\.*", text)
        is_height = parts and word in ("m", "cm", "mm") and re.search(r"[\W_]\d+$", parts[1])
        if parts and not is_height and (word != "m" or meaning_of(parts[1])[0] == "condition"):
            return parts[1] + (parts[2] or ""), unit
    return None


def unit_and_words(text: str) -> tuple[str, str]:
    """Unit of what stands in brackets and the other words there: `mm, sieved`, `g water/g dry soil`."""
    if unit := unit_in(text):
        share = VOLUMES.search(unit) and parse_scale(unit).kind == ()
        return unit, "volumetric" if share else ""
    if share := SHARE.fullmatch(text):
        return share["unit"], f"{share['before'].strip('. -')} {share['behind']}".strip()
    weighed = [word for word in re.findall(r"[^\W\d_]\w*", text) if plain_words(word) in words_of("weighed")]
    bare = re.sub(rf"\b(?:{'|'.join(map(re.escape, weighed))})\b\.?", " ", text)
    if weighed and (unit := unit_and_words(re.sub(r"\s*/\s*", "/", bare).strip()))[0]:
        return unit[0], " ".join((unit[1], *weighed)).strip()
    if BRACKETS.search(text) and (nested := read_heading(text)).unit:
        return nested.unit, nested.name
    for match in reversed([*SEPARATOR.finditer(text)]):
        first, rest = text[: match.start()], text[match.end() :]
        is_stated = match[0].strip() in (",", ";", ":") or is_surely_a_unit(first)
        if is_stated and not unit_in(rest) and (spelt := unit_in(first)):
            return spelt, rest
    return unit_at_end(text) if re.search(r"[,;:]|[^\W_]{3}", text) else ("", text)


def unit_at_end(text: str) -> tuple[str, str]:
    """Unit behind a name without brackets, and the name; empty where none is evident."""
    for match in SEPARATOR.finditer(text):
        name, sign, rest = text[: match.start()], match[0].strip(), text[match.end() :]
        is_quantity = len(name) < COMPOUND or meaning_of(name)[0] in KINDS.values()  # `fetch / m`
        is_unit = sign in STATING and (sign != "/" or is_quantity)
        if not name or not (is_unit or is_surely_a_unit(rest)) or re.match(r"\d+\s", rest):
            continue
        unit, words = unit_and_words(rest) if SHARE.fullmatch(rest) else (unit_in(rest) or "", "")
        valued = not sign and NUMBER_LAST.fullmatch(name) and unit not in ("", *LAWS)
        if unit and not (valued and parse_scale(unit).kind != RADIAN):
            return unit, f"{name} {words}"
    return "", text


def is_surely_a_unit(text: str) -> bool:
    return text in words_of("evident") or UNIT_SIGN.search(text) is not None


def looks_like_unit(text: str) -> bool:
    """Whether words in round brackets seem to be meant as a unit."""
    try:
        parse_scale(text)
    except UnknownUnit as error:
        words = " ".join(re.findall(r"\w+", plain_words(text)))
        sense = any(words in words_of(kind) for kind in ("weighed", "changes", "laws"))
        short = all(len(letters) < COMPOUND - 1 for letters in re.findall(r"[^\W\d_]+", text))
        return short and not sense and bool(error.hint or re.search(r"[/^⁻]", text))
    return False


def add_number_law(heading: Heading) -> Heading:
    """The heading with the law by which its numbers are turned into those of what it means."""
    role, place = meaning_of(heading.name)
    for law, (places, units, unit) in LAWS.items():
        named = (heading.unit,) in (units, (law,)) or has_word(heading.name, known_words()["laws"][law])
        if named and place in places and heading.unit in units and role in KINDS.values():
            return replace(heading, unit=unit or heading.unit, law=law)
    return replace(heading, unit="", unreadable=heading.unit) if heading.unit in LAWS else heading


def apply_law(number: float, unit: str, heading: Heading) -> float:
    """A number in phi [mm], a tangent or grade [deg], or water over wet mass, as over dry mass."""
    if heading.law == "mesh" or unit not in ("", heading.unit, heading.law):
        raise ValueError(heading.law)
    if heading.law == "wet":
        return number / (1.0 - number * parse_scale(heading.unit).factor)
    return 2.0**-number if heading.law == "phi" else degrees(atan(number * 0.01 ** (heading.law == "grade")))


def set_stated_unit(heading: Heading, text: str) -> Heading:
    """The heading with the unit that the user states; one that cannot be read is kept as such."""
    unit = unit_in(text)
    unit = "" if unit in LAWS else unit
    return replace(heading, unit=unit or "", unreadable="" if unit else text)


def unit_in(text: str) -> str | None:
    """A unit in the spelling of this program, None for what is none."""
    plain = text.strip(" '\"").removeprefix("in ").strip().translate(UNIT_SPELLINGS)
    if not plain:
        return None
    if spelt := next((unit for unit, words in known_words()["units"].items() if plain in words), ""):
        return spelt
    try:  # the number of a repeat, `angle 1/°`, is no unit
        return None if parse_scale(plain).kind == (("radian", -1),) else plain
    except UnknownUnit:
        return None


@cache
def words_of(kind: str) -> frozenset[str]:
    return frozenset(word for words in known_words()[kind].values() for word in words)


@cache
def known_words() -> dict[str, dict[str, tuple[str, ...]]]:
    """Known words by kind and meaning, plain but for those of units."""
    table = tomllib.loads((files("taichi_erosion.tables") / "vocabulary.toml").read_text(encoding="utf-8"))
    for kind, meanings in table.items():
        read = str if kind in AS_WRITTEN else plain_words
        table[kind] = {name: tuple(map(read, words)) for name, words in meanings.items()}
    return table


def plain_words(text: str) -> str:
    """A heading without accents, capitals, numbers of footnotes and signs between words."""
    lower = text.casefold().replace("ß", "ss").replace("’", "'").translate(FOOTNOTES)
    opened = unicodedata.normalize("NFKD", lower)
    opened = opened.replace("+/-", "±").replace("+-", "±")
    bare = "".join(sign for sign in opened if not unicodedata.combining(sign))
    return " ".join(re.sub(r"[_\-./,:;]+", " ", bare).split())


def word_pattern(word: str) -> str:
    """Pattern of a known word in a heading.

    A short word must stand alone; a longer one may be the part of a compound, at its beginning or its end.
    """
    plain = re.escape(word)
    if ord(word[-1]) >= IDEOGRAPHS:
        return plain
    alone = len(word) < COMPOUND or "*" in word
    return rf"(?<!\w){plain}(?!\w)" if alone else rf"(?<!\w){plain}|{plain}(?!\w)"


def word_length(word: str, heading: str) -> int:
    """Length of a known word that a heading has, an ideograph as three letters; 0 where it has not."""
    if not word or word not in heading or not re.search(word_pattern(word), heading):
        return 0
    return len(word) * (3 if ord(word[-1]) >= IDEOGRAPHS else 1)


def has_word(heading: str, words: Iterable[str]) -> bool:
    plain = plain_words(heading)
    return any(word_length(word, plain) for word in words)


@cache
def longest_word(heading: str, *kinds: str, unit: str | None = None) -> tuple[int, str, str]:
    """Length of the longest known word of some kinds in a heading, its kind, and its meaning in a unit."""
    plain = plain_words(heading)
    best = (0, "", "")
    for kind in kinds:
        for name, words in known_words()[kind].items():
            if is_other_kind(unit, name):
                continue
            is_name = kind in KINDS and heading.strip() == name.rpartition(".")[2]
            length = len(heading) + 1 if is_name else max(word_length(word, plain) for word in words)
            best = max(best, (length, kind, name), key=lambda each: each[0])
    return best


def meaning_of(heading: str) -> tuple[Role, str]:
    """Role of a column and what it measures or sets; unknown for a heading without known words.

    A word for scatter or repeats at either end of a heading makes it one, whatever else is known in it:
    `SD repose angle`. The sd of a condition is its error; any other scatter of it is a remark. A word of a
    thing that has the same quantity makes it another one: `funnel diameter`.
    """
    plain = plain_words(heading)
    whole = next((role for role, words in known_words()["whole"].items() if plain in words), None)
    if whole is not None:
        return whole, ""  # pyright: ignore[reportReturnType]
    length, kind, meaning = longest_word(heading, *KINDS)
    scatter = scatter_role(plain.partition("±")[0].strip(" (") or plain)  # `angle, mean ± SD` is no scatter
    other, _, role = longest_word(heading, "roles")
    if not length and {scatter, role} & {"n", "remark"} and has_word(heading, known_words()["things"]["n"]):
        return "unknown", ""  # a number of passes
    if scatter is not None and words_beside_quantity(heading):
        if kind == "conditions":
            return ("condition_sd", meaning) if scatter == "sd" else ("remark", "")
        return scatter, ""
    if longest_word(heading, "others")[0] > max(length, other) or names_another_thing(heading):
        return "unknown", ""
    if other and (not length or (role in SCATTER and other > length)):
        return role, ""  # pyright: ignore[reportReturnType]
    return KINDS.get(kind, "unknown"), meaning


def words_beside_quantity(heading: str) -> str:
    """Words of a heading beside those of the quantity that it means."""
    plain, (_, kind, meaning) = plain_words(heading), longest_word(heading, *KINDS)
    words = (*known_words()[kind][meaning], plain_words(meaning.rpartition(".")[2])) if kind else ()
    for word in sorted((word for word in words if word in plain), key=len, reverse=True):
        plain = re.sub(word_pattern(word), " ", plain)
    return " ".join(plain.split())


def names_another_thing(heading: str) -> bool:
    """Whether a heading names a thing that has the quantity too: the diameter of a funnel."""
    things = known_words()["things"].get(longest_word(heading, *KINDS)[2], ())
    return has_word(words_beside_quantity(heading), things)


def qualifying_words(heading: Heading) -> tuple[str, str]:
    """Words of a heading that make its quantity another one, and words that are not understood."""
    remainder, meaning = words_beside_quantity(heading.name), longest_word(heading.name, *KINDS)[2]
    for word in (*known_words()["laws"].get(heading.law, ()), *known_words()["again"].get(meaning, ())):
        remainder = re.sub(word_pattern(word), " ", remainder)
    scopes = [words for scope, words in known_words()["changes"].items() if scope in (meaning, "everywhere")]
    scopes += [known_words()["laws"][law] for law, (places, *_) in LAWS.items() if meaning in places]
    changed = [word for words in scopes for word in words if word_length(word, remainder)]
    parts = [meaning_of(part) for part in BRACKETS.sub(" ", heading.name).split("/")]
    if RATIO.search(heading.name) or (len([r for r, _ in parts if r in KINDS.values()]) > 1 and remainder):
        changed.append("/")  # a ratio of two quantities
    others = [word for word in re.findall(r"[^\W\d_]{3,}", remainder) if word not in words_of("harmless")]
    return max(changed, key=len, default=""), ", ".join(dict.fromkeys(others))


def heading_faults(file: str, rows: Sequence[tuple[int, Sequence[str]]]) -> Iterator[str]:
    """Headings, in the first of the numbered rows, that are missing above numbers, or stand twice."""
    first, (line, headings), *lines = dict[str, int](), *rows
    for place, text in enumerate(headings):
        where, content = f"{file}: row {line}, column {place + 1}", [row[place] for _, row in lines]
        numbers = [*map(str, range(len(lines) + 1))]
        is_index = sorted(content) in (sorted(numbers[:-1]), sorted(numbers[1:]))  # of a data frame
        if not text and any(content) and not is_index:
            yield f"{where} has no heading; name it (repeats: 'angle 1', 'angle 2'), or empty it"
        elif text in first and meaning_of(read_heading(text).name)[0] not in (*SCATTER, "remark"):
            words = "give each its own name, or write blocks of rows below one another"
            yield f"{where}: heading '{text}' stands in column {first[text] + 1} too; {words}"
        if text:
            first.setdefault(text, place)


def scatter_role(plain: str) -> Role | None:
    """Kind of scatter, or repeats, of which a word stands at the beginning or the end of a heading."""
    roles: list[tuple[int, Role]] = []
    numbered = [phrase for phrase in known_words()["roles"]["remark"] if word_length(phrase, plain)]
    for role in SCATTER:
        for word in known_words()["roles"][role]:
            counts = word in plain and not any(word in each for each in numbered)  # `Wdh. Nr.` does not
            if counts and re.fullmatch(rf"{re.escape(word)}(?!\w).*|.*(?<!\w){re.escape(word)}", plain):
                roles.append((len(word), role))
    return max(roles)[1] if roles else None


def meaning_of_symbol(heading: Heading) -> tuple[Role, str]:
    """Meaning of a letter by its unit: `d [mm]`, `w (dry mass) [%]`."""
    called = plain_words(heading.name)
    alone = re.sub(r"[()\[\]]", " ", called)
    for word in sorted(words_of("harmless") | words_of("bases"), key=len, reverse=True):
        alone = re.sub(word_pattern(word), " ", alone) if word in alone else alone
    alone = " ".join(alone.split())
    for name, symbols in known_words()["symbols"].items():
        if has_word(heading.name, known_words()["things"].get(name, ())):
            continue
        letters = {called, alone} if "." in name else {re.sub(r" \d$", "", each) for each in (called, alone)}
        for letter, unit in (symbol.rsplit(" ", 1) for symbol in symbols):
            alike = heading.unit and plain_words(letter) in letters  # of `q 2` too, a repeat
            if alike and parse_scale(heading.unit).kind == parse_scale(unit).kind:
                return "condition" if "." in name else "observable", name
    return "unknown", ""


def wind_height_of_heading(heading: Heading, name: str) -> float:
    """Height above the bed at which a column of winds was measured [m]; NaN where it states none.

    `name` is what the heading means; a single letter u or v is a speed where its unit is one.
    """
    speed = bool(heading.unit) and parse_scale(heading.unit).kind == parse_scale("m/s").kind
    unnamed = not name and has_word(heading.name, known_words()["asked"]["threshold_u_star"])
    if name not in WINDS and not ((unnamed or SYMBOL.match(heading.name)) and speed):
        return nan
    text = re.sub(r"\[[^\]]*\]", " ", re.sub(r"\b([uUvV])(?=\d+ ?c?m\b)", r"\1 ", heading.text))
    if match := HEIGHT.search(text.replace("_", " ")):
        unit = "ft" if match["foot"] else "in" if match["inch"] else match["unit"]
        return float(match["number"].replace(",", ".")) * parse_scale(unit).factor
    return float(index["number"]) if (index := INDEX.match(text)) else nan


def meaning_of_only_angle(heading: Heading) -> str:
    """Angle that a heading means in a table where nothing else is measured, `angle 1 [deg]`; else empty."""
    bare = re.sub(r"\d+", " ", plain_words(heading.name)).strip()
    angles = [name for name, words in known_words()["alone"].items() if bare in words and heading.unit]
    return angles[0] if angles and parse_scale(heading.unit).kind == RADIAN else ""


def suggest_meaning(heading: str, bare: bool = False) -> str:
    """What a heading seems to misspell, or may mean beside others, as a letter that is `bare` of a unit."""
    plain, words = plain_words(heading), known_words()
    if longest_word(heading, "others")[0] or names_another_thing(heading):
        return ""
    several = (*words["asked"].items(), *words["alone"].items())
    named_first = [name for name, texts in several if has_word(heading, texts)]
    letters = ((each.rsplit(" ", 1)[0], name) for name, texts in words["symbols"].items() for each in texts)
    named_first += [name for letter, name in letters if bare and plain_words(letter) == plain]
    meanings = (*words["observables"].items(), *words["conditions"].items())
    pairs = ((word, n) for n, texts in meanings for word in (*texts, plain_words(n.rpartition(".")[2])))
    likeness = {word: name for word, name in pairs if len(word) >= COMPOUND}
    parts = (plain, *(part for part in plain.split() if len(part) >= COMPOUND))
    near = [word for part in parts for word in get_close_matches(part, likeness, cutoff=NEAR)]
    near = [word for word in near if any(is_misspelling_of(part, word) for part in parts)]
    names = (*named_first, *(likeness[word] for word in near))
    return next((name for name in names if not has_word(heading, words["things"].get(name, ()))), "")


def is_misspelling_of(text: str, word: str) -> bool:
    """Whether a text may be a known word, of which each word is misspelt, behind its first letter, by one."""
    pairs = tuple(zip_longest(text.split(), word.split(), fillvalue=""))
    same = (sum(block.size for block in SequenceMatcher(None, a, b).get_matching_blocks()) for a, b in pairs)
    return all(a[:1] == b[:1] and k > max(len(a), len(b)) - 2 for k, (a, b) in zip(same, pairs, strict=True))


def heading_holds_value(heading: Heading) -> bool:
    """Whether a heading holds a number with another unit than its own: `repose angle (0.5 mm)`."""
    text = heading.name if heading.unit else BRACKETED_UNIT.sub(" ", heading.text)
    return any(unit_in(unit) not in (None, heading.unit) for unit in VALUE.findall(text))


def is_summary_word(cell: str) -> bool:
    """Whether a cell heads a row in which a spreadsheet sums up the others."""
    return plain_words(cell) in known_words()["rows"]["summary"]


def is_called_summary(row: Sequence[str]) -> bool:
    """Whether a word of a row means that it sums up others."""
    return any(map(is_summary_word, plain_words(" ".join(row)).split()))


def last_word(cell: str) -> str:
    """Last word of a cell: `mean` of `Control mean`."""
    return plain_words(cell).rpartition(" ")[2]
