"""A study made of a laboratory's table: the tidy table, a study, and a scene that fits what was measured.

What the table does not say is asked; every question has a guess, which counts where nobody is asked.
"""

import os
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import partial
from math import isfinite
from pathlib import Path
from typing import Any

from taichi_erosion.core.effect_file import read_effect_files
from taichi_erosion.core.errors import BadInput
from taichi_erosion.evidence.answers.scene_templates import (
    CLOSED_FORM_NUMBERS,
    INCLUDES,
    LENGTHS,
    READS,
    TEMPLATES,
    CalibratedNumber,
    Template,
    friction_numbers,
    least_grain_count,
    paths_of_place,
    scene_text,
    templates_for,
)
from taichi_erosion.evidence.answers.written_files import Content, StudyFiles, write_study_files
from taichi_erosion.evidence.data.measured import add_detection_limits, cells_in_unit, read_rows, value_faults
from taichi_erosion.evidence.data.tables import column_roles
from taichi_erosion.evidence.data.tables.column_roles import CONDITION, Ask, Column, Interview, TableOptions
from taichi_erosion.evidence.data.tables.rows import Faults, Table
from taichi_erosion.evidence.models import reduced
from taichi_erosion.evidence.models.simulator import FOR_EFFECTS
from taichi_erosion.evidence.models.table_columns import declared_units
from taichi_erosion.execution.checks import read_scene
from taichi_erosion.scene.paths import unit_at_path
from taichi_erosion.scene.physical_ranges import OBSERVED, OWN_RANGES, PhysicalRange, is_other_kind, range_at
from taichi_erosion.scene.schema.grains import Monodisperse
from taichi_erosion.scene.schema.units import parse_scale, parse_unit, scale_between
from taichi_erosion.tables import headings
from taichi_erosion.tables.cell_numbers import CellFault, CellNumber, read_cell, stated_number
from taichi_erosion.tables.headings import DIAMETER, FRICTION_VELOCITY, GRAIN_DENSITY, suggest_meaning
from taichi_erosion.tables.number_columns import own_name
from taichi_erosion.tables.number_words import count_noun, toml_key, with_unit
from taichi_erosion.tables.spreadsheet import laboratory_table_digest

Document = dict[str, Any]
GRAIN_UNITS = ("mm", "um", "µm", "μm", "in", "inch", "in.")  # of lengths that may be the size of grains
COARSEST = 4e-3  # m, of grains that wind erodes: a larger length is no size of theirs
OWN = "own"  # name of the apparatus of an own scene
CLOSED_FORM = "taichi_erosion.evidence.models.reduced:closed_form"
UNIT_ROLES = ("observable", "condition", "condition_sd", "sd", "se", "cv")  # of columns whose unit is told
ROLE_WORDS = {"sd": "scatter of single repeats", "cv": "scatter of single repeats, relative"}
ROLE_WORDS |= {"se": "standard error of the mean", "n": "number of repeats"}
ROLE_WORDS |= {"group": "set-up of a row", "remark": "not used"}


@dataclass(frozen=True)
class NewStudyOptions:
    """What the command line says beforehand."""

    table_options: TableOptions = field(default_factory=TableOptions)
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
    sd: Mapping[str, str] = field(default_factory=dict)  # column or observable -> scatter of single repeats
    fill_down: bool = False  # blank cells below a condition, a set-up or a source repeat it
    between_codes: Mapping[str, str] = field(default_factory=dict)  # observable -> sd of its level
    measured: Mapping[str, str] = field(default_factory=dict)  # calibrated number -> value and its sd


@dataclass(frozen=True)
class StudyRequest:
    """A laboratory's table, and what the user says of it."""

    table: Table
    table_options: TableOptions
    places: Mapping[str, str]  # condition -> place that it sets
    folder: Path  # of the study
    wishes: NewStudyOptions
    interview: Interview

    @property
    def names(self) -> list[str]:
        return list(dict.fromkeys(row.observable for row in self.table.rows))

    def path_from_study(self, file: Path) -> str:
        return Path(os.path.relpath(file, self.folder)).as_posix()


def write_new_study(table: Path, wishes: NewStudyOptions, ask: Ask, at_terminal: bool = False) -> Document:
    """Write table, study and scenes of a laboratory's table; the document says what was understood.

    Where the table has a study already, the table is corrected and the study stays, unless `wishes.anew`.
    Raises BadInput with all faults of the table, or where a file of another origin would be replaced.
    """
    folder = wishes.folder or table.parent / table.stem
    interview, options = Interview(ask, at_terminal=at_terminal), table_options(wishes)
    measured = read_laboratory_table(table, options, interview)
    request = StudyRequest(measured, options, condition_places(measured, options), folder, wishes, interview)
    refuse_useless_options(request)
    request = add_constant_conditions(request) if wishes.closed_form else request
    content = closed_form_study_content(request) if wishes.closed_form else scene_study_content(request)
    titles = {each.heading.name: each.name for each in measured.columns if each.name in content.observables}
    codes = {titles.get(name, name): text for name, text in wishes.between_codes.items()}
    content = replace(content, shared={k: shared_error_entry(k, codes[k], content) for k in codes})
    for name, text in wishes.measured.items():
        content = replace(content, parameters=set_measured_numbers(content.parameters, name, text))
    effect_files = [request.path_from_study(file) for file in wishes.effects]
    origin = request.path_from_study(table), laboratory_table_digest(table), interview.assumptions
    files = StudyFiles(folder, table.stem, request.table, content, *origin, effect_files)
    return {
        "table": str(table),
        "form": measured.form,
        "columns": [column_document(column, content) for column in measured.columns],
        "assumed": list(interview.assumptions),
        **write_study_files(files, wishes.anew),
    }


def shared_error_entry(name: str, text: str, content: Content) -> str:
    """Entry of the error that all rows of an observable share with another code. Raises BadInput."""
    if name not in content.observables or name not in OBSERVED:
        raise BadInput(f"--between-codes {name}: is none of {', '.join(content.observables)}")
    key, unit = ("sd_shared_relative", "1") if "%" in text else ("sd_shared", OBSERVED[name].unit)
    sd = stated_number(text, unit, f"--between-codes {name}", f"1 {OBSERVED[name].unit}, or 5 %")
    return f"{key} = {sd:g}    # of the level, between codes; half of it at each diameter"


def set_measured_numbers(numbers: Sequence[CalibratedNumber], name: str, text: str) -> list[CalibratedNumber]:
    """Calibrated numbers, of which one was measured on the grains, `0.5 ± 0.05`. Raises BadInput."""
    cell, last = CellNumber(), {each: sorted(each.path.rpartition(".")[2].split("_")) for each in numbers}
    matches = [each for each in numbers if name == each.path or sorted(name.split("_")) == last[each]]
    with suppress(CellFault):
        cell = read_cell(text, comma=False, single=True)
    inside = [each for each in matches if each.low < cell.value < each.high]
    if not matches or matches != inside or not cell.sd > 0.0 or cell.unit:
        ranges = ", ".join(f"{each.path} ({each.low:g} to {each.high:g})" for each in numbers)
        raise BadInput(f"--measured {name}={text}: write NUMBER=0.5 ± 0.05, for one of {ranges}")
    prior = {"start": cell.value, "sd_log": cell.sd / cell.value, "why": "as measured"}
    return [replace(each, **prior) if each in matches else each for each in numbers]


def refuse_useless_options(request: StudyRequest) -> None:
    """Raise BadInput for an option that a column states already, or that only a ready scene takes."""
    wishes, places = request.wishes, request.places.values()
    ready = {"--apparatus": (wishes.apparatus, ""), "--grains": (wishes.grains, "")}
    grains = {"--diameter": (wishes.diameter, DIAMETER), "--density": (wishes.density, GRAIN_DENSITY)}
    for option, (value, place) in (ready | grains).items():
        closed = wishes.closed_form and option in ready
        if value is not None and (closed or wishes.scene is not None):
            other = "--closed-form" if closed else "--scene"
            raise BadInput(f"{option}: has no use with {other}; leave it out")
        if value is not None and place in places:
            raise BadInput(f"{option}: a column of {request.table.file} states it; leave it out")


def read_laboratory_table(table: Path, options: TableOptions, interview: Interview) -> Table:
    """Rows of a table; raises BadInput with all faults of its cells, headings, units and ranges."""
    faults = Faults()
    measured = read_rows(table, table.name, options, interview, faults)
    ranges: list[tuple[str, PhysicalRange | None]] = []
    if measured is not None:
        places = faults.of(condition_places, measured, options) or {}
        ranges += [(name, range_at(place.split(",")[0].strip())) for name, place in places.items()]
        ranges += [(name, OBSERVED.get(name)) for name in dict.fromkeys(r.observable for r in measured.rows)]
        for name, allowed in ranges:
            faults += value_faults(measured, name, allowed, usual=not options.units)  # a stated unit counts
    faults.raise_if_any()
    assert measured is not None
    for name, allowed in ranges:
        cells = cells_in_unit(measured, name, allowed) if allowed else []
        odd = [each for each in cells if allowed and not allowed.is_usual(each[-1])]  # slips, perhaps
        for row, value, unit, _ in odd[:1]:
            more = f", and {count_noun(len(odd) - 1, 'row')} more," * (len(odd) > 1)
            number = with_unit(f"{value:g}", unit or "")
            interview.assume(f"row {row.line}, {name} = {number}{more} is unusual: used as it is")
    return add_detection_limits(measured, interview)


def condition_places(table: Table, options: TableOptions) -> dict[str, str]:
    columns = [column for column in table.columns if column.role == "condition"]
    # in a tidy table a column is called as the user likes
    places = {c.title: options.conditions.get(c.name) or path_of_tidy_column(c, options) for c in columns}
    if not any(column.role == "value" for column in table.columns):
        places = {column.title: column.name for column in columns}
    faults = [
        f"{table.file}: column '{name}': no place of a scene is known by that name; say which one it sets: "
        f"--condition {name}={suggest_meaning(name) or 'PATH'}, or give its unit: --condition {name}={unit}"
        for name, place in places.items()
        for unit in [table.units[table.conditions.index(name)] or "UNIT"]
        if name and not place
    ]
    for name, unit in zip(table.conditions, table.units, strict=True):
        allowed = None if unit else range_at(places[name].split(",")[0])
        if allowed is not None and column_roles.can_be_of_any_size(allowed):
            words = f"has no unit in its heading; write it there: '{name} [UNIT]', such as {allowed.unit}"
            faults.append(f"{table.file}: column '{name}': {words}")
    if faults:
        raise BadInput(*faults)
    return places


def path_of_tidy_column(column: Column, options: TableOptions) -> str:
    """Place that a column of a tidy table sets; empty where its name may mean another quantity."""
    if headings.qualifying_words(column.heading)[0]:
        return ""
    unknown = options.reads is not None and not suggest_meaning(column.name)  # residuals are tested along it
    return headings.meaning_of(column.name)[1] or (CONDITION + column.title if unknown else "")


def closed_form_study_content(request: StudyRequest) -> Content:
    """The study that the reduced model answers. Raises BadInput for an observable that it does not have."""
    if unknown := [name for name in request.names if name not in reduced.OBSERVABLES]:
        words = f"the closed form does not know '{unknown[0]}'; it knows {', '.join(reduced.OBSERVABLES)}"
        remedy = "leave out --closed-form, or begin the heading of that column with 'note'"
        remedy = "say its height, 'threshold wind speed at 1 m', " * ("wind" in unknown[0]) + remedy
        raise BadInput(f"{request.table.file}: {words}; {remedy}")
    if "flux" in request.names and FRICTION_VELOCITY not in request.places.values():
        words = "no column states the friction velocity, on which the flux depends"
        raise BadInput(f"{request.table.file}: {words}; add one, 'u* [m/s]', or leave out --closed-form")
    duplicates = {place for p in request.places.values() for place in INCLUDES.get(p, ())}
    # one that the model does not read keeps its place: residuals are tested along it
    conditions = {n: p if p in duplicates else READS.get(p, p) for n, p in request.places.items()}
    airs = [name for name, condition in conditions.items() if CONDITION + condition in column_roles.AIR]
    if airs and {*request.names} != {"repose_angle"}:
        request.interview.assume(f"the density of the air follows from {' and '.join(airs)} (ideal gas)")
    numbers = list(dict.fromkeys(each for name in request.names for each in CLOSED_FORM_NUMBERS[name]))
    return Content(dict.fromkeys(request.names, ""), conditions, numbers, model=CLOSED_FORM)


def add_constant_conditions(request: StudyRequest) -> StudyRequest:
    """The table with what no column states of the grains and the user does: constant conditions."""
    wishes, table, places = request.wishes, request.table, dict(request.places)
    reads = {"threshold_u_star", "flux"} & {*request.names} or "conditions.width" in places.values()
    usual = f"{1e3 * reduced.MEDIAN_DIAMETER:g} mm"
    diameter = wishes.diameter
    if diameter is None and reads and not {DIAMETER, "conditions.diameter"} & {*places.values()}:
        for column in (each for each in table.columns if each.unread and each.title in table.conditions):
            heading, place = column.heading, table.conditions.index(column.title)
            other_kind = headings.longest_word(heading.name, *headings.KINDS, "others")[0]
            is_length = heading.unit in GRAIN_UNITS and not other_kind
            largest = max(row.conditions[place] for row in table.rows)
            if is_length and largest * parse_scale(heading.unit or "").factor <= COARSEST:
                words = f"no column states the grain diameter; if '{heading.text}' does, say --condition"
                remedy = f"'{heading.name}={DIAMETER}'; else state it: --diameter '{usual}'"
                raise BadInput(f"{table.file}: {words} {remedy}")
        diameter = ask_diameter(request.interview, usual)
    entries = (("diameter", diameter, DIAMETER, "m", usual),)
    entries += (("density", wishes.density, GRAIN_DENSITY, "kg/m3", "2650 kg/m3"),)
    for name, text, place, unit, example in entries:
        if text is not None:
            value = stated_number_of(f"--{name}", text, place, unit, example)
            value, unit = (1e3 * value, "mm") if unit == "m" else (value, unit)
            rows = tuple(replace(row, conditions=(*row.conditions, value)) for row in table.rows)
            names, units = (*table.conditions, name), (*table.units, unit)
            table, places[name] = replace(table, conditions=names, units=units, rows=rows), place
    return replace(request, table=table, places=places)


def scene_study_content(request: StudyRequest) -> Content:
    scenes, parameters, conditions, observables = {}, {}, {}, {}
    stem = Path(request.table.file).stem
    for key, names in observables_by_apparatus(request).items():
        if key == OWN:
            scene_file = request.wishes.scene or Path()
            template, file = template_of_own_scene(scene_file, request), request.path_from_study(scene_file)
        else:
            scene = f"{key}_scene" if key == stem else key  # none has the name of the study
            template, file = TEMPLATES[key], f"{scene}.toml"
            scenes[scene] = apparatus_scene_text(request, key, names)
        observables |= dict.fromkeys(names, file)
        for name, place in request.places.items():
            paths = [*conditions.get(name, "").split(", "), *paths_of_place(template, place).split(", ")]
            conditions[name] = ", ".join(filter(None, dict.fromkeys(paths)))
        places = {place for paths in conditions.values() for place in paths.split(", ")}
        parameters |= {number.path: number for number in template.parameters if number.path not in places}
        if template.wind and FRICTION_VELOCITY not in request.places.values():
            request.interview.assume("no column states the friction velocity: the wind is that of the scene")
    return Content(observables, conditions, list(parameters.values()), scenes)


def observables_by_apparatus(request: StudyRequest) -> dict[str, list[str]]:
    """Observables of each apparatus; of an own scene all. Raises BadInput for one that measures none."""
    if request.wishes.scene is not None:
        return {OWN: request.names}
    groups: dict[str, list[str]] = {}
    for name in request.names:
        groups.setdefault(choose_apparatus(name, request), []).append(name)
    if (choice := request.wishes.apparatus) not in (None, *groups):
        others = dict.fromkeys(key for name in request.names for key in templates_for(name))
        complaint = f"measures none of {', '.join(request.names)}; name one of {', '.join(others)}"
        raise BadInput(f"--apparatus {choice}: {complaint}, or the column (--observable COLUMN=NAME)")
    return groups


def choose_apparatus(observable: str, request: StudyRequest) -> str:
    """Apparatus whose scene measures an observable; the guess measures most of what the table holds."""
    names = {*request.names}
    possible = sorted(templates_for(observable), key=lambda key: -len({*TEMPLATES[key].observables} & names))
    if not possible:
        words = "rename it, or name a scene of your own: --scene FILE"
        raise BadInput(f"{request.table.file}: no scene measures '{observable}'; {words}")
    if request.wishes.apparatus in possible:
        return str(request.wishes.apparatus)
    if len(possible) == 1:
        return possible[0]
    words = "; ".join(f"{name}: {TEMPLATES[name].words}" for name in possible)
    meaning = f"{observable} is taken as measured with {TEMPLATES[possible[0]].words} (--apparatus)"
    check = partial(column_roles.refuse_other_answer, what=observable, allowed=possible)
    return request.interview.choice(f"How was {observable} measured? {words}", possible[0], meaning, check)


def apparatus_scene_text(request: StudyRequest, key: str, names: Sequence[str]) -> str:
    """Text of the scene of an apparatus that measures some observables of a table."""
    template, file, assume = TEMPLATES[key], request.table.file, request.interview.assume
    diameters, density = grain_diameters(request, template), None
    if request.wishes.density is not None:
        density = stated_number_of("--density", request.wishes.density, GRAIN_DENSITY, "kg/m3", "2650 kg/m3")
    used = [row for row in request.table.rows if row.observable in names and isfinite(row.value)]
    scales = [scale_between(row.unit, parse_unit("deg")) for row in used]
    angles = [scale.to_use(row.value) for row, scale in zip(used, scales, strict=True) if scale is not None]
    safe = least_grain_count(template, angles)
    grains = request.wishes.grains or safe
    if template.rows and grains < safe:
        assume(f"{grains:,} grains may be too few for these angles; {safe:,} are enough (--grains)")
    if density is None and GRAIN_DENSITY not in request.places.values():
        assume(f"no column states the grain density: {template.usual_grain_density:g} kg/m3 (--density)")
    if sized := [name for name in names if name in LENGTHS]:
        heaps = f"{' and '.join(sized)}: heaps of {grains:,} grains in the scene '{key}'"
        advice = "give it as many as yours have (--grains), and the size of your apparatus"
        assume(f"{heaps}; lengths grow with the heap, so {advice}")
    notes = f"Made for {file}: {', '.join(names)}. Numbers of grains and contacts are usual ones."
    head = {"title": f"{file}: {template.words}", "notes": notes}
    return scene_text(template, head, diameters, grains, density, extra_condition_units(request))


def grain_diameters(request: StudyRequest, template: Template) -> list[float]:
    """Diameters of the grains in a scene [m]: those of the table, else as the user says, else as usual."""
    diameter, interview = request.wishes.diameter, request.interview
    if not template.varies:
        if diameter is not None:
            raise BadInput(f"--diameter: grains of {template.words} have sizes of their own, in its scene")
        column = next((name for name, place in request.places.items() if place == DIAMETER), "")
        words = f"those of the program's scene of {template.words}"
        words += f"; column '{column}' does not change them" if column else ""
        interview.assume(f"grain sizes and apparatus are {words}")
        return [template.diameter]
    for place, (name, unit) in enumerate(zip(request.table.conditions, request.table.units, strict=True)):
        scale = scale_between(unit or "m", parse_unit("m")) if request.places.get(name) == DIAMETER else None
        values = [row.conditions[place] for row in request.table.rows if isfinite(row.conditions[place])]
        if scale is not None and values:
            return [scale.to_use(each) for each in values]
    usual = f"{1e3 * template.diameter:g} mm"
    answer = diameter or ask_diameter(interview, usual)
    return [stated_number_of("--diameter", answer, DIAMETER, "m", usual)]


def ask_diameter(interview: Interview, usual: str) -> str:
    """Diameter of the grains, where no column states it."""
    meaning = f"no column states the grain diameter: {usual} is assumed (--diameter)"
    check = partial(stated_number_of, "--diameter", place=DIAMETER, unit="m", example=usual)
    return interview.choice("Grain diameter with its unit", usual, meaning, check)


def stated_number_of(option: str, said: str, place: str, unit: str, example: str) -> float:
    """A number of the grains as the user states it, in a unit. Raises BadInput outside what scenes allow."""
    value, allowed = stated_number(said, unit, option, example), range_at(place)
    if allowed is not None and not allowed.is_possible(value):
        raise BadInput(f"{option} '{said}': {value:g} {unit} is outside [{allowed.low:g}, {allowed.high:g}]")
    return value


def table_options(wishes: NewStudyOptions) -> TableOptions:
    """What is said of the table, with conditions that are stated by a unit, and names of an own scene.

    A condition that every scene has keeps its place, and takes the unit for its column, but for a unit of
    another quantity. Raises BadInput.
    """
    from taichi_erosion.effect_library import load_library

    measures = dict.fromkeys(name for each in TEMPLATES.values() for name in each.observables)
    conditions, own_conditions, observables = dict[str, str](), dict[str, str](), dict[str, str]()
    if wishes.scene is not None:
        measures = dict.fromkeys(read_scene(wishes.scene, ()).measure)
        observables = {name: name for name in measures}
        for name, unit in declared_units(wishes.scene).items():
            own_conditions[CONDITION + name], conditions[name] = unit, CONDITION + name
    said_of = wishes.table_options
    effects = load_library(read_effect_files(wishes.effects)).values()
    ignored = {CONDITION + n for n in {*FOR_EFFECTS}.difference(*(effect.reads for effect in effects))}
    optional = {*conditions, *observables} - said_of.observables.keys() - said_of.conditions.keys()
    for text, place in said_of.conditions.items():
        unit = headings.unit_in(place)
        if unit is None or unit_at_path(place) is not None or place == column_roles.NOT_USED:
            conditions[text] = place
            continue
        name = own_name(headings.read_heading(text).name, (), 0)
        is_other = is_other_kind(unit, CONDITION + name)
        conditions[text] = CONDITION + (own_name(f"{name} {unit}", (), 0) if is_other else name)
        own_conditions.setdefault(conditions[text], unit)
    options = replace(said_of, roughness=wishes.roughness, sd=wishes.sd, fill_down=wishes.fill_down)
    places = {*headings.known_words()["conditions"], *conditions.values()} - ignored
    reads = None if wishes.scene is not None else frozenset(places)  # such a scene declares what it has
    reads = frozenset(READS) if wishes.closed_form else reads
    options = replace(options, reads=reads, complete=True)
    options = replace(options, optional=frozenset(optional), measures=tuple(measures), conditions=conditions)
    return replace(options, observables=observables | dict(said_of.observables), own_units=own_conditions)


def extra_condition_units(request: StudyRequest) -> dict[str, str]:
    """Names and units of conditions that no scene has by itself."""
    columns = zip(request.table.conditions, request.table.units, strict=True)
    units = {request.places[name]: unit or "1" for name, unit in columns if name in request.places}
    units |= {path: ranges.unit for path, ranges in OWN_RANGES.items() if path in units}
    units |= request.table_options.own_units
    paths = [path for path in units if path.startswith(CONDITION) and unit_at_path(path) is None]
    return {path.removeprefix(CONDITION): units[path] for path in paths}


def template_of_own_scene(file: Path, request: StudyRequest) -> Template:
    """The apparatus of an own scene; the friction of its grains on each other is calibrated."""
    if lost := (undeclared := extra_condition_units(request)).keys() - declared_units(file).keys():
        unit = undeclared[name := min(lost)]
        entry = f'[conditions.extra] {toml_key(name)} = {{ unit = "{unit}" }}'
        raise BadInput(f"{file}: does not declare the condition '{name}'; write {entry}")
    scene = read_scene(file, ())
    pair = "-".join(2 * [max(scene.grains.parts.items(), key=lambda part: part[1].share)[0]])
    contact, size = scene.contact[pair], scene.grains.size
    winds = [k for k, stage in enumerate(scene.stages) if stage.friction_velocity is not None]
    return Template(
        scene=file.stem,
        words="your own scene",
        observables=tuple(scene.measure),
        changes=lambda diameter, grains: {},
        parameters=friction_numbers(pair, contact.friction_sliding, contact.friction_rolling or None),
        grains=0,
        diameter=0.0,
        varies=isinstance(size, Monodisperse),
        wind=tuple(f"stages.{stage}.friction_velocity" for stage in winds),
    )


def column_document(column: Column, content: Content) -> Document:
    role = ROLE_WORDS.get(column.role, column.role)
    if column.role == "observable" and column.name in content.observables:
        role = f"measured: {column.name}"
    elif column.role == "condition":
        first, *others = content.conditions.get(column.title, column.name).split(", ")
        role = f"sets {first}" + (f" and {len(others)} places more" if others else "")
    elif column.role == "condition_sd":
        role = f"sd of {column.title}"
    unit = column.heading.unit if column.role in UNIT_ROLES else ""
    return {"column": column.heading.text, "role": column.role, "told": role, "unit": unit}
