"""Text of a new study and of its tidy table, and the study that the closed form answers."""

import json
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from taichi_erosion.core.errors import BadInput
from taichi_erosion.evidence.answers.study_files.scene_templates import Calibrated
from taichi_erosion.evidence.data.physical_ranges import ANGLE, OBSERVED
from taichi_erosion.evidence.data.tables.headings import DIAMETER, GRAIN_DENSITY
from taichi_erosion.evidence.data.tables.rows import Table
from taichi_erosion.evidence.models import reduced
from taichi_erosion.scene.schema.units import Unit, parse_scale, scale_between

READ = "its cells when `study new` read it"
FRACTION = 0.3  # of the groups in the vault
MODEL = "taichi_erosion.evidence.models.reduced:predict"
CONDITIONS = {
    DIAMETER: "diameter",
    "conditions.diameter": "diameter",
    GRAIN_DENSITY: "grain_density",
    "conditions.moisture": "moisture",
    "conditions.slope": "slope",
    "conditions.roughness_density": "roughness",
    "conditions.angularity": "angularity",
    "conditions.fetch": "fetch",
    "conditions.friction_velocity": "u_star",
}
THRESHOLD = Calibrated("threshold_coefficient", 0.1, 0.04, 0.2, 0.2, "Bagnold's coefficient")
SLIDING = Calibrated("friction_sliding", 0.5, 0.1, 1.2, 0.2, "grain on grain")
ROLLING = Calibrated(
    "friction_rolling", 0.1, 0.005, 0.8, 0.6, "shape of the grains, as resistance to rolling"
)
FLUX = Calibrated("flux_coefficient", 2.5, 0.3, 20.0, 0.5, "of the flux above the threshold")
PARAMETERS = {"repose_angle": (SLIDING, ROLLING), "threshold_u_star": (THRESHOLD,), "flux": (THRESHOLD, FLUX)}
LEAST_SHIFT = 1e-3  # of an observable by an effect of strength 1, below which it cannot be seen [1]


@dataclass(frozen=True)
class StudyText:
    """Entries of a study."""

    observables: Mapping[str, str]  # name -> file of its scene; empty: the model answers
    conditions: Mapping[str, str]  # column -> places
    parameters: tuple[Calibrated, ...]
    logarithmic: frozenset[str] = frozenset()  # observables above zero everywhere
    candidates: tuple[str, ...] = ()  # empty: all of the library
    model: str = ""
    units: Mapping[str, str] = field(default_factory=dict)  # of the model's values, by observable
    title: str = ""
    measurements: str = ""
    made_from: str = ""  # table of the laboratory, relative to the study
    made_from_digest: str = ""  # of its cells
    assumed: tuple[str, ...] = ()
    drawn_from: str = ""  # digest of the table from which the rows of the vault are drawn
    effect_files: tuple[str, ...] = ()  # with effects of the user's own, relative to the study


def study_text(study: StudyText) -> str:
    """A study file."""
    command = shlex.join(["./erosion", "compare", f"{study.title}.toml"])
    lines = [f"# {command}", "", "[study]", f"title = {quoted(study.title)}"]
    lines += [f"measurements = {quoted(study.measurements)}"]
    if study.made_from:
        lines += [f"made_from = {quoted(study.made_from)}"]
        lines += [f"made_from_digest = {quoted(study.made_from_digest)}  # {READ}"]
    lines += [f"model = {quoted(study.model)}"] if study.model else []
    lines += [f"effect_files = {json.dumps(list(study.effect_files))}"] if study.effect_files else []
    if study.assumed:
        lines += ['notes = """', "Assumed, because the table does not say it:"]
        lines += [f"- {words.replace(chr(34), chr(39))}" for words in study.assumed] + ['"""']
    for name, scene in study.observables.items():
        lines += ["", f"[observables.{name}]"]
        lines += [f"scene = {quoted(scene)}"] if scene else []
        lines += [f"unit = {quoted(study.units[name])}"] if name in study.units else []
        is_angle = OBSERVED.get(name) is ANGLE
        lines += ['transform = "log"'] if name in study.logarithmic and not is_angle else []
    lines += ["", "[conditions]", *(f"{name} = {quoted(paths)}" for name, paths in study.conditions.items())]
    for number in study.parameters:
        lines += ["", f"[parameters.{quoted(number.path)}]    # {number.why}"]
        lines += [f"start = {number.start:g}", f"low = {number.low:g}", f"high = {number.high:g}"]
        lines += [f"prior_sd_log = {number.sd_log:g}"]
    if study.model:
        lines += [line for name in study.candidates for line in ("", f"[candidates.{name}]")]
    else:
        named = json.dumps(list(study.candidates)) if study.candidates else '"all"'
        lines += ["", "[candidates]", f"effects = {named}"]
    lines += [
        "",
        "[vault]",
        f"fraction = {FRACTION:g}    # of the set-ups, held out until an effect is adopted",
    ]
    if study.drawn_from:
        lines += [f"drawn_from = {quoted(study.drawn_from)}    # the table when its rows were drawn"]
    return "\n".join(lines) + "\n"


def quoted(text: str) -> str:
    """A TOML string."""
    return json.dumps(text, ensure_ascii=False)


def closed_form_study(table: Table, names: Sequence[str], places: Mapping[str, str]) -> StudyText:
    """Study of a table on the reduced model. Raises BadInput for an observable that it does not have."""
    faults = [
        f"{table.file}: the closed form does not know '{name}'; it knows {', '.join(reduced.OBSERVABLES)}; "
        "leave out --closed-form, or begin the heading of that column with 'note'"
        for name in names
        if name not in reduced.OBSERVABLES
    ]
    if faults:
        raise BadInput(*faults)
    conditions = {name: CONDITIONS[place] for name, place in places.items() if place in CONDITIONS}
    parameters = {number.path: number for name in names for number in PARAMETERS[name]}
    return StudyText(
        observables=dict.fromkeys(names, ""),
        conditions=conditions,
        parameters=tuple(parameters.values()),
        logarithmic=frozenset(
            n for n in names if all(r.value > 0.0 for r in table.rows if r.observable == n)
        ),
        candidates=acting_effects(table, names, conditions),
        model=MODEL,
        units={name: OBSERVED[name].unit for name in names},
    )


def acting_effects(table: Table, names: Sequence[str], conditions: Mapping[str, str]) -> tuple[str, ...]:
    """Effects of the reduced model that change a measured quantity under the table's conditions."""
    columns = {model: column_values(table, name) for name, model in conditions.items()}
    start = {number.path: number.start for name in names for number in PARAMETERS[name]}

    def values(name: str, effects: dict[str, float]) -> np.ndarray:
        return reduced.expected(name, columns, start, effects)

    found = []
    for effect in reduced.EFFECTS:
        shifts = [np.abs(values(name, {effect: 1.0}) / values(name, {}) - 1.0) for name in names]
        if any(bool(np.nanmax(shift) > LEAST_SHIFT) for shift in shifts):
            found.append(effect)
    return tuple(found)


def column_values(table: Table, name: str) -> np.ndarray:
    """A condition of all rows in SI units."""
    place = table.conditions.index(name)
    written = table.units[place]
    scale = scale_between(written, Unit(1.0, parse_scale(written).kind)) if written else None
    values = np.array([row.conditions[place] for row in table.rows])
    return values if scale is None else scale.origin + scale.factor * values
