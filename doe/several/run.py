"""Sealed cases with several effects at once or one beyond its list: draws, solves, opens, fills the page.

python -m doe.several.run draw NAME FOLDER     problems, and the truth, outside the tree; its digest here
python -m doe.several.run solve FOLDER         in processes that are given problem files only; goes on
python -m doe.several.run score NAME FOLDER COMMIT    opens the truth, writes the table
"""

import csv
import io
import json
import os
import pickle
import secrets
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from hashlib import sha256
from itertools import repeat
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
import typer

from doe.sealed.score import STRONG, share
from doe.sealed.several import KINDS, draw_several
from doe.sealed.solve import Outcome, answer_of, solve_file
from taichi_erosion.core.files import write_atomic
from taichi_erosion.report.markdown import fill_table, markdown_table

FOLDER = Path(__file__).parent
COUNTS = {  # set -> kind -> cases
    "first": {"null": 30, "single": 20, "pair": 25, "triple": 40, "quadruple": 10, "beyond": 30},
    "fresh": {"triple": 60, "quadruple": 15, "pair": 15, "null": 10, "single": 10, "beyond": 10},
    "anew": {"pair": 25, "triple": 20, "quadruple": 15, "null": 20},
}
app = typer.Typer()


def seal_file(name: str) -> Path:
    """Digest of the truth of one set."""
    return FOLDER / "seals" / f"{name}.sha256"


@app.command()
def draw(name: str, folder: Path) -> None:
    """Problems and the truth, with a salt of the operating system."""
    salt, truths, number = secrets.randbits(64), {}, 0
    (folder / "problems").mkdir(parents=True)
    for kind, count in COUNTS[name].items():
        for _ in range(count):
            case = draw_several(salt, number, kind, STRONG)
            write_atomic(folder / "problems" / f"{number:03d}.pickle", pickle.dumps(case.problem))
            truths[number] = {"kind": kind, "effects": case.truth.effects}
            number += 1
    sealed = json.dumps({"salt": salt, "truths": truths})
    write_atomic(folder / "truth.json", sealed.encode())
    write_atomic(seal_file(name), f"{sha256(sealed.encode()).hexdigest()}\n".encode())


@app.command()
def solve(folder: Path, processes: int = 2) -> None:
    """Answers of all problems that have none yet."""
    os.environ["OPENBLAS_NUM_THREADS"] = "1"  # read by the processes when they start
    problems = sorted((folder / "problems").glob("*.pickle"))
    (folder / "answers").mkdir(exist_ok=True)
    answers = [folder / "answers" / f"{path.stem}.json" for path in problems]
    with ProcessPoolExecutor(processes, mp_context=get_context("spawn")) as pool:
        list(pool.map(solve_file, problems, answers, repeat(False)))


@app.command()
def score(name: str, folder: Path, method: str) -> None:
    """The table of results, each row with the commit of the method, and the page."""
    sealed = (folder / "truth.json").read_text(encoding="utf-8")
    if sha256(sealed.encode()).hexdigest() != seal_file(name).read_text(encoding="utf-8").strip():
        raise typer.BadParameter("the truth is not the one that was sealed")
    rows = []
    for number, truth in json.loads(sealed)["truths"].items():
        file = folder / "answers" / f"{int(number):03d}.json"
        if file.exists():
            rows.append(row_of(number, truth, answer_of(file)) | {"method": method})
    page = io.StringIO()
    writer = csv.DictWriter(page, list(rows[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    write_atomic(FOLDER / "results" / f"{name}.csv", page.getvalue().encode())
    readme = FOLDER / "README.md"
    text = fill_table(readme.read_text(encoding="utf-8"), name, metrics(rows))
    write_atomic(readme, text.encode())


def row_of(number: str, truth: dict[str, Any], answer: Outcome) -> dict[str, str]:
    """Truth beside answer."""
    acting, named = truth["effects"], set(answer.named)
    dropped = [name for name in answer.dropped if name not in (*named, *answer.group)]
    held = {name: answer.strengths[name][1:] for name in acting if name in answer.strengths}
    inside = sum(low <= acting[name] <= high for name, (low, high) in held.items())
    return {
        "number": number,
        "kind": truth["kind"],
        "truth": "+".join(f"{name} {strength:.3g}" for name, strength in acting.items()),
        "verdict": answer.verdict,
        "named": "+".join(answer.named),
        "group": "+".join(answer.group),
        "dropped": "+".join(dropped),
        "exact": str(int(answer.verdict == "present" and named == set(acting))),
        "false": str(int(bool(named - set(acting)))),
        "false before": str(int(bool({*named, *dropped} - set(acting)))),
        "lost": str(int(bool(set(dropped) & set(acting)))),
        "told": str(int(bool(acting) and set(acting) <= {*named, *answer.group})),
        "intervals": str(len(held)),
        "inside": str(inside),
        "seconds": f"{answer.seconds:.3g}",
    }


def metrics(rows: Sequence[dict[str, str]]) -> str:
    """Shares of every kind with bounds of Clopper and Pearson."""
    lines = []
    for kind in KINDS:
        own = [row for row in rows if row["kind"] == kind]
        if not own:
            continue
        measures = {"a name that does not act": [row["false"] == "1" for row in own]}
        if KINDS[kind] > 1 and "dropped" in own[0]:
            measures["the same without the test"] = [row["false before"] == "1" for row in own]
            measures["a name that acts, dropped by the test"] = [row["lost"] == "1" for row in own]
        if kind != "null":
            measures["exact"] = [row["exact"] == "1" for row in own]
            measures["all that acts is told"] = [row["told"] == "1" for row in own]
        measures["not in the list"] = [row["verdict"] == "outside_library" for row in own]
        for name, hits in measures.items():
            found = share(name, hits, (">=", 0.0))
            lines.append(
                (kind, name, f"{found.value:.3f}", f"{found.low:.3f} to {found.high:.3f}", str(found.count))
            )
    inside = [k < int(row["inside"]) for row in rows for k in range(int(row["intervals"]))]
    found = share("", inside, (">=", 0.0))
    bounds = f"{found.low:.3f} to {found.high:.3f}"
    lines.append(("all", "90 % interval of a strength", f"{found.value:.3f}", bounds, str(found.count)))
    seconds = float(np.mean([float(row["seconds"]) for row in rows]))
    lines.append(("all", "seconds of one core, mean", f"{seconds:.2f}", "", str(len(rows))))
    return markdown_table(("kind", "measure", "value", "bounds", "cases"), lines)


if __name__ == "__main__":
    app()
