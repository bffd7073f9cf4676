"""The command `effects`: list of the library of optional physics, page of one effect, or a new effect file.

Measured shifts and known answers are the tables in `effect_library/measured/`, which studies in doe/ write.
"""

import csv
import re
from collections.abc import Mapping, Sequence
from dataclasses import fields
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer
from jinja2 import Environment, PackageLoader
from typer import Argument, Option

from taichi_erosion.cli import output
from taichi_erosion.cli.options import EXPLAIN, AsJson, EffectFiles, File, command_help, flag, value
from taichi_erosion.core.errors import BadInput, ExitCode, did_you_mean
from taichi_erosion.evidence.words import shell_command

if TYPE_CHECKING:
    from taichi_erosion.core.effect import Effect
    from taichi_erosion.evidence.record import DosePart, LawPart

SIGNIFICANT = 2.0  # shift over its standard error from which it is listed [1]
SHIFTS = ("signatures.csv", "beds.csv")
SHIFT = ("observable", "bare", "shift", "standard_error", "unit", "scene", "label", "strength", "n")
ANSWER = ("quantity", "bare", "value", "axis", "place", "n", "scene")
LIST_NOTES = {  # whether mechanisms are listed -> what is said below the list
    False: "A scene switches one of the first list on by [effects.NAME] strength = 1.0. A study of `study "
    "new --closed-form` names those of the second under [candidates] effects. `effects NAME` describes one.",
    True: "`effects NAME --mechanisms` describes one; `discover` tries them where no effect suffices.",
}
CLOSED_FORM = "taichi_erosion.evidence.models.reduced"
SIGNS = {1: "up", -1: "down"}

app = typer.Typer()
NEW = "new"  # first word that requests a new file; no effect has this name
FILE_NAME = re.compile(r"[a-z][a-z0-9_]{0,59}")
PARTS = re.compile(r'at\["[^"\]\\]+"\]|params\.[a-z]\b|np\.exp|np\.maximum|[\d.]+(?:e[-+]?\d+)?')
WIDEST = 10.0  # range of a coefficient over its fitted value [1]
MOST_POINTS = 8  # of a law, at which its file is checked
ScaffoldPlace = Literal["pair", "grain", "scene", "instrument"]  # places with a scaffold
RESULT = ".discover.json"  # end of the name of a discovery's result
MEANINGS = {"a": "dose at typical conditions", "k": "scale or onset, in the unit of the condition"}


@app.command(**command_help("effects", EXPLAIN))
def effects(
    words: Annotated[
        list[str] | None,
        Argument(metavar="NAME | new NAME", help="Effect to describe, or new file; default: all effects."),
    ] = None,
    effect: EffectFiles = None,
    discovery: Annotated[
        File,
        value(
            "STUDY",
            "Start the file from the law that `discover STUDY` proposed; or its STUDY.discover.json.",
            "--from-discovery",
        ),
    ] = None,
    place: Annotated[
        ScaffoldPlace | None,
        Option(help="Where the new effect acts; default: pair, a force between two grains."),
    ] = None,
    with_memory: Annotated[
        bool, flag("--with-memory", "Start the new file from an effect with state per grain.")
    ] = False,
    mechanisms: Annotated[
        bool, flag("--mechanisms", "Mechanisms in place of effects: where something can be missing.")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Optional physics of scenes: a list, one effect with its measured values, or a new effect file."""
    from taichi_erosion.effect_library import load_library
    from taichi_erosion.mechanisms.library import load_mechanisms

    new = (words or [""])[0] == NEW
    names = (words or [])[int(new) :]
    if sum((discovery is not None, with_memory, place is not None)) > new:
        raise BadInput("effects: --from-discovery, --with-memory or --place, one of them, needs new NAME")
    if mechanisms and (effect or new):
        raise BadInput("effects --mechanisms: excludes --effect and new NAME")
    if len(names) > 1 or (new and not names):
        raise BadInput(f"effects {' '.join(words or ())}: give one NAME, or new NAME")
    library = load_mechanisms() if mechanisms else load_library(effect or ())
    if new:
        path = write_effect_file(names[0], discovery, with_memory, place or "pair")
        typer.echo(str(path))
        typer.echo(f"{shell_command('effects', *names, '--effect', path)} shows and checks it.", err=True)
    elif not names:
        show_library(list(library.values()), as_json, mechanisms)
    elif names[0] in library:
        show_effect(library[names[0]], as_json)
    else:
        show_closed_form_effect(names[0], list(library), as_json)


def closed_form_effects() -> dict[str, str]:
    """Names and descriptions of the effects of the closed-form model, as its studies name them."""
    from taichi_erosion.evidence.models import reduced

    return {name: " ".join((law.__doc__ or "").split()) for name, law in reduced.EFFECTS.items()}


def show_closed_form_effect(name: str, library: "list[str]", as_json: bool) -> None:
    """What an effect of the closed-form model does there. Raises BadInput where neither has the name."""
    shifts = closed_form_effects()
    if name not in shifts:
        near = did_you_mean(name, [*library, *shifts])
        raise BadInput(f"effects {name}: is not in the library{near}; there are {', '.join(library)}")
    if as_json:
        return output.print_json({"effects": {name: {"model": CLOSED_FORM, "description": shifts[name]}}})
    typer.echo(f"{name} is an effect of the closed-form model, not of scenes: {shifts[name]}")


def show_library(library: "list[Effect]", as_json: bool, mechanisms: bool) -> None:
    """Tables of all effects of scenes and of the closed-form model, or of mechanisms; details in JSON."""
    shifts = {} if mechanisms else closed_form_effects()
    if as_json:
        listed = {effect.name: effect_record(effect) for effect in library}
        return output.print_json({"effects": listed} | ({"closed_form": shifts} if shifts else {}))
    rows = ((effect.name, effect.title, effect.place) for effect in library)
    output.print_table("", ("effect", "what it is", "acts on"), rows)
    if shifts:
        output.print_table("\nof the closed-form model", ("effect", "what it does"), shifts.items())
    typer.echo(LIST_NOTES[mechanisms])


def show_effect(effect: "Effect", as_json: bool) -> None:
    """Page of one effect: law, parameters, verification table, measured shifts, breaches of the contract."""
    from taichi_erosion.verification.effect_contract import examine_effect

    examination = examine_effect(effect)
    if as_json:
        lines = [{"claim": c.claim, "got": c.got, "want": c.want, "rtol": c.rtol} for c in examination.table]
        page = effect_record(effect) | {"checks": lines, "breaches": list(examination.breaches)}
        output.print_json({"effects": {effect.name: page}})
    else:
        typer.echo((effect.doc or effect.title).strip())
        print_parameters(effect)
        rows = ((c.claim, f"{c.got:.7g}", f"{c.want:.7g}", f"{c.rtol:g}") for c in examination.table)
        output.print_table("verification", ("claim", "got", "want", "tolerance"), rows)
        print_measured_table("measured shifts", SHIFT, measured_shifts(effect.name))
        print_measured_table("known answers", ANSWER, measured_rows("answers.csv", effect.name))
        output.print_lines(examination.breaches, "breaks the contract: ")
        typer.echo(f"It {'does not keep' if examination.breaches else 'keeps'} the contract of effects.")
    if examination.breaches:
        raise typer.Exit(ExitCode.FAILURE)


def print_measured_table(title: str, columns: tuple[str, ...], rows: list[dict[str, str]]) -> None:
    if rows:
        output.print_table(title, columns, ([row[name] for name in columns] for row in rows))


def print_parameters(effect: "Effect") -> None:
    """Entries of the effect in a scene file."""
    from taichi_erosion.core.effect import STRENGTH_MOST
    from taichi_erosion.verification.effect_contract import conditions_to_declare

    above = f"0: absent, 1: textbook; more is simulated with a warning, up to {STRENGTH_MOST:g}"
    rows = [("strength", "1", "1", f"0 to {effect.most:g}", above)]
    for f in fields(effect.params):
        span = f"{f.metadata['low']:g} to {f.metadata['high']:g}"
        rows.append((f.name, f"{f.default:g}", f.metadata["unit"], span, f.metadata["meaning"]))
    output.print_table(f"effects.{effect.name}", ("entry", "default", "unit", "range", "meaning"), rows)
    if effect.grain_state is not None:
        state = [(f.name, f.metadata["unit"], f.metadata["meaning"]) for f in fields(effect.grain_state)]
        output.print_table("state of every grain", ("number", "unit", "meaning"), state)
    if effect.reads:
        typer.echo(f"reads the conditions {', '.join(effect.reads)}")
    for name in conditions_to_declare(effect):
        typer.echo(f"a scene declares {name}: [conditions.extra] {name} = {{ unit = ..., value = ... }}")
    if effect.uncertain:
        typer.echo(f"calibrated with the strength: {', '.join(effect.uncertain)} (published values differ)")
    if effect.expected:
        directions = ", ".join(f"{name} {SIGNS.get(sign, '?')}" for name, sign in effect.expected.items())
        typer.echo(f"expected from the literature: {directions}")


def effect_record(effect: "Effect") -> dict[str, Any]:
    from taichi_erosion.core.effect import first_reference

    state = fields(effect.grain_state) if effect.grain_state else ()
    return {
        "title": effect.title,
        "place": effect.place,
        "reads": list(effect.reads),
        "uncertain": dict(effect.uncertain),
        "expected": dict(effect.expected),
        "measured": measured_shifts(effect.name),
        "reference": first_reference(effect),
        "prior_scale": effect.prior_scale,
        "max": effect.most,
        "parameters": {f.name: {"value": f.default, **f.metadata} for f in fields(effect.params)},
        "memory": {f.name: dict(f.metadata) for f in state},
        "description": effect.doc or "",
    }


def measured_rows(table: str, effect: str) -> list[dict[str, str]]:
    """Rows of one effect in a table of the package data in `taichi_erosion/effect_library/measured/`."""
    text = (files("taichi_erosion.effect_library") / "measured" / table).read_text(encoding="utf-8")
    return [row for row in csv.DictReader(text.splitlines()) if row["effect"] == effect]


def measured_shifts(effect: str) -> list[dict[str, str]]:
    """Measured shifts of an effect that differ significantly from 0."""
    rows = (row for table in SHIFTS for row in measured_rows(table, effect))
    return [row for row in rows if abs(float(row["shift"])) > SIGNIFICANT * float(row["standard_error"])]


def write_effect_file(name: str, discovery: Path | None, memory: bool, place: ScaffoldPlace) -> Path:
    """Write a new effect file that fulfils the contract of effects; returns its path."""
    from taichi_erosion.effect_library import load_library

    path = Path(f"{name}.py")
    if not FILE_NAME.fullmatch(name) or name == NEW:
        allowed = "a name begins with a lower-case letter and has lower-case letters, digits and _"
        raise BadInput(f"effects new {name}: {allowed}, 60 at most")
    if name in load_library() or path.exists():
        raise BadInput(f"effects new {name}: there is an effect or a file of this name; take another one")
    blank = "stateful_effect" if memory else f"{place}_effect"
    text = law_effect_text(name, discovery) if discovery else effect_file_text(blank).replace("NAME", name)
    path.write_text(text, encoding="utf-8")
    return path


def effect_file_text(kind: str, **entries: Any) -> str:
    loader = PackageLoader("taichi_erosion.cli", "scaffold")
    environment = Environment(loader=loader, trim_blocks=True, lstrip_blocks=True, keep_trailing_newline=True)
    return environment.get_template(f"{kind}.txt").render(entries)


def law_effect_text(name: str, source: Path) -> str:
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
    entries = law_file_entries(*read_law(result), *study_column_names(study))
    return effect_file_text("mechanism_law", name=name, title=title, source=result.name, **entries)


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


def study_column_names(path: Path) -> tuple[Mapping[str, str], Mapping[str, float]]:
    """Condition that each column of a study sets, "" for none, and units of conditions over those of SI.

    Both are empty without a study file: then names mean themselves.
    """
    if not path.is_file():
        return {}, {}
    from taichi_erosion.campaign.study_file import read_evidence_study
    from taichi_erosion.evidence.models.simulator import condition_name_of_dotted_path, dotted_paths
    from taichi_erosion.evidence.models.table_columns import declared_units_of_study
    from taichi_erosion.scene.schema.units import parse_scale

    file = read_evidence_study(path)
    if file.study.model is not None:
        return dict(file.conditions), {}
    units = declared_units_of_study(file, path.parent)
    set_by = {
        column: next(filter(None, map(condition_name_of_dotted_path, dotted_paths(paths))), "")
        for column, paths in file.conditions.items()
    }
    return set_by, {name: parse_scale(unit).factor for name, unit in units.items()}


def law_file_entries(
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
        "numbers": [(key, each.value, *number_meaning(key, each.value)) for key, each in law.numbers.items()],
        "points": law_check_points(doses, columns, mechanism),
    }


def number_meaning(key: str, value: float) -> tuple[str, float, float]:
    if key in ("p", "q"):
        return "exponent", -WIDEST, WIDEST
    low, high = sorted((value / WIDEST, value * WIDEST))
    return MEANINGS.get(key, "rate"), low, high


def law_check_points(
    parts: Sequence["DosePart"], columns: Mapping[str, tuple[str, float]], mechanism: "Effect"
) -> list[tuple[dict[str, float], float, float]]:
    """Conditions in SI units, dose of the law there, and response of a mechanism on the device, if any."""
    from taichi_erosion.core.device import start_device, stop_device
    from taichi_erosion.core.effect_probe import allocate_bench, make_probe
    from taichi_erosion.core.setup import Numerics
    from taichi_erosion.mechanisms.law import device_response, params_at

    parts = parts[:: -(-len(parts) // MOST_POINTS)]
    doses, responses = [each.dose for each in parts], [0.0] * len(parts)
    if mechanism.constants is not None:
        start_device(Numerics(threads=1))
        try:
            probe = make_probe(mechanism, allocate_bench())
            responses = [device_response(mechanism, probe, params_at(mechanism, dose), {}) for dose in doses]
        finally:
            stop_device()
    settings = [{columns[key][0]: v * columns[key][1] for key, v in p.conditions.items()} for p in parts]
    return list(zip(settings, doses, responses, strict=True))
