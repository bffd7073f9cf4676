"""The command `effects`: list of the library of optional physics, page of one effect, or a new effect file.

Measured shifts and known answers are the tables in `effect_library/measured/`, which studies in doe/ write.
"""

import csv
from dataclasses import fields
from importlib.resources import files
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer import Argument, Option

from taichi_erosion.cli import output
from taichi_erosion.cli.new_effect import NEW, ScaffoldPlace, write_effect_file
from taichi_erosion.cli.options import EXPLAIN, AsJson, EffectFiles, File, help_of
from taichi_erosion.core.errors import BadInput, ExitCode, did_you_mean
from taichi_erosion.evidence.words import shell_command

if TYPE_CHECKING:
    from taichi_erosion.core.effect import Effect

SIGNIFICANT = 2.0  # shift over its standard error from which it is listed [1]
SHIFTS = ("signatures.csv", "beds.csv")
SHIFT = ("observable", "bare", "shift", "standard_error", "unit", "scene", "label", "strength", "n")
ANSWER = ("quantity", "bare", "value", "axis", "place", "n", "scene")
LIST_NOTES = {  # whether mechanisms are listed -> what is said below the list
    False: "A scene switches one of the first list on by [effects.NAME] strength = 1.0. A study whose model "
    'is "taichi_erosion.evidence.models.reduced:predict" (`study new --closed-form`) names those of the '
    "second under [candidates] effects. `effects NAME` describes one.",
    True: "`effects NAME --mechanisms` describes one; `discover` tries them where no effect suffices.",
}
CLOSED_FORM = "taichi_erosion.evidence.models.reduced"
SIGNS = {1: "up", -1: "down"}

app = typer.Typer()


@app.command(**help_of("effects", EXPLAIN))
def effects(
    words: Annotated[
        list[str] | None,
        Argument(metavar="NAME | new NAME", help="Effect to describe, or new file; default: all effects."),
    ] = None,
    effect: EffectFiles = None,
    discovery: Annotated[
        File,
        Option(
            "--from-discovery",
            metavar="STUDY",
            help="Start the file from the law that `discover STUDY` proposed; or its STUDY.discover.json.",
        ),
    ] = None,
    place: Annotated[
        ScaffoldPlace | None,
        Option(help="Where the new effect acts; default: pair, a force between two grains."),
    ] = None,
    with_memory: Annotated[
        bool, Option("--with-memory", help="Start the new file from an effect with state per grain.")
    ] = False,
    mechanisms: Annotated[
        bool, Option("--mechanisms", help="Mechanisms in place of effects: where something can be missing.")
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
        show_shift(names[0], list(library), as_json)


def closed_form_effects() -> dict[str, str]:
    """Names and descriptions of the effects of the closed-form model, as its studies name them."""
    from taichi_erosion.evidence.models import reduced

    return {name: " ".join((law.__doc__ or "").split()) for name, law in reduced.EFFECTS.items()}


def show_shift(name: str, library: "list[str]", as_json: bool) -> None:
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
        listed = {effect.name: record(effect) for effect in library}
        return output.print_json({"effects": listed} | ({"closed_form": shifts} if shifts else {}))
    rows = ((effect.name, effect.title, effect.place) for effect in library)
    output.print_table("", ("effect", "what it is", "acts on"), rows)
    if shifts:
        output.print_table("\nof the closed-form model", ("effect", "what it does"), shifts.items())
    typer.echo(LIST_NOTES[mechanisms])


def show_effect(effect: "Effect", as_json: bool) -> None:
    """Page of one effect: law, parameters, verification table, measured shifts, breaches of the contract."""
    from taichi_erosion.verification.effect_contract import examine

    examination = examine(effect)
    if as_json:
        lines = [{"claim": c.claim, "got": c.got, "want": c.want, "rtol": c.rtol} for c in examination.table]
        page = record(effect) | {"checks": lines, "breaches": list(examination.breaches)}
        output.print_json({"effects": {effect.name: page}})
    else:
        typer.echo((effect.doc or effect.title).strip())
        print_parameters(effect)
        rows = ((c.claim, f"{c.got:.7g}", f"{c.want:.7g}", f"{c.rtol:g}") for c in examination.table)
        output.print_table("verification", ("claim", "got", "want", "tolerance"), rows)
        print_measured("measured shifts", SHIFT, measured_shifts(effect.name))
        print_measured("known answers", ANSWER, rows_of("answers.csv", effect.name))
        output.print_lines(examination.breaches, "breaks the contract: ")
        typer.echo(f"It {'does not keep' if examination.breaches else 'keeps'} the contract of effects.")
    if examination.breaches:
        raise typer.Exit(ExitCode.FAILURE)


def print_measured(title: str, columns: tuple[str, ...], rows: list[dict[str, str]]) -> None:
    """Print some columns of a table of measured values."""
    if rows:
        output.print_table(title, columns, ([row[name] for name in columns] for row in rows))


def print_parameters(effect: "Effect") -> None:
    """Entries of the effect in a scene file."""
    from taichi_erosion.core.effect import STRENGTH_MOST
    from taichi_erosion.verification.effect_contract import own_conditions

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
    for name in own_conditions(effect):
        typer.echo(f"a scene declares {name}: [conditions.extra] {name} = {{ unit = ..., value = ... }}")
    if effect.uncertain:
        typer.echo(f"calibrated with the strength: {', '.join(effect.uncertain)} (published values differ)")
    if effect.expected:
        directions = ", ".join(f"{name} {SIGNS.get(sign, '?')}" for name, sign in effect.expected.items())
        typer.echo(f"expected from the literature: {directions}")


def record(effect: "Effect") -> dict[str, Any]:
    """JSON record of an effect."""
    from taichi_erosion.core.effect import reference

    state = fields(effect.grain_state) if effect.grain_state else ()
    return {
        "title": effect.title,
        "place": effect.place,
        "reads": list(effect.reads),
        "uncertain": dict(effect.uncertain),
        "expected": dict(effect.expected),
        "measured": measured_shifts(effect.name),
        "reference": reference(effect),
        "prior_scale": effect.prior_scale,
        "max": effect.most,
        "parameters": {f.name: {"value": f.default, **f.metadata} for f in fields(effect.params)},
        "memory": {f.name: dict(f.metadata) for f in state},
        "description": effect.doc or "",
    }


def rows_of(table: str, effect: str) -> list[dict[str, str]]:
    """Rows of one effect in a table of the package data in `taichi_erosion/effect_library/measured/`."""
    text = (files("taichi_erosion.effect_library") / "measured" / table).read_text(encoding="utf-8")
    return [row for row in csv.DictReader(text.splitlines()) if row["effect"] == effect]


def measured_shifts(effect: str) -> list[dict[str, str]]:
    """Measured shifts of an effect that differ significantly from 0."""
    rows = (row for table in SHIFTS for row in rows_of(table, effect))
    return [row for row in rows if abs(float(row["shift"])) > SIGNIFICANT * float(row["standard_error"])]
