"""New effect files: from a scaffold, or from the law that a discovery proposed.

The names of a law are columns of a study's table; an effect reads conditions of scenes, or those of a model
function, so the study says which is which.
"""

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from jinja2 import Environment, PackageLoader

from taichi_erosion.core.errors import BadInput

if TYPE_CHECKING:
    from taichi_erosion.core.effect import Effect
    from taichi_erosion.evidence.record import DosePart, LawPart

NEW = "new"  # first word that requests a new file; no effect has this name
FILE_NAME = re.compile(r"[a-z][a-z0-9_]{0,59}")
PARTS = re.compile(r'at\["[^"\]\\]+"\]|params\.[a-z]\b|np\.exp|np\.maximum|[\d.]+(?:e[-+]?\d+)?')
WIDEST = 10.0  # range of a coefficient over its fitted value [1]
MOST_POINTS = 8  # of a law, at which its file is checked
ScaffoldPlace = Literal["pair", "grain", "scene", "instrument"]  # places with a scaffold
RESULT = ".discover.json"  # end of the name of a discovery's result
MEANINGS = {"a": "dose at typical conditions", "k": "scale or onset, in the unit of the condition"}


def write_effect_file(
    name: str, discovery: Path | None = None, memory: bool = False, place: ScaffoldPlace = "pair"
) -> Path:
    """Write a new effect file that fulfils the contract of effects; returns its path."""
    from taichi_erosion.effect_library import load_library

    path = Path(f"{name}.py")
    if not FILE_NAME.fullmatch(name) or name == NEW:
        allowed = "a name begins with a lower-case letter and has lower-case letters, digits and _"
        raise BadInput(f"effects new {name}: {allowed}, 60 at most")
    if name in load_library() or path.exists():
        raise BadInput(f"effects new {name}: there is an effect or a file of this name; take another one")
    blank = "stateful_effect" if memory else f"{place}_effect"
    text = law_file(name, discovery) if discovery else render(blank).replace("NAME", name)
    path.write_text(text, encoding="utf-8")
    return path


def render(kind: str, **entries: Any) -> str:
    """Text of a new effect file."""
    loader = PackageLoader("taichi_erosion.cli", "scaffold")
    environment = Environment(loader=loader, trim_blocks=True, lstrip_blocks=True, keep_trailing_newline=True)
    return environment.get_template(f"{kind}.txt").render(entries)


def law_file(name: str, source: Path) -> str:
    """Effect file of the law that a discovery found; `source` is its study or its result. Raises BadInput."""
    if source.suffix == ".toml":
        from taichi_erosion.campaign.study_file import read_evidence_study
        from taichi_erosion.evidence.models.load_study import results_folder

        result, study = results_folder(source, read_evidence_study(source)) / f"{source.stem}{RESULT}", source
    else:
        result, study = source, source.parent.parent / f"{source.name.removesuffix(RESULT)}.toml"
    if not (result.name.endswith(RESULT) and result.is_file()):
        raise BadInput(f"{source}: is not a result of discover (STUDY{RESULT}), nor a study that has one")
    title = name.replace("_", " ").capitalize()
    entries = law_entries(*read_law(result), *names_of_study(study))
    return render("mechanism_law", name=name, title=title, source=result.name, **entries)


def read_law(result: Path) -> tuple["LawPart", Sequence["DosePart"]]:
    """Law of a mechanism that a discovery found, and its doses. Raises BadInput where there is none."""
    from taichi_erosion.evidence.answers.files import read_reply
    from taichi_erosion.mechanisms.library import load_mechanisms

    reply = read_reply(result.parent, result.name.removesuffix(RESULT), "discover")
    if reply is None:
        raise BadInput(f"{result}: is of an earlier version; give discover again")
    law = reply.record.law
    if law is None:
        raise BadInput(f"{result}: no law; discover finds one only where a mechanism explains a misfit")
    if law.mechanism not in load_mechanisms():
        raise BadInput(f"{result}: the law is of {law.mechanism}, which is in the list of effects: adopt it")
    if set(PARTS.sub("", law.python)) - set(" +-*/(),"):
        raise BadInput(f"{result}: the law '{law.python}' is not one that discover writes")
    return law, reply.record.mechanisms[law.mechanism].doses


def names_of_study(path: Path) -> tuple[Mapping[str, str], Mapping[str, float]]:
    """Condition that each column of a study sets, "" for none, and units of conditions over those of SI.

    Both are empty without a study file: then names mean themselves.
    """
    if not path.is_file():
        return {}, {}
    from taichi_erosion.campaign.study_file import read_evidence_study
    from taichi_erosion.evidence.models.simulator import condition_name, dotted_paths
    from taichi_erosion.evidence.models.table_columns import declared_conditions
    from taichi_erosion.scene.schema.units import parse_scale

    file = read_evidence_study(path)
    if file.study.model is not None:
        return dict(file.conditions), {}
    units = declared_conditions(file, path.parent)
    set_by = {
        column: next(filter(None, map(condition_name, dotted_paths(paths))), "")
        for column, paths in file.conditions.items()
    }
    return set_by, {name: parse_scale(unit).factor for name, unit in units.items()}


def law_entries(
    law: "LawPart", doses: Sequence["DosePart"], set_by: Mapping[str, str], factors: Mapping[str, float]
) -> dict[str, Any]:
    """Entries of `mechanism_law.txt`. Raises BadInput for a column that sets no condition."""
    from taichi_erosion.mechanisms.library import load_mechanisms

    mechanism = load_mechanisms()[law.mechanism]
    columns = {}
    for column in law.conditions:
        if not (name := set_by.get(column, column)):
            remedy = f'{column} = "..., conditions.{column}", which [conditions.extra] of the scene declares'
            raise BadInput(f"the law reads '{column}', which sets no condition; let it set one too: {remedy}")
        columns[column] = name, factors.get(name, 1.0)
    expression = re.sub(r'at\["(\w+)"\]|params\.|np\.', r"\1", law.python)
    return {
        "mechanism": law.mechanism,
        "mechanism_title": mechanism.title,
        "expression": expression.replace("maximum", "max").replace(" ** ", "^").replace(" * ", " "),
        "python": law.python,
        "share": f"{max(law.held_out_share, 0.0):.0%}",
        "columns": columns,
        "numbers": [(key, each.value, *meaning_of(key, each.value)) for key, each in law.numbers.items()],
        "points": check_points(doses, columns, mechanism),
    }


def meaning_of(key: str, value: float) -> tuple[str, float, float]:
    """Meaning and range of one number of a law."""
    if key in ("p", "q"):
        return "exponent", -WIDEST, WIDEST
    low, high = sorted((value / WIDEST, value * WIDEST))
    return MEANINGS.get(key, "rate"), low, high


def check_points(
    parts: Sequence["DosePart"], columns: Mapping[str, tuple[str, float]], mechanism: "Effect"
) -> list[tuple[dict[str, float], float, float]]:
    """Conditions in SI units, dose of the law there, and response of a mechanism on the device, if any."""
    from taichi_erosion.core.device import start_device, stop_device
    from taichi_erosion.core.effect_probe import make_bench, probe_of
    from taichi_erosion.core.setup import Numerics
    from taichi_erosion.mechanisms.law import at_dose, device_response

    parts = parts[:: -(-len(parts) // MOST_POINTS)]
    doses, responses = [each.dose for each in parts], [0.0] * len(parts)
    if mechanism.constants is not None:
        start_device(Numerics(threads=1))
        try:
            probe = probe_of(mechanism, make_bench())
            responses = [device_response(mechanism, probe, at_dose(mechanism, dose), {}) for dose in doses]
        finally:
            stop_device()
    settings = [
        {columns[key][0]: value * columns[key][1] for key, value in each.conditions.items()} for each in parts
    ]
    return list(zip(settings, doses, responses, strict=True))
