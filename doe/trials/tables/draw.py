"""Draws a case from its seed: a laboratory, what acts in it, what it measured, and how it wrote that down."""

from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, replace
from itertools import product
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from doe.trials.tables.laws import Design, Sight, drawn_truth, values
from doe.trials.tables.layouts import SIDE, UNKNOWN_SCATTER, Setting, Sheet, Style, write_table
from doe.trials.tables.reading import misread
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

SETS, TRIES, SKEW = (8, 40), 500, 0.5


@dataclass(frozen=True)
class TableCase:
    """A table, what is hidden behind it, and how hard that is to see."""

    truth: dict[str, Any]
    sheet: Sheet
    settings: tuple[Setting, ...]
    sight: Sight

    def difficulty(self) -> dict[str, Any]:
        """Signal over noise of what acts, beyond what calibration and soils imitate."""
        return self.sight.difficulty()

    def write(self, place: Path) -> None:
        """The folder that the solver is given: the table, the same in plain words, options."""
        write_table(self.sheet, self.settings, place, "table")
        plain = replace(self.sheet, style=self.sheet.style.repaired(), readings=[])
        write_table(plain, self.settings, place, "plain")
        write_atomic(place / "options.txt", "\n".join(self.truth["options"]).encode())

    def answer(self, _number: int = 0) -> dict[str, Any]:
        """What the program says of it now."""
        with TemporaryDirectory() as folder:
            self.write(Path(folder) / "case")
            return table_answer(Path(folder) / "case")

    def row(self, answer: Mapping[str, Any]) -> dict[str, Any]:
        """Truth, difficulty and answer without their rows, and what was misread."""
        wrong = misread(self.truth, answer["tidy"]) if answer["tidy"] else []
        truth = {key: value for key, value in self.truth.items() if key != "readings"}
        answer = {key: value for key, value in answer.items() if key != "tidy"}
        return {"truth": truth, "difficulty": self.difficulty(), "answer": answer, "misread": wrong}


def draw(seed: int, number: int) -> TableCase:
    """One case; the same numbers always give the same case."""
    chance = Chance(np.random.default_rng([seed, number, 49]))
    kind, observables = chance.one(SHARES["kinds"]), tuple(chance.one(SHARES["observed"]).split())
    for _ in range(TRIES):
        laboratory = Laboratory(chance, observables)
        if case := laboratory.case(kind):
            return case
    raise RuntimeError(f"no table in {TRIES} draws")


@dataclass(frozen=True)
class Chance:
    """A generator of random numbers with a few habits."""

    generator: np.random.Generator

    def one(self, words: Iterable[str]) -> str:
        """One of some words, by weight where they have weights."""
        weights = np.array([float(words[w]) if isinstance(words, Mapping) else 1.0 for w in words])
        return str(self.generator.choice(list(words), p=weights / weights.sum()))

    def yes(self, share: float) -> bool:
        """True with some probability."""
        return bool(self.generator.random() < share)

    def standard(self, shape: str, n: int) -> Floats:
        """Numbers of mean 0 and sd 1: normal, Student's t of 4 degrees of freedom, or skewed."""
        normal = self.generator.standard_normal(n)
        if shape == "student":
            return self.generator.standard_t(4, n) / np.sqrt(2.0)
        mean, spread = np.exp(0.5 * SKEW**2), np.sqrt(np.expm1(SKEW**2))
        return (np.exp(SKEW * normal) - mean) / (spread * mean) if shape == "lognormal" else normal


class Laboratory:
    """What one laboratory varies, how it measures, and how it writes."""

    def __init__(self, chance: Chance, observables: tuple[str, ...]) -> None:
        """Draw conditions, units, repeats and errors."""
        self.chance, self.observables = chance, observables
        self.conditions = self.drawn_conditions()
        quantities = (*self.conditions, *observables)
        self.units = {q: int(chance.generator.choice(len(QUANTITIES[q]["units"]))) for q in quantities}
        self.layout, self.shape = chance.one(SHARES["layouts"]), chance.one(SHARES["shapes"])
        self.soils = 1 + chance.yes(0.2)
        self.n = int(chance.generator.integers(2, 5 if self.layout in SIDE else 6))
        if self.layout in ("rows", "numbered", "long") and chance.yes(0.1):
            self.n = 1
        self.noise = {q: float(chance.generator.uniform(*LABORATORY[q]["noise"])) for q in observables}
        share = chance.generator.uniform(0.6, 1.3) * chance.yes(0.3)  # of preparations, in some laboratories
        self.between = {q: share * sd for q, sd in self.noise.items()}

    def drawn_conditions(self) -> tuple[str, ...]:
        """Two or three conditions; of flux the wind is one."""
        weights = dict(CONDITIONS[self.observables[0]])
        flux, generator = "flux" in self.observables, self.chance.generator
        share = np.array(list(weights.values())) / sum(weights.values())
        count = int(generator.choice([2, 3], p=[0.65, 0.35])) - flux
        return (*map(str, generator.choice(list(weights), count, False, share)), *(["u_star"] * flux))

    def case(self, kind: str) -> TableCase | None:
        """A case; None where it would be no table."""
        design = self.design()
        truth = drawn_truth(self.chance.generator, kind, self.observables, design)
        if truth is None:
            return None
        exact = {name: values(truth, name, design) for name in self.observables}
        limits = self.limits(exact)
        found = {name: self.readings(name, mean) for name, mean in exact.items()}
        keep = np.all([np.min(found[name], axis=1) > -3.0 * limit for name, limit in limits.items()], axis=0)
        keep = np.broadcast_to(keep, design.size)  # sets whose flux is too small are left out, or below
        ends = {name: LABORATORY[name]["usual"] for name in exact}
        usual = all(ends[n][0] < v.min() and v.max() < ends[n][1] for n, v in exact.items())
        design, found = design.rows(keep), {name: rows[keep] for name, rows in found.items()}
        if not usual or not design.varied or design.size < SETS[0]:
            return None
        style = self.style(design)
        floors = {n: number(style.cell(n, x)) * style.unit(n)[1] for n, x in limits.items()}
        hidden = {n: np.min(rows, axis=1) < floors.get(n, -1.0) for n, rows in found.items()}
        if any(np.mean(own) > 0.6 for own in hidden.values()) or any(floors[n] == 0.0 for n in floors):
            return None
        acting = truth.outside.axes[:1] if truth.outside and truth.outside.form == "unread" else ()
        others = [name for name in self.chance.generator.permutation(list(EXTRAS)) if name not in acting]
        count = int(self.chance.generator.choice([0, 1, 2], p=[0.5, 0.35, 0.15])) * (self.layout != "long")
        style = replace(style, extras=(*acting, *map(str, others[:count])))
        settings = self.settings(design, found, style)
        sheet = Sheet(style, self.conditions, self.observables, floors)
        sheet.table(settings)
        sd = {n: np.full(design.size, np.hypot(self.between[n], self.noise[n] / self.n**0.5)) for n in found}
        sight = Sight(truth, design, sd, {name: ~own for name, own in hidden.items()})
        return TableCase(asdict(truth) | self.document(sheet), sheet, settings, sight)

    def design(self) -> Design:
        """Incompletely crossed conditions as their cells state them, of one soil or two."""
        generator, levels = self.chance.generator, []
        for name in self.conditions:
            usual = QUANTITIES[name]["levels"]
            count = int(generator.integers(3, min(len(usual), 7 if len(self.conditions) < 3 else 4) + 1))
            levels.append(np.sort(generator.choice(usual, count, replace=False)))
        crossed = np.array([(soil, *at) for soil in range(self.soils) for at in product(*levels)])
        most = min(int(generator.integers(*SETS)), round(generator.uniform(0.6, 1.0) * len(crossed)))
        count = min(max(SETS[0], most), len(crossed))
        crossed = crossed[np.sort(generator.choice(len(crossed), count, replace=False))]
        at, measured = {}, self.chance.yes(0.2)  # moisture is measured, not set
        for name, column in zip(self.conditions, crossed.T[1:], strict=True):
            if measured and name == "moisture":
                column = column * np.exp(0.08 * generator.standard_normal(count))
            _, size, decimals = QUANTITIES[name]["units"][self.units[name]]
            stated = column * QUANTITIES[name]["units"][0][1] / size
            at[name] = np.array([number(written(x, decimals)) * size for x in stated])
        extra = {name: generator.uniform(low, high, count) for name, (low, high) in RANGES.items()}
        return Design(at, crossed[:, 0], extra)

    def limits(self, exact: Mapping[str, Floats]) -> dict[str, float]:
        """Least flux that an instrument shows; negative where sets below are left out."""
        if "flux" not in exact or not np.any(exact["flux"] > 0.0):
            return {}
        share = float(np.exp(self.chance.generator.uniform(np.log(0.02), np.log(0.4))))
        limit = share * float(np.median(exact["flux"][exact["flux"] > 0.0]))
        return {"flux": limit if self.chance.yes(0.5) else -limit}

    def readings(self, name: str, exact: Floats) -> Floats:
        """Repeats (sets, repeats)."""
        kicks = self.between[name] * self.chance.generator.standard_normal((exact.size, 1))
        kicks = kicks + self.noise[name] * np.array([self.chance.standard(self.shape, self.n) for _ in exact])
        return exact[:, None] + kicks if name == "repose_angle" else exact[:, None] * np.exp(kicks)

    def style(self, design: Design) -> Style:
        """How this laboratory writes."""
        chance, layout, soil = self.chance, self.layout, ""
        language, workbook = chance.one(SHARES["languages"]), chance.yes(0.25)
        comma = language in ("de", "fr") and not workbook and chance.yes(0.8)
        words = {kind: chance.one(words[language]) for kind, words in WORDS["words"].items()}
        names = {n: chance.one(QUANTITIES[n][language]) for n in (*self.conditions, *self.observables)}
        if layout == "long":  # the form of the program itself
            names = {name: name for name in names}
        if len(set(design.soil.tolist())) > 1:
            kind = "soil" if layout == "long" or chance.yes(0.7) else "laboratory"
            soil = "group" if layout == "long" else words[kind]
            words["labels"] = words["soils" if kind == "soil" else "laboratories"]
        unseen, fewer = (
            chance.one(SHARES["unseen"]),
            {name: int(chance.yes(0.15)) for name in self.observables},
        )
        style = Style(layout, language, workbook=workbook, names=names | words, units=self.units, soil=soil)
        style = replace(style, decimal_comma=comma, separator=chance.one([";", "\t"] if comma else ",;\t"))
        western = ["cp1252"] * (language in ("de", "fr"))
        style = replace(style, encoding=chance.one(["utf-8", "utf-8-sig", *western]), fewer=fewer)
        style = replace(style, unseen=words["unseen"] if unseen == "words" else unseen)
        if layout == "long":
            return style
        if layout in ("mean_sd", "columns", "bare_n") and design.size <= 14 and chance.yes(0.3):
            return replace(style, transposed=True, form=chance.one(list(FORMS)), short=chance.yes(0.4))
        title, row = words["title"] * chance.yes(0.2), layout not in SIDE and chance.yes(0.15)
        return replace(style, form=chance.one(list(FORMS)), title=title, units_row=row, short=chance.yes(0.4))

    def settings(self, design: Design, found: Mapping[str, Floats], style: Style) -> tuple[Setting, ...]:
        """Sets of conditions with what was measured there, in the order of the table."""
        labels, settings = style.names.get("labels", "|").split("|"), []
        for k, soil in enumerate(design.soil):
            at = {name: float(design.at[name][k]) for name in self.conditions}
            cells = [{e: self.extra_cell(design, style, e, k) for e in style.extras} for _ in range(self.n)]
            rows = {name: values[k].tolist() for name, values in found.items()}
            settings.append(Setting(at, labels[int(soil)], cells, rows))
        return tuple(settings)

    def extra_cell(self, design: Design, style: Style, name: str, k: int) -> str:
        """Cell of a column that no model reads; the mass of a sample differs in every repeat."""
        day, generator = 1 + k % 28, self.chance.generator
        if name not in RANGES:
            dates = f"{day:02d}.06.2025" if style.language == "de" else f"2025-06-{day:02d}"
            return dates if name == "date" else ("MK", "LB")[k % 2]
        value = generator.uniform(*RANGES[name][:2]) if name == "mass" else design.extra[name][k]
        return written(float(value), EXTRAS[name]["decimals"], style.decimal_comma)

    def document(self, sheet: Sheet) -> dict[str, Any]:
        """What belongs to the truth besides what acts."""
        style, kinds = sheet.style, [reading["kind"] for reading in sheet.readings]
        legit = ["blank cells"] * (style.layout == "grouped" and not style.workbook)
        legit += ["n.d."] * ("unseen" in kinds and style.unseen == "n.d.")
        errors = {"noise": self.noise, "between": self.between, "shape": self.shape, "n": self.n}
        return {
            **{"layout": style.layout, "style": asdict(style), "may_refuse": legit, "options": []},
            **{"conditions": sheet.conditions, "observables": sheet.observables},
            **{"errors": errors, "unknown_scatter": style.layout in UNKNOWN_SCATTER or self.n == 1},
            **{"soils": len({reading["soil"] for reading in sheet.readings}), "name": ""},
            **{"below": sum(kind != "exact" for kind in kinds), "readings": list(sheet.readings)},
        }
