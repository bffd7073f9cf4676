"""A run in words, for terminal, page and Python: measured beside simulated, warnings, what follows.

All are made from the document of a run (`execution/result.py`).
"""

from collections import Counter
from collections.abc import Iterator, Mapping
from math import floor, hypot, isfinite, log10, nan, sqrt
from typing import Any

from taichi_erosion.evidence.words import shell_command
from taichi_erosion.evidence.words.answer_lines import Table
from taichi_erosion.evidence.words.vocabulary import in_words
from taichi_erosion.tables.number_words import count_noun, heading, plain, with_unit

Document = Mapping[str, Any]

CHANCE = 2.0  # standard errors, up to which a difference is chance [1]
LEAST_RUNS = 2  # that show a scatter
COLUMNS = ("measure", "simulated", "measured", "difference")


def with_sd_text(measure: Document, usual: int | None = None) -> str:
    """`32.91 ± 0.51 (n = 2)`, rounded to two digits of the deviation; without n where it is the usual one."""
    value, sd, n = measure.get("value"), measure.get("sd"), measure.get("n")
    if value is None or not isfinite(value):
        return "-"
    text = plain(value, 4)
    if (sd := deviation_or_zero(sd)) > 0.0:
        digits = max(0, 1 - floor(log10(sd)))
        text = f"{value:.{digits}f} \N{PLUS-MINUS SIGN} {sd:.{digits}f}"
    return text if n in (None, usual) else f"{text} (n = {n})"


def run_table(document: Document) -> Table:
    """Simulated and measured values with their difference, one row a measure."""
    simulated, measured, rows = document["measures"], document["measured"], []
    for name in dict.fromkeys((*simulated, *measured)):
        measure, datum = simulated.get(name, {}), measured.get(name, {})
        got, want = (nan if each.get("value") is None else each["value"] for each in (measure, datum))
        share = f" ({(got - want) / want:+.0%})" if want else ""
        gap = f"{got - want:+.3g}{share}" if isfinite(got - want) else "-"
        title = heading(in_words(name), measure.get("unit") or datum.get("unit") or "")
        rows.append((title, with_sd_text(measure, len(document["replicas"])), with_sd_text(datum), gap))
    return Table("", COLUMNS, tuple(rows))


def measured_value_texts(document: Document) -> Iterator[str]:
    for name, datum in document["measured"].items():
        measure, title = document["measures"].get(name, {}), in_words(name)
        if any(each["blocks"] for each in measure.get("shortfalls", ())):
            yield f"The {title} cannot be compared with the measured one: see the warning."
        elif measure.get("value") is None or not isfinite(measure["value"]):
            yield f"The {title} has no simulated value; {datum['value']:g} was measured."
        else:
            yield comparison_sentence(title, measure, datum)


def comparison_sentence(title: str, measure: Document, datum: Document) -> str:
    """`The angle of repose is 4.8 deg lower than measured: 6.1 standard errors.`"""
    gap = measure["value"] - datum["value"]
    size = with_unit(plain(abs(gap), 2), measure.get("unit", ""))
    words = f"The {title} is {size} {'lower' if gap < 0.0 else 'higher'} than measured"
    words += "".join(f" ({each['sentence'].partition(':')[0]})" for each in measure.get("shortfalls", ())[:1])
    if (measure.get("n") or 1) < LEAST_RUNS:
        sd = deviation_or_zero(datum.get("sd"))
        far = f": {abs(gap) / sd:.1f} times the measured scatter" if sd > 0.0 else ""
        return f"{words}{far}. One run shows no scatter of its own: use --replicas 3."
    errors = (deviation_or_zero(each.get("sd")) / sqrt(each.get("n") or 1) for each in (measure, datum))
    error = hypot(deviation_or_zero(measure.get("details", {}).get("shared_sd")), *errors)
    far = f"{abs(gap) / error:.1f} standard errors" if error > 0.0 else ""
    if far and abs(gap) <= CHANCE * error:
        return f"The {title} agrees with the measured one: {size} apart, {far}."
    return f"{words}: {far}." if far else f"{words}."


def deviation_or_zero(sd: float | None) -> float:
    return sd if sd is not None and isfinite(sd) else 0.0


def steady_window_texts(document: Document) -> Iterator[str]:
    """Where the window begins in which transport was steady, once for all measures that share it."""
    for measure in document["measures"].values():
        shared, lacking = measure.get("details", {}), {each["flag"] for each in measure.get("shortfalls", ())}
        if "window_start" in shared and "unsteady" not in lacking:
            start, balance = plain(shared["window_start"], 2), plain(shared["stress_over_wind"], 3)
            carried = f"air and grains together carry {balance} of the stress of the wind"
            yield f"Transport is steady from {start} s of its stage on: {carried}."


def run_warnings(document: Document) -> list[str]:
    """What the set-up lacks for its measures, and what went wrong: each once, the gravest first."""
    lacking: dict[str, list[tuple[str, Document]]] = {}
    for name, measure in document["measures"].items():
        for each in measure.get("shortfalls", ()):
            if not each["stated"]:
                lacking.setdefault(each["flag"], []).append((name, each))
    groups = sorted(lacking.values(), key=lambda group: not group[0][1]["blocks"])
    counts = Counter(line for replica in document["replicas"] for line in replica.get("warnings", ()))
    among = len(document["replicas"])
    return [
        *(f"{', '.join(in_words(name) for name, _ in alike)}: {alike[0][1]['sentence']}" for alike in groups),
        *(f"{line} ({count} of {count_noun(among, 'repeat')})" for line, count in counts.items()),
        *document.get("limits", {}).get("warnings", ()),
    ]


def run_notes(document: Document) -> Iterator[str]:
    """Limits that the scene states, notes of measures, and what its stiffness and contacts imply."""
    for name, measure in document["measures"].items():
        limits = (each["sentence"] for each in measure.get("shortfalls", ()) if each["stated"])
        yield from (f"{in_words(name)}: {sentence}" for sentence in limits)
        yield from (f"{in_words(name)}: {note}" for note in measure.get("notes", ()))
    yield from set_up_consequences(document)
    sources = {datum.get("source") for datum in document["measured"].values()}
    yield from (f"measured: {source}" for source in sources if source)


def set_up_consequences(document: Document) -> Iterator[str]:
    """What reduced stiffness, adhesion and rolling friction of a scene imply."""
    limits = document.get("limits", {})
    for word, name in (("grains", "kinds"), ("stiffness", "softening"), ("rolling friction", "rolling")):
        yield from (f"{word}: {line}" for line in limits.get(name, ()))
    if adhesion := limits.get("adhesion"):
        pull = f"{adhesion['pull_off_force']:.3g} N, {adhesion['bond_number']:.3g} weights"
        yield f"adhesion: grains pull with {pull}, and stick below {adhesion['sticking_speed']:.3g} m/s"


def cost_and_origin_text(document: Document) -> str:
    """`2 repeats in 8.5 s, 2.86e+06 grain-steps/s, scene 550ba494cbcb, seed 1`."""
    seconds, kind = document["wall_s"], "cell" if "cell_steps" in document else "grain"
    speed = document[f"{kind}_steps"] / seconds if seconds else 0.0
    repeats = count_noun(len(document["replicas"]), "repeat")
    count = f"{repeats} in {seconds:.1f} s, {speed:.3g} {kind}-steps/s"
    return f"{count}, scene {document['hash']}, seed {document['seed']}"


def step_texts(document: Document) -> Iterator[str]:
    if recording := document.get("recording"):
        view, page = shell_command("view", recording), shell_command("report", recording)
        yield f"{view} shows the run, {page} makes a page of it."
    if document["measures"] and not document.get("resolved", {}).get("measured"):
        yield "[measured] in the scene file prints a measured value beside the simulated one."
