"""A study made of a laboratory's table: the tidy table, a study, and a scene that fits what was measured.

What the table does not say is asked; every question has a guess, which counts where nobody is asked.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import isfinite
from pathlib import Path
from statistics import median
from typing import Any

from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.files import write_atomic
from taichi_erosion.evidence.answers import closed_form
from taichi_erosion.evidence.answers.check_study import acting_candidates, check_study, range_faults
from taichi_erosion.evidence.answers.scene_templates import (
    TEMPLATES,
    WIND_COLUMN,
    Template,
    places_of,
    safe_grains,
    scene_text,
    templates_for,
)
from taichi_erosion.evidence.answers.study_text import StudyText, study_text, table_text
from taichi_erosion.evidence.data.tables.column_roles import Column, Told, column_roles
from taichi_erosion.evidence.data.tables.laboratory_table import Choices, tidy_cells, tidy_name
from taichi_erosion.evidence.data.tables.spreadsheet import Cells, read_cells
from taichi_erosion.evidence.data.tables.tidy_table import Table, is_tidy, pointed, tidy_table
from taichi_erosion.evidence.data.tables.vocabulary import DIAMETER, known_places, meaning_of
from taichi_erosion.evidence.models.load_study import load_study
from taichi_erosion.scene.paths import unit_of_path
from taichi_erosion.scene.schema.units import parse_unit, scale_between

Ask = Callable[[str, str], str]  # (question, guess) -> answer
Document = dict[str, Any]
NOT_USED = "-"
UNITS = {  # of the program's measures, where a heading has none
    **dict.fromkeys(
        ("repose_angle", "cone_angle", "angle_of_repose", "dynamic_angle", "sliding_angle"), "deg"
    ),
    **dict.fromkeys(("threshold_u_star", "impact_threshold", "threshold_wind_speed", "rolling_onset"), "m/s"),
    "flux": "kg/(m s)",
}


@dataclass(frozen=True)
class Wishes:
    """What the command line says beforehand."""

    told: Told = field(default_factory=Told)
    folder: Path | None = None
    apparatus: str | None = None  # of TEMPLATES
    closed_form: bool = False  # the reduced model answers in place of scenes


@dataclass
class Interview:
    """Questions that were asked, and what was assumed where a guess was taken."""

    ask: Ask
    assumed: list[str] = field(default_factory=list)

    def choice(self, question: str, guess: str, meaning: str) -> str:
        """Answer to a question; an accepted guess is recorded with its meaning."""
        answer = self.ask(question, guess).strip() or guess
        if answer == guess:
            self.assumed.append(meaning)
        return answer


def new_study(table: Path, wishes: Wishes, ask: Ask) -> Document:
    """Write table, study and scenes of a laboratory's table; the document says what was understood.

    Raises BadInput with all faults of the table, or where a file would be replaced.
    """
    cells = read_cells(table, table.name)
    if not cells.rows:
        raise BadInput(f"{table.name}: is empty; the first row names the columns")
    if not cells.lines:
        raise BadInput(f"{table.name}: has a heading but no measured value")
    interview = Interview(ask)
    tidy, columns = understood(cells, wishes.told, interview)
    measured = tidy_table(pointed(tidy))
    names = list(dict.fromkeys(row.observable for row in measured.rows))
    folder = wishes.folder or table.with_name(table.stem)
    refuse_existing(folder, table)
    places = condition_places(measured, columns, wishes.told)
    if faults := list(range_faults(measured, places)):
        raise BadInput(*faults)
    if wishes.closed_form:
        text, scenes = closed_form.study(measured, names, places), {}
    else:
        text, scenes = scene_study(measured, names, places, wishes, interview)
    text = replace(text, title=table.stem, measurements=tidy_file(table), assumed=tuple(interview.assumed))
    study = folder / f"{table.stem}.toml"
    write_atomic(folder / tidy_file(table), table_text(tidy).encode())
    for name, content in scenes.items():
        write_atomic(folder / f"{name}.toml", content.encode())
    write_atomic(study, study_text(text).encode())
    return {
        "table": str(table),
        "form": cells.form,
        "columns": [told_column(column, cells, text) for column in columns],
        "assumed": list(interview.assumed),
        "written": [str(study), str(folder / tidy_file(table)), *(str(folder / f"{n}.toml") for n in scenes)],
        **checked_study(study, text),
    }


def tidy_file(table: Path) -> str:
    """Name of the tidy table: another one than that of the laboratory's."""
    return f"{table.stem}_tidy.csv"


def refuse_existing(folder: Path, table: Path) -> None:
    """Refuse to write over a study that is there."""
    for path in (folder / f"{table.stem}.toml", folder / tidy_file(table)):
        if path.exists():
            raise BadInput(f"{path}: exists; remove it, or name another folder with --out")


def understood(cells: Cells, told: Told, interview: Interview) -> tuple[Cells, list[Column]]:
    """The tidy table and the meaning of the columns that it was made of."""
    if is_tidy(cells.heading):
        return cells, []
    columns = [settled(column, interview) for column in column_roles(cells, told)]
    if not any(column.role == "observable" for column in columns):
        known = ", ".join(dict.fromkeys(name for t in TEMPLATES.values() for name in t.observables))
        raise BadInput(
            f"{cells.file}: no column is known as a measured quantity; say which one is: --observable "
            f"'COLUMN=NAME', NAME one of {known}"
        )
    refuse_unknown(columns, cells)
    units = {c.place: unit_of(c, interview) for c in columns if c.role == "observable" and not c.heading.unit}
    scatter = "sd"
    if any("±" in cell or "+-" in cell or "+/-" in cell for _, row in cells.lines for cell in row):
        question = "What stands behind ±: sd of single repeats (sd) or standard error of the mean (se)?"
        told_as = "numbers behind ± are standard deviations of single repeats"
        scatter = interview.choice(question, "sd", told_as)
    if not any(column.role == "n" for column in columns):
        interview.assumed.append(
            "no column counts repeats: n is left empty, and a value counts as one measurement"
        )
    if scatter not in ("sd", "se"):
        raise BadInput(f"{cells.file}: '{scatter}' is not one of sd, se")
    return tidy_cells(cells, columns, Choices("se" if scatter == "se" else "sd", units)), columns


def settled(column: Column, interview: Interview) -> Column:
    """A column of which only a guess was known, as the user calls it."""
    if column.sure or not column.numeric:
        return column
    question = (
        f"Column '{column.heading.text}' is a measured quantity (its name), sets a place, or is not used (-)?"
    )
    meaning = f"column '{column.heading.text}' is not used: its heading says nothing known"
    answer = interview.choice(question, NOT_USED, meaning)
    if answer == NOT_USED:
        return replace(column, sure=True)
    role, name = meaning_of(answer)
    if "." in answer:
        return replace(column, role="condition", name=answer, sure=True)
    if role in ("observable", "condition"):
        return replace(column, role=role, name=name, sure=True)
    return replace(column, role="observable", name=answer, sure=True)


def refuse_unknown(columns: Sequence[Column], cells: Cells) -> None:
    """Refuse what no scene measures or has, and two columns for one condition."""
    faults = []
    seen: dict[str, str] = {}
    for column in columns:
        where = f"{cells.file}: column '{column.heading.text}'"
        if column.role == "observable" and not templates_for(column.name):
            known = ", ".join(dict.fromkeys(name for t in TEMPLATES.values() for name in t.observables))
            faults.append(f"{where}: no scene measures '{column.name}'; known: {known}")
        if column.role in ("observable", "condition"):
            if column.name in seen:
                faults.append(
                    f"{where} means {column.name}, as column '{seen[column.name]}' does; say what it is with "
                    f"--condition '{column.heading.name}=PATH', or remove one"
                )
            seen.setdefault(column.name, column.heading.text)
        if column.role == "condition":
            faults += list(kind_faults(column, where))
    if faults:
        raise BadInput(*faults)


def kind_faults(column: Column, where: str) -> Iterator[str]:
    """A condition that no scene has, or in a unit of another kind than its place."""
    place = column.name.split(",")[0].strip()
    unit = unit_of_path(place)
    if unit is None:
        known = ", ".join(known_places())
        yield f"{where}: no scene has a place '{place}'; known: {known}"
    elif column.heading.unit and scale_between(column.heading.unit, parse_unit(unit)) is None:
        slope = " (a slope in % is a tangent: write its angle)" if place.endswith("slope") else ""
        told = "a pure number" if unit == "1" else unit
        yield f"{where}: {place} counts in {told}; give it in that unit{slope}"


def unit_of(column: Column, interview: Interview) -> str:
    """Unit of an observable whose heading has none."""
    usual = UNITS.get(column.name, "m")
    meaning = f"'{column.heading.text}' has no unit in its heading: taken as {usual}"
    return interview.choice(f"Unit of '{column.heading.text}'?", usual, meaning)


def condition_places(table: Table, columns: Sequence[Column], told: Told) -> dict[str, str]:
    """Place that every condition of the tidy table sets."""
    if columns:
        return {tidy_name(c.name): c.name for c in columns if c.role == "condition"}
    stated = {name: told.conditions.get(name) or meaning_of(name)[1] for name in table.conditions}
    faults = [
        f"{table.file}: column '{name}': no place of a scene is known by that name; say which one it sets: "
        f"--condition {name}=PATH"
        for name, place in stated.items()
        if not place
    ]
    if faults:
        raise BadInput(*faults)
    return stated


def scene_study(
    table: Table, names: Sequence[str], places: Mapping[str, str], wishes: Wishes, interview: Interview
) -> tuple[StudyText, dict[str, str]]:
    """The study that scenes answer, and the scenes by name."""
    found: dict[str, list[str]] = {}
    for name in names:
        found.setdefault(apparatus_of(name, wishes, interview, table.file), []).append(name)
    scenes, parameters, conditions = {}, {}, {}
    for key, own in found.items():
        template = TEMPLATES[key]
        diameter = grain_diameter(table, template, places, interview)
        grains = safe_grains(template, angles_of(table, own))
        notes = f"Made for {table.file}: {', '.join(own)}. Numbers of grains and contacts are usual ones."
        head = {"title": f"{table.file}: {template.words}", "notes": notes}
        scenes[key] = scene_text(template, head, diameter, grains)
        parameters |= {number.path: number for number in template.parameters}
        for name, place in places.items():
            stated = dict.fromkeys(
                [*conditions.get(name, "").split(", "), *places_of(template, place).split(", ")]
            )
            conditions[name] = ", ".join(filter(None, stated))
        if template.wind and WIND_COLUMN not in places.values():
            interview.assumed.append("no column states the friction velocity: the wind is that of the scene")
    observables = {name: key for key, own in found.items() for name in own}
    positive = {n for n in names if all(r.value > 0.0 for r in table.rows if r.observable == n)}
    return StudyText(observables, conditions, tuple(parameters.values()), frozenset(positive)), scenes


def apparatus_of(observable: str, wishes: Wishes, interview: Interview, file: str) -> str:
    """Apparatus whose scene measures an observable."""
    possible = templates_for(observable)
    if not possible:
        raise BadInput(
            f"{file}: no scene measures '{observable}'; rename it, or write a study on your own scene"
        )
    if wishes.apparatus in possible:
        return str(wishes.apparatus)
    if wishes.apparatus is not None and wishes.apparatus not in TEMPLATES:
        raise BadInput(f"--apparatus {wishes.apparatus}: is not one of {', '.join(TEMPLATES)}")
    if len(possible) == 1:
        return possible[0]
    words = "; ".join(f"{name}: {TEMPLATES[name].words}" for name in possible)
    meaning = f"{observable} is taken as measured with {TEMPLATES[possible[0]].words} (--apparatus)"
    answer = interview.choice(f"How was {observable} measured? {words}", possible[0], meaning)
    if answer not in possible:
        raise BadInput(f"{observable}: '{answer}' is not one of {', '.join(possible)}")
    return answer


def grain_diameter(
    table: Table, template: Template, places: Mapping[str, str], interview: Interview
) -> float:
    """Diameter of the grains in a scene [m]: the middle of the table's, else as usual."""
    for place, (name, unit) in enumerate(zip(table.conditions, table.units, strict=True)):
        if places.get(name) == DIAMETER and template.varies:
            scale = scale_between(unit or "m", parse_unit("m"))
            values = [row.conditions[place] for row in table.rows if isfinite(row.conditions[place])]
            if scale is not None and values:
                return float(f"{scale.used(median(values)):.4g}")
    if template.varies:
        told = f"no column states the grain diameter: {1e3 * template.diameter:g} mm is assumed"
        interview.assumed.append(told)
    return template.diameter


def angles_of(table: Table, names: Sequence[str]) -> list[float]:
    """Measured angles of heaps [deg]."""
    found = []
    for row in table.rows:
        scale = scale_between(row.unit, parse_unit("deg")) if row.observable in names else None
        if scale is not None and isfinite(row.value):
            found.append(scale.used(row.value))
    return found


def checked_study(study: Path, text: StudyText) -> Document:
    """Validation and cost of the study that was written; of a scene's study the candidates that can act."""
    inactive: dict[str, str] = {}
    if not text.model:
        acting, inactive = acting_candidates(load_study(study))
        write_atomic(study, study_text(replace(text, candidates=tuple(acting))).encode())
    return check_study(study) | {"inactive": inactive}


def told_column(column: Column, cells: Cells, text: StudyText) -> Document:
    """What was understood of a column."""
    words = {"sd": "scatter of single repeats", "se": "standard error of the mean", "n": "number of repeats"}
    words |= {"group": "set-up of a row", "source": "source", "remark": "not used"}
    if column.role == "observable":
        told = f"measured: {column.name}"
    elif column.role == "condition":
        first, *others = text.conditions.get(tidy_name(column.name), column.name).split(", ")
        told = f"sets {first}" + (f" and {len(others)} places more" if others else "")
    else:
        told = words.get(column.role, column.role)
    unit = column.heading.unit if column.role in ("observable", "condition", "sd", "se") else ""
    return {"column": column.heading.text, "role": column.role, "told": told, "unit": unit}
