"""Begins a file with an effect of one's own: a pull that keeps the contract already, or a discovered law.

The pull may be one that remembers something of every grain.

The command `effects`: the library of optional physics as a list, one effect as a page, or a new file.
"""

import json
import re
from dataclasses import fields
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from jinja2 import Environment

from taichi_erosion.cli import output
from taichi_erosion.cli.help_pages import help_of
from taichi_erosion.cli.output import AsJson
from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.files import plain_text

NEW = "new"  # first word that asks for a new file, so no effect can be called so
FILE_NAME = re.compile(r"[a-z][a-z0-9_]{0,59}")
FACTOR = re.compile(r"\((?P<name>\w+) / (?P<typical>[-+.\deE]+)\)\^(?P<power>[-+.\deE]+)")
WIDEST = 10.0  # range of a coefficient over the one that was found [1]


def begin_file(name: str, discovery: Path | None = None, memory: bool = False) -> Path:
    """Write a file that keeps the contract of effects, for the user to change."""
    from taichi_erosion.effects import load_library

    path = Path(f"{name}.py")
    if not FILE_NAME.fullmatch(name) or name == NEW or name in load_library():
        raise BadInput(f"effects new {name}: give a new name of small letters, digits and _")
    if path.exists():
        raise BadInput(f"{path}: exists already")
    begun = scaffold("memory" if memory else "effect").replace("NAME", name)
    path.write_text(law_file(name, discovery) if discovery else begun)
    return path


def scaffold(kind: str) -> str:
    """Text that a new file begins with."""
    return (files("taichi_erosion.cli") / "scaffold" / f"{kind}.txt").read_text(encoding="utf-8")


def law_file(name: str, discovery: Path) -> str:
    """An effect that is the law which a discovery proposed; raises BadInput where it proposed none."""
    law = proposed_law(discovery)
    environment = Environment(trim_blocks=True, lstrip_blocks=True, keep_trailing_newline=True)
    page = environment.from_string(scaffold("law"))
    title = name.replace("_", " ").capitalize()
    return page.render(**law_words(law), name=name, title=title, source=discovery.name)


def proposed_law(discovery: Path) -> dict[str, Any]:
    """First law among the clues of a discovery's result, worst misfit first."""
    try:
        clues = json.loads(plain_text(discovery))["clues"]
    except (OSError, ValueError, KeyError, TypeError):
        raise BadInput(f"{discovery}: is not the result of a discovery (STUDY.discover.json)") from None
    laws = [clue["law"] for clue in clues if clue["law"] is not None]
    if not laws:
        raise BadInput(
            f"{discovery}: proposes no law; it does so where no effect of the library explains a misfit"
        )
    return laws[0]


def law_words(law: dict[str, Any]) -> dict[str, Any]:
    """What the scaffold needs to know of a law. Raises BadInput for a condition that no scene can state."""
    from taichi_erosion.scene.schema.scene import Conditions

    typical = {found["name"]: float(found["typical"]) for found in FACTOR.finditer(law["expression"])}
    for name in typical:
        if name not in Conditions.model_fields:
            raise BadInput(f"the law reads '{name}', which is not among the conditions of a scene")
    logarithm = f"ln {law['observable']}" in law["expression"]
    numbers = [f"term_{k + 1}" for k in range(len(law["terms"]))]
    terms = [
        term_words(powers, coefficient, typical) | {"alone": alone(numbers, k)}
        for k, (powers, coefficient) in enumerate(zip(law["terms"], law["coefficients"], strict=True))
    ]
    return {
        "observable": law["observable"],
        "left": "y exp(strength c)" if logarithm else "y + strength c",
        "formula": law["expression"].partition(" = ")[2],
        "logarithm": logarithm,
        "unit": "1" if logarithm else "unit of the observable",
        "share": f"{law['held_out_share']:.0%}",
        "conditions": ", ".join(f'"{name}"' for name in typical),
        "typical": ", ".join(f'"{name}": {value:g}' for name, value in typical.items()),
        "terms": terms,
    }


def term_words(powers: dict[str, float], coefficient: float, typical: dict[str, float]) -> dict[str, str]:
    """One term: its coefficient with a range, and its factors as code and in words."""
    factors = [f'(conditions["{name}"] / {typical[name]:g}) ** {power:g}' for name, power in powers.items()]
    words = [f"({name} / {typical[name]:g})^{power:g}" for name, power in powers.items()]
    widest = WIDEST * abs(coefficient)
    return {
        "coefficient": f"{coefficient:.6g}",
        "low": f"{-widest:.3g}",
        "high": f"{widest:.3g}",
        "words": f"coefficient of {' '.join(words)}",
        "code": " * ".join(factors),
    }


def alone(numbers: list[str], chosen: int) -> str:
    """Coefficients of a check in which one term acts alone, as code."""
    return ", ".join(f'"{name}": {0.2 if k == chosen else 0.0}' for k, name in enumerate(numbers))


if TYPE_CHECKING:
    from doe.effects.answers import Answer
    from taichi_erosion.core.effect import Check, Effect

SIGNIFICANT = 2.0  # standard errors from 0 at which a shift counts as measured [1]
SHIFTS = ("effect_signatures/signatures.csv", "effects/beds.csv")  # of doe/
SIGNS = {1: "up", -1: "down"}

app = typer.Typer()

Words = Annotated[
    list[str] | None,
    typer.Argument(metavar="NAME | new NAME", help="Effect to describe, or file to begin; all if left out."),
]
EffectFile = Annotated[
    list[Path] | None,
    typer.Option("--effect", metavar="FILE", help="Python file with an effect of your own; may be repeated."),
]
Discovery = Annotated[
    Path | None,
    typer.Option(
        "--from-discovery",
        metavar="FILE",
        help="Begin the file with the law that a discovery proposed (STUDY.discover.json).",
    ),
]
WithMemory = Annotated[
    bool,
    typer.Option("--with-memory", help="Begin the file with an effect that remembers something of grains."),
]


@app.command(**help_of("effects"))
def effects(
    words: Words = None,
    effect: EffectFile = None,
    discovery: Discovery = None,
    with_memory: WithMemory = False,
    as_json: AsJson = False,
) -> None:
    """Optional physics that a scene can switch on: all of it, one effect with its numbers, or a new file."""
    from taichi_erosion.effects import load_library

    if discovery is not None and (words or [""])[0] != NEW:
        raise BadInput("effects --from-discovery: goes with new NAME")
    if with_memory and (discovery is not None or (words or [""])[0] != NEW):
        raise BadInput("effects --with-memory: goes with new NAME, and with no discovery")
    match words or []:
        case ["new", name]:
            typer.echo(str(begin_file(name, discovery, with_memory)))
        case []:
            show_library(list(load_library(effect or ()).values()), as_json)
        case [name]:
            library = load_library(effect or ())
            if name not in library:
                raise BadInput(f"effects {name}: is not in the library: {', '.join(library)}")
            show_effect(library[name], as_json)
        case _:
            raise BadInput(f"effects {' '.join(words or [])}: give one NAME, or new NAME")


def show_library(library: "list[Effect]", as_json: bool) -> None:
    """All effects: name, place, what they move by measurement, reference."""
    measured = measured_shifts()
    if as_json:
        return output.print_json({"effects": {effect.name: record(effect, measured) for effect in library}})
    table = output.empty_table("effects", "name", "what it is", "place", "moves (measured)", "reference")
    answers = measured_answers()
    for effect in library:
        moved = [sentence(row) for row in standing(measured.get(effect.name, []))]
        words = "; ".join(moved + answers.get(effect.name, [])) or output.MARK_MISSING
        table.add_row(effect.name, effect.title, effect.place, words, first_reference(effect))
    output.print_table(table)
    typer.echo("A scene switches one on by [effects.NAME] strength = 1.0; `effects NAME` describes it.")


def show_effect(effect: "Effect", as_json: bool) -> None:
    """The page of one effect: its law, its numbers, its verification table, what it moves."""
    checks, breaches = examined(effect)
    measured = measured_shifts()
    if as_json:
        lines = [{"claim": c.claim, "got": c.got, "want": c.want, "rtol": c.rtol} for c in checks]
        page = record(effect, measured) | {"checks": lines, "breaches": breaches}
        return output.print_json({"effects": {effect.name: page}})
    typer.echo((effect.doc or effect.title).strip())
    print_parameters(effect)
    print_checks(effect, checks)
    for breach in breaches:
        typer.echo(f"breaks the contract: {breach}")
    for row in measured.get(effect.name, ()):
        typer.echo(f"measured: {sentence(row)} ({circumstances(row)})")
    for words in measured_answers().get(effect.name, ()):
        typer.echo(f"measured: {words}")


def print_parameters(effect: "Effect") -> None:
    """Entries that a scene may give."""
    table = output.empty_table(f"effects.{effect.name}", "entry", "default", "unit", "range", "meaning")
    table.add_row("strength", "1", "1", f"0 to {effect.most:g}", "0: absent, 1: textbook")
    for f in fields(effect.params):
        about = f.metadata
        span = f"{about['low']:g} to {about['high']:g}"
        table.add_row(f.name, f"{f.default:g}", about["unit"], span, about["meaning"])
    output.print_table(table)
    if effect.memory is not None:
        kept = output.empty_table("remembered of every grain", "number", "unit", "meaning")
        for f in fields(effect.memory):
            kept.add_row(f.name, f.metadata["unit"], f.metadata["meaning"])
        output.print_table(kept)
    if effect.reads:
        typer.echo(f"reads the conditions {', '.join(effect.reads)}")
    if effect.uncertain:
        typer.echo(f"calibrated with its strength, for the literature differs: {', '.join(effect.uncertain)}")
    if effect.expected:
        moved = ", ".join(f"{name} {SIGNS.get(sign, '?')}" for name, sign in effect.expected.items())
        typer.echo(f"expected by the literature: {moved}")


def print_checks(effect: "Effect", checks: "list[Check]") -> None:
    """Verification table."""
    table = output.empty_table("verification", "claim", "got", "want", "tolerance")
    for check in checks:
        table.add_row(check.claim, f"{check.got:.7g}", f"{check.want:.7g}", f"{check.rtol:g}")
    output.print_table(table)


def examined(effect: "Effect") -> "tuple[list[Check], list[str]]":
    """Verification table of an effect, and where it breaks the contract."""
    from taichi_erosion.core.device import start_device, stop_device
    from taichi_erosion.core.effect_probe import make_bench, probe_of
    from taichi_erosion.core.setup import Numerics
    from taichi_erosion.verification.effect_contract import breaches

    start_device(Numerics(threads=1))
    bench = make_bench()
    try:
        return list(effect.checks(probe_of(effect, bench))), breaches(effect, bench)
    finally:
        stop_device()


def record(effect: "Effect", measured: dict[str, list[dict[str, str]]]) -> dict[str, Any]:
    """An effect as JSON can hold it."""
    return {
        "title": effect.title,
        "place": effect.place,
        "reads": list(effect.reads),
        "uncertain": dict(effect.uncertain),
        "expected": dict(effect.expected),
        "measured": measured.get(effect.name, []),
        "reference": first_reference(effect),
        "prior_scale": effect.prior_scale,
        "max": effect.most,
        "parameters": {f.name: {"value": f.default, **f.metadata} for f in fields(effect.params)},
        "memory": {f.name: dict(f.metadata) for f in fields(effect.memory)} if effect.memory else {},
        "description": effect.doc or "",
    }


def first_reference(effect: "Effect") -> str:
    """First work that an effect's docstring names."""
    _, _, works = (effect.doc or "").partition("Reference:")
    return " ".join(works.split()).partition(";")[0].rstrip(".")


def measured_shifts() -> dict[str, list[dict[str, str]]]:
    """Rows of the tables of shifts that are told from 0, by effect; none without the tables."""
    from doe.common.cases import ROOT
    from doe.effect_signatures.shifts import read_shifts

    found: dict[str, list[dict[str, str]]] = {}
    for table in SHIFTS:
        for row in read_shifts(ROOT / "doe" / table):
            if abs(float(row["shift"])) > SIGNIFICANT * float(row["standard_error"]):
                found.setdefault(row["effect"], []).append(row)
    return found


def standing(rows: list[dict[str, str]]) -> list[dict[str, str]]:
    """Shifts of the case that stands for an effect; of its first case where none does."""
    told = [row for row in rows if not row["label"]]
    return told or [row for row in rows if row["label"] == rows[0]["label"]]


def measured_answers() -> dict[str, list[str]]:
    """What each effect did where its answer is known, in words; none without the table."""
    from doe.common.cases import ROOT
    from doe.effects.answers import read_answers

    found: dict[tuple[str, str], list[Answer]] = {}
    for answer in read_answers(ROOT / "doe" / "effects" / "answers.csv"):
        found.setdefault((answer.effect, answer.quantity), []).append(answer)
    words: dict[str, list[str]] = {}
    for (name, quantity), answers in found.items():
        words.setdefault(name, []).append(f"{quantity} {span(answers)}")
    return words


def span(answers: "list[Answer]") -> str:
    """`0.0292 to 0.0298` without and with; `1.1 to 1.46 (altitude [m] 1100 to 5000)` on an axis."""
    first, last = answers[0], answers[-1]
    ratio = "over bare" in first.quantity
    if len(answers) == 1:
        return f"{first.value:.3g}" if ratio else f"{first.bare:.3g} to {first.value:.3g}"
    bare = "" if ratio else f"; bare {first.bare:.3g}"
    axis = f"{first.axis} {first.place:g} to {last.place:g}"
    return f"{first.value:.3g} to {last.value:.3g} ({axis}{bare})"


def circumstances(row: dict[str, str]) -> str:
    """`column_collapse.toml, moisture 0.1, strength 1, n = 6`."""
    label = f"{row['label']}, " if row["label"] else ""
    return f"{row['scene']}, {label}strength {row['strength']}, n = {row['n']}"


def sentence(row: dict[str, str]) -> str:
    """`repose_angle +2.1 +- 0.3 deg`."""
    shift, error = float(row["shift"]), float(row["standard_error"])
    unit = "" if row["unit"] == "1" else f" {row['unit']}"
    return f"{row['observable']} {shift:+.2g} \N{PLUS-MINUS SIGN} {error:.1g}{unit}"
