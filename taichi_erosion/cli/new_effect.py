"""New effect files: from a scaffold, or from the law that a discovery proposed.

The names of a law are columns of a study's table; an effect reads conditions of scenes, or those of a model
function, so the study says which is which.
"""

import json
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from jinja2 import Environment

from taichi_erosion.cli.mechanism_file import has_law, mechanism_law_file
from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.files import read_text_file

if TYPE_CHECKING:
    from taichi_erosion.campaign.study_file import StudyFile

NEW = "new"  # first word that requests a new file; no effect has this name
FILE_NAME = re.compile(r"[a-z][a-z0-9_]{0,59}")
FACTOR = re.compile(r"\((?P<name>\w+) / (?P<typical>[-+.\deE]+)\)\^(?P<power>[-+.\deE]+)")
WIDEST = 10.0  # range of a coefficient over its fitted value [1]
ScaffoldPlace = Literal["pair", "grain", "scene", "instrument"]  # places with a scaffold
RESULT = ".discover.json"  # end of the name of a discovery's result


@dataclass(frozen=True)
class NamesOfStudy:
    """What the names of a law mean to an effect; without a study they mean themselves."""

    conditions: Mapping[str, str] = field(default_factory=dict)  # column -> condition
    factors: Mapping[str, float] = field(default_factory=dict)  # condition -> its unit over that of SI
    observables: Mapping[str, str] = field(default_factory=dict)  # observable -> measure of the model
    simulated: bool = False  # by scenes, whose measures are in SI units, angles in degrees


def write_effect_file(
    name: str, discovery: Path | None = None, memory: bool = False, place: ScaffoldPlace = "pair"
) -> Path:
    """Write a new effect file that fulfils the contract of effects; returns its path."""
    from taichi_erosion.effects import load_library

    path = Path(f"{name}.py")
    if not FILE_NAME.fullmatch(name) or name == NEW:
        allowed = "a name begins with a lower-case letter and has lower-case letters, digits and _"
        raise BadInput(f"effects new {name}: {allowed}, 60 at most")
    if name in load_library():
        taken = f"the library has an effect of this name: `effects {name}` describes it"
        raise BadInput(f"effects new {name}: {taken}; take another name")
    if path.exists():
        raise BadInput(f"{path}: exists already")
    blank = scaffold("stateful_effect" if memory else f"{place}_effect").replace("NAME", name)
    path.write_text(law_file(name, discovery) if discovery else blank, encoding="utf-8")
    return path


def scaffold(kind: str) -> str:
    """Template of a new effect file."""
    return (files("taichi_erosion.cli") / "scaffold" / f"{kind}.txt").read_text(encoding="utf-8")


def law_file(name: str, source: Path) -> str:
    """Effect file of the law that a discovery found; `source` is its study or its result."""
    result, study = discovery_of(source)
    document = discovery_document(result, source)
    names = NamesOfStudy() if study is None else names_of_study(study)
    if has_law(document):
        columns = {column: known_column(column, names) for column in document["beyond"]["law"]["conditions"]}
        readings = {each: known_reading(each, names, document) for each in document.get("units", {})}
        page = scaffold("mechanism_law")
        return mechanism_law_file(name, document, columns, readings, result.name, page)
    environment = Environment(trim_blocks=True, lstrip_blocks=True, keep_trailing_newline=True)
    page, title = environment.from_string(scaffold("law")), name.replace("_", " ").capitalize()
    law = law_fields(proposed_law(document, result), names, document.get("units", {}))
    return page.render(**law, name=name, title=title, source=result.name)


def discovery_of(source: Path) -> tuple[Path, Path | None]:
    """Result of a discovery, and its study where that is known."""
    if source.suffix != ".toml":
        study = source.parent.parent / f"{source.name.removesuffix(RESULT)}.toml"
        return source, study if source.name.endswith(RESULT) and study.is_file() else None
    from taichi_erosion.campaign.study_file import read_evidence_study
    from taichi_erosion.evidence.models.load_study import results_folder

    result = results_folder(source, read_evidence_study(source)) / f"{source.stem}{RESULT}"
    if not result.is_file():
        raise BadInput(f"{source}: has no discovery yet; `discover {source}` makes it")
    return result, source


def discovery_document(result: Path, source: Path) -> dict[str, Any]:
    """Document of a discovery. Raises BadInput for anything else."""
    try:
        document = json.loads(read_text_file(result))
        document["clues"]
    except (OSError, ValueError, KeyError, TypeError):
        raise BadInput(f"{source}: is not a result of discover (STUDY{RESULT}), nor a study") from None
    return document


def proposed_law(document: Mapping[str, Any], result: Path) -> dict[str, Any]:
    """Law of the worst misfit in a discovery. Raises BadInput where there is none."""
    laws = [clue["law"] for clue in document["clues"] if clue["law"] is not None]
    if not laws:
        raise BadInput(
            f"{result}: no law; discover fits one only where no effect of the library explains a misfit"
        )
    return laws[0]


def names_of_study(path: Path) -> NamesOfStudy:
    """What columns and observables of a study are called by effects. Raises BadInput."""
    from taichi_erosion.campaign.study_file import read_evidence_study
    from taichi_erosion.evidence.models.column_units import declared_conditions
    from taichi_erosion.scene.schema.units import parse_scale

    file = read_evidence_study(path)
    measures = {name: entry.measure or name for name, entry in file.observables.items()}
    if file.study.model is not None:
        return NamesOfStudy(dict(file.conditions), observables=measures)
    units = declared_conditions(file, path.parent)
    factors = {name: parse_scale(unit).factor for name, unit in units.items()}
    return NamesOfStudy(conditions_set(file), factors, measures, simulated=True)


def conditions_set(file: "StudyFile") -> dict[str, str]:
    """Condition of scenes that each column sets; the empty name where it sets none."""
    from taichi_erosion.evidence.models.simulator import condition_name, dotted_paths

    found = {}
    for column, paths in file.conditions.items():
        names = [name for path in dotted_paths(paths) if (name := condition_name(path)) is not None]
        found[column] = names[0] if names else ""
    return found


def law_fields(law: dict[str, Any], names: NamesOfStudy, units: Mapping[str, str]) -> dict[str, Any]:
    """Template fields of a law, in the names and SI units of effects."""
    typical: dict[str, float] = {}

    def renamed(found: re.Match[str]) -> str:
        name = condition_of(found["name"], names)
        typical[name] = float(found["typical"]) * names.factors.get(name, 1.0)
        return f"({name} / {typical[name]:g})^{found['power']}"

    formula = FACTOR.sub(renamed, law["expression"].partition(" = ")[2])
    terms = [{condition_of(name, names): power for name, power in term.items()} for term in law["terms"]]
    logarithm = f"ln {law['observable']}" in law["expression"]
    return {
        "observable": names.observables.get(law["observable"], law["observable"]),
        "formula": formula,
        "logarithm": logarithm,
        "unit": "1" if logarithm else units.get(law["observable"], "unit of the observable"),
        "share": f"{law['held_out_share']:.0%}",
        "typical": typical,
        "terms": list(zip(terms, law["coefficients"], strict=True)),
        "widest": WIDEST,
    }


def known_column(column: str, names: NamesOfStudy) -> tuple[str, float]:
    """Condition that an effect reads for a column, and the unit of the column over that of SI."""
    name = condition_of(column, names)
    return name, names.factors.get(name, 1.0)


def known_reading(observable: str, names: NamesOfStudy, document: Mapping[str, Any]) -> tuple[str, float]:
    """Measure that an instrument reads for an observable, and the study's unit over that of the measure."""
    from taichi_erosion.scene.schema.units import conversion, parse_unit

    measure = names.observables.get(observable, observable)
    if not names.simulated:
        return measure, 1.0
    unit, degrees = parse_unit(document["units"][observable]), parse_unit("deg")
    return measure, conversion(unit, degrees) or unit.factor


def condition_of(column: str, names: NamesOfStudy) -> str:
    """Condition that an effect reads for a column. Raises BadInput where there is none."""
    name = names.conditions.get(column, column)
    if not name:
        raise BadInput(
            f"the law reads the column '{column}', which sets no condition of the scene; let it set one too: "
            f'{column} = "..., conditions.{column}", which [conditions.extra] of the scene declares'
        )
    return name
