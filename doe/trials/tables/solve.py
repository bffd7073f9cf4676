"""What the program says of a table: `study new --yes --closed-form`, then compare, discover and adopt.

The solver is given a folder with `table.csv` or `table.xlsx`, and `plain.csv`, the table as its owner writes
it after a refusal: plain headings, blank cells filled; and the options of both, a word a line (`*.txt`).
"""

import json
from math import isfinite
from pathlib import Path
from time import process_time
from typing import Any

from typer.testing import CliRunner

from taichi_erosion.cli.commands import app
from taichi_erosion.core.errors import BadInput
from taichi_erosion.evidence.answers.commands import adopt_study, compare_study, discover_study
from taichi_erosion.evidence.data.tables.rows import PLACE
from taichi_erosion.evidence.models.load_study import load_study
from taichi_erosion.evidence.record import Record
from taichi_erosion.evidence.words.part_words import agrees, naming_lowers_misfit

Answer = dict[str, Any]
LEAST, SIGNIFICANT = 1e-3, 0.01  # probability that is kept; p below which what is left is no chance
LISTS = ("named", "group", "mechanisms", "varying", "tidy", "assumed")
TEXTS = ("refused", "refused_first", "refused_scatter", "law")


def table_answer(folder: Path) -> Answer:
    """Answer of a folder; `refused` is the last refusal, `refused_first` that of the table as it is."""
    start, answer = process_time(), {"verdict": "refused", "agrees": False, "excluded": {}}
    answer |= {name: [] for name in LISTS} | dict.fromkeys(TEXTS, "")
    for file in (*folder.glob("table.[cx]*"), folder / "plain.csv"):
        study, told = new_study(file, file.with_suffix(".txt").read_text(encoding="utf-8").splitlines())
        answer |= {"file": file.stem, "refused": "" if study else told}
        if study is None:
            answer["refused_first"] = answer["refused_first"] or told
            continue
        answer |= {"assumed": told, "tidy": tidy(study)}
        try:
            answer |= answered(study)
        except BadInput as refusal:
            answer["refused_scatter"] = str(refusal)
        break
    return answer | {"seconds": process_time() - start}


def new_study(file: Path, options: list[str]) -> tuple[Path | None, Any]:
    """Path of the study that is written, and what was assumed; None and the text of a refusal."""
    order = ["study", "new", str(file), "--yes", "--closed-form", "--json", *options]
    found = CliRunner().invoke(app, order)
    if found.exit_code:
        refusal = str(found.exception) if isinstance(found.exception, BadInput) else found.output
        return None, refusal or repr(found.exception)
    document = json.loads(found.stdout)
    return Path(document["written"][0]), document["assumed"]


def tidy(study: Path) -> list[dict[str, Any]]:
    """Rows as the race takes them, in the units of the model."""
    loaded = load_study(study)
    table, places, rows = loaded.problem.measurements, loaded.file.conditions, []
    for k, name in enumerate(table.observable):
        value = float(table.limit[k] if table.censored[k] else table.value[k])
        source = "" if PLACE.fullmatch(table.source[k]) else table.source[k]
        n, place = finite(table.n[k]), f"{table.group[k]}|{source}"
        row = {"observable": name, "value": finite(value), "below": bool(table.censored[k]), "set_up": place}
        at = {places.get(c, c): float(column[k]) for c, column in table.conditions.items()}
        rows.append(row | {"sd": finite(table.sd[k]), "n": None if n is None else int(n), "at": at})
    return rows


def answered(study: Path) -> Answer:
    """Compare, discover, and adopt what is named, or the first of a group."""
    compared = compare_study(study, lambda *_: None).record
    record = discover_study(study, lambda *_: None).record
    effects, law = record.effects, record.law
    strengths = {name: effects[name].strength_range for name in record.named}
    names = record.named or record.group[:1]
    return {
        **{"agrees": agrees(compared), "p": compared.p_misfit, "p_after": record.p_misfit_after},
        **{"p_lack_of_fit": finite(compared.p_lack_of_fit), "verdict": record.verdict},
        **{"named": [*record.named], "group": [*record.group]},
        **{"mechanisms": [*record.acting_mechanisms]},
        "probabilities": {key: p for key, p in record.probabilities.items() if p > LEAST},
        "strengths": {n: [s.value, s.low, s.high] for n, s in strengths.items() if isfinite(s.value)},
        "excluded": {name: each.limit for name, each in effects.items() if each.status == "excluded"},
        **{"law": law.form if law else "", "held_out_share": law.held_out_share if law else None},
        "adopted": adopted(adopt_study(study, names, lambda *_: None).record) if names else None,
    }


def adopted(record: Record) -> Answer:
    """What adopting says: whether the error falls, and whether what is left is chance."""
    if (held := record.vault) is None or not held.n:
        return {"improves": True, "holds": True}
    left = min(held.p_after, record.p_misfit_after)
    numbers = {"before": held.chi2_per_row_before, "after": held.chi2_per_row_after, "p_after": held.p_after}
    return {"improves": naming_lowers_misfit(record), "holds": left >= SIGNIFICANT, **numbers}


def finite(number: float) -> float | None:
    """A number; None for none."""
    return float(number) if isfinite(number) else None
