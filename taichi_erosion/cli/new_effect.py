"""New effect files: from a scaffold, or from the law that a discovery proposed.

The names of a law are columns of a study's table; an effect reads conditions of scenes, or those of a model
function, so the study says which is which.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from jinja2 import Environment, PackageLoader

from taichi_erosion.core.errors import BadInput
from taichi_erosion.evidence.words.shell import shell_command

if TYPE_CHECKING:
    from taichi_erosion.core.effect import Effect
    from taichi_erosion.evidence.race.record import LawPart

NEW = "new"  # first word that requests a new file; no effect has this name
FILE_NAME = re.compile(r"[a-z][a-z0-9_]{0,59}")
PARTS = re.compile(r'at\["[^"\]\\]+"\]|params\.[a-z]\b|np\.exp|np\.maximum|[\d.]+(?:e[-+]?\d+)?')
WIDEST = 10.0  # range of a coefficient over its fitted value [1]
MOST_POINTS = 8  # of a law, at which its file is checked
ScaffoldPlace = Literal["pair", "grain", "scene", "instrument"]  # places with a scaffold
RESULT = ".discover.json"  # end of the name of a discovery's result
MEANINGS = {"a": "dose at typical conditions", "k": "scale or onset, in the unit of the condition"}
MEANINGS |= dict.fromkeys(("p", "q"), "exponent")


@dataclass(frozen=True)
class NamesOfStudy:
    """What the names of a law mean to an effect; without a study they mean themselves."""

    conditions: Mapping[str, str] = field(default_factory=dict)  # column -> condition; "" where there is none
    factors: Mapping[str, float] = field(default_factory=dict)  # condition -> its unit over that of SI

    def condition(self, column: str) -> str:
        """Condition that an effect reads for a column. Raises BadInput where there is none."""
        if name := self.conditions.get(column, column):
            return name
        raise BadInput(
            f"the law reads the column '{column}', which sets no condition of the scene; let it set one too: "
            f'{column} = "..., conditions.{column}", which [conditions.extra] of the scene declares'
        )


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
    blank = "stateful_effect" if memory else f"{place}_effect"
    text = law_file(name, discovery) if discovery else rendered(blank).replace("NAME", name)
    path.write_text(text, encoding="utf-8")
    return path


def rendered(kind: str, **entries: Any) -> str:
    """Text of a new effect file."""
    loader = PackageLoader("taichi_erosion.cli", "scaffold")
    environment = Environment(loader=loader, trim_blocks=True, lstrip_blocks=True, keep_trailing_newline=True)
    return environment.get_template(f"{kind}.txt").render(entries)


def law_file(name: str, source: Path) -> str:
    """Effect file of the law that a discovery found; `source` is its study or its result."""
    result, study = discovery_of(source)
    entries = law_entries(found_law(result), names_of_study(study))
    title = name.replace("_", " ").capitalize()
    return rendered("mechanism_law", name=name, title=title, source=result.name, **entries)


def discovery_of(source: Path) -> tuple[Path, Path | None]:
    """Result of a discovery, and its study where that is known. Raises BadInput."""
    if source.suffix != ".toml":
        if not (source.name.endswith(RESULT) and source.is_file()):
            raise BadInput(f"{source}: is not a result of discover (STUDY{RESULT}), nor a study")
        study = source.parent.parent / f"{source.name.removesuffix(RESULT)}.toml"
        return source, study if study.is_file() else None
    from taichi_erosion.campaign.study_file import read_evidence_study
    from taichi_erosion.evidence.models.load_study import results_folder

    result = results_folder(source, read_evidence_study(source)) / f"{source.stem}{RESULT}"
    if not result.is_file():
        raise BadInput(f"{source}: has no discovery yet; {shell_command('discover', source)} makes it")
    return result, source


def found_law(result: Path) -> "LawPart":
    """Law of the dose of a mechanism that a discovery found. Raises BadInput where there is none."""
    from taichi_erosion.evidence.answers.files import read_reply
    from taichi_erosion.mechanisms.library import load_mechanisms

    reply = read_reply(result.parent, result.name.removesuffix(RESULT), "discover")
    if reply is None:
        raise BadInput(f"{result}: is of an earlier version; give discover again")
    law = reply.record.law
    if law is None:
        raise BadInput(f"{result}: no law; discover finds one only where a mechanism explains a misfit")
    if law.mechanism not in load_mechanisms():
        listed = f"the law is of the strength of {law.mechanism}, which is in the list of effects"
        raise BadInput(f"{result}: {listed}; `adopt` tests it")
    if set(PARTS.sub("", law.python)) - set(" +-*/(),"):
        raise BadInput(f"{result}: the law '{law.python}' is not one that discover writes")
    return law


def names_of_study(path: Path | None) -> NamesOfStudy:
    """What columns of a study are called by effects. Raises BadInput."""
    if path is None:
        return NamesOfStudy()
    from taichi_erosion.campaign.study_file import read_evidence_study
    from taichi_erosion.evidence.models.simulator import condition_name, dotted_paths
    from taichi_erosion.evidence.models.table_columns import declared_conditions
    from taichi_erosion.scene.schema.units import parse_scale

    file = read_evidence_study(path)
    if file.study.model is not None:
        return NamesOfStudy(dict(file.conditions))
    units = declared_conditions(file, path.parent)
    factors = {name: parse_scale(unit).factor for name, unit in units.items()}
    set_by = {
        column: next(filter(None, map(condition_name, dotted_paths(paths))), "")
        for column, paths in file.conditions.items()
    }
    return NamesOfStudy(set_by, factors)


def law_entries(law: "LawPart", names: NamesOfStudy) -> dict[str, Any]:
    """Entries of `mechanism_law.txt`."""
    from taichi_erosion.mechanisms.library import load_mechanisms

    mechanism = load_mechanisms()[law.mechanism]
    read = {column: names.condition(column) for column in law.conditions}
    columns = {column: (name, names.factors.get(name, 1.0)) for column, name in read.items()}
    written = re.sub(r'at\["(\w+)"\]|params\.|np\.', r"\1", law.python)
    return {
        "mechanism": law.mechanism,
        "mechanism_title": mechanism.title,
        "expression": written.replace("maximum", "max").replace(" ** ", "^").replace(" * ", " "),
        "python": law.python,
        "share": f"{max(law.held_out_share, 0.0):.0%}",
        "columns": columns,
        "numbers": [number_entries(key, each.value) for key, each in law.numbers.items()],
        "points": points(law, columns, mechanism),
    }


def number_entries(key: str, value: float) -> tuple[str, float, str, float, float]:
    """Name, value, meaning and range of one number of a law."""
    low, high = sorted((value / WIDEST, value * WIDEST))
    if key in ("p", "q"):
        low, high = -WIDEST, WIDEST
    return key, value, MEANINGS.get(key, "rate"), low, high


def points(
    law: "LawPart", columns: Mapping[str, tuple[str, float]], mechanism: "Effect"
) -> list[tuple[dict[str, float], float, float]]:
    """Conditions in SI units, dose of the law there, and response of a mechanism on the device."""
    chosen = law.doses[:: -(-len(law.doses) // MOST_POINTS)]
    stated = [
        {columns[column][0]: value * columns[column][1] for column, value in at.items()} for at, _ in chosen
    ]
    doses = [dose.value for _, dose in chosen]
    return list(zip(stated, doses, device_responses(mechanism, doses), strict=True))


def device_responses(mechanism: "Effect", doses: list[float]) -> list[float]:
    """What a mechanism does on the device in a typical situation at some doses; zeros for one of the host."""
    from taichi_erosion.core.device import start_device, stop_device
    from taichi_erosion.core.effect_probe import make_bench, probe_of
    from taichi_erosion.core.setup import Numerics
    from taichi_erosion.mechanisms.law import at_dose, device_response

    if mechanism.constants is None:
        return [0.0] * len(doses)
    start_device(Numerics(threads=1))
    try:
        probe = probe_of(mechanism, make_bench())
        return [device_response(mechanism, probe, at_dose(mechanism, dose), {}) for dose in doses]
    finally:
        stop_device()
