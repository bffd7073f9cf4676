"""The command `effects`: list of the library of optional physics, page of one effect, or a new effect file.

Measured shifts and known answers are the tables in `effects/measured/`, which studies in doe/ write.
"""

import csv
from dataclasses import fields
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from taichi_erosion.cli import output
from taichi_erosion.cli.help import help_of
from taichi_erosion.cli.new_effect import NEW, ScaffoldPlace, write_effect_file
from taichi_erosion.cli.output import AsJson, EffectFiles
from taichi_erosion.core.errors import BadInput, ExitCode, did_you_mean
from taichi_erosion.evidence.words import shell_command

if TYPE_CHECKING:
    from taichi_erosion.core.effect import Check, Effect

Row = dict[str, str]  # of a table of measured shifts or known answers

SIGNIFICANT = 2.0  # shift over its standard error from which it is listed [1]
SHIFTS = ("signatures.csv", "beds.csv")
LIST_NOTES = {  # whether mechanisms are listed -> what is said below the list
    False: "A scene switches one of the first list on by [effects.NAME] strength = 1.0. A study whose model "
    'is "taichi_erosion.evidence.models.reduced:predict" (`study new --closed-form`) names those of the '
    "second under [candidates] effects. `effects NAME` describes one.",
    True: "`effects NAME --mechanisms` describes one; `discover` tries them where no effect suffices.",
}
CLOSED_FORM = "taichi_erosion.evidence.models.reduced"
SIGNS = {1: "up", -1: "down"}

app = typer.Typer()

Words = Annotated[
    list[str] | None,
    typer.Argument(metavar="NAME | new NAME", help="Effect to describe, or new file; default: all effects."),
]
Discovery = Annotated[
    Path | None,
    typer.Option(
        "--from-discovery",
        metavar="STUDY",
        help="Start the new file from the law that `discover STUDY` proposed; or its STUDY.discover.json.",
    ),
]
PlaceOf = Annotated[
    ScaffoldPlace | None,
    typer.Option("--place", help="Where the new effect acts; default: pair, a force between two grains."),
]
WithMemory = Annotated[
    bool, typer.Option("--with-memory", help="Start the new file from an effect with state per grain.")
]

Mechanisms = Annotated[
    bool, typer.Option("--mechanisms", help="Mechanisms in place of effects: where something can be missing.")
]


@app.command(**help_of("effects"))
def effects(
    words: Words = None,
    effect: EffectFiles = None,
    discovery: Discovery = None,
    place: PlaceOf = None,
    with_memory: WithMemory = False,
    mechanisms: Mechanisms = False,
    as_json: AsJson = False,
) -> None:
    """Optional physics of scenes: a list, one effect with its measured values, or a new effect file."""
    new = (words or [""])[0] == NEW
    of_new = [discovery is not None, with_memory, place is not None]
    if sum(of_new) > new:
        raise BadInput("effects: --from-discovery, --with-memory or --place, one of them, needs new NAME")
    if mechanisms and (effect or new):
        raise BadInput("effects --mechanisms: excludes --effect and new NAME")
    match words or []:
        case ["new", name]:
            path = write_effect_file(name, discovery, with_memory, place or "pair")
            typer.echo(str(path))
            typer.echo(f"{shell_command('effects', name, '--effect', path)} shows and checks it.", err=True)
        case []:
            show_library(list(asked_library(effect, mechanisms).values()), as_json, mechanisms)
        case [name]:
            library = asked_library(effect, mechanisms)
            if name in library:
                show_effect(library[name], as_json)
            else:
                show_shift(name, list(library), as_json)
        case _:
            raise BadInput(f"effects {' '.join(words or [])}: give one NAME, or new NAME")


def asked_library(effect_files: list[Path] | None, mechanisms: bool) -> "dict[str, Effect]":
    """The effects, or the mechanisms."""
    if mechanisms:
        from taichi_erosion.mechanisms.library import load_mechanisms

        return load_mechanisms()
    from taichi_erosion.effects import load_library

    return load_library(effect_files or ())


def closed_form_effects() -> dict[str, str]:
    """Names and descriptions of the effects of the closed-form model, as its studies name them."""
    from taichi_erosion.evidence.models import reduced

    return {name: " ".join((law.__doc__ or "").split()) for name, law in reduced.EFFECTS.items()}


def show_shift(name: str, library: "list[str]", as_json: bool) -> None:
    """What an effect of the closed-form model does there. Raises BadInput where neither has the name."""
    shifts = closed_form_effects()
    if name not in shifts:
        near = did_you_mean(name, [*library, *shifts])
        raise BadInput(
            f"effects {name}: is not in the library{near}; `effects` lists it: {', '.join(library)}"
        )
    if as_json:
        return output.print_json({"effects": {name: {"model": CLOSED_FORM, "description": shifts[name]}}})
    typer.echo(f"{name} is an effect of the closed-form model, not of scenes: {shifts[name]}")
    if near := did_you_mean(name, library):
        typer.echo(f"For scenes{near.removeprefix(';')}")


def show_library(library: "list[Effect]", as_json: bool, mechanisms: bool) -> None:
    """Tables of all effects of scenes and of the closed-form model, or of mechanisms; details in JSON."""
    shifts = {} if mechanisms else closed_form_effects()
    if as_json:
        measured = measured_shifts()
        listed = {effect.name: record(effect, measured) for effect in library}
        return output.print_json({"effects": listed} | ({"closed_form": shifts} if shifts else {}))
    rows = ((effect.name, effect.title, effect.place) for effect in library)
    output.print_table("", ("effect", "what it is", "acts on"), rows)
    if shifts:
        output.print_table("\nof the closed-form model", ("effect", "what it does"), shifts.items())
    typer.echo(LIST_NOTES[mechanisms])


def show_effect(effect: "Effect", as_json: bool) -> None:
    """Page of one effect: law, parameters, verification table, measured shifts."""
    from taichi_erosion.verification.effect_contract import examine

    found = examine(effect)
    checks, breaches = list(found.table), list(found.breaches)
    measured = measured_shifts()
    if as_json:
        lines = [{"claim": c.claim, "got": c.got, "want": c.want, "rtol": c.rtol} for c in checks]
        page = record(effect, measured) | {"checks": lines, "breaches": breaches}
        output.print_json({"effects": {effect.name: page}})
    else:
        print_effect(effect, checks, breaches, measured)
    if breaches:
        raise typer.Exit(ExitCode.FAILURE)


def print_effect(
    effect: "Effect", checks: "list[Check]", breaches: list[str], measured: dict[str, list[Row]]
) -> None:
    """Print the page of one effect; breaches of the contract stand at the end."""
    typer.echo((effect.doc or effect.title).strip())
    print_parameters(effect)
    rows = ((c.claim, f"{c.got:.7g}", f"{c.want:.7g}", f"{c.rtol:g}") for c in checks)
    output.print_table("verification", ("claim", "got", "want", "tolerance"), rows)
    for row in measured.get(effect.name, ()):
        case = f"{row['scene']}, {row['label'] and row['label'] + ', '}strength {row['strength']}"
        typer.echo(f"measured: {shift_text(row)} ({case}, n = {row['n']})")
    for answer in known_answers().get(effect.name, ()):
        typer.echo(f"measured: {answer}")
    for breach in breaches:
        typer.echo(f"breaks the contract: {breach}")
    typer.echo(
        "It does not keep the contract of effects." if breaches else "It keeps the contract of effects."
    )


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


def record(effect: "Effect", measured: dict[str, list[Row]]) -> dict[str, Any]:
    """JSON record of an effect."""
    from taichi_erosion.core.effect import reference

    state = fields(effect.grain_state) if effect.grain_state else ()
    return {
        "title": effect.title,
        "place": effect.place,
        "reads": list(effect.reads),
        "uncertain": dict(effect.uncertain),
        "expected": dict(effect.expected),
        "measured": measured.get(effect.name, []),
        "reference": reference(effect),
        "prior_scale": effect.prior_scale,
        "max": effect.most,
        "parameters": {f.name: {"value": f.default, **f.metadata} for f in fields(effect.params)},
        "memory": {f.name: dict(f.metadata) for f in state},
        "description": effect.doc or "",
    }


def measured_table(name: str) -> list[Row]:
    """Rows of one table of the package data in `taichi_erosion/effects/measured/`."""
    table = files("taichi_erosion.effects") / "measured" / name
    return list(csv.DictReader(table.read_text(encoding="utf-8").splitlines()))


def measured_shifts() -> dict[str, list[Row]]:
    """Measured shifts that differ significantly from 0, by effect."""
    found: dict[str, list[Row]] = {}
    for row in (row for name in SHIFTS for row in measured_table(name)):
        if abs(float(row["shift"])) > SIGNIFICANT * float(row["standard_error"]):
            found.setdefault(row["effect"], []).append(row)
    return found


def known_answers() -> dict[str, list[str]]:
    """Values of each effect in scenes with a known answer, one sentence a quantity, by effect."""
    found: dict[tuple[str, str], list[Row]] = {}
    for row in measured_table("answers.csv"):
        found.setdefault((row["effect"], row["quantity"]), []).append(row)
    sentences: dict[str, list[str]] = {}
    for (name, quantity), rows in found.items():
        sentences.setdefault(name, []).append(f"{quantity} {value_range(rows)}")
    return sentences


def value_range(rows: list[Row]) -> str:
    """`0.0292 to 0.0298` without and with; `1.1 to 1.46 (altitude [m] 1100 to 5000)` on an axis."""
    is_ratio = "over bare" in rows[0]["quantity"]
    bare, first, last = float(rows[0]["bare"]), float(rows[0]["value"]), float(rows[-1]["value"])
    if len(rows) == 1:
        return f"{first:.3g}" if is_ratio else f"{bare:.3g} to {first:.3g}"
    suffix = "" if is_ratio else f"; bare {bare:.3g}"
    axis = f"{rows[0]['axis']} {float(rows[0]['place']):g} to {float(rows[-1]['place']):g}"
    return f"{first:.3g} to {last:.3g} ({axis}{suffix})"


def shift_text(row: Row) -> str:
    """`repose_angle +2.1 +- 0.3 deg`."""
    shift, error = float(row["shift"]), float(row["standard_error"])
    unit = "" if row["unit"] == "1" else f" {row['unit']}"
    return f"{row['observable']} {shift:+.2g} \N{PLUS-MINUS SIGN} {error:.1g}{unit}"
