"""A table as a laboratory writes it, and what every row of it says.

A layout puts the readings of a set of conditions into rows of cells; a style says in which language, with
which decimal mark, separator and file. What a cell says is read back from its text, so that rounding belongs
to the truth.
"""

import csv
import io
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from math import isnan, sqrt
from pathlib import Path
from typing import Any

import numpy as np
import openpyxl

from doe.trials.tables.words import EXTRAS, QUANTITIES, WORDS, heading, number, written
from taichi_erosion.core.files import write_atomic

ROWS, SIDE = ("rows", "numbered", "grouped", "long"), ("columns", "merged")  # a value a row; repeats beside
MEANS = ("mean_sd", "plus_minus", "mean_se", "cv", "bare", "bare_n")
UNKNOWN_SCATTER = ("bare", "bare_n")
Merged = list[tuple[int, int, int, int]]  # first row and column, last row and column


@dataclass(frozen=True)
class Style:
    """How a laboratory writes."""

    layout: str
    language: str
    form: str = "brackets"  # of a heading
    separator: str = ","
    decimal_comma: bool = False
    workbook: bool = False
    encoding: str = "utf-8"
    title: str = ""
    units_row: bool = False
    transposed: bool = False
    names: dict[str, str] = field(default_factory=dict)  # heading of every quantity, and of other words
    units: dict[str, int] = field(default_factory=dict)  # place of its unit in the list
    fewer: dict[str, int] = field(default_factory=dict)  # decimals that are left out
    unseen: str = "<"  # a value below the limit: <, 0, n.d., words
    short: bool = False  # `Winkel 1` for repeats of the angle
    soil: str = ""  # heading of the column of soils
    note: str = ""  # before headings that are not to be read
    extras: tuple[str, ...] = ()  # columns that no model reads

    def unit(self, name: str) -> tuple[str, float, int]:
        """Unit of a quantity as written, its size, decimals."""
        text, size, decimals = QUANTITIES[name]["units"][self.units[name]]
        return text, size, max(decimals - self.fewer.get(name, 0), 0)

    def cell(self, name: str, value: float, more: int = 0) -> str:
        """A value in the unit of its quantity."""
        _, size, decimals = self.unit(name)
        return written(value / size, decimals + more, self.decimal_comma)

    def repaired(self) -> "Style":
        """The same with plain headings and filled cells, as after a refusal."""
        names = {kind: words["en"][0] for kind, words in WORDS["words"].items()}
        names |= {name: QUANTITIES[name]["plain"] for name in self.names if name in QUANTITIES}
        layout = {"grouped": "rows", "merged": "columns"}.get(self.layout, self.layout)
        unseen = "<" if self.unseen == "n.d." else self.unseen
        plain = Style(layout, "en", separator=";" if self.decimal_comma else ",", unseen=unseen, note="note ")
        names = self.names if layout == "long" else names
        plain = replace(plain, names=names, units=self.units, fewer=self.fewer, extras=self.extras)
        return replace(plain, decimal_comma=self.decimal_comma, soil="soil" * bool(self.soil))


@dataclass(frozen=True)
class Setting:
    """One set of conditions of one soil, with what was measured there."""

    at: dict[str, float]  # in the units of the model
    soil: str
    extra: list[dict[str, str]]  # of every repeat, cells of columns that no model reads
    values: dict[str, np.ndarray]  # repeats by observable; NaN where one was lost


@dataclass(frozen=True)
class Sheet:
    """Columns of a table, and what its cells say once it is written."""

    style: Style
    conditions: tuple[str, ...]
    observables: tuple[str, ...]
    repeats: int
    limits: dict[str, float]  # below which an instrument shows nothing, in the unit of the model
    stated_sd: dict[str, float]  # of means, by an option: deg, or a share of the value
    readings: list[dict[str, Any]] = field(default_factory=list)

    def table(self, settings: Sequence[Setting]) -> tuple[list[tuple[str, str, str]], list[list[str]]]:
        """Heading as (merged heading, name, unit) and rows; readings are kept."""
        style, rows = self.style, []
        self.readings.clear()
        heads = [("", style.names[name], style.unit(name)[0]) for name in self.conditions]
        heads = [("", style.soil, "")] * bool(style.soil) + heads + list(self.measured_heads())
        for setting in settings:
            lead = [setting.soil] * bool(style.soil)
            lead += [style.cell(name, setting.at[name]) for name in self.conditions]
            for index, cells in enumerate(self.measured(setting)):
                extra = setting.extra[min(index, len(setting.extra) - 1)]
                rows.append([*lead, *cells, *(extra[name] for name in style.extras)])
        for extra in (EXTRAS[name] for name in style.extras):
            heads.append(("", style.note + extra[style.language], extra.get("unit", "")))
        return heads, rows

    def measured_heads(self) -> Iterator[tuple[str, str, str]]:
        """Headings of what was measured."""
        layout, names = self.style.layout, self.style.names
        if layout == "numbered":
            yield "", names["repeat"], ""
        if layout == "long":
            yield from (("", text, "") for text in ("observable", "value", "unit"))
        for name in self.observables if layout != "long" else ():
            unit, first = self.style.unit(name)[0], names[name]
            first = names["angle"] if self.style.short and name == "repose_angle" else first
            if layout in SIDE:
                top = names[name] if layout == "merged" else ""
                yield from (
                    (top, str(k + 1) if top else f"{first} {k + 1}", unit) for k in range(self.repeats)
                )
                continue
            yield "", names[name], unit
            if layout in ("mean_sd", "mean_se", "cv"):
                several = f" {names[name]}" * (len(self.observables) > 1)
                yield "", names[layout] + several, "%" if layout == "cv" else unit
        if layout in MEANS and layout != "bare":
            yield "", names["count"], ""

    def measured(self, setting: Setting) -> Iterator[list[str]]:
        """Cells of what was measured at a set, row by row."""
        layout, names = self.style.layout, self.observables
        for k in range(self.repeats if layout in ROWS else 0):
            cells = [self.single(setting, name, k) for name in names]
            if layout == "long":
                units = [self.style.unit(name)[0] for name in names]
                yield from map(list, zip(names, cells, units, strict=True))
            else:
                yield [str(k + 1)] * (layout == "numbered") + cells
        if layout in SIDE:
            yield [self.single(setting, name, k) for name in names for k in range(self.repeats)]
        elif layout in MEANS:
            cells = [cell for name in names for cell in self.summary(setting, name)]
            count = min(int(np.sum(np.isfinite(values))) for values in setting.values.values())
            yield cells + [str(count)] * (layout != "bare")

    def single(self, setting: Setting, name: str, k: int) -> str:
        """Cell of one repeat; empty where there is none."""
        value = float(setting.values[name][k])
        if isnan(value) or value < self.limits.get(name, -1.0):
            return "" if isnan(value) else self.hidden(setting, name)
        text = self.style.cell(name, value)
        self.keep(setting, name, text)
        return text

    def summary(self, setting: Setting, name: str) -> list[str]:
        """Cells of mean and scatter of the repeats."""
        style, layout, values = self.style, self.style.layout, setting.values[name]
        values = values[np.isfinite(values)]
        n, told = int(values.size), dict[str, Any](n=int(values.size)) if layout != "bare" else {}
        if np.any(values < self.limits.get(name, -1.0)):
            return [self.hidden(setting, name, **told), *([""] * (layout in ("mean_sd", "mean_se", "cv")))]
        _, size, decimals = style.unit(name)
        text, sd = style.cell(name, float(values.mean())), float(values.std(ddof=1)) if n > 1 else 0.0
        if layout in UNKNOWN_SCATTER:
            if name in self.stated_sd:
                relative = 1.0 if name == "repose_angle" else number(text) * size
                told["sd"] = float(f"{self.stated_sd[name]:.2g}") * relative
            self.keep(setting, name, text, **told)
            return [text]
        root, least = sqrt(n) if layout == "mean_se" else 1.0, size * 10.0 ** -(decimals + 1)
        spread = style.cell(name, max(sd / root, least), 1)
        if layout == "cv":
            mean = number(text) * size
            spread = written(max(100.0 * sd / mean, 0.1), 1, style.decimal_comma)
            root = 0.01 * mean / size
        self.keep(setting, name, text, sd=number(spread) * size * root, **told)
        return [text + style.names["plus_minus"] + spread] if layout == "plus_minus" else [text, spread]

    def hidden(self, setting: Setting, name: str, **told: Any) -> str:
        """Cell of a value below the limit of its instrument."""
        word, limit = self.style.unseen, self.style.cell(name, self.limits[name])
        self.keep(setting, name, limit, kind={"<": "below", "0": "zero"}.get(word, "unseen"), **told)
        return f"<{limit}" if word == "<" else word

    def keep(self, setting: Setting, name: str, text: str, **told: Any) -> None:
        """Keep what a cell says."""

        def stated(key: str, text: str) -> float:
            return number(text) * self.style.unit(key)[1]

        at = {key: stated(key, self.style.cell(key, x)) for key, x in setting.at.items()}
        row = {"soil": setting.soil, "observable": name, "at": at, "value": stated(name, text)}
        self.readings.append(row | {"kind": "exact", "sd": None, "n": None} | told)


def grid(sheet: Sheet, settings: Sequence[Setting]) -> tuple[list[list[str]], Merged]:
    """Rows of cells, heading first, and cells that a workbook merges."""
    style, (heads, body) = sheet.style, sheet.table(settings)
    merged: Merged = []
    rows = [[heading(name, unit, style.form) for _, name, unit in heads], *body]
    if style.layout == "merged":
        tops = [heading(top or name, unit, style.form) for top, name, unit in heads]
        starts = [k for k, (top, *_) in enumerate(heads) if not top or k == 0 or tops[k] != tops[k - 1]]
        first = [text if k in starts else "" for k, text in enumerate(tops)]
        second = [[name if top else "" for top, name, _ in heads]] * (style.workbook or style.short)
        rows = [first, *second, *body]  # in a text file blank headings stay to the right of one
        ends = [*starts[1:], len(tops)]
        merged += [(0, a, 0, b - 1) for a, b in zip(starts, ends, strict=True) if b - a > 1]
    elif style.units_row:
        rows = [[name for _, name, _ in heads], [f"[{unit}]" * bool(unit) for *_, unit in heads], *body]
    if style.layout == "grouped":
        merged += blank_below(rows, len(rows) - len(body), 1 + bool(style.soil))
    if style.transposed:
        rows = [list(row) for row in zip(*rows, strict=True)]
    if style.title:
        rows, merged = [[style.title], [], *rows], [(a + 2, b, c + 2, d) for a, b, c, d in merged]
    return rows, merged


def blank_below(rows: list[list[str]], start: int, lead: int) -> Merged:
    """Leave the first cells of rows only in the first row of their block; the blocks."""
    blocks, first = [], start
    for row in range(start + 1, len(rows) + 1):
        if row < len(rows) and rows[row][:lead] == rows[first][:lead]:
            continue
        for other in range(first + 1, row):
            rows[other][:lead] = [""] * lead
        blocks += [(first, column, row - 1, column) for column in range(lead) if row - first > 1]
        first = row
    return blocks


def write_table(sheet: Sheet, settings: Sequence[Setting], folder: Path, stem: str) -> None:
    """Write the file of a table: text, or a workbook with numbers as numbers and merged cells."""
    style, (rows, merged) = sheet.style, grid(sheet, settings)
    folder.mkdir(parents=True, exist_ok=True)
    if not style.workbook:
        text = io.StringIO(newline="")
        csv.writer(text, delimiter=style.separator, lineterminator="\n").writerows(rows)
        encoding = "utf-8" if "⁻" in text.getvalue() else style.encoding  # cp1252 has no raised minus
        write_atomic(folder / f"{stem}.csv", text.getvalue().encode(encoding))
        return
    book = openpyxl.Workbook()
    page = book.worksheets[0]
    for k, row in enumerate(rows, 1):
        for j, text in enumerate(row, 1):
            page.cell(k, j, text or None)
            with suppress(ValueError):
                page.cell(k, j, float(text))
    for a, b, c, d in merged:
        page.merge_cells(start_row=a + 1, start_column=b + 1, end_row=c + 1, end_column=d + 1)
    book.save(folder / f"{stem}.xlsx")
