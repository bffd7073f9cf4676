"""The command `effects`: the library of optional physics as a list, one effect as a page, or a new file."""

from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from taichi_erosion.cli import output
from taichi_erosion.cli.effect_files import NEW, begin_file
from taichi_erosion.cli.output import AsJson
from taichi_erosion.cli.pages import help_of
from taichi_erosion.core.errors import BadInput

if TYPE_CHECKING:
    from taichi_erosion.core.effect import Check, Effect
    from taichi_erosion.verification.effect_answers import Answer

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
    from taichi_erosion.campaign.cases import ROOT
    from taichi_erosion.campaign.signatures import read_shifts

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
    from taichi_erosion.campaign.cases import ROOT
    from taichi_erosion.verification.effect_answers import read_answers

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
