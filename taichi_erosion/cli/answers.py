"""Answers about studies for a terminal: sentences first, then a table, then the limits of the result."""

from collections.abc import Iterable, Iterator, Sequence
from typing import TYPE_CHECKING

import typer

from taichi_erosion.cli import next_steps, output
from taichi_erosion.cli.output import MARK_MISSING, Record, print_table
from taichi_erosion.evidence.answers.agreement_words import (
    FITTED_ERRORS,
    HELD_OUT_ERRORS,
    comparison_sentences,
)
from taichi_erosion.evidence.data.number_words import heading, plain
from taichi_erosion.evidence.inference.verdict_levels import CORRELATED, p_number

if TYPE_CHECKING:
    from taichi_erosion.evidence.data.table_units import TableUnits
    from taichi_erosion.evidence.models.load_study import StudyOptions

ANSWERS = 6  # printed probabilities
CANDIDATE_COLUMNS = ("effect", "status", "strength", "90 % interval", "probability")
CANDIDATE_COLUMNS += ("ln Bayes factor", "power", "absorbed")
MOST_ERRORS = 2  # observables whose errors are printed beside chi2
MOST_CHANGES = 5  # of one column, told one by one
ERRORS = ("rmse", "bias")  # columns in the unit of the observable
CONTROLS = {
    "with_all": "with all that was named",
    "best_wrong": "control: best other effect",
    "random_wrong": "control: effect drawn at random",
}


def print_comparison(document: Record, options: "StudyOptions") -> None:
    """Print whether the model agrees, where it fails, and the misfit of every observable."""
    print_lines(document["set_up"], "set-up: ")
    print_lines(comparison_sentences(document))
    units = units_of(document)
    rows = (
        (
            heading(name, units.value_unit(name)),
            str(misfit["n"]),
            number(misfit["chi2"]),
            *(number(units.value(name, misfit[key])) for key in ERRORS),
            MARK_MISSING if misfit["p"] is None else p_number(misfit["p"]),
        )
        for name, misfit in document["observables"].items()
    )
    print_table("calibrated model against measurement", ("observable", "rows", "chi2", *ERRORS, "p"), rows)
    typer.echo(FITTED_ERRORS)
    print_parameters(document["parameters"])
    print_correlations(document["correlations"])
    print_limits(document)
    print_lines(next_steps.after_comparison(document, options.effect_files))


def print_discovery(document: Record, options: "StudyOptions") -> None:
    """Print the verdict, the table of candidates, and the limits of the result."""
    print_lines(document["set_up"], "set-up: ")
    print_lines(document["sentences"])
    if not next_steps.waits(document):
        print_table("candidates", CANDIDATE_COLUMNS, candidate_rows(document["effects"]))
        ranked = sorted(document["probabilities"].items(), key=lambda item: -(item[1] or 0.0))[:ANSWERS]
        told = (f"{name.replace('_', ' ')} {percent(p)}" for name, p in ranked)
        typer.echo(f"probabilities: {', '.join(told)}")
    print_parameters(document["parameters"])
    print_correlations(document["correlations"])
    print_lines((clue["sentence"] for clue in document["clues"]), "clue: ")
    print_lines((experiment["sentence"] for experiment in document["next_experiments"]), "next: ")
    print_limits(document)
    print_lines(next_steps.after_discovery(document, options.effect_files))


def candidate_rows(effects: Record) -> Iterator[tuple[str, ...]]:
    """Rows of the table of candidates, in order of probability."""
    for name, found in sorted(effects.items(), key=lambda item: -(item[1]["probability"] or 0.0)):
        status = found["status"].replace("_", " ")
        if found["strength"] is None:  # nothing was weighed
            yield name, status, *[MARK_MISSING] * (len(CANDIDATE_COLUMNS) - 2)
            continue
        interval = f"{number(found['strength_low'])} to {number(found['strength_high'])}"
        evidence = percent(found["probability"]), number(found["log_bayes_factor"])
        design = percent(found["power"]), percent(found["absorption"])
        yield name, status, number(found["strength"]), interval, *evidence, *design


def print_adoption(document: Record, options: "StudyOptions") -> None:
    """Print the error before and after adoption, with two control effects."""
    print_lines(document["set_up"], "set-up: ")
    typer.echo(document["sentence"])
    print_errors(document)
    print_parameters(document["added"]["strengths"] | document["added"]["parameters"])
    print_correlations(document["added"]["correlations"])
    opened = document["vault"]["opened"]
    if opened > 1:
        typer.echo(f"note: the vault has been opened {opened} times; its rows are no longer unseen data.")
    print_lines(document["notes"], "note: ")
    print_lines(document["files"], "written: ")
    typer.echo(cost(document))
    print_lines(next_steps.after_adoption(document, options.effect_files))


def print_errors(document: Record) -> None:
    """Print chi2 per row and the error of the held-out rows of every fit of an adoption."""
    units, rows = units_of(document), []
    names = list(document["base"]["vault_rmse"])
    names = names if len(names) <= MOST_ERRORS else []

    def add(label: str, fit: Record, keys: tuple[str, str, str]) -> None:
        chi2, errors = (number(fit[key]) for key in keys[:2]), fit.get(keys[2]) or {}
        rows.append((label, *chi2, *(number(units.value(name, errors.get(name))) for name in names)))

    rungs = document.get("ladder") or []
    if rungs and rungs[0]["effects"] != document["adopted"]:
        add("as it was", rungs[0], ("chi2_per_row_fitted", "chi2_per_row_held_out", "rmse_held_out"))
    labels = {"base": "before", "added": f"with {', '.join(document['added']['effects'])}", **CONTROLS}
    for key, label in labels.items():
        if (fit := document.get(key)) is not None:
            effects = f" ({', '.join(fit['effects'])})" if key in CONTROLS else ""
            add(label + effects, fit, ("chi2_per_row", "vault_chi2_per_row", "vault_rmse"))
    columns = [heading("rmse" if len(names) == 1 else name, units.value_unit(name)) for name in names]
    title = "chi2 per row; rmse of held-out rows" if names else "chi2 per row"
    print_table(title, ("model", "fitted rows", "held-out rows", *columns), rows)
    typer.echo(HELD_OUT_ERRORS)


def print_experiments(document: Record, options: "StudyOptions") -> None:
    """Print experiments in order of information per cost."""
    print_lines(document["set_up"], "set-up: ")
    typer.echo(document["sentence"])
    for rank, experiment in enumerate(document["next_experiments"], 1):
        typer.echo(f"{rank}. {experiment['sentence']}")
    print_lines(document["notes"], "note: ")
    print_lines(next_steps.after_next(document, options.effect_files))


def print_new_study(document: Record) -> None:
    """Print what was understood, what was assumed, what was written, and what an answer costs."""
    typer.echo(f"{document['table']}: {document['form']}")
    if document["columns"]:
        rows = ((c["column"], c["unit"], c["told"]) for c in document["columns"])
        print_table("columns", ("column", "unit", "understood as"), rows)
    print_lines(document["assumed"], "assumed: ")
    print_lines(told_changes(document) if "changes" in document else ())
    print_content(document)
    print_lines(document["written"], "written: ")
    if document["written"]:
        typer.echo(f"next: {next_steps.command('compare', document['study'])}")


def told_changes(document: Record) -> Iterator[str]:
    """What a corrected table says otherwise, and what stays."""
    changes, study = document["changes"], document["study"]
    if not any(changes.values()):
        yield f"{study} is there already, and its table has not changed"
    for name, before, after in changes["units"]:
        yield f"corrected: column {name}: unit {before or 'none'} -> {after or 'none'}"
    yield from corrected_cells(changes["cells"])
    if changes["added"]:
        yield f"added: row {', '.join(map(str, dict.fromkeys(changes['added'])))}"
    yield from (f"no longer there: {row}" for row in changes["removed"])
    if any(path.endswith(next_steps.TIDY) for path in document["written"]):
        yield "the rows of before stay held out or fitted, and openings of the vault go on being counted"
        yield "answers given before rest on the earlier table: ask again"
    yield from (f"kept: {words}" for words in document["kept"])
    if document["kept"]:
        yield f"{study} stays as it is, with your changes; --anew writes it as a new study would be"


def corrected_cells(changes: Sequence[Record]) -> Iterator[str]:
    """Cells that say something else, column by column."""
    for name in dict.fromkeys(change["column"] for change in changes):
        cells = [change for change in changes if change["column"] == name]
        for cell in cells[:MOST_CHANGES]:
            before, after = (cell[key] or "empty" for key in ("before", "after"))
            yield f"corrected: row {cell['line']}, {name}: {before} -> {after}"
        if len(cells) > MOST_CHANGES:
            yield f"corrected: {name} in {len(cells) - MOST_CHANGES} rows more"


def print_check(document: Record) -> None:
    """Print that a study is valid, what it holds, and what an answer costs."""
    typer.echo(f"{document['study']}: valid; nothing was run")
    if document["kind"] == "evidence":
        print_lines(output.examined_effects(document["effects"]))
        print_content(document)
        if document["held_out"]:
            typer.echo(f"held-out rows: drawn_from = {document['drawn_from']}")


def print_content(document: Record) -> None:
    """Print rows, conditions, candidates and cost."""
    rows = ", ".join(f"{name} ({count} rows)" for name, count in document["observables"].items())
    typer.echo(f"measured: {rows}; {document['held_out']} rows are held out until an effect is adopted")
    for name, told in document["conditions"].items():
        typer.echo(f"condition {name}: {told}")
    typer.echo(f"calibrated: {', '.join(document['parameters']) or 'nothing'}")
    typer.echo(f"candidates: {', '.join(document['candidates']) or 'none'}")
    print_lines(document["notes"], "note: ")
    for name, found in document["cost"].items():
        typer.echo(cost_line(name, found))


def cost_line(name: str, found: Record) -> str:
    """What an answer costs, in one line."""
    minutes = found.get("core_minutes")
    cores = "" if minutes is None else f" ({plain(minutes)} core-minutes)"
    return f"cost with --budget {name}: {found['sentence'].rstrip('.')}{cores}"


def print_parameters(parameters: Record) -> None:
    """Print calibrated parameters with their intervals."""
    for name, fitted in parameters.items():
        bound = "; at the limit of its allowed range" if fitted["at_bound"] else ""
        remark = f"; {fitted['remark']}" if fitted.get("remark") else ""
        ends = interval(fitted["low"], fitted["high"])
        typer.echo(f"{name} = {number(fitted['value'])} ({ends}, 90 %){bound}{remark}")


def print_correlations(pairs: Sequence[Record]) -> None:
    """Print pairs of calibrated numbers of which the measurements know little but a combination."""
    for pair in pairs:
        if abs(pair["value"]) >= CORRELATED:
            words = f"{pair['first']} and {pair['second']}: correlation {pair['value']:.2f}"
            typer.echo(f"{words}; a combination of them is known better than either")


def print_limits(document: Record) -> None:
    """Print noise where it was estimated, notes, warnings and cost of a result."""
    print_lines(document.get("noise", {}).get("sentences", ()))
    print_lines([*document["notes"], *document["warnings"]], "note: ")
    typer.echo(cost(document))


def print_lines(sentences: Iterable[str], lead: str = "") -> None:
    """Print one sentence per line, without repetitions."""
    for sentence in dict.fromkeys(sentences):
        typer.echo(f"{lead}{sentence}")


def cost(document: Record) -> str:
    """Runs, wall time, seed, and the place of the results."""
    runs, seconds = document.get("runs"), document.get("wall_s")
    return f"{runs} runs in {seconds:.1f} s, seed {document['seed']}, results beside {document['study']}"


def units_of(document: Record) -> "TableUnits":
    """Units of the study's table, in which numbers are told."""
    from taichi_erosion.evidence.data.table_units import TableUnits

    return TableUnits.of(document)


def number(value: float | None) -> str:
    """Number in three significant digits."""
    return MARK_MISSING if value is None or value != value else plain(value)


def interval(low: float | None, high: float | None) -> str:
    """Both ends of an interval."""
    return MARK_MISSING if low is None or low != low else f"{number(low)} to {number(high)}"


def percent(value: float | None) -> str:
    """Share in percent."""
    return MARK_MISSING if value is None else f"{value:.1%}" if value < 0.1 else f"{value:.0%}"
