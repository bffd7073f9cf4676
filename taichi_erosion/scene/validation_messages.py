"""Messages of validation errors: dotted path, value, what is allowed; one line each."""

from collections.abc import Mapping, Sequence
from typing import Any

from pydantic import ValidationError

from taichi_erosion.core.errors import did_you_mean
from taichi_erosion.scene.schema.fields import DIAMETERS

DISCRIMINATORS = ("law", "shape")
KEY_MARK = "[key]"
LONGEST_VALUE = 60  # characters of a value that a message repeats

SENTENCES = {
    "missing": "is missing",
    "finite_number": "must be a finite number",
    "float_type": "must be a number",
    "int_type": "must be a whole number",
    "int_from_float": "must be a whole number",
    "bool_type": "must be true or false",
    "string_type": "must be text in quotes",
    "tuple_type": "must be a list",
    "dict_type": "must be a table",
    "model_type": "must be a table",
    "model_attributes_type": "must be a table",
    "string_pattern_mismatch": "must be a name of letters, digits and _ (a contact: two names joined by -)",
}


def problem_lines(error: ValidationError, table: Any, diameter: float | None = None) -> list[str]:
    """One line for every error, in the order of the file's sections.

    Without a nominal diameter [m] lengths in diameters cannot be judged: of a scene only the grains are.
    """
    entries = error.errors(include_url=False)
    grains = [entry for entry in entries if entry["loc"][:1] == ("grains",)]
    judged = grains if diameter is None and grains else entries
    return [problem_line(entry, table) for entry in judged]


def problem_line(entry: Any, table: Any) -> str:
    """`grains.count = -3 lies outside [1, 5e+06]`."""
    kind, context = entry["type"], entry.get("ctx", {})
    words, written = as_written(entry["loc"], table)
    if kind == "unknown":
        return f"{dotted([*words, context['key']])} is unknown; {context['hint']}"
    where = dotted(words)
    if kind == "missing":
        return missing_line(words, table)
    if kind == "contradiction":
        return f"{where}: {context['message']}"
    if kind == "union_tag_not_found":
        return missing_line([*words, context["discriminator"].strip("'")], table)
    if kind == "union_tag_invalid":
        key = context["discriminator"].strip("'")
        return f"{where}.{key} = {shown(context['tag'])} is not one of {context['expected_tags']}"
    value = shown(entry["input"])
    if words and words[-1].endswith(DIAMETERS):
        value = f"{shown(written)} diameters: {value}"
    return f"{where} = {value} {sentence(kind, context, entry['msg'])}"


def sentence(kind: str, context: Mapping[str, Any], message: str) -> str:
    """Second half of a message: the reason."""
    if kind == "outside":
        return f"lies outside {context['range']}"
    if kind == "literal_error":
        return f"is not one of {context['expected']}"
    if kind in ("too_long", "too_short"):
        bound = context.get("max_length", context.get("min_length"))
        side = "at most" if kind == "too_long" else "at least"
        return f"has {context['actual_length']} entries; {side} {bound} allowed"
    return SENTENCES.get(kind, message[:1].lower() + message[1:])


def missing_line(words: Sequence[str], table: Any) -> str:
    """An entry that is missing; a section beside one of nearly the same name may be misspelt."""
    *above, section, _ = ["", *words]
    for word in above[1:]:
        table = step_into(table, word)
    others = [name for name in table if name != section] if isinstance(table, dict) else []
    return f"{dotted([*words])} is missing{did_you_mean(section, others)}"


def as_written(location: tuple[str | int, ...], table: Any) -> tuple[list[str], Any]:
    """Keys of a place as the file has them, and its value there.

    Left out are tags of unions (a section's own `law` or `shape`) and marks of keys; what was given in
    diameters keeps its suffix.
    """
    words: list[str] = []
    for key in location:
        written = key
        if isinstance(table, dict) and key not in table:
            if key in [table.get(name) for name in DISCRIMINATORS]:
                continue
            written = f"{key}{DIAMETERS}" if f"{key}{DIAMETERS}" in table else key
        if key != KEY_MARK:
            words.append(str(written))
            table = step_into(table, written)
    return words, table


def step_into(table: Any, key: str | int) -> Any:
    """Entry of a table or list, None where there is none."""
    try:
        return table[key]
    except (KeyError, IndexError, TypeError):
        return None


def dotted(words: list[str]) -> str:
    """Path of a place in one line."""
    return ".".join(map(one_line, words)) or "the file"


def shown(value: Any) -> str:
    """Value on one line, shortened."""
    if isinstance(value, dict):
        return "a table"
    if isinstance(value, tuple):
        value = list(value)
    if isinstance(value, int) and not isinstance(value, bool) and abs(value) >= 10**LONGEST_VALUE:
        return "a number of more than 60 digits"
    return one_line(f"'{value}'" if isinstance(value, str) else repr(value))


def one_line(text: str) -> str:
    """Printable text without line breaks, at most LONGEST_VALUE characters."""
    clean = "".join(c if c.isprintable() else "?" for c in text[: LONGEST_VALUE + 1])
    return clean if len(clean) <= LONGEST_VALUE else clean[: LONGEST_VALUE - 3] + "..."
