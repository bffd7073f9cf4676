"""A study made of a laboratory's table: the tidy table, a study, and a scene that fits what was measured.

What the table does not say is asked; every question has a guess, which counts where nobody is asked.
"""

import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import isfinite
from pathlib import Path
from statistics import median
from typing import Any

from taichi_erosion.core.errors import BadInput
from taichi_erosion.evidence.answers.study_files.scene_templates import (
    LENGTHS,
    SIZES,
    TEMPLATES,
    USUAL_HEAP,
    Diameters,
    Template,
    contact,
    places_of,
    safe_grains,
    scene_text,
    templates_for,
)
from taichi_erosion.evidence.answers.study_files.study_text import StudyText, closed_form_study
from taichi_erosion.evidence.answers.study_files.written_files import (
    StudyFiles,
    corrected_study,
    earlier_study,
    written_files,
)
from taichi_erosion.evidence.data.measured import read_rows
from taichi_erosion.evidence.data.physical_ranges import OBSERVED, column_faults, place_range
from taichi_erosion.evidence.data.tables.column_roles import Column, Told
from taichi_erosion.evidence.data.tables.headings import (
    DIAMETER,
    FRICTION_VELOCITY,
    GRAIN_DENSITY,
    meaning_of,
    near_meaning,
    plain_words,
    read_heading,
    unit_in,
)
from taichi_erosion.evidence.data.tables.interview import Ask, Interview
from taichi_erosion.evidence.data.tables.rows import NAME, Faults, Table
from taichi_erosion.evidence.data.tables.spreadsheet import source_digest, stated_number
from taichi_erosion.evidence.models.table_columns import declared_units
from taichi_erosion.run.checks import read_scene
from taichi_erosion.scene.load import toml_table
from taichi_erosion.scene.paths import unit_of_path
from taichi_erosion.scene.schema.units import parse_unit, scale_between

Document = dict[str, Any]
CONDITION = "conditions."
OWN = "own"  # name of the apparatus of an own scene
LIGHTEST, DENSEST = 100.0, 20000.0  # of grains [kg m-3]


@dataclass(frozen=True)
class Wishes:
    """What the command line says beforehand."""

    told: Told = field(default_factory=Told)
    folder: Path | None = None
    apparatus: str | None = None  # of TEMPLATES
    closed_form: bool = False  # the reduced model answers in place of scenes
    roughness: str | None = None  # length of the bed under winds that were measured at a height
    anew: bool = False  # write a study that is there anew; else its table alone is corrected
    diameter: str | None = None  # of the grains, with its unit, where no column states it
    density: str | None = None  # of the grains, with its unit
    grains: int | None = None  # of a run
    scene: Path | None = None  # of the user's own, in place of those of TEMPLATES
    effects: tuple[Path, ...] = ()  # files with effects of the user's own

    @property
    def table(self) -> Told:
        """What is said of the table."""
        measures = tuple(dict.fromkeys(name for each in TEMPLATES.values() for name in each.observables))
        if self.scene is not None:
            measures = tuple(read_scene(self.scene, ()).measure)
        return replace(self.told, roughness=self.roughness, measures=measures)


def new_study(table: Path, wishes: Wishes, ask: Ask) -> Document:
    """Write table, study and scenes of a laboratory's table; the document says what was understood.

    Where the table has a study already, the table is corrected and the study stays, unless `wishes.anew`.
    Raises BadInput with all faults of the table, or where a file of another origin would be replaced.
    """
    folder = wishes.folder or table.parent / table.stem
    interview, wishes = Interview(ask), with_own_conditions(replace(wishes, folder=folder))
    measured = read_laboratory_table(table, wishes, interview)
    names = list(dict.fromkeys(row.observable for row in measured.rows))
    refuse_file(folder)
    earlier = earlier_study(folder, table.stem)
    places = condition_places(measured, wishes.told)
    if wishes.closed_form:
        if wishes.density is not None:
            raise BadInput(
                "--density: the closed form reads a column of grain densities; without one it takes quartz"
            )
        text, scenes = closed_form_study(measured, names, places), {}
        for name in places.keys() - text.conditions.keys():
            if places[name] in wishes.told.conditions.values():
                raise BadInput(
                    f"--condition: the closed form does not read '{name}'; leave out --closed-form"
                )
            interview.assume(f"column '{name}' is not used: the closed form does not read it")
    else:
        text, scenes = scene_study(measured, names, places, wishes, interview)
    text = replace(
        text,
        title=table.stem,
        assumed=tuple(interview.assumed),
        made_from=relative(table, folder),
        made_from_digest=source_digest(table),
        effect_files=tuple(relative(file, folder) for file in wishes.effects),
    )
    files = StudyFiles(folder, table.stem, text, measured, scenes)
    found = written_files(files) if earlier is None else corrected_study(earlier, files, wishes.anew)
    return {
        "table": str(table),
        "form": measured.form,
        "columns": [told_column(column, text) for column in measured.columns],
        "assumed": list(interview.assumed),
        **found,
    }


def relative(file: Path, folder: Path) -> str:
    """Path of a file as a study in a folder names it."""
    return Path(os.path.relpath(file, folder)).as_posix()


def refuse_file(folder: Path) -> None:
    """Raise BadInput where a file stands in the place of a folder to write."""
    for path in (folder, *folder.parents):
        if path.exists():
            if not path.is_dir():
                raise BadInput(f"{path}: is a file, and no folder; name another one with --out")
            return


def read_laboratory_table(table: Path, wishes: Wishes, interview: Interview) -> Table:
    """Rows of a table; raises BadInput with all faults of its cells, headings, units and ranges."""
    faults = Faults()
    measured = read_rows(table, table.name, wishes.table, interview, faults)
    if measured is not None:
        places = faults.of(condition_places, measured, wishes.told) or {}
        faults += value_faults(measured, places, wishes.told)
    faults.tell()
    assert measured is not None
    return measured


def value_faults(table: Table, places: Mapping[str, str], told: Told) -> Iterator[str]:
    """Impossible values of conditions and observables, and units that seem mistaken.

    A unit that the user states counts.
    """
    for name, place in places.items():
        allowed = place_range(place.split(",")[0].strip())
        yield from column_faults(table, name, allowed, usual=not told.units)
    for name in dict.fromkeys(row.observable for row in table.rows):
        yield from column_faults(table, name, OBSERVED.get(name), usual=not told.units)


def condition_places(table: Table, told: Told) -> dict[str, str]:
    """Place that every condition of a table sets."""
    columns = [column for column in table.columns if column.role == "condition"]
    # in a tidy table a column is called as the user likes
    stated = {c.title: told.conditions.get(c.name) or meaning_of(c.name)[1] for c in columns}
    if not any(column.role == "value" for column in table.columns):
        stated = {column.title: column.name for column in columns}
    faults = [
        f"{table.file}: column '{name}': no place of a scene is known by that name; say which one it sets: "
        f"--condition {name}={near_meaning(name) or 'PATH'}, or give its unit: --condition {name}=UNIT"
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
    scenes, parameters, conditions = {}, {}, {}
    found, study = apparatus_of_all(names, wishes, interview, table.file), Path(table.file).stem
    files = {key: f"{key}_scene" if key == study else key for key in found}  # none has the name of the study
    for key, own in found.items():
        template = own_template(wishes) if key == OWN else TEMPLATES[key]
        if key != OWN:
            scenes[files[key]] = new_scene(table, key, own, places, wishes, interview)
        for name, place in places.items():
            paths = [*conditions.get(name, "").split(", "), *places_of(template, place).split(", ")]
            conditions[name] = ", ".join(filter(None, dict.fromkeys(paths)))
        stated = {place for paths in conditions.values() for place in paths.split(", ")}
        parameters |= {number.path: number for number in template.parameters if number.path not in stated}
        if template.wind and FRICTION_VELOCITY not in places.values():
            interview.assume("no column states the friction velocity: the wind is that of the scene")
    observables = {name: f"{files[key]}.toml" for key, own in found.items() for name in own}
    if wishes.scene is not None:
        observables = dict.fromkeys(names, relative(wishes.scene, wishes.folder or Path()))
    positive = {n for n in names if all(r.value > 0.0 for r in table.rows if r.observable == n)}
    return StudyText(observables, conditions, tuple(parameters.values()), frozenset(positive)), scenes


def apparatus_of_all(
    names: Sequence[str], wishes: Wishes, interview: Interview, file: str
) -> dict[str, list[str]]:
    """Observables of each apparatus; of an own scene all."""
    if wishes.scene is not None:
        return {OWN: list(names)}
    found: dict[str, list[str]] = {}
    for name in names:
        found.setdefault(apparatus_of(name, names, wishes, interview, file), []).append(name)
    if wishes.apparatus is not None and wishes.apparatus not in found:
        others = dict.fromkeys(key for name in names for key in templates_for(name))
        own = TEMPLATES[wishes.apparatus].observables
        raise BadInput(
            f"--apparatus {wishes.apparatus}: measures {', '.join(own)}, not {', '.join(names)}; say which "
            f"column holds it (--observable 'COLUMN={own[0]}'), or name one of {', '.join(others)}"
        )
    return found


def new_scene(
    table: Table,
    key: str,
    names: Sequence[str],
    places: Mapping[str, str],
    wishes: Wishes,
    interview: Interview,
) -> str:
    """Text of the scene of an apparatus that measures some observables of a table."""
    template = TEMPLATES[key]
    diameters = grain_diameters(table, template, places, wishes, interview)
    safe = safe_grains(template, angles_of(table, names))
    grains = wishes.grains or safe
    if template.rows and grains < safe:
        interview.assume(f"{grains:,} grains may be too few for these angles; {safe:,} are enough (--grains)")
    density = grain_density(wishes, places, table.file)
    if density is None and GRAIN_DENSITY not in places.values():
        interview.assume(f"no column states the grain density: {template.usual_density:g} kg/m3 (--density)")
    if sized := [name for name in names if name in LENGTHS]:
        interview.assume(
            f"{' and '.join(sized)}: heaps of {grains:,} grains in the scene '{key}'; lengths grow with the "
            f"heap, so give it as many as yours have (--grains), and your apparatus: {', '.join(SIZES[key])}"
        )
    notes = f"Made for {table.file}: {', '.join(names)}. Numbers of grains and contacts are usual ones."
    head = {"title": f"{table.file}: {template.words}", "notes": notes}
    return scene_text(template, head, diameters, grains, density, undeclared(wishes.told))


def apparatus_of(
    observable: str, names: Sequence[str], wishes: Wishes, interview: Interview, file: str
) -> str:
    """Apparatus whose scene measures an observable; the guess measures most of what the table holds."""
    possible = sorted(
        templates_for(observable), key=lambda key: -len({*TEMPLATES[key].observables} & {*names})
    )
    if not possible:
        raise BadInput(
            f"{file}: no scene measures '{observable}'; rename it, or name a scene of your own: --scene FILE"
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


def grain_diameters(
    table: Table, template: Template, places: Mapping[str, str], wishes: Wishes, interview: Interview
) -> Diameters:
    """Diameters of the grains in a scene: those of the table, else as the user says, else as usual."""
    for place, (name, unit) in enumerate(zip(table.conditions, table.units, strict=True)):
        if places.get(name) == DIAMETER and template.varies:
            scale = scale_between(unit or "m", parse_unit("m"))
            values = [row.conditions[place] for row in table.rows if isfinite(row.conditions[place])]
            if scale is not None and values:
                if wishes.diameter is not None:
                    raise BadInput(f"--diameter: column '{name}' of {table.file} states the grain diameter")
                middle, largest = (float(f"{scale.used(each):.4g}") for each in (median(values), max(values)))
                return Diameters(middle, largest)
    if not template.varies:
        if wishes.diameter is not None:
            raise BadInput(f"--diameter: grains of {template.words} have sizes of their own, in its scene")
        interview.assume(f"grain sizes and apparatus are those of the program's scene of {template.words}")
        return Diameters(template.diameter, template.diameter)
    usual = f"{1e3 * template.diameter:g} mm"
    told = f"no column states the grain diameter: {usual} is assumed (--diameter)"
    answer = wishes.diameter or interview.choice("Grain diameter with its unit", usual, told)
    diameter = stated_number(answer, "m", "--diameter", usual)
    allowed = place_range(DIAMETER)
    if allowed is not None and not allowed.possible(diameter):
        raise BadInput(f"--diameter '{answer}': no grain of soil is as large or as small; check the unit")
    return Diameters(diameter, diameter)


def grain_density(wishes: Wishes, places: Mapping[str, str], file: str) -> float | None:
    """Density of the grains that the user states [kg m-3]; None where the scene's own stays."""
    if wishes.density is None:
        return None
    if GRAIN_DENSITY in places.values():
        raise BadInput(f"--density: a column of {file} states the density of the grains")
    found = stated_number(wishes.density, "kg/m3", "--density", "2650 kg/m3")
    if not LIGHTEST <= found <= DENSEST:
        raise BadInput(f"--density '{wishes.density}': must lie from {LIGHTEST:g} to {DENSEST:g} kg/m3")
    return found


def angles_of(table: Table, names: Sequence[str]) -> list[float]:
    """Measured angles of heaps [deg]."""
    found = []
    for row in table.rows:
        scale = scale_between(row.unit, parse_unit("deg")) if row.observable in names else None
        if scale is not None and isfinite(row.value):
            found.append(scale.used(row.value))
    return found


def with_own_conditions(wishes: Wishes) -> Wishes:
    """The wishes with conditions that are stated by a unit, `roots=kg/m3`, and those of an own scene.

    A condition that every scene has keeps its place, and takes the unit for its column. Raises BadInput.
    """
    told, own = dict[str, str](), dict[str, str]()
    measures = {} if wishes.scene is None else {name: name for name in read_scene(wishes.scene, ()).measure}
    for name, unit in ({} if wishes.scene is None else declared_units(wishes.scene)).items():
        own[CONDITION + name], told[name] = unit, CONDITION + name
    known = frozenset((*told, *measures)) - wishes.told.observables.keys() - wishes.told.conditions.keys()
    for text, said in wishes.told.conditions.items():
        name, unit = plain_words(read_heading(text).name).replace(" ", "_"), unit_in(said)
        if unit is None or unit_of_path(said) is not None:
            told[text] = said
            continue
        if not NAME.fullmatch(name):
            raise BadInput(f"--condition {text}={said}: '{name}' is no name of letters, digits and _")
        told[text] = CONDITION + name
        own.setdefault(told[text], unit)
    observables = measures | dict(wishes.told.observables)
    stated = Told(observables, told, wishes.told.units, optional=known, own_units=own)
    return replace(wishes, told=stated)


def undeclared(told: Told) -> dict[str, str]:
    """Names and units of conditions that no scene has by itself."""
    own = {path: unit for path, unit in told.own_units.items() if unit_of_path(path) is None}
    return {path.removeprefix(CONDITION): unit for path, unit in own.items()}


def own_template(wishes: Wishes) -> Template:
    """The apparatus of an own scene; the friction of its grains on each other is calibrated."""
    assert wishes.scene is not None
    if lost := (own := undeclared(wishes.told)).keys() - declared_units(wishes.scene).keys():
        unit = own[name := min(lost)]
        entry = f'[conditions.extra] {name} = {{ unit = "{unit}" }}'
        raise BadInput(f"{wishes.scene}: does not declare the condition '{name}'; write {entry}")
    scene, table = read_scene(wishes.scene, ()), toml_table(wishes.scene)
    grains = table.get("grains", {})
    pair, size = "-".join([str(grains.get("material", ""))] * 2), grains.get("size", {})
    stated = table.get("contact", {}).get(pair)
    if stated is None:
        raise BadInput(f"{wishes.scene}: no contact.{pair}, whose friction a study calibrates")
    rolling = stated.get("friction_rolling") or None
    winds = [k for k, stage in enumerate(table.get("stages", ())) if "friction_velocity" in stage]
    return Template(
        scene=wishes.scene.stem,
        words="your own scene",
        observables=tuple(scene.measure),
        changes=lambda diameter, grains: {},
        parameters=contact(pair, float(stated.get("friction_sliding", 0.5)), rolling and float(rolling)),
        grains=0,
        diameter=float(size.get("diameter", USUAL_HEAP)),
        varies="diameter" in size,
        wind=tuple(f"stages.{stage}.friction_velocity" for stage in winds),
    )


UNIT_ROLES = ("observable", "condition", "condition_sd", "sd", "se", "cv")  # of columns whose unit is told
ROLE_WORDS = {
    "sd": "scatter of single repeats",
    "se": "standard error of the mean",
    "cv": "scatter of single repeats, relative",
    "n": "number of repeats",
    "group": "set-up of a row",
    "remark": "not used",
}


def told_column(column: Column, text: StudyText) -> Document:
    """What was understood of a column."""
    told = ROLE_WORDS.get(column.role, column.role)
    if column.role == "observable" and column.name in text.observables:
        told = f"measured: {column.name}"
    elif column.role == "condition":
        first, *others = text.conditions.get(column.title, column.name).split(", ")
        told = f"sets {first}" + (f" and {len(others)} places more" if others else "")
    elif column.role == "condition_sd":
        told = f"sd of {column.title}"
    unit = column.heading.unit if column.role in UNIT_ROLES else ""
    return {"column": column.heading.text, "role": column.role, "told": told, "unit": unit}
