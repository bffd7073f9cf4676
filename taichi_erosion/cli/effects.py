"""The command `effects`: the library of optional physics as a list, and one effect as a page."""

from dataclasses import fields
from typing import TYPE_CHECKING, Annotated, Any

import typer

from taichi_erosion.cli import output
from taichi_erosion.core.errors import BadInput

if TYPE_CHECKING:
    from taichi_erosion.core.effect import Effect

SIGNS = {1: "up", -1: "down"}

app = typer.Typer()

Name = Annotated[str | None, typer.Argument(metavar="[NAME]", help="Effect to describe; all if left out.")]
AsJson = Annotated[bool, typer.Option("--json", help="Print one JSON document and nothing else.")]


@app.command()
def effects(name: Name = None, as_json: AsJson = False) -> None:
    """Optional physics that a scene can switch on: all of it in a list, or one effect with its numbers."""
    from taichi_erosion.effects import load_library

    library = load_library()
    if name is not None and name not in library:
        raise BadInput(f"effects {name}: is not in the library: {', '.join(library)}")
    chosen = [library[name]] if name is not None else list(library.values())
    if as_json:
        output.print_json({"effects": {effect.name: record(effect) for effect in chosen}})
    elif name is not None:
        print_effect(chosen[0])
    else:
        print_library(chosen)


def record(effect: "Effect") -> dict[str, Any]:
    """An effect as JSON can hold it."""
    return {
        "title": effect.title,
        "place": effect.place,
        "reads": list(effect.reads),
        "expected": dict(effect.expected),
        "prior_scale": effect.prior_scale,
        "max": effect.most,
        "parameters": {f.name: {"value": f.default, **f.metadata} for f in fields(effect.params)},
        "description": effect.doc or "",
    }


def print_library(library: "list[Effect]") -> None:
    """One row an effect."""
    table = output.empty_table("effects", "name", "what it is", "place", "reads", "expected to move")
    for effect in library:
        table.add_row(effect.name, effect.title, effect.place, ", ".join(effect.reads), moves(effect))
    output.print_table(table)
    typer.echo("A scene switches one on by [effects.NAME] strength = 1.0; `effects NAME` describes it.")


def print_effect(effect: "Effect") -> None:
    """The page of one effect: its law, then its numbers."""
    typer.echo((effect.doc or effect.title).strip())
    table = output.empty_table(f"effects.{effect.name}", "entry", "default", "unit", "range", "meaning")
    table.add_row("strength", "1", "1", f"0 to {effect.most:g}", "0: absent, 1: textbook")
    for f in fields(effect.params):
        about = f.metadata
        span = f"{about['low']:g} to {about['high']:g}"
        table.add_row(f.name, f"{f.default:g}", about["unit"], span, about["meaning"])
    output.print_table(table)
    if effect.reads:
        typer.echo(f"reads the conditions {', '.join(effect.reads)}")
    if effect.expected:
        typer.echo(f"expected to move {moves(effect)}")


def moves(effect: "Effect") -> str:
    """Observables that it moves, and which way."""
    return ", ".join(f"{name} {SIGNS.get(sign, '?')}" for name, sign in effect.expected.items())
