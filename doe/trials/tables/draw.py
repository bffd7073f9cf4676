"""Draws a case from its seed: a laboratory, what acts in it, what it measured, and how it wrote that down."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from itertools import product
from pathlib import Path
from shutil import rmtree
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from doe.trials.tables.laws import Design, Random, Sight, drawn_truth, one_of, values
from doe.trials.tables.layouts import SIDE, UNKNOWN_SCATTER, Setting, Sheet, Style, write_table
from doe.trials.tables.reading import is_told, misread
from doe.trials.tables.solve import table_answer
from doe.trials.tables.words import (
    CONDITIONS,
    EXTRAS,
    FORMS,
    LABORATORY,
    QUANTITIES,
    RANGES,
    SHARES,
    WORDS,
    number,
    written,
)
from taichi_erosion.core.files import write_atomic
from taichi_erosion.evidence.data.problem import Floats

SETS, TRIES, SKEW, ENCODINGS = (8, 40), 500, 0.5, ("utf-8", "utf-8-sig", "cp1252")


@dataclass(frozen=True)
class TableCase:
    """A table, what is hidden behind it, and how hard that is to see."""

    truth: dict[str, Any]
    sheet: Sheet
    settings: tuple[Setting, ...]
    sight: Sight

    def write(self, place: Path) -> None:
        """The folder that the solver is given: the table, the same in plain words, options."""
        write_table(self.sheet, self.settings, place, "table")
        plain = replace(self.sheet, style=self.sheet.style.repaired(), readings=[])
        write_table(plain, self.settings, place, "plain")
        for stem, options in self.truth["options"].items():
            write_atomic(place / f"{stem}.txt", "\n".join(options).encode())

    def answer(self, number: int, keep: Path | None = None) -> dict[str, Any]:
        """What the program says of it now; its table and study stay in a folder."""
        with TemporaryDirectory() as other:
            place = (keep or Path(other)) / f"case_{number:05d}"
            rmtree(place, ignore_errors=True)
            self.write(place)
            return table_answer(place)

    def row(self, answer: Mapping[str, Any]) -> dict[str, Any]:
        """Truth, difficulty and answer without their rows, and what was misread."""
        wrong = misread(self.truth, answer["tidy"]) if answer["tidy"] else []
        told = [kind for kind in wrong if is_told(kind, self.truth, answer["assumed"])]
        truth = {key: value for key, value in self.truth.items() if key != "readings"}
        answer = {key: value for key, value in answer.items() if key != "tidy"} | {"told_misread": told}
        found = {"truth": truth, "difficulty": self.sight.difficulty(), "answer": answer}
        return found | {"misread": [kind for kind in wrong if kind not in told]}


def draw(seed: int, number: int) -> TableCase:
    """One case; the same numbers always give the same case."""
    generator = np.random.default_rng([seed, number, 49])
    kind, observables = (one_of(generator, SHARES[name]) for name in ("kinds", "observed"))
    for _ in range(TRIES):
        if case := Laboratory(generator, tuple(observables.split())).case(kind):
            return case
    raise RuntimeError(f"no table in {TRIES} draws")


def standard(generator: Random, shape: str, size: tuple[int, int]) -> Floats:
    """Numbers of mean 0 and sd 1: normal, Student's t of 4 degrees of freedom, or skewed."""
    normal, mean = generator.standard_normal(size), np.exp(0.5 * SKEW**2)
    skewed = (np.exp(SKEW * normal) - mean) / (np.sqrt(np.expm1(SKEW**2)) * mean)
    student = generator.standard_t(4, size) / np.sqrt(2.0)
    return {"normal": normal, "student": student, "lognormal": skewed}[shape]


class Laboratory:
    """What one laboratory varies, how it measures, and how it writes."""

    def __init__(self, generator: Random, observables: tuple[str, ...]) -> None:
        """Draw conditions, units, repeats and errors."""
        self.generator, self.observables = generator, observables
        self.conditions = self.drawn_conditions()
        quantities = ("diameter", *self.conditions, *observables)
        self.units = {q: int(generator.choice(len(QUANTITIES[q]["units"]))) for q in quantities}
        self.sand = ""  # diameter, where no column states it
        if "diameter" not in self.conditions and self.yes(0.2):
            self.sand = f"{generator.choice(QUANTITIES['diameter']['levels']):g} mm"
        self.layout, self.shape = (one_of(generator, SHARES[kind]) for kind in ("layouts", "shapes"))
        self.soils, single = 1 + self.yes(0.2), self.layout in ("rows", "numbered", "long") and self.yes(0.1)
        self.n = 1 if single else int(generator.integers(2, 5 if self.layout in SIDE else 6))
        self.noise = {q: float(generator.uniform(*LABORATORY[q]["noise"])) for q in observables}
        self.lost = 0.2 * (self.layout in SIDE and self.yes(0.3))  # share of lost repeats
        self.stated_sd = self.noise if self.layout in UNKNOWN_SCATTER and self.yes(0.3) else {}  # by option
        share = generator.uniform(0.6, 1.3) * self.yes(0.3)  # of preparations, in some laboratories
        self.between = {q: share * sd for q, sd in self.noise.items()}

    def yes(self, share: float) -> bool:
        """True with some probability."""
        return bool(self.generator.random() < share)

    def drawn_conditions(self) -> tuple[str, ...]:
        """Two or three conditions; of flux the wind is one."""
        weights = dict(CONDITIONS[self.observables[0]])
        flux, generator = "flux" in self.observables, self.generator
        share = np.array(list(weights.values())) / sum(weights.values())
        count = int(generator.choice([2, 3], p=[0.65, 0.35])) - flux
        return (*map(str, generator.choice(list(weights), count, False, share)), *(["u_star"] * flux))

    def case(self, kind: str) -> TableCase | None:
        """A case; None where it would be no table."""
        design = self.design()
        truth = drawn_truth(self.generator, kind, self.observables, design)
        if truth is None:
            return None
        exact = {name: values(truth, name, design) for name in self.observables}
        share = float(np.exp(self.generator.uniform(-4.0, -0.9))) * (1.0 if self.yes(0.65) else -1.0)
        limits = {n: share * float(np.quantile(x, 0.6)) for n, x in exact.items() if n == "flux"}
        found = {name: self.readings(name, mean) for name, mean in exact.items()}
        keep = np.ones(design.soil.size, np.bool_)  # sets of a small flux are left out, or below
        for name, limit in limits.items():
            keep &= np.nanmin(found[name], axis=1) > -3.0 * limit
        ends = {name: LABORATORY[name]["usual"] for name in exact}
        usual = all(ends[n][0] < v.min() and v.max() < ends[n][1] for n, v in exact.items())
        design, found = design.rows(keep), {name: rows[keep] for name, rows in found.items()}
        if not usual or design.varied < len(self.conditions) or design.soil.size < SETS[0]:
            return None
        style = self.style(design)
        floors = {n: number(style.cell(n, x)) * style.unit(n)[1] for n, x in limits.items()}
        hidden = {n: np.nanmin(rows, axis=1) < floors.get(n, -1.0) for n, rows in found.items()}
        if any(np.mean(own) > 0.6 for own in hidden.values()) or any(floors[n] == 0.0 for n in floors):
            return None
        acting = truth.outside.axes[:1] if truth.outside and truth.outside.form == "unread" else ()
        others = [name for name in self.generator.permutation(list(EXTRAS)) if name not in acting]
        count = int(self.generator.choice([0, 1, 2], p=[0.5, 0.35, 0.15])) * (self.layout != "long")
        style = replace(style, extras=(*acting, *map(str, others[:count])))
        settings = self.settings(design, found, style)
        sheet = Sheet(style, self.conditions, self.observables, self.n, floors, self.stated_sd)
        sheet.table(settings)
        count = {name: np.sum(np.isfinite(rows), axis=1) for name, rows in found.items()}
        sd = {n: np.hypot(self.between[n], self.noise[n] / count[n] ** 0.5) for n in found}
        sight = Sight(truth, design, sd, {name: ~own for name, own in hidden.items()})
        return TableCase(asdict(truth) | self.document(sheet), sheet, settings, sight)

    def design(self) -> Design:
        """Incompletely crossed conditions as their cells state them, of one soil or two."""
        generator, levels = self.generator, []
        for name in self.conditions:
            usual = QUANTITIES[name]["levels"]
            count = int(generator.integers(3, min(len(usual), 7 if len(self.conditions) < 3 else 4) + 1))
            levels.append(np.sort(generator.choice(usual, count, replace=False)))
        crossed = np.array([(soil, *at) for soil in range(self.soils) for at in product(*levels)])
        most = min(int(generator.integers(*SETS)), round(generator.uniform(0.6, 1.0) * len(crossed)))
        count = min(max(SETS[0], most), len(crossed))
        crossed = crossed[np.sort(generator.choice(len(crossed), count, replace=False))]
        at, measured = {}, self.yes(0.2)  # moisture is measured, not set
        for name, column in zip(self.conditions, crossed.T[1:], strict=True):
            if measured and name == "moisture":
                column = column * np.exp(0.08 * generator.standard_normal(count))
            _, size, decimals = QUANTITIES[name]["units"][self.units[name]]
            stated = column * QUANTITIES[name]["units"][0][1] / size
            at[name] = np.array([number(written(x, decimals)) * size for x in stated])
        if self.sand:
            at["diameter"] = np.full(count, 1e-3 * float(self.sand.removesuffix(" mm")))
        extra = {name: generator.uniform(low, high, count) for name, (low, high) in RANGES.items()}
        return Design(at, crossed[:, 0], extra)

    def readings(self, name: str, exact: Floats) -> Floats:
        """Repeats (sets, repeats)."""
        kicks = self.between[name] * self.generator.standard_normal((exact.size, 1))
        kicks = kicks + self.noise[name] * standard(self.generator, self.shape, (exact.size, self.n))
        kicks[:, 1:][self.generator.random((exact.size, self.n - 1)) < self.lost] = np.nan
        return exact[:, None] + kicks if name == "repose_angle" else exact[:, None] * np.exp(kicks)

    def style(self, design: Design) -> Style:
        """How this laboratory writes."""
        layout, soil, workbook, tidy = self.layout, "", self.yes(0.25), self.layout == "long"
        language, unseen = (one_of(self.generator, SHARES[kind]) for kind in ("languages", "unseen"))
        comma = language in ("de", "fr") and not workbook and self.yes(0.8)
        words = {kind: one_of(self.generator, words[language]) for kind, words in WORDS["words"].items()}
        for name, heads in ((n, QUANTITIES[n]) for n in (*self.conditions, *self.observables)):
            words[name] = heads.get("tidy", name) if tidy else one_of(self.generator, heads[language])
        if len(set(design.soil.tolist())) > 1:
            kind = "soil" if tidy or self.yes(0.7) else "laboratory"
            soil = "group" if tidy else words[kind]
            words["labels"] = words["soils" if kind == "soil" else "laboratories"]
        known: dict[str, Any] = {"names": words, "units": self.units, "soil": soil}
        known |= {"separator": one_of(self.generator, [";", "\t"] if comma else ",;\t")}
        known |= {"fewer": {name: int(self.yes(0.15)) for name in self.observables}, "workbook": workbook}
        known |= {"encoding": one_of(self.generator, ENCODINGS[: 3 if language in ("de", "fr") else 2])}
        known |= {"unseen": words["unseen"] if unseen == "words" else unseen, "decimal_comma": comma}
        if not tidy:
            known |= {"form": one_of(self.generator, list(FORMS)), "short": self.yes(0.3)}
        if layout in ("mean_sd", "columns", "bare_n") and design.soil.size <= 14 and self.yes(0.3):
            return Style(layout, language, transposed=True, **known)
        row = layout not in SIDE and not tidy and self.yes(0.15)
        return Style(layout, language, title=words["title"] * self.yes(0.2), units_row=row, **known)

    def settings(self, design: Design, found: Mapping[str, Floats], style: Style) -> tuple[Setting, ...]:
        """Sets of conditions with what was measured there, in the order of the table."""
        labels, settings = style.names.get("labels", "|").split("|"), list[Setting]()
        for k, soil in enumerate(map(int, design.soil)):
            at = {name: float(column[k]) for name, column in design.at.items()}
            cells = [{e: self.extra_cell(design, style, e, k) for e in style.extras} for _ in range(self.n)]
            settings.append(Setting(at, labels[soil], cells, {n: values[k] for n, values in found.items()}))
        return tuple(settings)

    def extra_cell(self, design: Design, style: Style, name: str, k: int) -> str:
        """Cell of a column that no model reads; the mass of a sample differs in every repeat."""
        extra = EXTRAS[name]
        if "cells" in extra:
            return extra["cells"][k % len(extra["cells"])]
        value = self.generator.uniform(*extra["range"]) if name == "mass" else design.extra[name][k]
        return written(float(value), extra["decimals"], style.decimal_comma)

    def options(self, style: Style) -> list[str]:
        """What a careful user says of a table where it does not say it itself."""
        words, sides = [], self.n if style.layout == "columns" and style.short else 0
        words += ["--diameter", self.sand] * bool(self.sand)
        for name in self.observables:
            size, unit = (1, "deg") if name == "repose_angle" else (100, "%")
            sd = f"{style.names[name]}={size * self.noise[name]:.2g} {unit}"
            words += ["--sd", sd] * bool(self.stated_sd)
            for k in range(sides if name == "repose_angle" else 0):
                words += ["--observable", f"{style.names['angle']} {k + 1}={name}"]
        return words + ["--fill-down"] * (style.layout == "grouped" and not style.workbook and self.n > 2)

    def document(self, sheet: Sheet) -> dict[str, Any]:
        """What belongs to the truth besides what acts."""
        style, kinds = sheet.style, [reading["kind"] for reading in sheet.readings]
        options = {"table": self.options(style), "plain": self.options(style.repaired())}
        legit = ["blank cells"] * (style.layout == "grouped" and not style.workbook)
        legit += ["n.d."] * ("unseen" in kinds and style.unseen == "n.d.")
        errors = {"noise": self.noise, "between": self.between, "shape": self.shape, "n": self.n}
        unknown = (style.layout in UNKNOWN_SCATTER or self.n == 1) and not self.stated_sd
        names = (*sheet.conditions, *(["diameter"] * bool(self.sand)))
        return {
            **{"layout": style.layout, "style": asdict(style), "may_refuse": legit, "options": options},
            **{"conditions": names, "observables": sheet.observables, "name": ""},
            **{"errors": errors, "unknown_scatter": unknown, "below": len(kinds) - kinds.count("exact")},
            **{"soils": len({reading["soil"] for reading in sheet.readings}), "readings": sheet.readings},
        }
